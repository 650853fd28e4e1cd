"""Frames that are left-handed: a column has its sign reversed, or two are exchanged, which no turn of a device does.

How a device stands is fitted, so that any turned frame is as good as another; a mirrored one is none of them. Points
in a plane or on a line do not tell: there a reflection is a turn as well, about an axis in that plane. So what is
asked of the motion is whether a reflection follows it where the best rotation does not, by more than any error.
"""

from __future__ import annotations

import itertools

import numpy as np

from geoerr.errors import GeometryError
from geoerr.fit.sightings import SEE_POSITIONS, Numbers, Sightings
from geoerr.fit.start import moving_targets, nominal_mm
from geoerr.machine import Machine
from geoerr.observations import MEASURED

# A rotation leaves more than this, and than this share of the travel: no error of a machine that can be fitted.
_BELIEVABLE_MM, _BELIEVABLE = 1.0, 0.01
# What a reflection leaves of that, in so many rows at least: signs of few are slips of those.
_FOLLOWS, _FEWEST_ROWS, _FEWEST = 0.2, 6, 0.05
# Elements of a frame that is as the base but for signs and order: it stands turned by less than 15°.
_NEARLY_ONE = 0.96


def refuse_mirrored(sightings: Sightings, machine: Machine) -> None:
    """Refuse measuring frames that are left-handed.

    Raises
    ------
    GeometryError
        where a reflection takes the commanded motion of a session to the measured one, and no rotation does.
    """
    nominal = nominal_mm(machine, sightings)
    targets = sightings.once("moving_targets", moving_targets)
    of_sessions: list[list[np.ndarray]] = [[] for _ in sightings.sessions]
    for rows in targets:
        of_sessions[sightings.session[rows[0]]].append(rows)
    for number, (kind, own) in enumerate(zip(sightings.frames, of_sessions, strict=True)):
        if kind not in SEE_POSITIONS or not own:
            continue
        for components in _together(sightings, kind, np.concatenate(own)):
            moved, seen = _from_middles(nominal, sightings, own, components)
            reflection = _reflection(moved, seen)
            if reflection is not None:
                raise GeometryError(_words(sightings.sessions[number], components, reflection))


def _together(sightings: Sightings, kind: str, rows: np.ndarray) -> list[list[int]]:
    """Give the components whose frame turns as one: all, two in their plane, or each that stands as the base does."""
    if kind == "free":
        return [[0, 1, 2]]
    is_measured = sightings.is_measured[rows]
    seen = np.flatnonzero(is_measured.any(axis=0)).tolist()
    if len(seen) == 2 and is_measured[:, seen].all(axis=1).any():
        return [seen]
    return [[component] for component in seen]


def _from_middles(
    nominal: Numbers, sightings: Sightings, targets: list[np.ndarray], components: list[int]
) -> tuple[Numbers, Numbers]:
    """Give nominal and measured points (n, k) from the middles of their targets: where those sit says nothing."""
    moved, seen = [np.zeros((0, len(components)))], [np.zeros((0, len(components)))]
    for rows in targets:
        own = rows[sightings.is_measured[rows][:, components].all(axis=1)]
        if len(own):
            for points, centred in ((nominal, moved), (sightings.measured_mm, seen)):
                centred.append(points[own][:, components] - points[own][:, components].mean(axis=0))
    return np.concatenate(moved), np.concatenate(seen)


def _reflection(moved: Numbers, seen: Numbers) -> Numbers | None:
    """Give the reflection (k, k) that takes points (n, k) to seen ones where no rotation does; None otherwise."""
    if len(moved) < _FEWEST_ROWS:
        return None
    left, _, right = np.linalg.svd(seen.T @ moved)
    last = np.zeros(len(left))
    last[-1] = 1.0
    best = left @ right
    # Least squares among those of the other handedness turn the direction with the least spread.
    other = best - 2.0 * np.outer(left @ last, last @ right)
    rotation, reflection = (best, other) if np.linalg.det(best) > 0.0 else (other, best)
    by_rotation, by_reflection = (np.linalg.norm(seen - moved @ turn.T, axis=1) for turn in (rotation, reflection))
    believable_mm = max(_BELIEVABLE_MM, _BELIEVABLE * float(np.ptp(moved, axis=0).max()))
    for_it, against_it = (
        int(((one > believable_mm) & (two < _FOLLOWS * one)).sum())
        for one, two in ((by_rotation, by_reflection), (by_reflection, by_rotation))
    )
    is_told = for_it >= max(_FEWEST_ROWS, _FEWEST * len(moved)) and against_it < _FOLLOWS * for_it
    return reflection if is_told else None


def _words(session: str, components: list[int], reflection: Numbers) -> str:
    names = [MEASURED[component] for component in components]
    return (
        f"what was measured in session {session!r} is the mirror image of what was commanded: no turn of a measuring "
        f"device takes the one to the other\nhint: {_slip(names, reflection)}: what is measured is right-handed, as "
        "x, y and z are; which way a target goes the machine's chain and the column carrier say"
    )


def _slip(names: list[str], reflection: Numbers) -> str:
    """Name the columns that look so; of a device that stands askew nobody can tell which."""
    signs = np.where(np.abs(reflection) > _NEARLY_ONE, np.sign(reflection), 0.0)
    for number, name in enumerate(names):
        if np.array_equal(signs, _but_one_sign(len(names), number)):
            return f"{name} looks like an axis that is mirrored, its sign reversed"
    for one, two in itertools.combinations(range(len(names)), 2):
        if np.array_equal(signs, _exchanged(len(names), one, two)):
            return f"the columns {names[one]} and {names[two]} look exchanged"
    return (
        f"an axis is mirrored (the sign of one of {', '.join(names)} reversed), or two of these columns are exchanged"
    )


def _but_one_sign(n: int, number: int) -> Numbers:
    signs = np.ones(n)
    signs[number] = -1.0
    return np.diag(signs)


def _exchanged(n: int, one: int, two: int) -> Numbers:
    order = np.arange(n)
    order[[one, two]] = two, one
    return np.eye(n)[order]
