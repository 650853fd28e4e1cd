"""One camera: pinhole, lens distortion in OpenCV's terms, its exact inverse, and every derivative.

OpenCV's `undistortPoints` stops after five fixed-point steps, which leaves up to a few hundredths of a pixel
in the corners of a wide lens; a marker's corner is known to a few thousandths. Here the inverse is Newton's,
carried to rounding.

Pixel centres are at whole numbers, as in OpenCV.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

DISTORTION_NAMES = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6", "s1", "s2", "s3", "s4")
"""OpenCV's order of distortion coefficients (without the tilted sensor's two angles)."""

DISTORTION_COUNTS = (4, 5, 8, 12)
INTRINSIC_NAMES = ("fx_px", "fy_px", "cx_px", "cy_px")

_NEWTON_STEPS = 12
# A lens model folds over where its radial curve turns back: there a pixel has no inverse in the picture.
_INVERSE_TOLERANCE = 1e-12


@dataclass(frozen=True, eq=False)
class Camera:
    """Pinhole and distortion of one camera.

    Attributes
    ----------
    matrix_px
        (3, 3) camera matrix K, zero skew.
    distortion
        (4,), (5,), (8,) or (12,) coefficients, in the order of `DISTORTION_NAMES`.
    """

    matrix_px: Array
    distortion: Array

    @property
    def focal_px(self) -> Array:
        """(2,) fx and fy."""
        return np.array([self.matrix_px[0, 0], self.matrix_px[1, 1]])

    @property
    def principal_point_px(self) -> Array:
        """(2,) cx and cy."""
        return np.array([self.matrix_px[0, 2], self.matrix_px[1, 2]])

    def pixel_from_normalised(self, normalised: Array) -> Array:
        """Where the picture shows the rays (x/z, y/z), shape (..., 2): distorted, in pixels."""
        result: Array = distort(normalised, self.distortion) * self.focal_px + self.principal_point_px
        return result

    def normalised_from_pixel(self, pixel: Array) -> Array:
        """Rays (x/z, y/z) of distorted pixels, shape (..., 2); NaN where the lens model has no inverse."""
        return undistort((pixel - self.principal_point_px) / self.focal_px, self.distortion)

    def pixel_slope(self, normalised: Array) -> tuple[Array, Array]:
        """Distorted pixels (..., 2) of rays, and their derivative (..., 2, 2) by undistorted pixels."""
        distorted, by_ray, _ = distort_jacobian(normalised, self.distortion)
        slope: Array = by_ray * self.focal_px[:, None] / self.focal_px
        return distorted * self.focal_px + self.principal_point_px, slope

    def undistorted_pixel_from_normalised(self, normalised: Array) -> Array:
        """Pixels that a lens without distortion would give, shape (..., 2)."""
        result: Array = normalised * self.focal_px + self.principal_point_px
        return result


def camera_from_parameters(parameters: Array) -> Camera:
    """Camera from (fx, fy, cx, cy, then distortion coefficients)."""
    fx, fy, cx, cy = parameters[:4]
    return Camera(np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]]), np.array(parameters[4:]))


def parameters_of(camera: Camera) -> Array:
    """(fx, fy, cx, cy, then distortion coefficients): the inverse of `camera_from_parameters`."""
    return np.concatenate([camera.focal_px, camera.principal_point_px, camera.distortion])


def _radial(r2: Array, k: Array) -> tuple[Array, Array, Array, Array]:
    """Numerator, denominator of the radial factor and their derivatives by r²."""
    numerator = 1.0 + r2 * (k[0] + r2 * (k[1] + r2 * k[4]))
    numerator_slope = k[0] + r2 * (2.0 * k[1] + 3.0 * r2 * k[4])
    denominator = 1.0 + r2 * (k[5] + r2 * (k[6] + r2 * k[7]))
    denominator_slope = k[5] + r2 * (2.0 * k[6] + 3.0 * r2 * k[7])
    return numerator, denominator, numerator_slope, denominator_slope


def _padded(distortion: Array) -> Array:
    k = np.zeros(12)
    k[: len(distortion)] = distortion
    return k


def distort(normalised: Array, distortion: Array) -> Array:
    """Bend rays as the lens does (Brown's model as OpenCV writes it); shape (..., 2) to (..., 2)."""
    k = _padded(distortion)
    x, y = normalised[..., 0], normalised[..., 1]
    r2 = x * x + y * y
    numerator, denominator, _, _ = _radial(r2, k)
    g = numerator / denominator
    xd = x * g + 2.0 * k[2] * x * y + k[3] * (r2 + 2.0 * x * x) + r2 * (k[8] + r2 * k[9])
    yd = y * g + k[2] * (r2 + 2.0 * y * y) + 2.0 * k[3] * x * y + r2 * (k[10] + r2 * k[11])
    return np.stack([xd, yd], axis=-1)


def distort_jacobian(normalised: Array, distortion: Array) -> tuple[Array, Array, Array]:
    """Bend rays, with derivatives.

    Returns
    -------
    distorted : (..., 2)
    by_ray : (..., 2, 2)
        derivative by (x/z, y/z).
    by_distortion : (..., 2, len(distortion))

    Notes
    -----
    Verified against finite differences and `cv2.projectPoints` (tests/vision/test_camera.py).
    """
    k = _padded(distortion)
    x, y = normalised[..., 0], normalised[..., 1]
    r2 = x * x + y * y
    r4 = r2 * r2
    r6 = r4 * r2
    numerator, denominator, numerator_slope, denominator_slope = _radial(r2, k)
    g = numerator / denominator
    g_slope = (numerator_slope - g * denominator_slope) / denominator
    xy2 = 2.0 * x * y
    xd = x * g + k[2] * xy2 + k[3] * (r2 + 2.0 * x * x) + r2 * (k[8] + r2 * k[9])
    yd = y * g + k[2] * (r2 + 2.0 * y * y) + k[3] * xy2 + r2 * (k[10] + r2 * k[11])
    prism_x = 2.0 * (k[8] + 2.0 * r2 * k[9])
    prism_y = 2.0 * (k[10] + 2.0 * r2 * k[11])
    by_ray = np.empty((*x.shape, 2, 2))
    by_ray[..., 0, 0] = g + 2.0 * x * x * g_slope + 2.0 * k[2] * y + 6.0 * k[3] * x + prism_x * x
    by_ray[..., 0, 1] = xy2 * g_slope + 2.0 * k[2] * x + 2.0 * k[3] * y + prism_x * y
    by_ray[..., 1, 0] = xy2 * g_slope + 2.0 * k[2] * x + 2.0 * k[3] * y + prism_y * x
    by_ray[..., 1, 1] = g + 2.0 * y * y * g_slope + 6.0 * k[2] * y + 2.0 * k[3] * x + prism_y * y
    by_k = np.zeros((*x.shape, 2, 12))
    for column, power in ((0, r2), (1, r4), (4, r6)):
        by_k[..., 0, column] = x * power / denominator
        by_k[..., 1, column] = y * power / denominator
    by_k[..., 0, 2] = xy2
    by_k[..., 1, 2] = r2 + 2.0 * y * y
    by_k[..., 0, 3] = r2 + 2.0 * x * x
    by_k[..., 1, 3] = xy2
    for column, power in ((5, r2), (6, r4), (7, r6)):
        by_k[..., 0, column] = -x * g * power / denominator
        by_k[..., 1, column] = -y * g * power / denominator
    by_k[..., 0, 8] = r2
    by_k[..., 0, 9] = r4
    by_k[..., 1, 10] = r2
    by_k[..., 1, 11] = r4
    return np.stack([xd, yd], axis=-1), by_ray, by_k[..., : len(distortion)]


def undistort(distorted: Array, distortion: Array) -> Array:
    """Straighten bent rays: the exact inverse of `distort`, by Newton's method; NaN where there is none."""
    wanted = np.asarray(distorted, dtype=np.float64)
    if not np.any(distortion):
        return wanted.copy()
    ray = wanted.copy()
    with np.errstate(all="ignore"):
        for _ in range(_NEWTON_STEPS):
            value, slope, _ = distort_jacobian(ray, distortion)
            missing = wanted - value
            determinant = slope[..., 0, 0] * slope[..., 1, 1] - slope[..., 0, 1] * slope[..., 1, 0]
            step_x = (slope[..., 1, 1] * missing[..., 0] - slope[..., 0, 1] * missing[..., 1]) / determinant
            step_y = (slope[..., 0, 0] * missing[..., 1] - slope[..., 1, 0] * missing[..., 0]) / determinant
            ray = ray + np.stack([step_x, step_y], axis=-1)
            if np.nanmax(np.abs(missing), initial=0.0) < 1e-15:
                break
        left_over = np.abs(distort(ray, distortion) - wanted).max(axis=-1)
        ray[~(left_over < _INVERSE_TOLERANCE) | ~(determinant > 0.0)] = np.nan
    return ray


def project(points_mm: Array, camera: Camera) -> Array:
    """Distorted pixels of points in the camera's frame; (..., 3) to (..., 2)."""
    return camera.pixel_from_normalised(points_mm[..., :2] / points_mm[..., 2:3])


def project_jacobian(points_mm: Array, camera: Camera) -> tuple[Array, Array, Array]:
    """Project points in the camera's frame, with derivatives.

    Returns
    -------
    pixel : (..., 2)
    by_point : (..., 2, 3)
        px/mm
    by_camera : (..., 2, 4 + n)
        by fx, fy, cx, cy and the n distortion coefficients.
    """
    depth = points_mm[..., 2]
    ray = points_mm[..., :2] / depth[..., None]
    distorted, by_ray, by_distortion = distort_jacobian(ray, camera.distortion)
    focal = camera.focal_px
    scaled = by_ray * focal[:, None]
    by_point = np.empty((*depth.shape, 2, 3))
    by_point[..., :2] = scaled / depth[..., None, None]
    by_point[..., 2] = -(scaled * ray[..., None, :]).sum(axis=-1) / depth[..., None]
    by_camera = np.zeros((*depth.shape, 2, 4 + len(camera.distortion)))
    by_camera[..., 0, 0] = distorted[..., 0]
    by_camera[..., 1, 1] = distorted[..., 1]
    by_camera[..., 0, 2] = 1.0
    by_camera[..., 1, 3] = 1.0
    by_camera[..., 4:] = by_distortion * focal[:, None]
    return distorted * focal + camera.principal_point_px, by_point, by_camera
