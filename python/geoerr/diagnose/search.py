"""The search: candidates and probes judged together, the best added, until chance explains what is left."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from geoerr.diagnose.candidates import Candidate, Formulas, Shapes, candidates_of, is_free
from geoerr.diagnose.functions import Functions
from geoerr.diagnose.held_out_after import HeldOutAfter
from geoerr.diagnose.noise import NoiseModel, NoiseSums, without_drift
from geoerr.diagnose.null import N_DRAWS, Null, largest_surprise, surprise
from geoerr.diagnose.probes import Probe, bodies, probes_of, shapes_on
from geoerr.diagnose.scan import Scanned, Scanner, all_channels, estimate, off_model
from geoerr.diagnose.space import Channels, Space, beyond, noise_sums, orthonormal, whitened_space
from geoerr.diagnose.waves_in_time import WavesInTime
from geoerr.diagnose.where import displacement_um
from geoerr.effects.collection import Catalogue
from geoerr.fit.fitted import Fitted
from geoerr.fit.held_out import projected_rows
from geoerr.fit.sightings import Numbers
from geoerr.machine import AXES
from geoerr.terms import Parameter, Term

_SEED = 19_820_601
# A wave in time that is less of a surprise is chance's, whatever its evidence: others surprise more in every search.
_LEAST_OF_HUM = 3.0
# Family-wise: one half for the catalogue, the other for probes.
ALPHA = 0.05
MOST_EFFECTS = 6
# Every further look is another chance to be wrong: beside what was found, this share of the level.
_FURTHER = 0.2
# A probe has to be this much better than the best name, in the logarithm of the evidence, for there to be no name.
_IMPOSTOR = 3.0
# A name that explains this share of what the best probe does is the name of it, if not all of it.
_MOST_OF_IT = 0.8
# Functions of time, which a drift can swallow, are judged with the drift estimated anew: so many of the best, and
# such as would be a surprise if nothing drifted.
_MOST_LIKE_DRIFT, _LEAST_SURPRISE = 4, 8.0
# How many names at most are tried in place of a probe that beats each of them alone.
_MOST_INSTEAD = 2
# A name that does less than this share of what it does on components without an unknown is part of that.
_ELSEWHERE = 0.7
# Alike so far, an error of a formula of a seventh would decide between the two; with more freedom it is no rival, it
# contains it.
_TOO_ALIKE = 0.99
# Logarithm of the evidence that a function of time needs beside a drift that is estimated anew: of drifts alone the
# largest was 10.
_LEAST_BESIDE_DRIFT = 12.5
# That was of so many functions of time; with more of them chance has more to choose from.
_FEW_LIKE_DRIFT = 10.0
# A drift that moves the mean of a block by less than this share of its scatter (variances) hides nothing.
_STRONG_DRIFT = 1.0
# Evidence, and share of the gain, of a curve in a candidate's own covariate: the formula is another one.
_BENT, _BENT_SHARE = 6.0, 0.02
# Variables of formulas by the names that probes have for what is nearly the same.
_PROBED_AS = {"clock": "t", "bed_x": "x", "bed_y": "y"}
_PROBED_AS |= {f"mean_v_{axis}": f"v_{axis}" for axis in AXES} | {f"t_rev_{axis}": f"s_{axis}" for axis in AXES}
# Less sure than this, a name has to help where the fit did not see the data.
_SURE = 1e-3
# Vuong's statistic below this, and a correlation above that: not told apart (one in twenty, one-sided).
_VUONG, _LEAST_CORRELATION = 1.64, 0.5
TIED_CORRELATION = 0.95
# Falls of the sum of squares that differ by less than 6 are e^3 in likelihood, which is little; by 20, decided.
_LEAST_DIFFERENCE, _MOST_DIFFERENCE = 6.0, 20.0
# Refinement of an inner parameter: points between two trials, so many times.
_REFINED, _REFINEMENTS = 17, 3
# Candidates that are looked at closely.
_CLOSELY = 12


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


@dataclass(frozen=True, eq=False)
class Settled:
    """A candidate with its inner parameters refined: values, standard errors, columns.

    Attributes
    ----------
    term
        With values and standard errors.
    shapes
        At one trial.
    gain
        Fall of the sum of squares.
    raw : (n, 3, k)
        Columns in units of the stated uncertainties: coefficients, then inner derivatives.
    displacement : (n, 3)
        What it explains, whitened, off the model.
    visible_um
        Root mean square of what it explains beyond the model.
    """

    term: Term | None
    shapes: Shapes
    gain: float
    raw: Numbers
    displacement: Numbers
    visible_um: float


class Bench:
    """A fit, the effects added so far, and the space that they leave."""

    def __init__(self, fitted: Fitted, functions: Functions, *, names: Sequence[str], threads: int = 0) -> None:
        self.fitted, self.functions, self.names, self.threads = fitted, functions, tuple(names), threads
        solved = fitted.solved
        scale = solved.used.astype(np.float64)
        raw = projected_rows(fitted.problem, solved.state, solved.solution.covariance_root, scale, threads)
        self.rows = (fitted.sightings.is_measured & solved.used[:, None]).astype(np.float64)
        flat = orthonormal(raw.reshape(-1, raw.shape[2]), threads=threads)
        self.base = flat.reshape(*self.rows.shape, -1)
        self.channels = Channels(fitted, self.rows, threads=threads)
        self.channels.need(self.names)
        self.noise: NoiseModel | None = None
        self._last_sums: tuple[tuple[Numbers, ...], NoiseSums] | None = None
        self.waves = WavesInTime(fitted.sightings, [f"{body}-{axis}" for body in bodies(fitted) for axis in AXES])

    def scanner(self, space: Space, *, n_draws: int = N_DRAWS) -> Scanner:
        """Give a space in the form in which the core multiplies it."""
        return Scanner(space, self.channels, self.functions, names=self.names, n_draws=n_draws, threads=self.threads)

    @cached_property
    def held_out(self) -> HeldOutAfter:
        """The held-out error with more in the model."""
        return HeldOutAfter(self.fitted, self.base, self.rows)

    @cached_property
    def _base_sums(self) -> NoiseSums:
        return noise_sums(self.fitted, self.rows, self.base, threads=self.threads)

    def sums(self, added: Sequence[Numbers]) -> NoiseSums:
        """Give what the likelihood of the noise depends on, with the model and what was added in its basis."""
        if not added:
            return self._base_sums
        if self._last_sums is None or not _are_the_same(self._last_sums[0], added):
            self._last_sums = tuple(added), self._sums_with(added)
        return self._last_sums[1]

    def _sums_with(self, added: Sequence[Numbers]) -> NoiseSums:
        columns = np.concatenate(added, axis=2)
        new = beyond(self.base.reshape(-1, self.base.shape[2]), columns.reshape(-1, columns.shape[2]))
        return self._base_sums.with_columns(new.reshape(*self.rows.shape, -1))

    def space(self, added: Sequence[Numbers]) -> Space:
        """Give the space that the model and what was added leave, the noise estimated anew."""
        sums = self.sums(added)
        self.noise = sums.fit(start=self.noise)
        return whitened_space(self.fitted, self.noise, self.rows, sums)


def _are_the_same(first: Sequence[Numbers], second: Sequence[Numbers]) -> bool:
    return len(first) == len(second) and all(a is b for a, b in zip(first, second, strict=True))


@dataclass(frozen=True, eq=False)
class Round:
    """One look at everything: all candidates and probes against what a model leaves.

    Attributes
    ----------
    space, scanner
        What was left.
    candidates, probes
        Best first, by evidence; of candidates those that can be seen.
    invisible
        Candidates of which the model leaves nothing.
    null
        What chance finds among the candidates.
    overall
        What chance finds among candidates and probes together.
    """

    space: Space
    scanner: Scanner
    candidates: tuple[Judged, ...]
    probes: tuple[Judged, ...]
    invisible: tuple[Candidate, ...]
    null: Null
    overall: Null

    @property
    def p_value(self) -> float:
        """That nothing is missing, for all that was looked at, before any gate: uniform where nothing is."""
        return self.overall.p_value(
            max((one.surprise for one in (*self.candidates, *self.probes)), default=-math.inf)
        )


def look(bench: Bench, space: Space, candidates: Sequence[Candidate], probes: Sequence[Probe]) -> Round:
    """Judge every candidate and probe."""
    everything: list[Candidate | Probe] = [*candidates, *probes]
    scanner = bench.scanner(space)
    scanned = iter(scanner.scan([shapes for what in everything for shapes in what.shapes]))
    judged: list[list[Judged]] = []
    nulls: list[Null] = []
    invisible: list[Candidate] = []
    groups: tuple[Sequence[Candidate | Probe], ...] = (candidates, probes)
    for group in groups:
        found = [(what, [next(scanned) for _ in what.shapes]) for what in group]
        best = _best(space, found)
        invisible += [
            what for what, (one, _) in zip(group, best, strict=True) if one is None and isinstance(what, Candidate)
        ]
        # As for a draw of noise the largest over all trials, not that of the best one.
        own = [replace(one, surprise=most) for one, most in best if one is not None]
        of_draws = [
            (one.largest, what.n_trials)
            for (what, of_shapes), (top, _) in zip(found, best, strict=True)
            if top is not None
            for one in of_shapes
        ]
        largest = largest_surprise(of_draws, scanner.n_draws)
        if group is probes:
            waves, drawn = hums(bench, space, scanner)
            own, largest = [*waves, *own], np.maximum(largest, drawn)
        null = Null(largest)
        nulls.append(null)
        own = [
            replace(one, p_value=null.p_value(one.surprise))
            for one in own
            if one.evidence <= 0.0 or _is_admissible(space, scanner, one)
        ]
        # Of equals the one with the least freedom: with more of it, it says the same.
        judged.append(sorted(own, key=lambda one: (-round(one.evidence, 6), _freedom(one))))
    return Round(space, scanner, tuple(judged[0]), tuple(judged[1]), tuple(invisible), nulls[0], _together(nulls))


def hums(bench: Bench, space: Space, scanner: Scanner) -> tuple[list[Judged], Numbers]:
    """Judge waves in time: the best of each channel, and what chance finds in as many searches, (n_draws,).

    That some frequency has a surprise above s has a chance of e^-s at most: so it is drawn.
    """
    found = []
    waves = list(bench.waves.look(space, bench.channels)) if scanner.n_draws else []
    for wave in waves:
        if wave.surprise < _LEAST_OF_HUM:
            continue
        codes = [bench.functions.given(column) for column in wave.columns]
        shapes = shapes_on(wave.channel, [codes], [(wave.frequency,)])
        probe = Probe(wave.channel[-1], ("t",), (shapes,), 1, "hum")
        judged, _ = _best(space, [(probe, [scanner.exact(shapes)])])[0]
        if judged is not None:
            evidence = judged.evidence - math.log(wave.n_trials)
            found.append(replace(judged, surprise=wave.surprise, evidence=evidence))
    drawn = np.random.default_rng(_SEED).exponential(size=(max(len(waves), 1), scanner.n_draws))
    return found, np.max(drawn, axis=0) if waves else np.full(scanner.n_draws, -math.inf)


def _together(nulls: Sequence[Null]) -> Null:
    return Null(np.max([one.largest for one in nulls], axis=0))


def beside_drift(bench: Bench, looked: Round, added: Sequence[Numbers]) -> Round:
    """Judge functions of time by the likelihood with the drift estimated anew under each of them.

    A drift that was estimated without a jump has learnt the jump, and leaves nothing of it. So has one that is strong
    what follows a temperature.
    """
    is_strong = _drift_to_scatter(looked.space) > _STRONG_DRIFT
    like = [one for one in looked.candidates if _is_of_time(one.what) or (is_strong and _is_slow(one.what))]
    if not like:
        return looked
    least = _LEAST_BESIDE_DRIFT + math.log(max(len(like) / _FEW_LIKE_DRIFT, 1.0))
    sums = bench.sums(added)
    calm = whitened_space(bench.fitted, without_drift(looked.space.noise, sums.weights), bench.rows, sums)
    scanner = bench.scanner(calm, n_draws=0)
    scanned = iter(scanner.scan([shapes for one in like for shapes in one.what.shapes]))
    tops = _best(calm, [(one.what, [next(scanned) for _ in one.what.shapes]) for one in like])
    clear = sorted((one for one, _ in tops if one and one.surprise > _LEAST_SURPRISE), key=lambda one: -one.evidence)
    if not clear:
        return looked
    without = sums.fit(restricted=False, start=bench.noise).log_likelihood
    judged = {id(one.what): one for one in looked.candidates}
    for one in clear[:_MOST_LIKE_DRIFT]:
        # A drift forgives no jump at the wrong moment: the time is found first.
        single = settle(calm, scanner, one).shapes
        columns = scanner.raw_columns(single, 0)
        with_it = bench.sums([*added, columns]).fit(restricted=False, start=bench.noise).log_likelihood
        gain = max(2.0 * (with_it - without), 0.0)
        found = float(surprise(np.array([gain]), one.rank, one.what.n_trials)[0])
        n_ways = len(one.what.shapes) * len(one.shapes.trials)
        evidence = float(_evidence(looked.space, np.array([gain]), np.array([one.rank]), n_ways)[0])
        if evidence > max(judged[id(one.what)].evidence, least):
            judged[id(one.what)] = replace(
                one,
                shapes=single,
                trial=0,
                gain=gain,
                surprise=found,
                evidence=evidence,
                p_value=looked.null.p_value(found),
            )
    return replace(looked, candidates=tuple(sorted(judged.values(), key=lambda one: -one.evidence)))


def _drift_to_scatter(space: Space) -> float:
    """Give the variance of the drift over that of the mean of a block of rows, the largest of all components."""
    return float((space.noise.drift**2 * space.rows.sum(axis=0)).max()) / len(space.noise.blocks)


def _is_slow(what: Candidate | Probe) -> bool:
    return isinstance(what, Candidate) and what.reference.covariate is not None


def _is_of_time(what: Candidate | Probe) -> bool:
    return any(shapes.term is not None and shapes.term.is_of_time for shapes in what.shapes)


def _best(
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
    evidence = np.where(rank > 0, _evidence(space, gain, rank, np.array(n_ways)[group]), -math.inf)
    surprises = np.where(rank > 0, surprise(gain, rank, n_trials[group]), -math.inf)
    result: list[tuple[Judged | None, float]] = []
    start = 0
    for what, found in everything:
        end = start + sum(len(one.rank) for one in found)
        best = start + int(np.argmax(evidence[start:end]))
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


def _is_admissible(space: Space, scanner: Scanner, judged: Judged) -> bool:
    """Tell whether a candidate's best trial has the sign that physics gives it; few have one."""
    term = judged.shapes.term
    if not isinstance(judged.what, Candidate) or term is None:
        return True
    specs = judged.what.effect.coefficients
    signs = [
        next((s.sign for s in specs if one.name == s.name or one.name.startswith(f"{s.name}_")), 0)
        for one in term.coefficients
    ]
    if not any(signs):
        return True
    values, _, _ = estimate(space, scanner.raw_columns(judged.shapes, judged.trial))
    # Corners of an affine parameter share a coefficient: their weights add up to it.
    values = values.reshape(-1, len(signs)).sum(axis=0)
    return bool((values * signs >= 0.0).all())


