"""The calibration of the camera pair as one source: one error for all points, by groups of the rig's parameters."""

from __future__ import annotations

import math

import numpy as np

from geoerr.budget.estimator import Estimator, root_of
from geoerr.budget.source import Piece, Source
from geoerr.errors import GeometryError
from geoerr.model.arrays import Numbers
from geoerr.vision.camera import INTRINSIC_NAMES
from geoerr.vision.rig import Rig
from geoerr.vision.sensitivity import project_to_both, sensitivity_of_points

_WHAT = "calibration of the camera pair (one error for all points)"


def calibration_source(estimator: Estimator, rig: Rig | None, dof: float) -> Source | None:
    """Give the calibration's part; None where neither a rig is given nor the fit was told of a calibration.

    Parameters
    ----------
    rig
        Its frame, the left camera's, is the measuring frame, so that measured positions are all that it takes. None:
        the part that the fit holds, without groups.
    dof
        Degrees of freedom of its covariance.
    """
    if rig is None:
        if not estimator.is_calibration.any():
            return None
        return Source("calibration", _WHAT, "A", "normal", math.nan, "", dof, by_parameter=estimator.of_calibration())
    if rig.covariance is None:
        raise GeometryError("the rig states no covariance: what its calibration leaves uncertain is not known")
    fitted = estimator.fitted
    rows = fitted.sightings.is_measured.all(axis=1)
    displacement = np.zeros((len(fitted.sightings), 3, len(rig.parameter_names)))
    displacement[rows] = sensitivity_of_points(rig, fitted.sightings.measured_mm[rows])
    if not np.isfinite(displacement).all():
        raise GeometryError(
            "some points are not before both cameras of the rig: it is not the one that they were measured with"
        )
    by_rig = estimator.of_displacements(displacement)
    root = root_of(rig.covariance)
    pieces = {
        name: Piece(by_rig @ projector @ root, *_size(projector @ rig.covariance @ projector.T, name, rig))
        for name, projector in _groups(rig).items()
    }
    return Source("calibration", _WHAT, "A", "normal", math.nan, "", dof, by_parameter=by_rig @ root, pieces=pieces)


def point_in_pixels(rig: Rig, points_mm: Numbers, covariance_mm2: Numbers) -> Numbers:
    """Give the standard uncertainty (n,) of one picture coordinate that makes the points' covariances, px.

    Four coordinates of σ each leave `F C Fᵀ = σ² P`, P a projector of rank 3 and F the projection's derivative.
    """
    by_point = project_to_both(rig, points_mm).by_point
    seen = by_point @ covariance_mm2 @ by_point.transpose(0, 2, 1)
    return np.asarray(np.sqrt(np.trace(seen, axis1=1, axis2=2) / 3.0))


def _groups(rig: Rig) -> dict[str, Numbers]:
    """Give projectors (p, p) on groups of the rig's parameters; they add up to 1."""
    names = rig.parameter_names
    is_intrinsic = np.array([name.partition("_")[2] in INTRINSIC_NAMES for name in names])
    n_cameras = len(names) - 6
    is_camera = np.arange(len(names)) < n_cameras
    turn = (np.arange(len(names)) >= n_cameras) & (np.arange(len(names)) < n_cameras + 3)
    along = np.zeros(len(names))
    along[-3:] = rig.right_from_left.t_mm / rig.baseline_mm
    shift = np.diag((~is_camera & ~turn).astype(np.float64))
    baseline = np.outer(along, along)
    return {
        "intrinsics": np.diag(is_intrinsic.astype(np.float64)),
        "distortion": np.diag((is_camera & ~is_intrinsic).astype(np.float64)),
        "turn of the right camera": np.diag(turn.astype(np.float64)),
        "direction of the baseline": shift - baseline,
        "length of the baseline (scale)": baseline,
    }


def _size(covariance: Numbers, name: str, rig: Rig) -> tuple[float, str]:
    """Give a group's own standard uncertainty: root mean square of its parameters where they are of one unit."""
    variance = np.diagonal(covariance)
    if name == "distortion":
        return math.nan, ""
    if name == "intrinsics":
        return float(np.sqrt(np.mean(variance[variance > 0.0]))) if variance.any() else 0.0, "px"
    total = float(np.sqrt(max(variance.sum(), 0.0)))
    if name.startswith("turn"):
        return total * 1e6, "µrad"
    return total / rig.baseline_mm * 1e6, "µrad" if name.startswith("direction") else "10⁻⁶"
