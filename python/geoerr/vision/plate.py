"""A square plate in space from its four corners in two pictures.

Four corners of a printed square are a parallelogram: centre, and two half sides. Fitted to all sixteen pixel numbers
with their full covariances, that gives the centre about a fifth better across and a tenth better in depth than the
mean of four corners triangulated one by one, and needs no belief in the printed size: side lengths and the right
angle come out as measured.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from geoerr.geometry import triangulate
from geoerr.vision.rig import Rig
from geoerr.vision.sensitivity import StereoProjection, project_to_both

Array = npt.NDArray[np.float64]

# Corner k = centre + SIGNS[k, 0] · half side along + SIGNS[k, 1] · half side down.
_SIGNS = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
N_RESIDUALS = 7
"""Sixteen pixel numbers less nine of the parallelogram."""

_STEPS = 3
_FLOOR_PX = 1e-4


@dataclass(frozen=True, eq=False)
class SeenPlates:
    """Corners of n plates in both pictures.

    Attributes
    ----------
    left_px, right_px
        (n, 4, 2) undistorted pixels.
    left_covariance_px2, right_covariance_px2
        (n, 8, 8)
    """

    left_px: Array
    left_covariance_px2: Array
    right_px: Array
    right_covariance_px2: Array


@dataclass(frozen=True, eq=False)
class Plates:
    """Plates in the measuring frame; NaN where `why` says something.

    Attributes
    ----------
    centre_mm
        (n, 3)
    covariance_mm2
        (n, 3, 3) of the centre, from the pictures' noise.
    sides_mm
        (n, 2) lengths of the two sides.
    side_std_mm
        (n,) standard uncertainty of their mean, from the pictures' noise.
    along
        (n, 3) unit vectors along the first side.
    right_angle_error_rad
        (n,) how far the angle between them is from a right one.
    whitened_residual
        (n, 7) what the parallelogram leaves: independent with variance 1 if the covariances are right.
    whitened_by_rig
        (n, 7, p) its derivative by the rig's parameters.
    reprojection_px
        (n,) root mean square distance of the eight corners in the pictures from the fitted ones.
    why
        '' or the reason why a plate has no place.
    """

    centre_mm: Array
    covariance_mm2: Array
    sides_mm: Array
    side_std_mm: Array
    along: Array
    right_angle_error_rad: Array
    whitened_residual: Array
    whitened_by_rig: Array
    reprojection_px: Array
    why: tuple[str, ...]


def locate_plates(rig: Rig, seen: SeenPlates, threads: int = 0) -> Plates:
    """Fit a parallelogram in space to each plate's corners in both pictures.

    Notes
    -----
    Start: the four corners, each by two-view least squares (Li et al. 2023, Eqs. 3–5). Then Gauss–Newton on
    `Σ rᵀ C⁻¹ r` over the distorted pixels, C the two 8×8 covariances. Verified by Monte-Carlo
    (tests/vision/test_plate.py).
    """
    n_plates, n_parameters = len(seen.left_px), len(rig.parameter_names)
    corners = triangulate(
        rig.projection_left_px,
        rig.projection_right_px,
        seen.left_px.reshape(-1, 2),
        seen.right_px.reshape(-1, 2),
        cov_left_px2=_diagonal_blocks(seen.left_covariance_px2),
        cov_right_px2=_diagonal_blocks(seen.right_covariance_px2),
        threads=threads,
    )
    points = corners.points_mm.reshape(n_plates, 4, 3)
    statuses = corners.status.reshape(n_plates, 4)
    known = (statuses == 0).all(axis=1)
    measured, covariance = _distorted(rig, seen)
    known &= np.isfinite(measured).all(axis=1)
    result = Plates(
        centre_mm=np.full((n_plates, 3), np.nan),
        covariance_mm2=np.full((n_plates, 3, 3), np.nan),
        sides_mm=np.full((n_plates, 2), np.nan),
        side_std_mm=np.full(n_plates, np.nan),
        along=np.full((n_plates, 3), np.nan),
        right_angle_error_rad=np.full(n_plates, np.nan),
        whitened_residual=np.full((n_plates, N_RESIDUALS), np.nan),
        whitened_by_rig=np.full((n_plates, N_RESIDUALS, n_parameters), np.nan),
        reprojection_px=np.full(n_plates, np.nan),
        why=(),
    )
    if known.any():
        _fit(rig, points[known], measured[known], covariance[known], result, known)
    placed = np.isfinite(result.reprojection_px)
    why = ("" if ok else _reason(int(row.max())) for ok, row in zip(placed, statuses, strict=True))
    return replace(result, why=tuple(why))


def _fit(
    rig: Rig, points: Array, measured: Array, covariance: Array, result: Plates, known: npt.NDArray[np.bool_]
) -> None:
    """Fill the rows `known` of the result."""
    # A ten-thousandth of a pixel beside the stated uncertainty keeps every covariance invertible.
    whitener = np.linalg.inv(np.linalg.cholesky(covariance + _FLOOR_PX**2 * np.eye(16)))
    plate = np.stack([points.mean(axis=1), *(np.einsum("k,nkc->nc", s, points) / 4.0 for s in _SIGNS.T)], axis=1)
    for _ in range(_STEPS):
        residual, columns, _ = _linearised(rig, plate, measured)
        white = whitener @ columns
        gram = white.transpose(0, 2, 1) @ white
        right = white.transpose(0, 2, 1) @ (whitener @ residual[..., None])
        plate = plate + np.linalg.solve(gram, right).reshape(-1, 3, 3)
    residual, columns, seen = _linearised(rig, plate, measured)
    white = whitener @ columns
    # The part of 16-space that no parallelogram reaches: the last seven columns of a full QR.
    complete, _ = np.linalg.qr(white, mode="complete")
    left_over = complete[:, :, 9:].transpose(0, 2, 1) @ whitener
    by_rig = _by_corner(seen.by_rig)
    lengths = np.linalg.norm(plate[:, 1:], axis=2)
    cosine = (plate[:, 1] * plate[:, 2]).sum(axis=1) / (lengths[:, 0] * lengths[:, 1])
    result.centre_mm[known] = plate[:, 0]
    of_plate = np.linalg.inv(white.transpose(0, 2, 1) @ white)
    result.covariance_mm2[known] = of_plate[:, :3, :3]
    result.sides_mm[known] = 2.0 * lengths
    # The mean of both sides is the sum of both half sides' lengths.
    by_half_sides = (plate[:, 1:] / lengths[..., None]).reshape(-1, 6)
    result.side_std_mm[known] = np.sqrt(np.einsum("ni,nij,nj->n", by_half_sides, of_plate[:, 3:, 3:], by_half_sides))
    result.along[known] = plate[:, 1] / lengths[:, :1]
    result.right_angle_error_rad[known] = np.arcsin(cosine)
    result.whitened_residual[known] = (left_over @ residual[..., None])[..., 0]
    result.whitened_by_rig[known] = -left_over @ by_rig
    result.reprojection_px[known] = np.sqrt((residual**2).sum(axis=1) / 8.0)


def _linearised(rig: Rig, plate: Array, measured: Array) -> tuple[Array, Array, StereoProjection]:
    """Residual (n, 16) and derivative (n, 16, 9) by centre and two half sides; order: left corners, right corners."""
    corners = plate[:, None, 0] + _SIGNS[:, :1] * plate[:, None, 1] + _SIGNS[:, 1:] * plate[:, None, 2]
    seen = project_to_both(rig, corners.reshape(-1, 3))
    residual = measured - _by_corner(seen.pixel[..., None])[..., 0]
    by_corner = seen.by_point.reshape(-1, 4, 2, 2, 3)
    factors = np.column_stack([np.ones(4), _SIGNS])
    columns = np.einsum("nkvpc,kf->nvkpfc", by_corner, factors).reshape(len(plate), 16, 9)
    return residual, columns, seen


def _by_corner(stacked: Array) -> Array:
    """(4n, 4, m) rows (u_left, v_left, u_right, v_right) of corners to (n, 16, m): left corners, right corners."""
    m = stacked.shape[-1]
    result: Array = stacked.reshape(-1, 4, 2, 2, m).transpose(0, 2, 1, 3, 4).reshape(-1, 16, m)
    return result


def _distorted(rig: Rig, seen: SeenPlates) -> tuple[Array, Array]:
    """Corners (n, 16) as the pictures show them, distorted, with covariance (n, 16, 16)."""
    n = len(seen.left_px)
    pixels = np.empty((n, 2, 4, 2))
    covariance = np.zeros((n, 16, 16))
    sides = (
        (rig.left, seen.left_px, seen.left_covariance_px2),
        (rig.right, seen.right_px, seen.right_covariance_px2),
    )
    for view, (camera, straight, straight_covariance) in enumerate(sides):
        rays = (straight - camera.principal_point_px) / camera.focal_px
        pixels[:, view], slope = camera.pixel_slope(rays)
        bend = np.zeros((n, 8, 8))
        for k in range(4):
            bend[:, 2 * k : 2 * k + 2, 2 * k : 2 * k + 2] = slope[:, k]
        block = slice(8 * view, 8 * view + 8)
        covariance[:, block, block] = bend @ straight_covariance @ bend.transpose(0, 2, 1)
    return pixels.reshape(n, 16), covariance


def _diagonal_blocks(covariance: Array) -> Array:
    """(n, 8, 8) to the (4n, 2, 2) of the corners one by one."""
    blocks = covariance.reshape(-1, 4, 2, 4, 2)
    result: Array = np.stack([blocks[:, k, :, k] for k in range(4)], axis=1).reshape(-1, 2, 2)
    return result


_REASONS = {
    1: "a corner has no place in the picture",
    2: "the rays of the two cameras are parallel",
    3: "the rays of the two cameras meet behind a camera",
    4: "a corner has no usable uncertainty",
}


def _reason(status: int) -> str:
    return _REASONS.get(status, "no place in space explains both pictures")