def _evidence(space: Space, gain: Numbers, rank: np.ndarray, n_trials: np.ndarray | int) -> Numbers:
    return np.asarray(0.5 * gain - 0.5 * rank * math.log(max(space.n_numbers, 2)) - np.log(np.maximum(n_trials, 1)))


def settle(space: Space, scanner: Scanner, judged: Judged, *, refinements: int = _REFINEMENTS) -> Settled:
    """Refine the inner parameters of a candidate, and give its values with standard errors."""
    shapes = judged.shapes
    if shapes.term is None:
        raw = scanner.raw_columns(shapes, judged.trial)
        coefficients, _, gain = estimate(space, raw)
        displacement = off_model(space, raw) @ coefficients
        return Settled(None, shapes, float(gain), raw, displacement, visible_um(space, displacement))
    term = shapes.term
    formulas = Formulas(scanner.functions, term)
    inner = list(shapes.trials[judged.trial])
    single = replace(shapes, columns=formulas.columns, n_coefficients=len(term.coefficients), corners=({},))
    free = [place for place, one in enumerate(term.inner) if is_free(one)]

    def at(trials: Sequence[Sequence[float]]) -> Shapes:
        codes = np.array([formulas.codes(trial) for trial in trials], dtype=np.int64)
        return replace(single, trials=tuple(tuple(trial) for trial in trials), codes=codes)

    bounds = {place: _neighbours(shapes, judged.trial, place) for place in free}
    for _ in range(refinements):
        for place in free:
            low, high = bounds[place]
            if not low < high:
                continue
            points = _between(term.inner[place], low, high)
            trials = [[*inner[:place], value, *inner[place + 1 :]] for value in points]
            best = int(np.argmax(scanner.exact(at(trials)).gain))
            inner[place] = points[best]
            bounds[place] = (points[max(best - 1, 0)], points[min(best + 1, len(points) - 1)])
    single = at([inner])
    raw = scanner.raw_columns(single, 0)
    coefficients, _, gain = estimate(space, raw)
    parts = [raw]
    for place in free:
        low, high = _range(term.inner[place])
        step = 1e-4 * (abs(inner[place]) if term.inner[place].spacing == "log" else high - low)
        sides = at([[*inner[:place], inner[place] + sign * step, *inner[place + 1 :]] for sign in (1.0, -1.0)])
        up, down = (scanner.raw_columns(sides, side) @ coefficients for side in (0, 1))
        parts.append(((up - down) / (2.0 * step))[:, :, None])
    joined = np.concatenate(parts, axis=2)
    beyond = off_model(space, joined).reshape(-1, joined.shape[2])
    size = np.sqrt(np.maximum((beyond**2).sum(axis=0), 1e-300))
    covariance = np.linalg.pinv(beyond.T @ beyond / np.outer(size, size), rcond=1e-9) / np.outer(size, size)
    std = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    k = len(coefficients)
    inner_std = np.zeros(len(inner))
    inner_std[free] = std[k:]
    valued = term.with_values(
        coefficients.tolist(), inner, coefficients_std=std[:k].tolist(), inner_std=inner_std.tolist()
    )
    displacement = (beyond[:, :k] @ coefficients).reshape(space.residual.shape)
    return Settled(valued, single, float(gain), joined, displacement, visible_um(space, displacement))


