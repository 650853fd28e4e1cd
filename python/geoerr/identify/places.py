"""Li's numbers for the lines that were found, and the place that each axis's functions are first worked out for.

Lines 1, 2, 3 run along X, Y, Z through one point; 4 (x, 0, z₀), 5 (x, y₀, 0), 6 (0, y, z₀), 7 (x₀, y, 0), 8 (0, y₀,
z), 9 (x₀, 0, z) are offset from it (Li Fig. 6). The offsets are levers, not axis positions
(`geoerr.identify.levers`). Further lines have no number; they take part like the others.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from geoerr.identify.levers import lever_mm
from geoerr.identify.linear import Numbers
from geoerr.identify.passes import Pass
from geoerr.machine import AXES, Machine

# Two lines closer than this are the same line: a target plate is not mounted to better than a millimetre or two, and
# an angle would need an offset far larger.
SAME_PLACE_MM = 2.0

BASE_NUMBER = {"x": 1, "y": 2, "z": 3}
# Moving axis and direction of the offset to Li's number.
OFFSET_NUMBER = {
    ("x", "z"): 4,
    ("x", "y"): 5,
    ("y", "z"): 6,
    ("y", "x"): 7,
    ("z", "y"): 8,
    ("z", "x"): 9,
}

# Ratio of distances up to which two places of a fixture count as equally central.
_EQUALLY_CENTRAL = 1.1
_MAX_COMBINATIONS = 20_000
# An offset counts as one along a direction from 60° on: cos 60°.
_LEAST_ALIGNMENT = 0.5


@dataclass(frozen=True)
class Line:
    """The passes that share a moving axis and a place.

    Attributes
    ----------
    axis
        Moving axis.
    number
        Li's number, 1 to 9; None for a further line.
    place_mm : (3,)
        Lever of the axis on the target.
    passes
        Indices into the list of passes.
    """

    axis: str
    number: int | None
    place_mm: Numbers
    passes: tuple[int, ...]


@dataclass(frozen=True)
class Places:
    """The lines, and for each axis that has any the lever of its base line and Li's numbers that are missing."""

    lines: tuple[Line, ...]
    base_mm: dict[str, Numbers]
    missing: dict[str, tuple[int, ...]]


def number_lines(passes: Sequence[Pass], machine: Machine) -> Places:
    """Group passes into lines and give them Li's numbers."""
    grouped = {axis: _distinct_places(passes, axis) for axis in AXES}
    grouped = {axis: places for axis, places in grouped.items() if places}
    base = _crossing_lines({axis: [place for place, _ in places] for axis, places in grouped.items()})
    lines: list[Line] = []
    missing: dict[str, tuple[int, ...]] = {}
    for axis, places in grouped.items():
        origin = _origin(axis, grouped, base, passes, machine)
        numbers = _numbers(axis, [place for place, _ in places], origin)
        lines.extend(Line(axis, number, *place) for number, place in zip(numbers, places, strict=True))
        wanted = [BASE_NUMBER[axis], *(number for (moving, _), number in OFFSET_NUMBER.items() if moving == axis)]
        missing[axis] = tuple(sorted(set(wanted) - set(numbers)))
    return Places(tuple(lines), base, missing)


def _distinct_places(passes: Sequence[Pass], axis: str) -> list[tuple[Numbers, tuple[int, ...]]]:
    """Give the places of an axis's lines; places that differ along the axis only are one."""
    across = [index for index in range(3) if AXES[index] != axis]
    found: list[tuple[Numbers, list[int]]] = []
    for number, one in enumerate(passes):
        if one.axis != axis:
            continue
        for place, members in found:
            if np.max(np.abs((place - one.place_mm)[across])) < SAME_PLACE_MM:
                members.append(number)
                break
        else:
            found.append((one.place_mm, [number]))
    return [(place, tuple(members)) for place, members in found]


