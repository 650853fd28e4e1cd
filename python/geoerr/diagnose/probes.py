"""Probes: functions of one variable, two or three on each axis, for structure that no effect of the catalogue has.

A probe names variables, not causes. It is judged like a candidate, against the same noise and the same kind of null.
Most are smooth; waves over a plane, and waves along an axis that change with a condition, stand beside them. Waves in
time, of which there are too many for columns, are in `waves_in_time`.
"""

from __future__ import annotations

import contextlib
import itertools
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from geoerr.diagnose.candidates import Shapes
from geoerr.diagnose.functions import Functions
from geoerr.diagnose.probe_variables import MOST_DEGREES, PLAYS, Variable
from geoerr.errors import InputFileError
from geoerr.fit.empirical import curve_in, empirical_term, finer_part
from geoerr.fit.fitted import Fitted
from geoerr.machine import AXES
from geoerr.observations import CARRIERS
from geoerr.terms import EMPIRICAL, Term

_Degrees = tuple[tuple[int, int], ...]
Form = Literal["smooth", "play", "waves", "hum", "places"]
# Degrees of the functions of one variable.
_ONE = (1, 3, MOST_DEGREES)
# Of two (each alone and their products): the low ones cost less. What no rigid body does is often a pattern over a
# plane; what changes with the direction may follow the other variable closely; two conditions are seen in few places.
_PLANE: _Degrees = ((1, 1), (2, 2), (4, 4))
_USUAL: _Degrees = ((1, 1), (2, 2))
_OF_DIRECTION: _Degrees = ((1, 2),)
_OF_DIRECTION_CLOSELY: _Degrees = ((1, 2), (1, 4))
_CONDITIONS: _Degrees = ((1, 1),)
# A variable of so few values that each can have its own is followed closely.
_CLOSELY = 8
# Of three positions: straight lines, one of them bent, all bent.
_SPACE = ((1, 1, 1), (2, 1, 1), (1, 2, 1), (1, 1, 2), (2, 2, 2))
# Waves over an axis's range: between two of them a wave has three quarters of its gain. Below them polynomials do.
_WAVES_OF_PLANE, _WAVES_OF_AXIS = (1.0, 5.2), (2.0, 8.0)
_STEP_OF_WAVES = 0.6


@dataclass(frozen=True, eq=False)
class Probe:
    """A dependence of one component of the error on one variable or more.

    Attributes
    ----------
    component
        Axis of the base along which it acts.
    depends_on
        Names of its variables, sorted.
    shapes
        Of rising freedom.
    n_sets
        How many sets of as many variables there are: each is as likely as another.
    form
        `smooth`; `play`: what a temperature leaves behind, trials are widths as shares of its range; `waves`: trials
        are lengths in mm; `hum`: the trial is a frequency; `places`: a number for each of a few places, and nothing
        between them.
    """

    component: str
    depends_on: tuple[str, ...]
    shapes: tuple[Shapes, ...]
    n_sets: int = 1
    form: Form = "smooth"

    @property
    def n_trials(self) -> int:
        """Number of ways to write it."""
        return sum(len(one.trials) for one in self.shapes)


@dataclass(frozen=True)
class _Group:
    """A probe on any channel: for each way to write it, the codes of its columns at each trial value."""

    names: tuple[str, ...]
    ways: tuple[tuple[tuple[int, ...], ...], ...]
    form: Form = "smooth"
    trials: tuple[tuple[float, ...], ...] = ((),)

    @classmethod
    def smooth(cls, names: Sequence[str], ways: Sequence[Sequence[int]]) -> _Group:
        return cls(tuple(names), tuple((tuple(codes),) for codes in dict.fromkeys(map(tuple, ways)) if codes))

    def shapes(self, channel: str) -> tuple[Shapes, ...]:
        return tuple(shapes_on(channel, way, self.trials) for way in self.ways)


def probes_of(fitted: Fitted, functions: Functions, variables: Sequence[Variable]) -> list[Probe]:
    """Give all probes of some variables that are columns; their functions are added to `functions`."""
    known = [_Codes(functions, one) for one in variables]
    groups = [*_alone(known), *_pairs(known), *_triples(known), *_memories(known), *_waves(known)]
    sets = Counter(len(names) for names in {tuple(sorted(group.names)) for group in groups})
    return [
        Probe(axis, tuple(sorted(own.names)), own.shapes(f"{body}-{axis}"), sets[len(own.names)], own.form)
        for body in bodies(fitted)
        for axis in AXES
        for own in groups
    ]