def _range(parameter: Parameter) -> tuple[float, float]:
    assert parameter.low is not None
    assert parameter.high is not None
    return parameter.low, parameter.high


def _neighbours(shapes: Shapes, trial: int, place: int) -> tuple[float, float]:
    """Give the trial values on both sides of one; the whole range of a parameter that was not tried."""
    assert shapes.term is not None
    tried = sorted({values[place] for values in shapes.trials})
    if len(tried) == 1:
        return _range(shapes.term.inner[place])
    at = tried.index(shapes.trials[trial][place])
    return tried[max(at - 1, 0)], tried[min(at + 1, len(tried) - 1)]


def _between(parameter: Parameter, low: float, high: float) -> list[float]:
    spaced = np.geomspace if parameter.spacing == "log" else np.linspace
    return [float(value) for value in spaced(low, high, _REFINED)]


def visible_um(space: Space, displacement: Numbers) -> float:
    """Give the root mean square of a whitened displacement (n, 3) in µm, components summed as for errors."""
    stated = space.noise.unwhiten(displacement)
    mm = np.einsum("nij,nj->ni", space.fitted.sightings.unwhitening, stated)
    count = np.maximum(space.rows.sum(axis=0), 1.0)
    return 1e3 * float(np.sqrt(((mm**2 * space.rows).sum(axis=0) / count).sum()))


