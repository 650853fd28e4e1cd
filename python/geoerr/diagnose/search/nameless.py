"""What has no name: when a probe beats every name, and which names were only a part of it."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from geoerr.diagnose.candidates import Candidate
from geoerr.diagnose.scan import estimate
from geoerr.diagnose.search.bench import Bench
from geoerr.diagnose.search.judged import (
    CLEARLY_BETTER,
    Judged,
    component_of,
    evidence_of,
    first_to_pass,
    variables_of,
)
from geoerr.diagnose.search.look import Round, look
from geoerr.diagnose.search.rivals import Found
from geoerr.diagnose.search.settle import Settled
from geoerr.diagnose.search.uneven import Uneven, columns_along, explained_by, most_uneven
from geoerr.diagnose.where import displacement_um
from geoerr.fit.sightings import Numbers
from geoerr.machine import AXES
from geoerr.terms import HISTORY_NAMES, is_motion

# A name that explains this share of what the best probe does is the name of it, if not all of it.
_MOST_OF_IT = 0.8
# What a name and its unevenness along an axis do, of what a probe does, if that is all there is.
_NEARLY_ALL, _NEARLY_ALL_LEFT = 0.9, 0.7
# A name that does less than this share of what it does on components without an unknown is part of that.
_ELSEWHERE = 0.7
# Evidence, and share of the gain, of a curve in a candidate's own covariate: the formula is another one.
_BENT, _BENT_SHARE = 6.0, 0.02
# Variables of formulas by the names that probes have for what is nearly the same.
_PROBED_AS = {"clock": "t", "bed_x": "x", "bed_y": "y"}
_PROBED_AS |= {f"mean_v_{axis}": f"v_{axis}" for axis in AXES} | {f"t_rev_{axis}": f"s_{axis}" for axis in AXES}

# The acceleration at a picture is known from the pictures around it, not from the controller: what an effect of it
# leaves of itself is less than this share, and follows how the axis moves.
_REMAINDER = 0.3
_MOTION_OF_ALL = ("feed", "moving")


def is_a_remainder(found: Sequence[Found], settled: Settled) -> bool:
    """Tell whether a name may be no more than what a larger one, of an acceleration, leaves of itself."""
    term = settled.term
    assert term is not None
    axes = {name[-1] for name in term.variables}
    larger = (one for one in found if settled.visible_um < _REMAINDER * one.settled.visible_um)
    return all(is_motion(name, *HISTORY_NAMES) for name in term.variables) and any(
        axes <= own for one in larger if (own := _accelerated(one))
    )


def without_remainders(found: Sequence[Found], probes: Sequence[Judged]) -> tuple[Judged, ...]:
    """Give the probes that see more than what effects of an acceleration leave of themselves.

    How one axis moves goes with how the others do, and with where they are.
    """
    for one in found:
        if not _accelerated(one):
            continue
        least = _REMAINDER**2 * one.settled.gain
        part = _components_of(one.settled)
        probes = [
            probe
            for probe in probes
            if probe.gain >= least or component_of(probe) not in part or not _follows_motion(variables_of(probe))
        ]
    return tuple(probes)


def _accelerated(found: Found) -> set[str]:
    """Give the axes of whose acceleration something is an effect."""
    term = found.settled.term
    return set() if term is None else {name[-1] for name in term.variables if is_motion(name, "a")}


def _follows_motion(names: set[str]) -> bool:
    """Tell whether variables are how, and where, axes move."""
    motion = {name for name in names if is_motion(name, *HISTORY_NAMES) or name in _MOTION_OF_ALL}
    return bool(motion) and names - motion <= set(AXES)


def is_impostor(
    bench: Bench,
    best: tuple[Judged, Settled] | None,
    probe: Judged,
    added: Sequence[Numbers],
    candidates: Sequence[Candidate],
    level: float,
) -> bool:
    """Tell whether the best name only stands in for something that has none.

    It does not where it is only a little uneven. A probe of two variables may beat each of two effects that are both
    missing: two names together are tried. But where the probe follows nothing but what the name follows, and says
    more, the formula is another one, however much of it a straight line does.
    """
    if best is None:
        return True
    name, settled = best
    if _is_of_another_formula(settled, name, probe):
        return True
    if probe.evidence <= name.evidence + CLEARLY_BETTER or name.gain >= _MOST_OF_IT * probe.gain:
        return False
    if _is_only_uneven(settled, _NEARLY_ALL * probe.gain):
        return False
    space = bench.space([*added, settled.raw])
    second = first_to_pass(look(bench, space, [c for c in candidates if c is not name.what], []).candidates, level)
    evidence = name.evidence + (0.0 if second is None else second.evidence)
    return evidence < probe.evidence


def _is_of_another_formula(settled: Settled, name: Judged, probe: Judged) -> bool:
    """Tell whether a probe of just a name's own variables does what the name does, and clearly more."""
    term = settled.term
    assert term is not None
    if not _is_probe_of(probe, _as_probed(term.variables)) or component_of(probe) not in _components_of(settled):
        return False
    # An acceleration is not known exactly, and an effect of it leaves that much of itself.
    share = _REMAINDER**2 if any(is_motion(one, "a") for one in term.variables) else _BENT_SHARE
    return probe.gain - name.gain >= share * name.gain and probe.evidence - name.evidence >= _BENT


