"""The causes that a circular test is searched for, with the trial values of their inner parameters.

Formulas are the catalogue's. Of the smooth classic errors a circle sees the lowest orders only: their functions here
are the first that centre, radius, squareness and scale do not hold.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from geoerr.diagnose.circles.fast_waves import fast_waves
from geoerr.diagnose.circles.runs import Runs
from geoerr.effects import Effect
from geoerr.effects.collection import Catalogue
from geoerr.effects.effect import DEFAULT_TIME_RANGE_S
from geoerr.errors import InputFileError
from geoerr.fit.sightings import Numbers
from geoerr.fit.variables import clock_s, clock_span_s
from geoerr.machine import Machine
from geoerr.terms import EffectReference, Parameter, Part, Term

# In this order: of two that explain the same, the one that is named first is the one that shops find more often.
_OF_PAIRS = ("squareness", "scale-mismatch", "servo-mismatch", "radial-shrink", "change-over")
_OF_ONE = ("scale", "lag")
_OF_AXES = (
    *("backlash", "backlash-position", "lateral-play", "straightness", "pitch-error", "reversal-spike"),
    *("reversal-windup", "stick-slip", "periodic", "screw-wobble", "vibration", "lost-steps"),
)
_OTHERS = ("spiral",)
# What these need besides the radius.
_NEED_TIMES = (
    "servo-mismatch",
    "lag",
    "radial-shrink",
    "reversal-spike",
    "stick-slip",
    "vibration",
    "lost-steps",
    "spiral",
)
# Effects that die away behind a reversal.
DECAYS = ("reversal-spike", "reversal-windup", "stick-slip")
# Phases of a vibration have nothing to do with the start of a run.
BY_RUN = ("vibration",)
# A vibration is searched down to this many rows of the fastest run; a wave of an axis to fewer, at mean spacing:
# beside its reversals they lie closer.
_ROWS_OF_A_SHAKE, _ROWS_OF_A_WAVE = 2.05, 1.25
# Longer waves than this share of the radius are curves: straightness, or an uneven scale.
_LONGEST_WAVE = 0.45
# Vibration has so many waves a turn at least.
_LEAST_WAVES = 12.0
# Trial values of waves lie so close that the phase at the ends of the data differs by a quarter turn at most.
_PHASE_STEP = 0.3
_MOST_WAVES = 700
_N_DECAYS = 9
_JUMPS_OF_A_TURN = 72
_JUMP_FROM_END = 0.05
# The low orders of a guideway's shape, and of positioning, in words.
_SHAPES = {"h": "bow", "s": "S-shape"}
_MIDDLES = {"h": "middle", "s": "S-shape"}
# Their functions, across an axis and along it. A circle sees of the S that of sin 4θ, or of cos 4θ: nothing of it is
# squareness, or a scale, and that of the other axis is the same.
_BENT, _UNEVEN = ("(1 - u^2)", "(u^3 - u/2)"), ("(1 - u^2)", "(u^3 - u)")

_WHY_NOT = {
    "radius-change": "the radius of every set-up is free: it is told beside the causes",
    "centre-offset": "the centre of every set-up is free: it is told beside the causes",
    "scale": "the radius is free: one plane sees only the difference of two scales, offered as scale-mismatch",
    "lag": "a circle sees only the difference of two axes' lags: offered as servo-mismatch",
    "angular": "one circle at one tool length cannot tell it from scale, squareness and straightness: measure lines "
    "with targets at two offsets",
    "angular-reversal": "at one tool length it looks like backlash or lateral play: measure targets at two offsets",
    "gantry-racking": "at one place across it looks like backlash or lateral play: measure at two places across",
    "acceleration": "offered as radial-shrink: of the other sign, a circle that grows with the feed",
}
_TIMES = "needs the feed, or times: state feed (mm/min) or t (s)"
_ELSEWHERE = "not among the causes that a circular test alone is diagnosed for: measure points"


@dataclass(frozen=True, eq=False)
class Way:
    """One way to write a cause: a term, and trial values (n_trials, n_inner) of its inner parameters."""

    term: Term
    trials: tuple[tuple[float, ...], ...]
    is_by_run: bool = False


@dataclass(frozen=True, eq=False)
class Suspect:
    """An effect of an axis or a pair, with the ways to write it."""

    reference: EffectReference
    effect: Effect
    ways: tuple[Way, ...]

    @property
    def n_trials(self) -> int:
        """Number of ways to write it, trial values counted."""
        return sum(len(way.trials) for way in self.ways)


def suspects_of(
    runs: Runs, known: Catalogue, own: Sequence[Effect] = ()
) -> tuple[list[Suspect], list[tuple[str, str]]]:
    """Give all causes that the runs can carry, and effects that are not offered, with the reason.

    Parameters
    ----------
    own
        A user's effects, beside the catalogue's causes.
    """
    taken = {term.id for term in runs.fitted.terms}
    why_not: dict[str, str] = {}
    found: list[Suspect] = []
    for name, axis in _named(runs):
        found += _suspect(runs, known[name], axis, why_not)
    for effect in own:
        found += _own(runs, effect, why_not)
    offered = {one.reference.effect for one in found}
    for effect in known:
        if effect.id not in offered:
            why_not.setdefault(effect.id, _WHY_NOT.get(effect.id, _ELSEWHERE))
    return [one for one in found if str(one.reference) not in taken], list(why_not.items())


def _named(runs: Runs) -> list[tuple[str, str | None]]:
    """Give every cause with every axis or pair that it may be of."""
    pairs = [pair for pair in ("xy", "xz", "yz") if any(set(pair) == set(plane) for plane in runs.planes)]
    # In one plane the scale of either axis, and its lag, are their mismatch.
    singles = [(name, axis) for name in _OF_ONE for axis in runs.axes] if len(runs.planes) > 1 else []
    return [
        *((name, pair) for name in _OF_PAIRS for pair in pairs),
        *singles,
        *((name, axis) for name in _OF_AXES for axis in runs.axes),
        *((name, None) for name in _OTHERS),
    ]


def _suspect(runs: Runs, effect: Effect, axis: str | None, why_not: dict[str, str]) -> list[Suspect]:
    if effect.id in _NEED_TIMES and not runs.has_times:
        why_not[effect.id] = _TIMES
        return []
    terms = [_within_reach(runs, term) for term in _terms(runs, effect, axis)]
    ways = [Way(term, _trials(runs, term), effect.id in BY_RUN) for term in terms]
    ways = [way for way in ways if way.trials]
    if not ways:
        why_not[effect.id if axis is None else f"{effect.id}:{axis}"] = "the rows are too far apart to see it"
        return []
    return [Suspect(EffectReference(effect.id, axis), effect, tuple(ways))]


def _own(runs: Runs, effect: Effect, why_not: dict[str, str]) -> list[Suspect]:
    """Give the suspects of a user's own effect."""
    machine, columns = runs.fitted.machine, runs.fitted.sightings.effect_columns
    wanting = effect.wanting(columns, is_circular=True)
    if effect.again is not None:
        wanting = f"stands beside {effect.again} only, and is looked for among measured points"
    if wanting is not None:
        why_not[effect.id] = wanting
        return []
    found = []
    for reference in effect.candidates(machine, columns, is_circular=True):
        try:
            terms = [
                effect.term(reference.axis, reference.covariate, machine, form=form.name) for form in effect.forms
            ]
        except InputFileError as error:
            why_not[effect.id] = str(error)
            continue
        found.append(Suspect(reference, effect, tuple(Way(term, _trials(runs, term)) for term in terms)))
    return found