def correlation(first: Settled, other: Judged, scanner: Scanner) -> float:
    """Give the share, as a cosine, of what one candidate explains that another could have explained."""
    columns = scanner.columns(other.shapes, other.trial)
    own = orthonormal(columns.reshape(-1, columns.shape[2]))
    flat = first.displacement.reshape(-1)
    size = float(np.linalg.norm(flat))
    return float(np.linalg.norm(own.T @ flat)) / size if size > 0.0 else 0.0


def vuong(space: Space, first: Numbers, second: Numbers) -> float:
    """Give Vuong's statistic by pass: how surely the first displacement (n, 3) is the better of two."""
    difference = (space.residual - second) ** 2 - (space.residual - first) ** 2
    by_pass = np.bincount(space.pass_number, weights=difference.sum(axis=1), minlength=space.n_passes)
    spread = float(np.sqrt(((by_pass - by_pass.mean()) ** 2).sum()))
    return float(by_pass.sum()) / spread if spread > 0.0 else 0.0


@dataclass(frozen=True, eq=False)
class Rival:
    """A candidate beside the best: how alike they are, and whether these data tell them apart.

    Attributes
    ----------
    judged, settled
        The candidate.
    correlation
        Share, as a cosine, of what the best explains that this one could have explained.
    is_tied
        Whether these data do not tell them apart.
    contains
        Whether it says what the best says, with more freedom: no rival, but the best written otherwise.
    """

    judged: Judged
    settled: Settled
    correlation: float
    is_tied: bool
    contains: bool


