"""Eight-node elements fitted to scattered errors: what one-dimensional elements are compared with."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from geoerr import _core
from geoerr.errors import GeometryError, ShapeError
from geoerr.geometry import unmasked

Numbers = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class HexahedronFit:
    """A grid of eight-node elements with an error at each node.

    Attributes
    ----------
    grid_mm
        Positions of the grid lines along x, y and z.
    nodal_error : (n_nodes, c)
        c components at node `(i·n_y + j)·n_z + k`; NaN where the data do not determine it.
    """

    grid_mm: tuple[Numbers, Numbers, Numbers]
    nodal_error: Numbers

    def evaluate(self, position_mm: npt.ArrayLike) -> Numbers:
        """Give the error (n, c) at positions (n, 3): outside that of the nearest point, NaN beside unknown nodes."""
        rows = _core.Hexahedra(*self.grid_mm).evaluate(_points(position_mm))
        known = np.all(np.isfinite(self.nodal_error), axis=1)
        error: Numbers = rows @ np.where(known[:, None], self.nodal_error, 0.0)
        error[np.any(rows[:, ~known] != 0.0, axis=1)] = np.nan
        return error


def fit_hexahedra(
    position_mm: npt.ArrayLike, error: npt.ArrayLike, grid_mm: Sequence[npt.ArrayLike]
) -> HexahedronFit:
    """Fit the errors at the nodes of a grid to errors anywhere by least squares.

    Parameters
    ----------
    position_mm : (n, 3)
        Where errors were measured.
    error : (n, c)
        Errors there, equally certain.
    grid_mm
        Rising positions of the grid lines along x, y and z, at least two each.

    Raises
    ------
    ShapeError
        for arrays that do not fit each other.
    GeometryError
        for grid lines that do not rise, and positions or errors that are not finite; the message names the first row.
    """
    points = _points(position_mm)
    errors = np.asarray(unmasked(error, "error"), dtype=np.float64)
    if errors.ndim != 2 or len(errors) != len(points):
        raise ShapeError(f"error has shape {errors.shape}, ({len(points)}, c) is needed")
    if len(grid_mm) != 3:
        raise ShapeError(f"{len(grid_mm)} lists of grid lines: one along each of x, y and z is needed")
    x, y, z = (np.ascontiguousarray(lines, dtype=np.float64) for lines in grid_mm)
    _refuse_not_finite(points, errors)
    rows = _core.Hexahedra(x, y, z).evaluate(points)
    # The right vectors are whole where there are as many points as nodes; the left ones would take n² numbers.
    left, singular, right = np.linalg.svd(rows, full_matrices=len(rows) < rows.shape[1])
    rank = int((singular > 1e-10 * singular.max(initial=0.0)).sum())
    nodal = right[:rank].T @ ((left[:, :rank].T @ errors) / singular[:rank, None])
    free = np.sqrt((right[rank:] ** 2).sum(axis=0)) > 1e-6
    nodal[free] = np.nan
    return HexahedronFit((x, y, z), nodal)


def _refuse_not_finite(points: Numbers, errors: Numbers) -> None:
    """Refuse a point that is not there: every node would hang on it."""
    for name, values in (("position_mm", points), ("error", errors)):
        bad = np.flatnonzero(~np.isfinite(values).all(axis=1))
        if bad.size:
            row = bad[0]
            others = f" (and {bad.size - 1} more)" if bad.size > 1 else ""
            raise GeometryError(
                f"{name}[{row}] is {values[row].tolist()}{others}: not finite\n"
                "hint: leave such points out, of position_mm and of error"
            )


def _points(position_mm: npt.ArrayLike) -> Numbers:
    points = np.ascontiguousarray(unmasked(position_mm, "position_mm"), dtype=np.float64)
    if points.ndim != 2 or points.shape[1] != 3:
        raise ShapeError(f"position_mm has shape {points.shape}, (n, 3) is needed")
    return points