def _terms(runs: Runs, effect: Effect, axis: str | None) -> list[Term]:
    machine = runs.fitted.machine
    if effect.id == "straightness":
        return [_straightness(runs, effect, axis or "", orders) for orders in ("h", "hs")]
    if effect.id == "pitch-error":
        return [_pitch(runs, effect, axis or "", orders) for orders in ("h", "hs")]
    if effect.id == "radial-shrink":
        return [_shrink(effect, axis or "", machine)]
    if effect.id == "reversal-spike":
        return [effect.term(axis, None, machine), _spike_in_travel(effect, axis or "")]
    span = clock_span_s(runs.fitted.sightings) or DEFAULT_TIME_RANGE_S
    return [effect.term(axis, None, machine, form=form.name, time_range_s=span) for form in effect.forms]


def _straightness(runs: Runs, effect: Effect, axis: str, orders: str) -> Term:
    """Give bow (`h`: how far the middle of the circle's diameter stands out) and S (`s`) across an axis."""
    across = [other for other in runs.axes if other != axis and _share_a_plane(runs, axis, other)]
    parts, coefficients = [], []
    for other in across:
        names = [f"{order}_{other}" for order in orders]
        channel = f"E{other.upper()}{axis.upper()}"
        parts.append(Part(channel, _low_orders(names, _BENT), _relative(runs, axis)))
        coefficients += [
            Parameter(name, "mm", what=f"{_SHAPES[order]} along {other}")
            for name, order in zip(names, orders, strict=True)
        ]
    return _classic(effect, axis, tuple(parts), tuple(coefficients))