def rivals_of(looked: Round, first: Judged, best: Settled, others: Sequence[Judged]) -> list[Rival]:
    """Look closely at the next best candidates."""
    found = []
    for other in others[:_CLOSELY]:
        alike = correlation(best, other, looked.scanner)
        is_far = best.gain - other.gain > 4.0 * _MOST_DIFFERENCE and best.gain > 2.0 * other.gain
        settled = _unrefined(looked, other) if is_far else settle(looked.space, looked.scanner, other)
        # In twice the logarithm of the evidence: what has more freedom has to earn it.
        difference = best.gain - settled.gain + _price(first) - _price(other)
        z = vuong(looked.space, best.displacement, settled.displacement)
        is_near = difference < _LEAST_DIFFERENCE or (difference < _MOST_DIFFERENCE and z < _VUONG)
        contains = alike > _TOO_ALIKE and _freedom(other) > _freedom(first) and difference > 0.0
        tied = not contains and (alike > _TOO_ALIKE or (alike > _LEAST_CORRELATION and is_near))
        found.append(Rival(other, settled, alike, tied, contains))
    return found


def _price(judged: Judged) -> float:
    """Give what a candidate's freedom takes off its gain."""
    return 2.0 * judged.evidence - judged.gain


def _freedom(judged: Judged) -> int:
    """Give the number of values that a candidate is free in."""
    term = judged.shapes.term
    return judged.rank if term is None else len(term.coefficients) + sum(is_free(one) for one in term.inner)


