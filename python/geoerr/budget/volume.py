"""The budget as a map: uncertainty over a grid of the volume."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from geoerr.budget.budget import Budget
from geoerr.budget.places import grid_axes_mm, grid_of
from geoerr.errors import ShapeError
from geoerr.model.arrays import Numbers
from geoerr.model.called import kind_of


@dataclass(frozen=True, eq=False)
class UncertaintyMap:
    """Error and uncertainty on a grid, (nx, ny, nz) each, µm; NaN where the data do not determine the error.

    Attributes
    ----------
    x_mm, y_mm, z_mm
        The grid.
    is_determined
        Where all three components of the error are determined.
    error_um
        Length of the predicted error: what a part has without compensation.
    prediction_um
        Standard uncertainty of that prediction (root of the sum of the three variances).
    part_um
        Standard uncertainty of a compensated part.
    part_95_um
        The length that a compensated part's error stays below with 95 %.
    """

    x_mm: Numbers
    y_mm: Numbers
    z_mm: Numbers
    is_determined: npt.NDArray[np.bool_]
    error_um: Numbers
    prediction_um: Numbers
    part_um: Numbers
    part_95_um: Numbers


def uncertainty_map(budget: Budget, n: int | tuple[int, int, int] = 11) -> UncertaintyMap:
    """Evaluate a budget on a grid of the volume.

    Parameters
    ----------
    n
        Places along each edge, or along X, Y and Z, from end to end; a single one is in the middle.

    Raises
    ------
    ShapeError
        for what is no budget, or no number of places.
    """
    if not isinstance(budget, Budget):
        raise ShapeError(
            f"{kind_of(budget)} was given where a budget is needed\nhint: uncertainty_map(uncertainty_budget(model))"
        )
    axes = grid_axes_mm(budget.model, n)
    on_grid = budget.at_places(grid_of(*axes))
    shape = tuple(len(axis) for axis in axes)
    error_mm = budget.predictor.error_mm(on_grid.q_mm)
    is_determined = on_grid.is_determined.all(axis=1)
    length_um = np.where(is_determined, np.linalg.norm(error_mm, axis=1) * 1e3, np.nan)
    return UncertaintyMap(
        *axes,
        is_determined.reshape(shape),
        length_um.reshape(shape),
        on_grid.standard_length_um("prediction").reshape(shape),
        on_grid.standard_length_um("part").reshape(shape),
        on_grid.expanded_length_um("part").reshape(shape),
    )
