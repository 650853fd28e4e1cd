"""How measured points depend on the rig: what an error of calibration does to every point at once.

The noise of one frame is in that frame's covariance; an error of calibration moves all points together and does not
average out. `rig_sensitivity` gives each point's derivative, so that `S Σ Sᵀ` with the rig's covariance Σ is what
calibration leaves uncertain, with all the correlations between points.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from geoerr.errors import GeometryError, InputFileError
from geoerr.geometry import triangulate
from geoerr.observations import PIXELS, Observations
from geoerr.vision.camera import project_jacobian
from geoerr.vision.rig import Rig, read_rig
from geoerr.vision.rotation import cross_matrix

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class StereoProjection:
    """Where both cameras see points, with derivatives.

    Attributes
    ----------
    pixel
        (n, 4) distorted u_left, v_left, u_right, v_right.
    by_point
        (n, 4, 3) px/mm.
    by_rig
        (n, 4, p) by the parameters of `Rig.parameter_names`.
    """

    pixel: Array
    by_point: Array
    by_rig: Array


def project_to_both(rig: Rig, points_mm: Array) -> StereoProjection:
    """Project points (n, 3) of the measuring frame into both cameras, with derivatives."""
    n_left, n_right = 4 + len(rig.dist_left), 4 + len(rig.dist_right)
    pose = rig.right_from_left
    turned = points_mm @ pose.R.T
    pixel_left, left_by_point, left_by_camera = project_jacobian(points_mm, rig.left)
    pixel_right, right_by_own, right_by_camera = project_jacobian(turned + pose.t_mm, rig.right)
    by_point = np.concatenate([left_by_point, right_by_own @ pose.R], axis=1)
    by_rig = np.zeros((len(points_mm), 4, n_left + n_right + 6))
    by_rig[:, :2, :n_left] = left_by_camera
    by_rig[:, 2:, n_left : n_left + n_right] = right_by_camera
    by_rig[:, 2:, -6:-3] = -right_by_own @ cross_matrix(turned)
    by_rig[:, 2:, -3:] = right_by_own
    return StereoProjection(np.concatenate([pixel_left, pixel_right], axis=1), by_point, by_rig)


def points_from_pixels(rig: Rig, pixels: Array) -> Array:
    """Triangulate distorted pixels (n, 4) to points (n, 3) in mm; NaN where there is none."""
    left, right = rig.left, rig.right
    return triangulate(
        rig.projection_left_px,
        rig.projection_right_px,
        left.undistorted_pixel_from_normalised(left.normalised_from_pixel(pixels[:, :2])),
        right.undistorted_pixel_from_normalised(right.normalised_from_pixel(pixels[:, 2:])),
    ).points_mm


def rig_sensitivity(rig: Rig, observations: Observations) -> Array:
    """Differentiate every measured point by every parameter of the rig.

    Parameters
    ----------
    rig
        The rig that the observations were measured with.
    observations
        With columns `u_left v_left u_right v_right`.

    Returns
    -------
    ndarray
        (n, 3, p), mm per unit of `rig.parameter_names`; NaN rows where a pixel is absent. 0 in sessions without any
        pixel: another device measured there.

    Raises
    ------
    GeometryError
        where the observations carry no pixels.

    Notes
    -----
    A point X explains its four pixels m: `m = f(X, θ)`, so `dX/dθ = −(AᵀA)⁻¹Aᵀ ∂f/∂θ` with `A = ∂f/∂X`. Verified
    against triangulation with a changed rig (tests/vision/test_sensitivity.py).
    """
    pixels = observations.numbers(*PIXELS)
    if len(pixels) and not np.isfinite(pixels).all(axis=1).any():
        raise GeometryError(
            "the observations have no pixels (u_left v_left u_right v_right): how they depend on the rig is unknown\n"
            "hint: `geoerr measure` writes them; without them leave the rig out"
        )
    sensitivity = sensitivity_of_points(rig, points_from_pixels(rig, pixels))
    session = np.asarray(observations.texts("session"))
    seen = np.unique(session[np.isfinite(pixels).any(axis=1)])
    sensitivity[~np.isin(session, seen)] = 0.0
    return sensitivity


def calibration_of_points(rig: Path, observations: Observations) -> tuple[Array, Array]:
    """Read how sure a calibration is: how it moves the points, (n, 3, p), and its covariance, (p, p).

    Raises
    ------
    InputFileError
        for a rig whose file states no covariance.
    GeometryError
        where the points have no pixels.
    """
    described = read_rig(rig)
    if described.covariance is None:
        raise InputFileError(
            rig,
            "states no covariance: how sure the calibration is, is not known",
            column="covariance",
            remedy="calibrate again with `geoerr calibrate`, or leave the rig out",
        )
    return rig_sensitivity(described, observations), described.covariance


def sensitivity_of_points(rig: Rig, points_mm: Array) -> Array:
    """Give the derivative (n, 3, p) of triangulated points (n, 3) by the rig's parameters, pixels held."""
    result = np.full((len(points_mm), 3, len(rig.parameter_names)), np.nan)
    known = np.isfinite(points_mm).all(axis=1)
    seen = project_to_both(rig, points_mm[known])
    transposed = seen.by_point.transpose(0, 2, 1)
    result[known] = -np.linalg.solve(transposed @ seen.by_point, transposed @ seen.by_rig)
    return result