def _unrefined(looked: Round, judged: Judged) -> Settled:
    """Give a candidate as the trial found it: for one that is far behind the digits do not matter."""
    if judged.shapes.term is None:
        return settle(looked.space, looked.scanner, judged)
    return settle(looked.space, looked.scanner, judged, refinements=0)


@dataclass(frozen=True, eq=False)
class Found:
    """An effect that the search added.

    Attributes
    ----------
    judged, settled
        The effect.
    rivals
        What came next.
    looked
        The look that found it.
    """

    judged: Judged
    settled: Settled
    rivals: tuple[Rival, ...]
    looked: Round


@dataclass(frozen=True, eq=False)
class Searched:
    """What the search found.

    Attributes
    ----------
    bench
        The fit, and what it is multiplied with.
    first
        The look at the model as it was.
    last
        The look after all that was added.
    found
        Effects in the order in which they were added.
    unknown
        The probe that no candidate matches, with what it is worth; None where there is none.
    not_offered
        Effects that the data cannot carry, and why.
    """

    bench: Bench
    first: Round
    last: Round
    found: tuple[Found, ...]
    unknown: tuple[Judged, Settled] | None
    not_offered: tuple[tuple[str, str], ...]


def search(fitted: Fitted, known: Catalogue, *, present: Sequence[str] = (), threads: int = 0) -> Searched:
    """Add what is missing, best first, until chance explains what is left.

    Where a probe beats every name, and two names together, there is something without a name: its columns are set
    aside, and the search goes on for names on other components.

    Parameters
    ----------
    present
        Ids of terms that the model has besides those of the fit.
    """
    candidates, not_offered, functions = candidates_of(fitted, known, present)
    probes = probes_of(fitted, functions)
    everything: list[Candidate | Probe] = [*candidates, *probes]
    names = all_channels([shapes for what in everything for shapes in what.shapes])
    bench = Bench(fitted, functions, names=names, threads=threads)
    found: list[Found] = []
    unknown: tuple[Judged, Settled] | None = None
    first: Round | None = None
    while True:
        aside = [] if unknown is None else [unknown[1].raw]
        added = [*aside, *(one.settled.raw for one in found)]
        looked = beside_drift(bench, look(bench, bench.space(added), candidates, probes), added)
        first = first or looked
        level = 0.5 * ALPHA * (_FURTHER if found or unknown is not None else 1.0)
        best = _passed(looked.candidates, level)
        probe = _simplest(looked.probes, level) if unknown is None else None
        if probe is not None and _is_impostor(bench, looked, best, probe, added, candidates, level):
            misnamed = _misnamed(found, probe)
            if misnamed is not None:
                found = [one for one in found if one is not misnamed]
                looked = look(bench, bench.space([one.settled.raw for one in found]), [], probes)
                probe = _simplest(looked.probes, level) or probe
            unknown = (probe, settle(looked.space, looked.scanner, probe))
            found = _not_taken_back(bench, found, unknown)
            continue
        if best is None or len(found) >= MOST_EFFECTS:
            break
        settled = settle(looked.space, looked.scanner, best)
        if not _helps(bench, settled, best, added):
            candidates = [one for one in candidates if one is not best.what]
            continue
        bent = _bent_by_its_covariate(looked, best, settled) if unknown is None else None
        if bent is not None:
            unknown = (bent, settle(looked.space, looked.scanner, bent))
            continue
        if unknown is not None and not _acts_elsewhere(looked.space, settled, unknown[0]):
            break
        others = [one for one in looked.candidates if one is not best]
        found.append(Found(best, settled, tuple(rivals_of(looked, best, settled, others)), looked))
        found = _without_superfluous(bench, found, aside)
        taken = {id(one.judged.what) for one in found}
        candidates = [one for one in candidates if id(one) not in taken]
    return Searched(bench, first, looked, tuple(found), unknown, tuple(not_offered))