def bodies(fitted: Fitted) -> list[str]:
    """Give the bodies whose displacement was seen: what one does, targets on the other do not show."""
    seen = {CARRIERS[number] for number in np.unique(fitted.sightings.carrier[fitted.solved.used])}
    return [body for body in ("tool", "work") if body in seen] or ["tool"]


def curve_reference(probe: Probe, channel: str) -> str:
    """Give a probe on a channel as the reference of an empirical curve writes it: `work-x` on the work."""
    component = channel.removeprefix("tool-")
    return f"{EMPIRICAL}:{component}@{'*'.join(probe.depends_on)}"


def curve_term(fitted: Fitted, probe: Probe, channel: str) -> Term | None:
    """Give a probe on a channel as the term of a curve; None where the data leave nothing to draw it by.

    Between places that are off by something each there is none, nor of what is left of a wave on a joint, which is no
    displacement over its variables alone. Beside a curve of the same variables that the fit has it is what that one
    lacks, under another id.
    """
    if probe.form == "places" or not _is_displacement(channel):
        return None
    reference = curve_reference(probe, channel)
    own = own_curve(fitted.terms, probe, channel)
    with contextlib.suppress(InputFileError):
        return empirical_term(fitted, reference) if own is None else finer_part(fitted, own)
    return None


def own_curve(terms: Sequence[Term], probe: Probe, channel: str) -> Term | None:
    """Give the curve that terms have of what a probe on a channel is; None on a joint, along which no curve acts."""
    return curve_in(terms, curve_reference(probe, channel)) if _is_displacement(channel) else None


def _is_displacement(channel: str) -> bool:
    return channel.startswith(("tool-", "work-"))


def shapes_on(channel: str, codes: Sequence[Sequence[int]], trials: Sequence[tuple[float, ...]] = ((),)) -> Shapes:
    """Give columns on a channel: codes of functions, as many at each trial."""
    n = len(codes[0])
    columns = tuple((0, k) for k in range(n))
    return Shapes(None, ((channel, 1.0),), columns, n, ({},), tuple(trials), np.array(codes, dtype=np.int64))


class _Codes:
    """A variable's functions, named."""

    def __init__(self, functions: Functions, variable: Variable) -> None:
        self.variable, self.functions = variable, functions
        self.name, self.kind = variable.name, variable.kind
        self.by_rank = [functions.given(one) for one in variable.by_rank]
        #: Functions of rising degree, each way to count them.
        self.ways = [self.by_rank, *([functions.given(one) for one in way] for way in variable.other_ways)]
        self.alone = [] if variable.alone is None else [[functions.given(one) for one in variable.alone]]
        self.memory = [functions.given(one) for one in variable.memory]
        self.grows = None if variable.from_lowest is None else functions.given(variable.from_lowest)


def _alone(known: Sequence[_Codes]) -> Iterator[_Group]:
    for one in known:
        ways = [own[:degree] for own in [*one.ways, *one.alone] for degree in _ONE]
        yield _Group.smooth([one.name], ways)


def _pairs(known: Sequence[_Codes]) -> Iterator[_Group]:
    for first, second in itertools.combinations(known, 2):
        if second.kind == "direction":
            first, second = second, first
        kinds = {first.kind, second.kind}
        degrees = _CONDITIONS
        if kinds == {"position"}:
            degrees = _PLANE
        elif first.kind == "direction":
            degrees = _OF_DIRECTION
            if second.kind == "position" or second.variable.n_levels <= _CLOSELY:
                degrees = _OF_DIRECTION_CLOSELY
        elif "position" in kinds:
            degrees = _USUAL
        ways = [(first.by_rank, second.by_rank)]
        if "position" in kinds:
            ways = list(itertools.product(first.ways, second.ways))
        columns = [_products(first.functions, one[:m], two[:n]) for one, two in ways for m, n in degrees]
        yield _Group.smooth([first.name, second.name], columns)


def _products(functions: Functions, one: Sequence[int], two: Sequence[int]) -> list[int]:
    """Give functions of two variables: each alone, and their products."""
    return [*one, *two, *(functions.product(a, b) for a in one for b in two)]