def _pitch(runs: Runs, effect: Effect, axis: str, orders: str) -> Term:
    """Give the same shapes along the axis: a scale that changes from one end to the other."""
    part = Part(f"E{axis.upper()}{axis.upper()}", _low_orders(orders, _UNEVEN), _relative(runs, axis))
    return _classic(
        effect,
        axis,
        (part,),
        tuple(Parameter(order, "mm", what=f"{_MIDDLES[order]} along {axis}") for order in orders),
    )


def _low_orders(names: Sequence[str], shapes: Sequence[str]) -> str:
    return " + ".join(f"{name}*{shape}" for name, shape in zip(names, shapes, strict=False))


def _relative(runs: Runs, axis: str) -> tuple[tuple[str, str], ...]:
    """Define u: the position between the ends of the circle, −1 to 1."""
    own = [number for number, plane in enumerate(runs.plane) if axis in plane]
    centre = float(runs.centre_mm[own, "xyz".index(axis)].mean())
    return (("u", f"({axis} - ({centre:.9g}))/{runs.radius_mm[own].mean():.9g}"),)


def _classic(effect: Effect, axis: str, parts: tuple[Part, ...], coefficients: tuple[Parameter, ...]) -> Term:
    return Term(
        id=f"{effect.id}:{axis}",
        title=effect.title,
        kind="effect",
        effect=effect.id,
        axis=axis,
        covariate=None,
        parts=parts,
        coefficients=coefficients,
    )


def _shrink(effect: Effect, pair: str, machine: Machine) -> Term:
    """Both axes of a circle alike: servos of one make."""
    first, second = (effect.term(axis, None, machine) for axis in pair)
    return replace(
        first,
        id=f"{effect.id}:{pair}",
        axis=pair,
        parts=(*first.parts, *second.parts),
    )


def _spike_in_travel(effect: Effect, axis: str) -> Term:
    """Give a spike that decays with the travel since the reversal, and so is flatter at its top than one in time."""
    part = Part(f"E{axis.upper()}{axis.upper()}", f"-A*d_{axis}*exp(-s_{axis}/lambda)")
    decay = Parameter("lambda", "mm", low=0.02, high=100.0, spacing="log")
    return replace(_classic(effect, axis, (part,), (Parameter("A", "mm"),)), inner=(decay,))


def _share_a_plane(runs: Runs, axis: str, other: str) -> bool:
    return any(axis in plane and other in plane for plane in runs.planes)


def _trials(runs: Runs, term: Term) -> tuple[tuple[float, ...], ...]:
    grids = [_grid(runs, term, parameter) for parameter in term.inner]
    return tuple(itertools.product(*grids)) if all(len(grid) for grid in grids) else ()


def _grid(runs: Runs, term: Term, parameter: Parameter) -> Sequence[float]:
    low, high = parameter.low, parameter.high
    assert low is not None
    assert high is not None
    if low == high:
        return [low]
    if parameter.name == "P" and term.effect in ("periodic", "screw-wobble"):
        return _periods_mm(runs, term.axis or "", low, high, shakes_itself=term.effect == "periodic")
    if parameter.name == "f" and term.effect == "vibration":
        return _frequencies_hz(runs, term.axis or "", low, high)
    if parameter.name == "t0" and term.effect == "lost-steps":
        return _jumps_s(runs)
    space = np.geomspace if parameter.spacing == "log" else np.linspace
    return [float(value) for value in space(low, high, _N_DECAYS)]


def _within_reach(runs: Runs, term: Term) -> Term:
    """Give a term with the ranges of its inner parameters as far as these runs reach: where they end is told."""
    return replace(term, inner=tuple(_reached(runs, term, one) for one in term.inner))


def _reached(runs: Runs, term: Term, parameter: Parameter) -> Parameter:
    low, high = parameter.low, parameter.high
    if term.effect not in DECAYS or low is None or high is None:
        return parameter
    if parameter.unit == "s":
        low, high = max(low, 0.7 * min(_steps_s(runs))), min(high, _turn_s(runs) / 12.0)
    elif parameter.unit == "mm":
        radius = float(runs.radius_mm.max())
        # Within the first tenth of the radius: what fills more slowly is a slope.
        low, high = max(low, 2e-4 * radius), min(high, 0.1 * radius)
    else:
        # Within the speeds of the runs: what no speed of theirs ends is backlash.
        low = max(low, 0.02 * float(np.nanmin(runs.feed_mm_min)) / 60.0)
        high = min(high, float(np.nanmax(runs.feed_mm_min)) / 60.0)
    if not low < high:
        low = high = float(np.sqrt(low * high)) if parameter.spacing == "log" else 0.5 * (low + high)
    return replace(parameter, low=low, high=high)