def _is_impostor(
    bench: Bench,
    looked: Round,
    best: Judged | None,
    probe: Judged,
    added: Sequence[Numbers],
    candidates: Sequence[Candidate],
    level: float,
) -> bool:
    """Tell whether the best name only stands in for something that has none.

    A probe of two variables may beat each of two effects that are both missing: so many names together are tried.
    """
    if best is None:
        return True
    if probe.evidence <= best.evidence + _IMPOSTOR or best.gain >= _MOST_OF_IT * probe.gain:
        return False
    evidence, named, one = best.evidence, [], best
    for _ in range(_MOST_INSTEAD - 1):
        named.append(settle(looked.space, looked.scanner, one).raw)
        looked = look(bench, bench.space([*added, *named]), [c for c in candidates if c is not one.what], [])
        following = _passed(looked.candidates, level)
        if following is None:
            break
        evidence, one = evidence + following.evidence, following
    return evidence < probe.evidence


def _bent_by_its_covariate(looked: Round, best: Judged, settled: Settled) -> Judged | None:
    """Give the probe of a candidate's covariate where the error follows it, but not as the candidate's formula says.

    What the candidate explains times its covariate is what a formula of the second order has beyond one of the first.
    """
    if not isinstance(best.what, Candidate) or best.what.reference.covariate is None or settled.term is None:
        return None
    sightings = looked.space.fitted.sightings
    names = best.what.reference.covariate.split("-")
    if not set(names) <= set(sightings.covariate_columns):
        return None
    values = sightings.numbers(names[0]) - (sightings.numbers(names[1]) if len(names) > 1 else 0.0)
    values = np.nan_to_num(values - np.nanmean(values))
    if not values.any():
        return None
    space = looked.space.with_columns(looked.space.noise.whiten(settled.raw))
    explained = settled.raw[:, :, : len(settled.term.coefficients)] @ [one.value for one in settled.term.coefficients]
    bent = (explained * (values / np.abs(values).max())[:, None])[:, :, None]
    _, root, gain = estimate(space, bent)
    evidence = float(_evidence(space, gain, np.asarray(root.shape[1]), 1))
    if evidence < _BENT or float(gain) < _BENT_SHARE * settled.gain:
        return None
    own = {*names, *(name for name in settled.term.variables if name in AXES)}
    return next((one for one in looked.probes if _is_probe_of(one, own) and set(names) <= _depends_on(one)), None)


