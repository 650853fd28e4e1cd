"""From the uncertainty of points to that of results: C_result = A C_points Aᵀ + (A J) C_rig (A J)ᵀ.

A is the linear operator that every result carries (`geoerr.identify.linear`). The points' own covariances are
independent between rows. The calibration's part J C_rig Jᵀ is shared by all rows, fully correlated. Where repeats or
redundant targets scatter significantly more than the covariances say, these are scaled (Birge); where none are
stated, repeats tell them.

Not counted: the uncertainty of target offsets and of commanded positions.

Verified by Monte-Carlo (ratio of standard deviations, 95 % coverage): tests/identify/test_monte_carlo.py.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from geoerr.distributions import chi_squared_sf, never_zero
from geoerr.identify.along import Scatter
from geoerr.identify.linear import Indices, Linear, Numbers
from geoerr.identify.measurements import Measurements
from geoerr.identify.passes import SAME_POSITION_MM, Pass

# Probability below which more scatter than stated is not chance.
_SIGNIFICANCE = 0.01
# Degrees of freedom from which repeats tell a 3×3 covariance usably (relative error of a standard deviation √(1/2ν)).
LEAST_DOF_OF_REPEATS = 12


@dataclass(frozen=True)
class AxisScatter:
    """How the points of one axis's lines scatter about the solution.

    Attributes
    ----------
    axis
        `x`, `y` or `z`.
    dof
        Degrees of freedom: data that repeats and redundant targets give beyond what is needed.
    rms_mm
        Root mean square residual, scaled to its degrees of freedom.
    chi_squared_per_dof
        None where no uncertainty is stated.
    p_value
        Of so much scatter by chance.
    birge_ratio
        What the stated uncertainties were multiplied by: 1 where the scatter is no larger than they say.
    """

    axis: str
    dof: int
    rms_mm: float | None
    chi_squared_per_dof: float | None
    p_value: float | None
    birge_ratio: float


@dataclass(frozen=True)
class Noise:
    """Covariances of the measured points.

    Attributes
    ----------
    rows_mm2 : (n, 3, 3) or None
        Of each row; None where nothing is known.
    sensitivity : (n, 3, p) or None
        Derivative of each row's position by the calibration's parameters.
    rig : (p, p) or None
        Their covariance.
    """

    rows_mm2: Numbers | None
    sensitivity: Numbers | None = None
    rig: Numbers | None = None

    def covariance_of(self, quantity: Linear) -> Numbers | None:
        """Give the covariance (n, n) of a quantity, None where the points' is unknown."""
        if self.rows_mm2 is None:
            return None
        operator = quantity.operator
        weighted = np.matmul(operator.transpose(1, 0, 2), self.rows_mm2[quantity.rows])
        covariance = np.asarray(np.einsum("kni,mki->nm", weighted, operator, optimize=True))
        if self.sensitivity is not None and self.rig is not None:
            shared = np.einsum("nki,kip->np", operator, self.sensitivity[quantity.rows], optimize=True)
            covariance = covariance + shared @ self.rig @ shared.T
        return covariance

    def std_of(self, quantity: Linear) -> Numbers | None:
        """Give the standard uncertainties (n,), None where the points' are unknown."""
        covariance = self.covariance_of(quantity)
        if covariance is None:
            return None
        return np.sqrt(np.maximum(np.diag(covariance), 0.0))


def axis_scatter(axis: str, stages: Sequence[Scatter], is_stated: bool) -> AxisScatter:
    """Judge the scatter of one axis's stages together."""
    dof = sum(stage.dof for stage in stages)
    if dof == 0:
        return AxisScatter(axis, 0, None, None, None, 1.0)
    n_residuals = sum(stage.n_residuals for stage in stages)
    mean_square = sum(stage.sum_of_squares_mm2 for stage in stages) / n_residuals
    rms = float(np.sqrt(mean_square * n_residuals / dof))
    if not is_stated:
        return AxisScatter(axis, dof, rms, None, None, 1.0)
    expected = sum(stage.expected for stage in stages)
    ratio = sum(stage.chi_squared for stage in stages) / expected
    p_value = never_zero(float(chi_squared_sf(ratio * dof, dof)))
    birge = float(np.sqrt(ratio)) if ratio > 1.0 and p_value < _SIGNIFICANCE else 1.0
    return AxisScatter(axis, dof, rms, ratio, p_value, birge)


def scaled(covariance_mm2: Numbers, passes: Sequence[Pass], scatter: dict[str, AxisScatter]) -> Numbers:
    """Multiply the covariances of each axis's rows by the square of its Birge ratio."""
    factor = np.ones(len(covariance_mm2))
    for one in passes:
        factor[one.rows] = np.maximum(factor[one.rows], scatter[one.axis].birge_ratio ** 2)
    return np.asarray(covariance_mm2 * factor[:, None, None])


def covariance_from_repeats(data: Measurements, passes: Sequence[Pass]) -> tuple[Numbers | None, int]:
    """Estimate one 3×3 covariance in the measuring frame from points that were visited again.

    Points are compared with those of the same target and place in other passes of the same session, each pass with
    its own constant. Both directions of approach count as repeats, so that reversal is part of the scatter.

    Returns
    -------
    covariance_mm2 : (n, 3, 3) or None
        The same for every row; None below `LEAST_DOF_OF_REPEATS` degrees of freedom.
    dof
        Degrees of freedom found.
    """
    total = np.zeros((3, 3))
    # Counted for each pair of components, because not every session need measure all of them.
    dof = np.zeros((3, 3), dtype=np.int64)
    for members in _repeated(passes):
        seen = np.array(passes[members[0]].components)
        residual, found = _residuals_of_repeats(data, [passes[number] for number in members])
        total += residual.T @ residual
        dof += found * np.outer(seen, seen)
    measured = np.diag(dof)[np.any([one.components for one in passes], axis=0)]
    fewest = int(measured.min())
    if fewest < LEAST_DOF_OF_REPEATS:
        return None, fewest
    return np.tile(total / np.maximum(dof, 1), (len(data.measured_mm), 1, 1)), fewest


def _repeated(passes: Sequence[Pass]) -> list[list[int]]:
    """Group passes of one session that show the same target on the same path."""
    groups: dict[tuple[object, ...], list[int]] = {}
    for number, one in enumerate(passes):
        parked = np.round(np.delete(one.parked_mm, one.index) / SAME_POSITION_MM).astype(np.int64)
        place = np.round(one.place_mm / SAME_POSITION_MM).astype(np.int64)
        path = (*parked.tolist(), *place.tolist())
        key = (one.session, one.axis, one.carrier, one.target, one.components, path)
        groups.setdefault(key, []).append(number)
    return list(groups.values())


def _residuals_of_repeats(data: Measurements, passes: Sequence[Pass]) -> tuple[Numbers, int]:
    rows: Indices = np.concatenate([one.rows for one in passes])
    position = np.concatenate([one.position_mm for one in passes])
    number = np.repeat(np.arange(len(passes)), [len(one.rows) for one in passes])
    _, cell = np.unique(np.round(position / SAME_POSITION_MM), return_inverse=True)
    design = np.hstack([np.eye(int(cell.max()) + 1)[cell], np.eye(len(passes))[number]])
    points = np.nan_to_num(data.measured_mm[rows])
    points = points - points.mean(axis=0)
    u, s, _ = np.linalg.svd(design, full_matrices=False)
    basis = u[:, s > 1e-9 * s[0]]
    return np.asarray(points - basis @ (basis.T @ points)), len(rows) - basis.shape[1]