def _crossing_lines(places: dict[str, list[Numbers]]) -> dict[str, Numbers]:
    """Choose one line of each axis so that they come closest to crossing at one point.

    Among three targets in an L the corner is chosen first: it is the place with the least sum of distances to the
    others.
    """
    central = {axis: _most_central(axis, candidates) for axis, candidates in places.items()}
    while np.prod([float(len(candidates)) for candidates in central.values()]) > _MAX_COMBINATIONS:
        central = {axis: candidates[: max(1, len(candidates) // 2)] for axis, candidates in central.items()}
    best = min(itertools.product(*central.values()), key=lambda chosen: _mismatch(list(central), chosen))
    return dict(zip(central, best, strict=True))


def _most_central(axis: str, candidates: list[Numbers]) -> list[Numbers]:
    across = [index for index in range(3) if AXES[index] != axis]
    points = np.array(candidates)[:, across]
    total = np.linalg.norm(points[:, None] - points[None], axis=2).sum(axis=1)
    return [
        place for place, sum_mm in zip(candidates, total, strict=True) if sum_mm <= _EQUALLY_CENTRAL * total.min()
    ]


def _mismatch(axes: list[str], chosen: tuple[Numbers, ...]) -> float:
    """Give the sum of squared distances between the lines, in the coordinate that each two of them share."""
    total = 0.0
    for first, second in itertools.combinations(range(len(axes)), 2):
        shared = 3 - AXES.index(axes[first]) - AXES.index(axes[second])
        total += float(chosen[first][shared] - chosen[second][shared]) ** 2
    return total


def _origin(
    axis: str,
    grouped: dict[str, list[tuple[Numbers, tuple[int, ...]]]],
    base: dict[str, Numbers],
    passes: Sequence[Pass],
    machine: Machine,
) -> Numbers:
    """Give the place where the base line of an axis is, or should be where the data lack it."""
    places = [place for place, _ in grouped[axis]]
    # One line alone is the base line, wherever it is.
    if len(places) == 1 or _spans_both_directions(axis, places):
        return base[axis]
    for other, others in grouped.items():
        if other == axis or not _spans_both_directions(other, [place for place, _ in others]):
            continue
        seen = passes[next(members[0] for place, members in others if place is base[other])]
        mine = passes[grouped[axis][0][1][0]]
        if seen.carrier == mine.carrier:
            return _place_of_target(machine, mine, seen, other)
    return _crossing_of_the_others(axis, base)


def _spans_both_directions(axis: str, places: list[Numbers]) -> bool:
    across = [index for index in range(3) if AXES[index] != axis]
    offsets = (np.array(places) - places[0])[:, across]
    return len(places) >= 3 and float(np.linalg.svd(offsets, compute_uv=False)[-1]) > SAME_PLACE_MM


def _place_of_target(machine: Machine, mine: Pass, seen: Pass, other: str) -> Numbers:
    """Give the lever that a target seen on another axis's line has on this axis's line."""
    # A moving axis's own position is part of no place, and of no lever but that of `relative` data.
    at_seen, at_mine = seen.parked_mm.copy(), mine.parked_mm.copy()
    at_seen[AXES.index(other)] = 0.0
    at_mine[mine.index] = 0.0
    offset = seen.place_mm - lever_mm(machine, seen.carrier, other, at_seen[None], np.zeros((1, 3)))[0]
    return np.asarray(lever_mm(machine, mine.carrier, mine.axis, at_mine[None], offset[None])[0])


def _crossing_of_the_others(axis: str, base: dict[str, Numbers]) -> Numbers:
    """Give the point where the other two axes' base lines cross, if they do; else this axis's own base line."""
    others = [name for name in AXES if name != axis and name in base]
    own = AXES.index(axis)
    if len(others) < 2:
        return base[axis]
    first, second = others
    if abs(base[first][own] - base[second][own]) > SAME_PLACE_MM:
        return base[axis]
    crossing = base[axis].copy()
    crossing[AXES.index(second)] = base[first][AXES.index(second)]
    crossing[AXES.index(first)] = base[second][AXES.index(first)]
    return crossing


def _numbers(axis: str, places: list[Numbers], origin: Numbers) -> list[int | None]:
    """Give each place Li's number by its offset from the origin."""
    numbers: list[int | None] = [None] * len(places)
    offsets = [place - origin for place in places]
    across = [name for name in AXES if name != axis]
    directions = [AXES.index(name) for name in across]
    lengths = [float(np.max(np.abs(offset[directions]))) for offset in offsets]
    nearest = int(np.argmin(lengths))
    if lengths[nearest] < SAME_PLACE_MM:
        numbers[nearest] = BASE_NUMBER[axis]
    free = [index for index in range(len(places)) if numbers[index] is None]
    for index, direction in _assigned(offsets, free, directions):
        numbers[index] = OFFSET_NUMBER[(axis, AXES[direction])]
    return numbers


def _assigned(offsets: list[Numbers], free: list[int], directions: list[int]) -> list[tuple[int, int]]:
    """Choose the lines whose offsets lie best along the two directions across the axis."""
    if len(free) == 1:
        offset = offsets[free[0]]
        return [(free[0], max(directions, key=lambda direction: abs(float(offset[direction]))))]
    first, second = directions
    alignment = {
        (index, direction): abs(float(offsets[index][direction])) / float(np.linalg.norm(offsets[index][directions]))
        for index in free
        for direction in directions
    }
    pairs = itertools.permutations(free, 2)
    best = max(pairs, key=lambda pair: alignment[pair[0], first] + alignment[pair[1], second], default=None)
    if best is None:
        return []
    chosen = [(best[0], first), (best[1], second)]
    return [pair for pair in chosen if alignment[pair] > _LEAST_ALIGNMENT]
