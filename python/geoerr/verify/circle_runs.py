"""The runs of a circular test: what was run once, in one sense at one feed."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import numpy.typing as npt
import polars as pl

from geoerr.errors import GeometryError
from geoerr.verify.circle import PLANES, fit_circle, plane_of

Numbers = npt.NDArray[np.float64]

# Below a quarter turn centre and radius of the set-up take most of the signal with them.
LEAST_ARC_RAD = math.pi / 2.0
# Centre and radius of the set-up alone take three.
FEWEST_ROWS = 4
# Rows that stand further apart than this, in the median, stand in no order along the circle.
_LARGEST_STEP_RAD = math.pi / 4.0


def runs_of(frame: pl.DataFrame) -> list[tuple[str, pl.DataFrame]]:
    """Give the runs of a circular test by name: rows of one line, repeat, sense and feed, by time."""
    keys: list[str] = [name for name in ("session", "line", "repeat", "dir") if name in frame.columns]
    if "feed" in frame.columns and _has_several_feeds(frame, keys):
        keys.append("feed")
    runs = []
    parts = frame.partition_by(keys, maintain_order=True, as_dict=True) if keys else {(): frame}
    for values, part in parts.items():
        words = [
            str(value) if key == "line" else f"{key} {value}"
            for key, value in zip(keys, values, strict=True)
            if value is not None and key != "dir"
        ]
        ordered = part.sort("t", maintain_order=True) if "t" in part.columns and not part["t"].null_count() else part
        runs += [(", ".join(words) or "the run", one) for one in _by_sense(ordered)]
    return runs


def _by_sense(frame: pl.DataFrame) -> list[pl.DataFrame]:
    """Cut rows that state no sense where the motion turns round: play shows otherwise in each of the two.

    A step back of less than the shortest arc is none; rows in no order have no sense.
    """
    states_it = "dir" in frame.columns and frame["dir"][0] is not None
    turned_rad = None if states_it or len(frame) < FEWEST_ROWS else _turned_rad(frame)
    if turned_rad is None or np.median(np.abs(np.diff(turned_rad))) > _LARGEST_STEP_RAD:
        return [frame]
    cuts = [0, *_turns(turned_rad), len(frame)]
    return [frame[begin:end] for begin, end in pairwise(cuts)]


def _turned_rad(frame: pl.DataFrame) -> Numbers | None:
    """Give how far the motion has turned about the circle's centre at each row, (n,); None without a circle."""
    commanded = frame.select("x", "y", "z").to_numpy().astype(np.float64)
    first, second, _ = PLANES[plane_of(commanded)]
    in_plane = commanded[:, [first, second]]
    try:
        from_centre = in_plane - fit_circle(in_plane).center_mm
    except GeometryError:
        return None
    return np.unwrap(np.arctan2(from_centre[:, 1], from_centre[:, 0]))


def _turns(turned_rad: Numbers) -> list[int]:
    """Give the first row behind each place at which an angle (n,) goes back by the shortest arc or more."""
    turns: list[int] = []
    sense, furthest = 0.0, 0
    for row, value in enumerate(turned_rad):
        gone = value - turned_rad[furthest]
        if sense == 0.0 and abs(gone) >= LEAST_ARC_RAD:
            sense, furthest = math.copysign(1.0, gone), row
        elif sense * gone > 0.0:
            furthest = row
        elif sense * gone <= -LEAST_ARC_RAD:
            turns.append(furthest + 1)
            sense, furthest = -sense, row
    return turns


def _has_several_feeds(frame: pl.DataFrame, keys: Sequence[str]) -> bool:
    runs = frame.partition_by(keys, maintain_order=True) if keys else [frame]
    return any(run["feed"].n_unique() > 1 for run in runs)