def _is_only_uneven(settled: Settled, gain: float) -> bool:
    """Tell whether an effect that may be a little uneven along an axis gains so much."""
    uneven = most_uneven(settled.space, settled)
    return uneven is not None and uneven.gain >= gain


def unevenness(
    looked: Round, found: Sequence[Found], best: Judged | None, probe: Judged
) -> tuple[Judged, Uneven] | None:
    """Give what is left of a name that is only a little off its formula: the probe that shows it, and its columns.

    No other name says more of it, and it is what the probe has found.
    """
    n_ways = len(found) * len(AXES)
    for one in found:
        uneven = most_uneven(looked.space, one.settled, is_added=True)
        if uneven is None or uneven.gain < _NEARLY_ALL_LEFT * probe.gain:
            continue
        evidence = float(evidence_of(looked.space, np.array(uneven.gain), np.array(uneven.rank), n_ways))
        if evidence < _BENT or (best is not None and evidence < best.evidence):
            continue
        own = _own(one) | {uneven.axis}
        of_it = (a for a in looked.probes if uneven.axis in variables_of(a) and _is_probe_of(a, own))
        return next((a for a in of_it if a.p_value <= probe.p_value), probe), uneven
    return None


def bent_by_its_covariate(looked: Round, best: Judged, settled: Settled) -> tuple[Judged, Numbers] | None:
    """Give the probe of a candidate's covariate where the error follows it, but not as the candidate's formula says.

    With it come columns (n, 3, k) of what follows the covariate where the candidate does, in whatever way. What the
    candidate explains times its covariate is what a formula of the second order has beyond one of the first.
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
    explained = explained_by(settled)
    bent = (explained * (values / np.abs(values).max())[:, None])[:, :, None]
    _, root, gain = estimate(space, bent)
    evidence = float(evidence_of(space, gain, np.asarray(root.shape[1]), 1))
    if evidence < _BENT or float(gain) < _BENT_SHARE * settled.gain:
        return None
    columns, _ = columns_along(explained, values)
    # What is uneven along an axis may seem bent, where it was warmer at one end.
    if _is_only_uneven(settled, settled.gain + float(estimate(space, columns)[2])):
        return None
    own = {*names, *(name for name in settled.term.variables if name in AXES)}
    of_it = (one for one in looked.probes if _is_probe_of(one, own) and set(names) <= variables_of(one))
    probe = next(of_it, None)
    return None if probe is None else (probe, np.concatenate([settled.raw, columns], axis=2))


def misnamed(found: Sequence[Found], probe: Judged) -> Found | None:
    """Give the name beside which something is left that follows nothing but the name's own variables.

    Its formula is another one, then. What a name leaves along another variable is an effect a little off its formula.
    The probe is a find by its own chance, in a look beside the name: more than its price needs no margin.
    """
    for one in found:
        is_more = probe.gain >= _BENT_SHARE * one.settled.gain and probe.evidence > 0.0
        if is_more and not acts_elsewhere(one.settled, probe) and _is_probe_of(probe, _own(one)):
            return one
    return None


def _own(found: Found) -> set[str]:
    """Give the variables of a name, as probes call them; of what turns a body, the positions that are its lever."""
    term = found.settled.term
    assert term is not None
    turns = any(
        not channel.startswith(("tool", "work", "target")) and channel[1] in "ABC_" for channel in term.channels
    )
    return _as_probed(term.variables) | (set(AXES) if turns else set())


def _as_probed(names: Iterable[str]) -> set[str]:
    return {_PROBED_AS.get(name, name) for name in names}


def _is_probe_of(judged: Judged, names: set[str]) -> bool:
    return variables_of(judged) <= names


def not_taken_back(bench: Bench, found: list[Found], unknown: Found) -> list[Found]:
    """Give the names that stand beside something without a name.

    Names on its component were parts of it where it does clearly more without them than they did; an effect whose
    formula is a little off keeps its name, and what it leaves is the unknown.
    """
    part = [one for one in found if not acts_elsewhere(one.settled, unknown.judged)]
    if not part:
        return found
    others = [one for one in found if one not in part]
    space = bench.space([one.settled.raw for one in others])
    _, _, of_names = estimate(space, np.concatenate([one.settled.raw for one in part], axis=2))
    _, _, of_unknown = estimate(space, unknown.settled.raw)
    if float(of_names) >= _MOST_OF_IT * float(of_unknown):
        return found
    is_only_uneven = len(part) == 1 and _is_only_uneven(part[0].settled, _NEARLY_ALL * float(of_unknown))
    return found if is_only_uneven else others


def acts_elsewhere(settled: Settled, unknown: Judged) -> bool:
    """Tell whether a name acts on other components than something without a name, of which it would be a part."""
    return component_of(unknown) not in _components_of(settled)


def _components_of(settled: Settled) -> set[str]:
    """Give the components on which a name does a good part of what it does."""
    energy = (displacement_um(settled.space, settled.displacement) ** 2).sum(axis=0)
    return {axis for axis, own in zip(AXES, energy, strict=True) if own >= (1.0 - _ELSEWHERE) * energy.sum()}
