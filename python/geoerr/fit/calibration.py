"""What a calibration leaves uncertain, as unknowns of a fit that it holds: all its points move together by them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from geoerr.errors import GeometryError, ShapeError
from geoerr.fit.sightings import SEE_POSITIONS, Numbers, Sightings
from geoerr.observations import MeasuredTable, Observations

# Round-off of a covariance, as a share of its largest element or eigenvalue.
_ROUND_OFF = 1e-9
# Directions that a calibration knows to this share of its least known one are known.
_KNOWN = 1e-14
_WHENCE = "give rig_sensitivity(rig, observations) of the same observations, and rig.covariance"


@dataclass(frozen=True, eq=False)
class CalibrationUnknowns:
    """Unknowns that rows share: derivative (n, 3, p) in the measuring frames; how many are known to be 0 ± 1."""

    derivative: Numbers
    n_held: int


def checked_calibration(
    sensitivity: npt.ArrayLike | None, covariance: npt.ArrayLike | None, n_rows: int
) -> tuple[Numbers, Numbers] | None:
    """Give how a calibration moves points, (n, 3, p), and its covariance, (p, p); None where there is none.

    Raises
    ------
    ShapeError
        where one of them is missing, of another shape, or no covariance: it would count for nothing, or for another.
    """
    if sensitivity is None and covariance is None:
        return None
    if sensitivity is None or covariance is None:
        raise ShapeError(
            f"rig_sensitivity and rig_covariance belong together: one of them is missing\nhint: {_WHENCE}"
        )
    moved, known = np.asarray(sensitivity, dtype=np.float64), np.asarray(covariance, dtype=np.float64)
    if known.ndim != 2 or known.shape[0] != known.shape[1]:
        raise ShapeError(f"rig_covariance has shape {known.shape}, a square matrix is needed\nhint: {_WHENCE}")
    if moved.shape != (n_rows, 3, len(known)):
        raise ShapeError(
            f"rig_sensitivity has shape {moved.shape}, ({n_rows}, 3, {len(known)}) is needed\nhint: {_WHENCE}"
        )
    why = _no_covariance(known)
    if why:
        raise ShapeError(f"rig_covariance is no covariance: {why}\nhint: {_WHENCE}")
    return moved, known


def _no_covariance(matrix: Numbers) -> str:
    if not np.isfinite(matrix).all():
        return "it has elements that are no finite numbers"
    if not np.allclose(matrix, matrix.T, rtol=0.0, atol=_ROUND_OFF * float(np.abs(matrix).max(initial=0.0))):
        return "it is not symmetric"
    values = np.linalg.eigvalsh(matrix)
    if values.min(initial=0.0) < -_ROUND_OFF * float(np.abs(values).max(initial=0.0)):
        return f"it has a negative eigenvalue, {values.min():.3g}"
    return ""


def calibration_unknowns(
    tables: Sequence[MeasuredTable],
    sightings: Sightings,
    rig_sensitivity: npt.ArrayLike | None,
    rig_covariance: npt.ArrayLike | None,
) -> CalibrationUnknowns | None:
    """Bring the calibration's uncertainty into unknowns of unit variance: S Σ Sᵀ = (S F)(S F)ᵀ with Σ = F Fᵀ.

    The sensitivity (n, 3, p) is that of the rows of the one table of points; radii and lengths know no camera.

    Raises
    ------
    ShapeError
        as `checked_calibration`.
    GeometryError
        for several tables of points, or rows whose part is not known.
    """
    if rig_sensitivity is None and rig_covariance is None:
        return None
    points = [table for table in tables if isinstance(table, Observations)]
    if len(points) != 1:
        raise GeometryError("the calibration's uncertainty can be taken along for one table of points only")
    checked = checked_calibration(rig_sensitivity, rig_covariance, len(points[0]))
    assert checked is not None
    moved, known = checked
    value, vector = np.linalg.eigh(known)
    keep = value > max(float(value.max(initial=0.0)), 0.0) * _KNOWN
    root = vector[:, keep] * np.sqrt(value[keep])
    is_point = sightings.of_kind(*SEE_POSITIONS)
    derivative = np.zeros((len(sightings), 3, root.shape[1]))
    derivative[is_point] = moved[sightings.source_row[is_point]] @ root
    if not np.isfinite(derivative).all():
        raise GeometryError(
            "some rows of a session that cameras saw have no pixels, so that the calibration's part in their "
            "uncertainty is unknown\nhint: leave --rig out, or leave these rows out"
        )
    return CalibrationUnknowns(derivative, int(keep.sum()))