def _misnamed(found: Sequence[Found], probe: Judged) -> Found | None:
    """Give the name beside which something is left that follows nothing but the name's own variables.

    Its formula is another one, then. What a name leaves along another variable is an effect a little off its formula.
    """
    for one in found:
        is_more = probe.gain >= _BENT_SHARE * one.settled.gain and probe.evidence >= _BENT
        if is_more and not _acts_elsewhere(one.looked.space, one.settled, probe) and _is_probe_of(probe, _own(one)):
            return one
    return None


def _own(found: Found) -> set[str]:
    """Give the variables of a name, as probes call them; of what turns a body, the positions that are its lever."""
    term = found.settled.term
    assert term is not None
    names = {_PROBED_AS.get(name, name) for name in term.variables}
    turns = any(
        not channel.startswith(("tool", "work", "target")) and channel[1] in "ABC_" for channel in term.channels
    )
    return names | (set(AXES) if turns else set())


def _is_probe_of(judged: Judged, names: set[str]) -> bool:
    return _depends_on(judged) <= names


def _component(judged: Judged) -> str | None:
    return judged.what.component if isinstance(judged.what, Probe) else None


def _depends_on(judged: Judged) -> set[str]:
    return set(judged.what.depends_on) if isinstance(judged.what, Probe) else set()


def _not_taken_back(bench: Bench, found: list[Found], unknown: tuple[Judged, Settled]) -> list[Found]:
    """Give the names that stand beside something without a name.

    Names on its component were parts of it where it does clearly more without them than they did; an effect whose
    formula is a little off keeps its name, and what it leaves is the unknown.
    """
    part = [one for one in found if not _acts_elsewhere(one.looked.space, one.settled, unknown[0])]
    if not part:
        return found
    others = [one for one in found if one not in part]
    space = bench.space([one.settled.raw for one in others])
    _, _, of_names = estimate(space, np.concatenate([one.settled.raw for one in part], axis=2))
    _, _, of_unknown = estimate(space, unknown[1].raw)
    return others if float(of_names) < _MOST_OF_IT * float(of_unknown) else found


def _helps(bench: Bench, settled: Settled, best: Judged, added: Sequence[Numbers]) -> bool:
    """Tell whether a name that is only just sure lowers the held-out error."""
    if best.p_value < _SURE:
        return True
    before, after = bench.held_out.um(added), bench.held_out.um([*added, settled.raw])
    return before is None or after is None or after < before


def _acts_elsewhere(space: Space, settled: Settled, unknown: Judged) -> bool:
    """Tell whether a name acts on other components than something without a name, of which it would be a part."""
    assert isinstance(unknown.what, Probe)
    energy = (displacement_um(space, settled.displacement) ** 2).sum(axis=0)
    return float(energy[AXES.index(unknown.what.component)]) < (1.0 - _ELSEWHERE) * float(energy.sum())


def _passed(judged: Sequence[Judged], level: float) -> Judged | None:
    """Give the best that is neither chance at this level nor not worth its freedom."""
    return next((one for one in judged if one.p_value <= level and one.evidence > 0.0), None)


def _simplest(probes: Sequence[Judged], level: float) -> Judged | None:
    """Give the best probe that passes; one of fewer of its variables where that is hardly worse."""
    best = _passed(probes, level)
    if best is None:
        return None
    near = [one for one in probes if one.p_value <= level and one.evidence >= best.evidence - _IMPOSTOR]
    fewer = [one for one in near if _component(one) == _component(best) and _depends_on(one) < _depends_on(best)]
    return min(fewer, key=lambda one: len(_depends_on(one)), default=best)


def _without_superfluous(bench: Bench, found: list[Found], aside: list[Numbers]) -> list[Found]:
    """Drop an earlier effect that a later one makes superfluous."""
    for place in range(len(found) - 1):
        others = [*aside, *(one.settled.raw for number, one in enumerate(found) if number != place)]
        space = bench.space(others)
        one = found[place]
        scanned = bench.scanner(space).exact(one.settled.shapes)
        if float(_evidence(space, scanned.gain, scanned.rank, one.judged.what.n_trials)[0]) <= 0.0:
            return [other for number, other in enumerate(found) if number != place]
    return found
