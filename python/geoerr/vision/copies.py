"""A marker that is on two plates: which sightings are of the target, where a picture shows only one of them.

Once a session has shown a target twice, a picture that shows it once may show the other plate. What tells is how the
plates move, and where session.toml says that they are. Two plates of a side s cannot stand nearer to each other than
s: a sighting within s/2 of where the target should be is the target's, and one farther off is not.

- Where others that are on the same carrier are beyond doubt, they give the rigid motion from what was commanded to
  the left camera, and with it the place of `offset_mm` in every frame.
- Where there are none, or they lie in one line, a target has to move as what carries it does: from sighting to
  sighting by as much as was commanded, while a plate that lies about stays where it is. Where sightings of both
  plates do so nobody can tell.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from geoerr.machine import AXES
from geoerr.summaries import counted
from geoerr.vision.expected import sessions_of
from geoerr.vision.plate_rows import PlateRows
from geoerr.vision.session import Session, Target

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]

# Of long sessions so many sightings tell how the others should lie; all of them are judged.
_MOST_COMPARED = 300


@dataclass(frozen=True)
class Copies:
    """What is left out because a marker is on two plates: the reason for each plate, '' for most; notes in words."""

    why: npt.NDArray[np.object_]
    notes: tuple[str, ...]


def judge_copies(session: Session, rows: PlateRows, is_good: Flags, twice: Sequence[tuple[int, int]]) -> Copies:
    """Tell which single sightings of targets that some picture shows twice cannot be taken for the target's.

    Parameters
    ----------
    rows
        Plates that were placed.
    is_good
        (n,) whether they can be used otherwise.
    twice
        Frame and target of every picture that shows one more than once.
    """
    why = np.full(len(rows.row), "", dtype=object)
    notes: list[str] = []
    frames = session.require_frames()
    number = sessions_of(frames)
    commanded_mm = frames.select(AXES).to_numpy().astype(np.float64)[rows.row]
    shown: dict[tuple[int, int], list[int]] = {}
    for row, target in twice:
        shown.setdefault((int(number[row]), target), []).append(row)
    for (own, target), at in shown.items():
        in_session = is_good & (number[rows.row] == own)
        mine = np.flatnonzero(in_session & (rows.target == target))
        is_sure = in_session & ~np.isin(rows.target, [other for one, other in shown if one == own])
        carrier = session.targets[target].carrier
        is_sure &= np.array([session.targets[index].carrier == carrier for index in rows.target], dtype=bool)
        off_mm = _off_mm(session, rows, commanded_mm, mine, np.flatnonzero(is_sure))
        half_mm = 0.5 * session.targets[target].size_mm
        if off_mm is None:
            is_own = _moves_as_carried(session, target, rows.centre_mm[mine], commanded_mm[mine])
        else:
            is_own = off_mm < half_mm
        first = frames["file_row"][min(at)]
        for place, index in enumerate(mine):
            if is_own[place]:
                continue
            how = (
                "which of them this is cannot be known"
                if off_mm is None
                else f"this one is {off_mm[place]:.0f} mm from where offset_mm and the other targets say that it is"
            )
            why[index] = f"row {first} of frames.csv shows it more than once, and {how}"
        notes.append(
            f"target {session.targets[target].name} is seen more than once in {counted(len(at), 'frame')}, the first "
            f"in row {first} of frames.csv; of {counted(len(mine), 'frame')} that show it once "
            f"{int((~is_own).sum())} left out: give every plate a marker of its own"
        )
    return Copies(why, tuple(notes))


def _moving_axes(session: Session, carrier: str) -> Iterator[list[int]]:
    """Give the axes that move a carrier; without a machine all that may."""
    if carrier == "base":
        yield []
    elif session.machine is not None:
        names = session.machine.tool_axes if carrier == "tool" else session.machine.work_axes
        yield [AXES.index(name) for name in names]
    else:
        yield from (list(some) for count in (3, 2, 1) for some in itertools.combinations(range(3), count))


def _off_mm(
    session: Session, rows: PlateRows, commanded_mm: Array, mine: npt.NDArray[np.intp], sure: npt.NDArray[np.intp]
) -> Array | None:
    """Give how far sightings of a target are from where others of its carrier put it; None where they do not say."""
    if not len(mine) or not len(sure):
        return None
    target = session.targets[rows.target[mine[0]]]
    if target.carrier == "base":
        # Their offsets are stated for nobody.
        return None
    some = sure[:: 1 + len(sure) // _MOST_COMPARED]
    half_mm = 0.5 * target.size_mm
    best, found = half_mm, None
    for axes in _moving_axes(session, target.carrier):
        nominal = _nominal_mm([session.targets[index] for index in rows.target[some]], commanded_mm[some], axes)
        mean, place = nominal.mean(axis=0), rows.centre_mm[some].mean(axis=0)
        u, extent, vt = np.linalg.svd((nominal - mean).T @ (rows.centre_mm[some] - place) / len(some))
        if extent[1] < half_mm**2:
            # In one line: the others may be turned about it.
            continue
        turn = vt.T @ np.diag([1.0, 1.0, np.sign(np.linalg.det(vt.T @ u.T))]) @ u.T
        left = rows.centre_mm[some] - place - (nominal - mean) @ turn.T
        rms_mm = float(np.sqrt((left**2).sum(axis=1).mean()))
        if rms_mm < best:
            own = _nominal_mm([target] * len(mine), commanded_mm[mine], axes)
            best, found = rms_mm, np.linalg.norm(rows.centre_mm[mine] - place - (own - mean) @ turn.T, axis=1)
    return found


def _nominal_mm(targets: Sequence[Target], commanded_mm: Array, axes: Sequence[int]) -> Array:
    """Give where targets of one carrier are by what was stated and commanded, (n, 3), but for a shift of them all."""
    place = np.array([target.offset_mm for target in targets], dtype=np.float64)
    sign = -1.0 if targets[0].carrier == "work" else 1.0
    place[:, list(axes)] += sign * commanded_mm[:, list(axes)]
    return place


def _moves_as_carried(session: Session, target: int, centre_mm: Array, commanded_mm: Array) -> Flags:
    """Tell which sightings move as the target's carrier does, where that tells them from others; else none."""
    half_mm = 0.5 * session.targets[target].size_mm
    for axes in _moving_axes(session, session.targets[target].carrier):
        agrees = _agreeing(centre_mm, commanded_mm[:, axes], half_mm)
        is_own = agrees.mean(axis=1) > 0.5 if agrees.size else np.zeros(len(centre_mm), dtype=bool)
        if not _is_told(commanded_mm[is_own], axes, half_mm):
            continue
        rest = ~is_own
        also = _agreeing(centre_mm[rest], commanded_mm[rest][:, axes], half_mm)
        if also.size and also.all() and _is_told(commanded_mm[rest], axes, half_mm):
            break
        return np.asarray(is_own)
    return np.zeros(len(centre_mm), dtype=bool)


def _agreeing(centre_mm: Array, moved_mm: Array, limit_mm: float) -> Flags:
    """(n, m): whether sightings are as far from some of them as was commanded."""
    some = slice(None, None, 1 + len(centre_mm) // _MOST_COMPARED)
    apart = np.linalg.norm(centre_mm[:, None] - centre_mm[None, some], axis=2)
    commanded = np.linalg.norm(moved_mm[:, None] - moved_mm[None, some], axis=2)
    return np.asarray(np.abs(apart - commanded) < limit_mm)


def _is_told(commanded_mm: Array, axes: Sequence[int], half_mm: float) -> bool:
    """Tell whether the carrier moved by enough for what stands still (of what stands: for what moves) to be told."""
    if len(commanded_mm) < 2:
        return False
    moved = commanded_mm[:, list(axes)] if axes else commanded_mm
    return bool(np.linalg.norm(np.ptp(moved, axis=0)) > half_mm)
