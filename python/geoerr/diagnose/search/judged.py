"""Candidates and probes at their best trial: gain, surprise, evidence, and what passes for more than chance."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from geoerr.diagnose.candidates import Candidate, Shapes, is_free
from geoerr.diagnose.null import surprise
from geoerr.diagnose.probes import Probe
from geoerr.diagnose.scan import Scanned, Scanner, seen
from geoerr.diagnose.space import Space
from geoerr.fit.noise_model import NoiseModel
from geoerr.fit.sightings import Numbers
from geoerr.fit.ties import first_best
from geoerr.terms import EffectReference, Term

# Family-wise: one half for the catalogue, the other for probes.
ALPHA = 0.05
# A probe has to be this much better than the best name, in the logarithm of the evidence, for there to be no name.
CLEARLY_BETTER = 3.0


@dataclass(frozen=True, eq=False)
class Judged:
    """A candidate or probe at its best trial.

    Attributes
    ----------
    what
        The candidate or probe.
    shapes, trial
        Its best form and trial value.
    gain, rank
        Fall of the sum of squares, and its degrees of freedom.
    surprise
        −ln of the chance of such a gain, trials counted: the largest over its trials.
    evidence
        Logarithm of the Bayes factor by Schwarz, trials counted.
    p_value
        Family-wise over the whole search.
    share
        What the model leaves of it; 0: not measurable with this plan.
    noise
        The noise beside it, where that was estimated anew because a drift or offsets had learnt it: there its inner
        parameters are to be found.
    is_settled
        Whether that was done.
    """

    what: Candidate | Probe
    shapes: Shapes
    trial: int
    gain: float
    rank: int
    surprise: float
    evidence: float
    p_value: float
    share: float
    noise: NoiseModel | None = None
    is_settled: bool = False


def best_of_each(
    space: Space, everything: Sequence[tuple[Candidate | Probe, Sequence[Scanned]]]
) -> list[tuple[Judged | None, float]]:
    """Give each at the trial of the most evidence, None where the model leaves nothing, and its largest surprise.

    All trials of all groups are judged in one go: there are tens of thousands of them, few in each group.
    """
    if not everything:
        return []
    groups = [(what, *one) for what, found in everything for one in zip(what.shapes, found, strict=True)]
    counts = np.array([len(one.rank) for _, _, one in groups])
    group = np.repeat(np.arange(len(groups)), counts)
    first = np.cumsum(counts) - counts
    rank = np.concatenate([one.rank for _, _, one in groups])
    gain = np.concatenate([one.gain for _, _, one in groups])
    n_ways = [
        (what.n_sets if isinstance(what, Probe) else 1) * len(what.shapes) * len(shapes.trials)
        for what, shapes, _ in groups
    ]
    n_trials = np.array([what.n_trials for what, _, _ in groups])
    n_coefficients = np.array([shapes.n_coefficients for _, shapes, _ in groups])[group]
    evidence = np.where(rank > 0, evidence_of(space, gain, rank, np.array(n_ways)[group]), -math.inf)
    surprises = np.where(rank > 0, surprise(gain, rank, n_trials[group]), -math.inf)
    result: list[tuple[Judged | None, float]] = []
    start = 0
    for what, found in everything:
        end = start + sum(len(one.rank) for one in found)
        best = start + first_best(evidence[start:end], n_coefficients[start:end])
        _, shapes, one = groups[group[best]]
        trial = best - int(first[group[best]])
        judged = Judged(
            what,
            shapes,
            trial,
            float(gain[best]),
            int(rank[best]),
            float(surprises[best]),
            float(evidence[best]),
            1.0,
            float(one.share[trial]),
        )
        result.append((judged if judged.rank > 0 else None, float(surprises[start:end].max())))
        start = end
    return result


def scanned_best(scanner: Scanner, everything: Sequence[Candidate | Probe]) -> list[tuple[Judged | None, float]]:
    """Scan everything, and give the best of each as `best_of_each` does."""
    scanned = iter(scanner.scan([shapes for what in everything for shapes in what.shapes]))
    return best_of_each(scanner.space, [(what, [next(scanned) for _ in what.shapes]) for what in everything])


def evidence_of(space: Space, gain: Numbers, rank: np.ndarray, n_trials: np.ndarray | int) -> Numbers:
    """Give the logarithm of the Bayes factor by Schwarz, for so many ways to choose from."""
    return np.asarray(0.5 * gain - 0.5 * rank * math.log(max(space.n_numbers, 2)) - np.log(np.maximum(n_trials, 1)))


def is_admissible(space: Space, scanner: Scanner, judged: Judged) -> bool:
    """Tell whether a candidate's best trial has the sign that physics gives it; few have one."""
    term = judged.shapes.term
    if not isinstance(judged.what, Candidate) or term is None:
        return True
    signs = [one.sign for one in term.coefficients]
    if not any(signs):
        return True
    own = seen(space, scanner.raw_columns(judged.shapes, judged.trial))
    values, _ = own.estimate(space)
    # Corners of an affine parameter share a coefficient: their weights add up to it.
    is_wrong = np.asarray(values.reshape(-1, len(signs)).sum(axis=0) * signs < 0.0)
    if not is_wrong.any():
        return True
    # What the data leave open may have the right sign.
    may_be_any = np.asarray(own.is_open.reshape(-1, len(signs)).any(axis=0))
    return bool(may_be_any[is_wrong].all())


def freedom_of(judged: Judged) -> int:
    """Give the number of values that a candidate is free in."""
    term = judged.shapes.term
    return judged.rank if term is None else freedom_of_term(term)


def freedom_of_term(term: Term) -> int:
    """Give the number of coefficients and free inner parameters."""
    return len(term.coefficients) + sum(is_free(one) for one in term.inner)


def price_of(judged: Judged) -> float:
    """Give what a candidate's freedom takes off its gain."""
    return 2.0 * judged.evidence - judged.gain


def first_to_pass(judged: Sequence[Judged], level: float) -> Judged | None:
    """Give the best that is neither chance at this level nor not worth its freedom."""
    return next((one for one in judged if one.p_value <= level and one.evidence > 0.0), None)


def simplest_to_pass(probes: Sequence[Judged], level: float) -> Judged | None:
    """Give the best probe that passes; one of fewer of its variables where that is hardly worse."""
    best = first_to_pass(probes, level)
    if best is None:
        return None
    near = [one for one in probes if one.p_value <= level and one.evidence >= best.evidence - CLEARLY_BETTER]
    fewer = [
        one for one in near if component_of(one) == component_of(best) and variables_of(one) < variables_of(best)
    ]
    return min(fewer, key=lambda one: len(variables_of(one)), default=best)


def reference_of(judged: Judged) -> EffectReference:
    """Give the name of a candidate."""
    assert isinstance(judged.what, Candidate)
    return judged.what.reference


def component_of(judged: Judged) -> str | None:
    """Give the axis along which a probe acts; None of a candidate."""
    return judged.what.component if isinstance(judged.what, Probe) else None


def channel_of(judged: Judged) -> str:
    """Give the channel on which a probe acts, `tool-x` or `work-x`."""
    return judged.shapes.channels[0][0]


def variables_of(judged: Judged) -> set[str]:
    """Give the variables of a probe; none of a candidate."""
    return set(judged.what.depends_on) if isinstance(judged.what, Probe) else set()