def _turn_s(runs: Runs) -> float:
    """Give the time of the fastest turn."""
    return float(np.nanmin(2.0 * np.pi * runs.radius_mm / (runs.feed_mm_min / 60.0)))


def _steps_s(runs: Runs) -> list[float]:
    """Give how far apart rows are in time, by run."""
    return [float(np.median(np.diff(runs.time_s[own]))) for own in runs.slices]


def _periods_mm(runs: Runs, axis: str, low: float, high: float, *, shakes_itself: bool) -> Sequence[float]:
    """Give trial periods; `shakes_itself` tells whether the waves are along the axis and not across it."""
    own = [number for number, plane in enumerate(runs.plane) if axis in plane]
    radius = float(runs.radius_mm[own].max())
    spacing = max(
        float(np.median(np.diff(runs.travelled_rad[runs.slices[number]]))) * float(runs.radius_mm[number])
        for number in own
    )
    shortest = low
    low, high = max(low, _ROWS_OF_A_WAVE * spacing), min(high, _LONGEST_WAVE * radius)
    if not low < high:
        return ()
    step = _PHASE_STEP / (2.0 * radius)
    n = min(int(np.ceil((1.0 / low - 1.0 / high) / step)) + 2, _MOST_WAVES)
    waves = np.linspace(1.0 / high, 1.0 / low, n)
    if shakes_itself:
        fast = fast_waves(runs, axis, "place", (1.0 / low, 1.0 / shortest), step)
        waves = np.concatenate([waves, np.sort(fast)])
    return [float(1.0 / wave) for wave in waves]


def _frequencies_hz(runs: Runs, axis: str, low: float, high: float) -> Sequence[float]:
    longest = max(float(np.ptp(runs.time_s[own])) for own in runs.slices)
    # Slower it is a shape of the circle.
    low = max(low, _LEAST_WAVES / _turn_s(runs))
    # In runs whose rows are further apart such a vibration looks slower, and only there: the others tell.
    fastest, high = high, min(high, 1.0 / (_ROWS_OF_A_SHAKE * min(_steps_s(runs))))
    if not low < high:
        return ()
    step = 2.0 * _PHASE_STEP / longest
    n = min(int(np.ceil((high - low) / step)) + 2, _MOST_WAVES)
    fast = fast_waves(runs, axis, "time", (high, fastest), step)
    return [float(value) for value in np.concatenate([np.linspace(low, high, n), np.sort(fast)])]


def tells_vibration(runs: Runs, way: Way) -> np.ndarray:
    """Tell at which rows each trial of a vibration is told from a shape of the circle, (n, n_trials).

    Of rows that are far apart a fast one looks slow: in such a run it may be lobes, and another run has to show it.
    """
    (place,) = (number for number, one in enumerate(way.term.inner) if one.name == "f")
    frequency_hz = np.array([trial[place] for trial in way.trials])
    told = np.zeros((len(runs), len(frequency_hz)), dtype=bool)
    for own, step_s in zip(runs.slices, _steps_s(runs), strict=True):
        seen_hz = np.abs(frequency_hz - np.rint(frequency_hz * step_s) / step_s)
        told[own] = (seen_hz * float(np.ptp(runs.time_s[own])) >= _LEAST_WAVES) | (frequency_hz * step_s < 0.5)
    return told


def _jumps_s(runs: Runs) -> Sequence[float]:
    """Give times inside the runs, on the clock of all of them; a jump between two runs is another set-up."""
    found: list[Numbers] = []
    clock = clock_s(runs.fitted.sightings)[runs.rows]
    for own in runs.slices:
        t = clock[own]
        turns = float(runs.travelled_rad[own][-1]) / (2.0 * np.pi)
        n = min(max(int(_JUMPS_OF_A_TURN * turns), 2), len(t) - 2)
        # A jump among the last rows of a run is a mistake in a few of them.
        margin = _JUMP_FROM_END * float(t[-1] - t[0])
        found.append(np.linspace(float(t[0]) + margin, float(t[-1]) - margin, n))
    return [float(value) for value in np.sort(np.concatenate(found))]
