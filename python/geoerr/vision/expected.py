"""Where targets should be in a picture: where they were in others, and what was commanded.

Some frames of a session are searched whole. From them, corners in space (c = 1 ... 4) at the commanded position q are

    X_c(q) = b_c + A (q − q̄)

with A (3 × 3) by least squares, 0 along what was never moved: axes are straight to a millimetre, and carry a target
without turning it. Projected into both pictures this is near enough to read the marker there and to fit its whole
picture; where either says no, the picture is searched.

| symbol | code | what | unit |
|---|---|---|---|
| X_c | - | corners in the left camera's frame, (4, 3) | mm |
| q | `commanded_mm` | commanded position, (3,) | mm |
| b_c | `corners_mm` | corners at the middle, (4, 3) | mm |
| A | `mm_per_mm` | way of the target for each mm of an axis, (3, 3) | - |
| q̄ | `middle_mm` | the middle of the positions, (3,) | mm |
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import polars as pl

from geoerr.geometry import triangulate
from geoerr.machine import AXES
from geoerr.vision.frame import FrameResult, SeenTarget
from geoerr.vision.rig import Rig

Array = npt.NDArray[np.float64]

# Frames of a session that are searched whole; a session with not many more is searched whole, all of it.
_SEARCHED, _WORTHWHILE = 24, 48
# Fewer places of a target say too little of how it moves.
_FEWEST = 8
# Share of a marker's side by which corners may be off: a fifth of a module, where eight make a side.
_NEAR = 0.025
# Directions in which the machine moved by less than this share of the others were not moved.
_NOT_MOVED = 1e-6


@dataclass(frozen=True)
class _Motion:
    """How one target moves in one session: corners (4, 3) in the left camera's frame at the middle, A, and q̄."""

    corners_mm: Array
    mm_per_mm: Array
    middle_mm: Array


@dataclass(frozen=True)
class Expected:
    """Where targets should be.

    Attributes
    ----------
    rig
        The camera pair.
    session : (n,)
        Session of each frame, by number.
    commanded_mm : (n, 3)
        Positions of the axes.
    motions
        By session and target.
    """

    rig: Rig
    session: npt.NDArray[np.int64]
    commanded_mm: Array
    motions: Mapping[tuple[int, int], _Motion]

    def corners_px(self, row: int, target: int) -> tuple[Array, Array] | None:
        """Give distorted pixels (4, 2) of a target's corners in either picture; None where nobody can say."""
        motion = self.motions.get((int(self.session[row]), target))
        if motion is None:
            return None
        points = motion.corners_mm + motion.mm_per_mm @ (self.commanded_mm[row] - motion.middle_mm)
        places = _projected(self.rig, points)
        return places if all(np.isfinite(place).all() for place in places) else None


def rows_to_search(frames: pl.DataFrame) -> list[int]:
    """Give the frames that tell where targets are in the others, evenly over each session; none where all are few."""
    session = sessions_of(frames)
    chosen: list[int] = []
    for number in range(int(session.max(initial=-1)) + 1):
        own = np.flatnonzero(session == number)
        if len(own) >= _WORTHWHILE:
            chosen += own[np.linspace(0, len(own) - 1, _SEARCHED).round().astype(np.int64)].tolist()
    return sorted(chosen)


def expected_places(rig: Rig, frames: pl.DataFrame, searched: Mapping[int, FrameResult]) -> Expected:
    """Learn from frames that were searched how each target moves; one that goes another way is not expected.

    Nor is one that some picture of its session shows more than once: which one is meant cannot be known.

    Parameters
    ----------
    frames
        With `x`, `y` and `z` in every row.
    """
    session = sessions_of(frames)
    commanded_mm = frames.select(AXES).to_numpy().astype(np.float64)
    seen: dict[tuple[int, int], list[SeenTarget]] = {}
    for row, result in searched.items():
        for item in result.seen:
            seen.setdefault((int(session[row]), item.target), []).append(item)
    repeated = {(int(session[row]), target) for row, result in searched.items() for target in result.repeated}
    motions = {
        key: motion
        for key, items in seen.items()
        if key not in repeated and (motion := _motion(rig, commanded_mm, items)) is not None
    }
    return Expected(rig, session, commanded_mm, motions)


def _motion(rig: Rig, commanded_mm: Array, items: list[SeenTarget]) -> _Motion | None:
    left, right = (np.stack([getattr(item, side).corners_px for item in items]) for side in ("left", "right"))
    found = triangulate(rig.projection_left_px, rig.projection_right_px, left.reshape(-1, 2), right.reshape(-1, 2))
    corners = found.points_mm.reshape(-1, 4, 3)
    q = commanded_mm[[item.row for item in items]]
    good = np.isfinite(corners).all(axis=(1, 2))
    corners, q = corners[good], q[good]
    if len(q) < _FEWEST:
        return None
    middle = q.mean(axis=0)
    of_target = corners.mean(axis=1)
    mm_per_mm = np.linalg.lstsq(q - middle, of_target - of_target.mean(axis=0), rcond=_NOT_MOVED)[0].T
    motion = _Motion(corners.mean(axis=0), mm_per_mm, middle)
    for own, place in zip(corners, q, strict=True):
        expected = motion.corners_mm + mm_per_mm @ (place - middle)
        for there, here in zip(_projected(rig, own), _projected(rig, expected), strict=True):
            side = np.linalg.norm(there - np.roll(there, 1, axis=0), axis=1).mean()
            if not np.abs(there - here).max() < _NEAR * side:
                return None
    return motion


def _projected(rig: Rig, points_mm: Array) -> tuple[Array, Array]:
    """Distorted pixels of points (n, 3) of the left camera's frame in both pictures, (n, 2) each."""
    pose = rig.right_from_left
    in_right = points_mm @ pose.R.T + pose.t_mm
    with np.errstate(all="ignore"):
        left, right = (points[:, :2] / points[:, 2:] for points in (points_mm, in_right))
        return rig.left.pixel_from_normalised(left), rig.right.pixel_from_normalised(right)


def sessions_of(frames: pl.DataFrame) -> npt.NDArray[np.int64]:
    """Give the session of each frame, by number."""
    if "session" not in frames.columns:
        return np.zeros(len(frames), dtype=np.int64)
    names = frames["session"].cast(pl.String).fill_null("").to_list()
    numbers = {name: number for number, name in enumerate(dict.fromkeys(names))}
    return np.array([numbers[name] for name in names], dtype=np.int64)
