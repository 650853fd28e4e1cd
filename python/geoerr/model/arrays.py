"""Arrays and other arguments as the core takes them."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from geoerr.errors import ShapeError

Numbers = npt.NDArray[np.float64]
Triple = tuple[float, float, float]


def contiguous(values: npt.ArrayLike) -> Numbers:
    """Give C-contiguous float64, without a copy where it is that already."""
    return np.ascontiguousarray(values, dtype=np.float64)


def points(values: npt.ArrayLike, name: str) -> Numbers:
    """Give (n, 3).

    Raises
    ------
    ShapeError
        naming the argument.
    """
    array = as_numbers(values, name)
    if array.ndim != 2 or array.shape[1] != 3:
        raise ShapeError(f"{name} must be (n, 3), not {array.shape}")
    return array


def offsets(values: npt.ArrayLike | None, n_rows: int) -> Numbers:
    """Give (1, 3), one offset for all rows, or (n, 3).

    Raises
    ------
    ShapeError
        for another shape.
    """
    if values is None:
        return np.zeros((1, 3))
    array = as_numbers(values, "offset_mm")
    if array.shape == (3,):
        return array.reshape(1, 3)
    if array.shape != (n_rows, 3):
        raise ShapeError(f"offset_mm must be (3,) or ({n_rows}, 3), not {array.shape}")
    return array


def triple_mm(values: npt.ArrayLike, name: str) -> Triple:
    """Give a place or an offset.

    Raises
    ------
    ShapeError
        naming the argument, for what is not three finite numbers.
    """
    try:
        array = as_numbers(values, name)
    except ShapeError:
        array = np.empty(0)
    if array.shape != (3,) or not np.isfinite(array).all():
        raise ShapeError(f"{name} is {values!r}\nhint: give three finite numbers, x, y and z in mm")
    x, y, z = array.tolist()
    return x, y, z


def as_numbers(values: npt.ArrayLike, name: str) -> Numbers:
    """Give contiguous float64.

    Raises
    ------
    ShapeError
        naming the argument, for what is no array of numbers.
    """
    try:
        return contiguous(values)
    except (TypeError, ValueError) as error:
        raise ShapeError(f"{name} is not an array of numbers: {error}") from error
