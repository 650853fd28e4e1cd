"""Moves of a program that pass as they are, arcs among them: by which way each axis gets to its end.

Nothing here is shared with the code that corrects programs.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

Place = tuple[float | None, float | None, float | None]
# Places of an axis, to which it goes one way after the other, behind where it begins; None where nobody knows.
Strokes = list[float] | None

# Places that differ by less are the same: rounding of sums of increments.
_SAME_MM = 1e-9
# Each has the place where an axis turns closer by the share of the radius by which it grows in a radian.
_STEPS_TO_TURN = 4
_OFFSETS = (b"I", b"J", b"K")
# No machine has an arc as large, whose squares would be no numbers.
_LARGEST_MM = 1e12
# Letters whose words all controllers read alike on the line of an arc.
_ARC_LETTERS = frozenset((b"X", b"Y", b"Z", b"E", b"F", b"S", *_OFFSETS, b"R"))


class Arc(NamedTuple):
    """How a line tells an arc.

    Attributes
    ----------
    plane
        Indices of the axes of its plane: from the first to the second it turns counter-clockwise.
    sense
        1 counter-clockwise (`G3`), −1 clockwise.
    centre_mm
        x + iy of its plane, from its begin, or a place; None where the radius tells it.
    is_place
        Whether it is a place.
    radius_mm
        Of the longer way round below 0.
    """

    plane: tuple[int, int]
    sense: float
    centre_mm: complex | None
    is_place: bool
    radius_mm: float


class Passage(NamedTuple):
    """A move that passes as it is.

    Attributes
    ----------
    begin_mm, end_mm
        Machine coordinates.
    is_followed
        Whether it is known of an axis how it goes.
    arc
        Which it is; None of a straight move.
    """

    begin_mm: Place
    end_mm: Place
    is_followed: tuple[bool, bool, bool]
    arc: Arc | None = None

    @property
    def is_whole(self) -> bool:
        """Whether it ends where it begins."""
        ends = zip(self.begin_mm, self.end_mm, strict=True)
        known = [(begin, end) for axis, (begin, end) in enumerate(ends) if self.arc and axis in self.arc.plane]
        return all(begin is not None and end is not None and abs(begin - end) <= _SAME_MM for begin, end in known)

    def strokes(self, *, is_whole: bool) -> tuple[Strokes, Strokes, Strokes]:
        """Give those of each axis; a whole circle ends beside its begin where a correction has moved that."""
        found: list[Strokes] = []
        for axis, (begin, end) in enumerate(zip(self.begin_mm, self.end_mm, strict=True)):
            if begin is None or end is None or not self.is_followed[axis]:
                found.append(None)
            elif self.arc is not None and axis in self.arc.plane:
                turn = self._turn(self.arc, is_whole=is_whole)
                found.append(None if turn is None else turn.strokes(self.arc.plane.index(axis)))
            else:
                found.append([end])
        return found[0], found[1], found[2]

    @property
    def miss_mm(self) -> float:
        """By how much its ends miss its arc: shorter strokes are rounding."""
        turn = None if self.arc is None else self._turn(self.arc, is_whole=False)
        return 0.0 if turn is None else abs(abs(turn.end) - abs(turn.begin))

    def _turn(self, arc: Arc, *, is_whole: bool) -> _Turn | None:
        first, second = arc.plane
        x, y, to_x, to_y = self.begin_mm[first], self.begin_mm[second], self.end_mm[first], self.end_mm[second]
        if x is None or y is None or to_x is None or to_y is None:
            return None
        begin, end = complex(x, y), complex(to_x, to_y)
        centre = _centre_by_radius(begin, end, arc.sense * arc.radius_mm) if arc.centre_mm is None else arc.centre_mm
        if centre is None:
            return None
        if arc.centre_mm is not None and not arc.is_place:
            centre += begin
        way = arc.sense * (cmath.phase(end - centre) - cmath.phase(begin - centre)) % math.tau
        if is_whole and way < math.pi:
            way += math.tau
        return _Turn(centre, begin - centre, end - centre, arc.sense, way)


class _Turn(NamedTuple):
    """An arc about a centre, from there by an angle; where its ends are not as far away, the radius goes evenly."""

    centre: complex
    begin: complex
    end: complex
    sense: float
    way: float

    def strokes(self, of_plane: int) -> list[float]:
        # Seen along the arc, an axis of a circle turns at each half turn from where it is highest.
        highest = 0.5 * math.pi * of_plane
        from_highest = (self.sense * (cmath.phase(self.begin) - highest)) % math.tau
        wider = (abs(self.end) - abs(self.begin)) / self.way if self.way > 0.0 else 0.0
        places = []
        for half_turns in range(6):
            gone = turn = half_turns * math.pi - from_highest
            for _ in range(_STEPS_TO_TURN):
                # Where the radius grows, a little behind.
                radius = abs(self.begin) + wider * gone
                gone = turn + (math.atan(wider / radius) if radius else 0.0)
            if 0.0 < gone < self.way:
                radius = abs(self.begin) + wider * gone
                places.append(_part(self.centre, of_plane) + radius * math.cos(from_highest + gone))
        return [*places, _part(self.centre + self.end, of_plane)]


def _part(number: complex, of_plane: int) -> float:
    return number.imag if of_plane else number.real


def _centre_by_radius(begin: complex, end: complex, radius: float) -> complex | None:
    """Give the centre at a radius that counts from the left of the chord."""
    half = 0.5 * (end - begin)
    if not abs(half) > 0.0:
        return None
    rise = math.copysign(math.sqrt(max(radius**2 - abs(half) ** 2, 0.0)), radius)
    return begin + half + 1j * half / abs(half) * rise


def arc_of(
    words: Mapping[bytes, float | None],
    plane: tuple[int, int],
    sense: float,
    unit_mm: float,
    origin_of_centre_mm: Place | None,
) -> Arc | None:
    """Read the arc of a line; None where controllers may read its words differently.

    `origin_of_centre_mm` is the zero that the centre counts from, None where that is the arc's begin.
    """
    told = {letter: number for letter, number in words.items() if letter in (*_OFFSETS, b"R")}
    offsets = [told.get(_OFFSETS[axis]) for axis in plane]
    if not words.keys() <= _ARC_LETTERS or None in told.values():
        return None
    if any(abs(number) * unit_mm > _LARGEST_MM for number in told.values() if number is not None):
        return None
    has_centre = any(offset is not None for offset in offsets)
    radius = told.get(b"R")
    if has_centre == (radius is not None):
        return None
    if radius is not None:
        return Arc(plane, sense, None, is_place=False, radius_mm=radius * unit_mm)
    centre = complex(*((offset or 0.0) * unit_mm for offset in offsets))
    if origin_of_centre_mm is not None:
        x, y = (origin_of_centre_mm[axis] for axis in plane)
        if x is None or y is None or None in offsets:
            return None
        centre += complex(x, y)
    return Arc(plane, sense, centre, is_place=origin_of_centre_mm is not None, radius_mm=0.0)


class Gone(NamedTuple):
    """What passed before a piece of a corrected program.

    Attributes
    ----------
    is_lost
        Whether an axis has gone in a way that is not known.
    places_mm
        Of each axis where its drive was, or where it was known again, and the places to which it has gone from there
        one way after the other; empty where it has not.
    end_mm
        Where the machine is behind it.
    """

    is_lost: tuple[bool, ...]
    places_mm: tuple[list[float], ...]
    end_mm: Place


def gone_before(passed: Sequence[Passage], is_whole: Iterable[bool]) -> Gone:
    """Put together what passed between two corrected moves."""
    is_lost, places_mm = [False] * 3, [list[float]() for _ in range(3)]
    for passage, whole in zip(passed, is_whole, strict=True):
        for axis, strokes in enumerate(passage.strokes(is_whole=whole)):
            begin = passage.begin_mm[axis]
            if strokes is None or begin is None:
                is_lost[axis], places_mm[axis] = True, []
            elif strokes != [begin]:
                places_mm[axis] = [*(places_mm[axis] or [begin]), *strokes]
    return Gone(tuple(is_lost), tuple(places_mm), passed[-1].end_mm)