def _triples(known: Sequence[_Codes]) -> Iterator[_Group]:
    """Give functions of all three positions, and straight ones of two positions and one thing more."""
    places = [one for one in known if one.kind == "position"]
    for first, second in itertools.combinations(places, 2):
        plane = _Plane(first, second)
        for third in known:
            if third.kind in ("direction", "condition"):
                yield _Group.smooth([first.name, second.name, third.name], [plane.times(third.by_rank, 1, 1, 1)])
        if [one.name for one in places] == [*AXES] and second is places[1]:
            yield _Group.smooth(AXES, [plane.times(places[2].by_rank, *degrees) for degrees in _SPACE])


class _Plane:
    """Products over two positions, to be multiplied by a third variable."""

    def __init__(self, first: _Codes, second: _Codes) -> None:
        self.first, self.second, self.functions = first, second, first.functions
        most = max(max(degrees) for degrees in _SPACE)
        self.product = {
            (m, n): self.functions.given(one * two)
            for m, one in enumerate(first.variable.by_rank[:most], start=1)
            for n, two in enumerate(second.variable.by_rank[:most], start=1)
        }

    def times(self, third: Sequence[int], *degrees: int) -> list[int]:
        """Give functions of all three up to their degrees: each alone, their products of two and of three."""
        of_first, of_second, of_third = degrees
        inside = [code for (m, n), code in self.product.items() if m <= of_first and n <= of_second]
        flat = [*self.first.by_rank[:of_first], *self.second.by_rank[:of_second], *inside]
        own = third[:of_third]
        return [*flat, *own, *(self.functions.product(code, other) for code in flat for other in own)]


def _memories(known: Sequence[_Codes]) -> Iterator[_Group]:
    """Give what a temperature leaves behind where it has been: alone, and more or less of it along an axis."""
    for one in known:
        if not one.memory:
            continue
        trials = tuple((share,) for share in PLAYS)
        yield _Group((one.name,), (tuple((code,) for code in one.memory),), "play", trials)
        for place in known:
            if place.kind == "position":
                codes = tuple((code, one.functions.product(code, place.by_rank[0])) for code in one.memory)
                yield _Group((one.name, place.name), (codes,), "play", trials)


def _waves(known: Sequence[_Codes]) -> Iterator[_Group]:
    """Give waves over two positions, and waves along one that grow with a condition or turn with a direction."""
    fewest = 2.0 * _WAVES_OF_AXIS[1]
    places = [_Waves(one) for one in known if one.kind == "position" and one.variable.n_levels > fewest]
    for one, two in itertools.combinations(places, 2):
        pairs = list(itertools.product(one.between(*_WAVES_OF_PLANE), two.between(*_WAVES_OF_PLANE)))
        codes = tuple(
            tuple(one.functions.product(a, b) for a in first[1] for b in second[1]) for first, second in pairs
        )
        lengths = tuple((first[0], second[0]) for first, second in pairs)
        yield _Group((one.name, two.name), (codes,), "waves", lengths)
    for one in places:
        own = one.between(*_WAVES_OF_AXIS)
        for other in known:
            if other.grows is not None:
                grown = tuple(tuple(one.functions.product(a, other.grows) for a in pair) for _, pair in own)
                yield _Group((one.name, other.name), (grown,), "waves", tuple((length,) for length, _ in own))


class _Waves:
    """Cosine and sine over a position's range."""

    def __init__(self, codes: _Codes) -> None:
        self.name, self.functions = codes.name, codes.functions
        values = codes.variable.values
        self.span_mm = float(np.ptp(values))
        self.turns = (values - values.min()) / self.span_mm
        self.known: dict[float, tuple[int, int]] = {}

    def between(self, fewest: float, most: float) -> list[tuple[float, tuple[int, int]]]:
        """Give the length in mm and the codes of each number of waves."""
        counts = np.arange(fewest, most + 0.5 * _STEP_OF_WAVES, _STEP_OF_WAVES).tolist()
        return [(self.span_mm / count, self._codes(count)) for count in counts]

    def _codes(self, count: float) -> tuple[int, int]:
        if count not in self.known:
            phase = 2.0 * np.pi * count * self.turns
            self.known[count] = (self.functions.given(np.cos(phase)), self.functions.given(np.sin(phase)))
        return self.known[count]
