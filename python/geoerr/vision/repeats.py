"""Frames whose pictures are those of another frame: no second measurement, whatever they are called.

The noise of a camera is never the same twice. A camera that delivers a picture again, a copy, and a row that names
the files of another one all look alike, and are no more than the one measurement that they hold.
"""

from __future__ import annotations

import zlib
from collections.abc import Mapping, Sequence

import numpy as np
import numpy.typing as npt
import polars as pl

from geoerr.machine import AXES


def digest_of(left: npt.NDArray[np.uint8], right: npt.NDArray[np.uint8]) -> int:
    """Give a number of 64 bits that tells a frame's two pictures from those of every other frame."""
    of_left, of_right = (zlib.crc32(np.ascontiguousarray(picture).data) for picture in (left, right))
    return of_left << 32 | of_right


def repeated_frames(frames: pl.DataFrame, digests: Mapping[int, int]) -> dict[int, str]:
    """Tell which frames give no measurement of their own, and why.

    Parameters
    ----------
    frames
        With `left`, `file_row`, and `x`, `y` and `z` in every row.
    digests
        Of the rows whose pictures could be read.

    Returns
    -------
    dict
        Rows to reasons. Of rows that were commanded alike the first keeps its pictures; of others none does.
    """
    rows_of: dict[int, list[int]] = {}
    for row, digest in digests.items():
        rows_of.setdefault(digest, []).append(row)
    why: dict[int, str] = {}
    for rows in rows_of.values():
        if len(rows) > 1:
            why |= _reasons(frames, sorted(rows))
    return dict(sorted(why.items()))


def _reasons(frames: pl.DataFrame, rows: Sequence[int]) -> dict[int, str]:
    places = frames[list(rows)].select(AXES)
    if places.n_unique() == 1:
        return {row: f"its pictures are those of {_name(frames, rows[0])} again" for row in rows[1:]}
    others = {row: _name(frames, rows[1] if row == rows[0] else rows[0]) for row in rows}
    return {
        row: f"its pictures are those of {other}, too, and the positions differ: which one they show cannot be known"
        for row, other in others.items()
    }


def _name(frames: pl.DataFrame, row: int) -> str:
    return f"{frames['left'][row]} (row {frames['file_row'][row]})"
