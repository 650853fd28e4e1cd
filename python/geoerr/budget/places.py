"""Places of the volume: corners, centre, and a grid."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np

from geoerr.errors import GeometryError, ShapeError
from geoerr.machine import AXES
from geoerr.model import Model
from geoerr.model.arrays import Numbers

# A place this near to the end of a range is at it.
_AT_THE_END_MM = 1e-6


def volume_mm(model: Model) -> tuple[Numbers, Numbers]:
    """Give the box (low (3,), high (3,)) that is inside the machine's range and the measured one."""
    measured = model.measured_range_mm
    low, high = np.empty(3), np.empty(3)
    for number, axis in enumerate(AXES):
        first, last = model.machine.axes[axis].range_mm
        own = measured[axis] or (first, last)
        low[number], high[number] = max(first, own[0]), min(last, own[1])
    if (low > high).any():
        raise GeometryError("the measured ranges of the errors do not overlap: there is no volume")
    return low, high


def stated_places(model: Model) -> dict[str, Numbers]:
    """Give the eight corners and the centre of the volume by name."""
    low, high = volume_mm(model)
    corners = {}
    for ends in itertools.product((0, 1), repeat=3):
        name = "corner " + "".join("+" if end else "−" for end in ends)
        corners[name] = np.where(np.array(ends) == 1, high, low)
    return {**corners, "centre": 0.5 * (low + high)}


def grid_axes_mm(model: Model, n: int | tuple[int, int, int]) -> tuple[Numbers, Numbers, Numbers]:
    """Give positions along X, Y and Z, spread evenly over the volume from end to end; a single one is the middle.

    Raises
    ------
    ShapeError
        for what is no number of places along each edge.
    """
    counts = _counts(n)
    low, high = volume_mm(model)
    x, y, z = (
        np.linspace(a, b, count) if count > 1 else np.array([0.5 * (a + b)])
        for a, b, count in zip(low, high, counts, strict=True)
    )
    return x, y, z


def _counts(n: object) -> tuple[int, ...]:
    given = tuple(n) if isinstance(n, Sequence | np.ndarray) else (n, n, n)
    counts = tuple(int(one) for one in given if isinstance(one, int | np.integer) and one >= 1)
    if len(given) != 3 or len(counts) != 3:
        raise ShapeError(
            f"n is {n!r}\nhint: write how many places there are along each edge of the volume, a whole number from 1 "
            "on, or three of them, for X, Y and Z"
        )
    return counts


def grid_of(x_mm: Numbers, y_mm: Numbers, z_mm: Numbers) -> Numbers:
    """Give all places (n, 3) of a grid; z changes fastest."""
    return np.stack(np.meshgrid(x_mm, y_mm, z_mm, indexing="ij"), axis=-1).reshape(-1, 3)


def outside_measured(model: Model, names: Sequence[str], q_mm: Numbers) -> tuple[str, ...]:
    """Say of each axis which places (n, 3) are outside the measured range, and how far: nothing where none is.

    An axis that stood is left out: away from there nothing is determined, and no number is stated.
    """
    sentences = []
    for axis, along_mm in zip(AXES, q_mm.T, strict=True):
        measured = None if axis in model.stood_mm else model.measured_range_mm[axis]
        if measured is None:
            continue
        low, high = measured
        beyond_mm = np.maximum(low - along_mm, along_mm - high)
        outside = np.flatnonzero(beyond_mm > _AT_THE_END_MM)
        if outside.size:
            farthest = outside[np.argmax(beyond_mm[outside])]
            more = f" (and {outside.size - 1} more)" if outside.size > 1 else ""
            sentences.append(
                f"{names[farthest]}{more}: {axis} = {along_mm[farthest]:g} is extrapolated: "
                f"{beyond_mm[farthest]:.3g} mm outside the measured range ({low:g} to {high:g} mm): whether the "
                "errors go on like that"
            )
    return tuple(sentences)
