"""Corners of black and white squares at the noise limit, by fitting the picture around each.

`cv2.cornerSubPix` looks for the place where grey gradients point away from; on 5-megapixel pictures with noise of
1.5 grey levels it scatters by 0.020 px. The same pixels, explained by a model of the corner, give 0.004 px, which
is what their noise allows (tests/vision/test_corners.py).

Model
-----
Two straight edges cross at the corner; the camera blurs them by a Gaussian (the pixel's own square included)::

    picture = m + g_u x + g_v y + c Q(a, b; ρ)        m, g: light that falls unevenly; c: half the contrast
    Q       = 4 Φ₂(a, b; ρ) − 2 Φ(a) − 2 Φ(b) + 1     +1 and −1 in the corner's opposite quadrants, blurred

| symbol | meaning | unit |
|---|---|---|
| x, y | pixel minus corner | px |
| a, b | signed distances from the two edges over the blur σ | – |
| ρ | cosine of the angle between the edges' normals | – |
| Φ₂(a, b; ρ) | bivariate normal distribution: ΦΦ + ρφφ (1 + ½ρab) + … (tetrachoric series) | – |

The picture of a corner is the same when turned by half a turn about it. So whatever the model leaves out that is
so too (a blur that is not Gaussian, more terms of the series) cannot move the corner.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from geoerr.vision.normal import normal_distribution

Array = npt.NDArray[np.float64]
GreyImage = npt.NDArray[np.uint8]

# A window of this radius sees edges of a wide lens as straight to a few thousandths of a pixel.
_LARGEST_RADIUS_PX = 11.0
_LEAST_RADIUS_PX = 3.0
# Of the square's side: the next corner's edges stay out, blur and all.
_RADIUS_OF_SIDE = 0.42
# Pixels nearer than this to a marker's edge would show its blur.
_CLEAR_OF_MARKER_PX = 2.5
_FIRST_BLUR_PX = 1.0
_BLUR_RANGE_PX = (0.3, 6.0)
_ITERATIONS = 15
_CONVERGED_PX = 1e-4
_LARGEST_STEP_PX = 1.0
_LARGEST_STEP_RAD = 0.3
# A corner that wanders further than this from where it was found is something else.
_FARTHEST_PX = 2.5
_LEAST_CONTRAST_GREY = 4.0
_LEAST_SEEN = 0.6
# Of an unknown's own weight in the picture: less than this share that no other unknown explains is round-off.
_LEAST_OWN_SHARE = 1e-9
# u, v, two edge angles, blur, contrast, level, its slopes.
_N_PARAMETERS = 9
_CORNERS_AT_A_TIME = 32


@dataclass(frozen=True)
class CornerFits:
    """Corners of one picture; entry i belongs to the i-th start.

    Attributes
    ----------
    corners_px
        (n, 2) distorted pixels; NaN where the fit has no trustworthy answer.
    covariance_px2
        (n, 2, 2) from what the model leaves.
    half_contrast_grey
        (n,) positive where the square towards −u −v is dark, negative where it is bright.
    """

    corners_px: Array
    covariance_px2: Array
    half_contrast_grey: Array

    @property
    def std_px(self) -> Array:
        """(n,) standard uncertainty of one coordinate: the mean over all directions."""
        return np.asarray(np.sqrt(0.5 * np.trace(self.covariance_px2, axis1=1, axis2=2)))


def fit_corners(
    picture: GreyImage, starts_px: Array, side_u_px: Array, side_v_px: Array, gap_of_side: float = math.inf
) -> CornerFits:
    """Fit every corner's neighbourhood.

    Parameters
    ----------
    picture
        (h, w) uint8.
    starts_px
        (n, 2) corners to within a pixel or two.
    side_u_px, side_v_px
        (n, 2) the square's side along the board's u and v as seen at each corner.
    gap_of_side
        White around a ChArUco marker, as a share of the square's side; pixels of markers are left out.

    Notes
    -----
    Verified against the simulator's true corners (tests/vision/test_corners.py): no bias above 0.001 px, scatter as
    the covariance says.
    """
    fits = [
        _fit(picture, starts_px[some], side_u_px[some], side_v_px[some], gap_of_side)
        for some in (
            slice(first, first + _CORNERS_AT_A_TIME) for first in range(0, len(starts_px), _CORNERS_AT_A_TIME)
        )
    ]
    if not fits:
        return CornerFits(np.empty((0, 2)), np.empty((0, 2, 2)), np.empty(0))
    return CornerFits(
        np.concatenate([fit.corners_px for fit in fits]),
        np.concatenate([fit.covariance_px2 for fit in fits]),
        np.concatenate([fit.half_contrast_grey for fit in fits]),
    )


@dataclass
class _Windows:
    """Pixels around each corner: place from the window's middle (p,), grey and weight (n, p)."""

    middle: npt.NDArray[np.int64]
    u: Array
    v: Array
    grey: Array
    weight: Array
    is_seen: npt.NDArray[np.bool_]


def _windows(picture: GreyImage, starts: Array, side_u: Array, side_v: Array, gap_of_side: float) -> _Windows:
    height, width = picture.shape
    length_u, length_v = np.linalg.norm(side_u, axis=1), np.linalg.norm(side_v, axis=1)
    cross = side_u[:, 0] * side_v[:, 1] - side_u[:, 1] * side_v[:, 0]
    # Distance between opposite sides of the foreshortened square.
    narrow = np.abs(cross) / np.maximum(length_u, length_v)
    radius = np.minimum(_RADIUS_OF_SIDE * narrow, _LARGEST_RADIUS_PX)
    is_wide = radius >= _LEAST_RADIUS_PX
    reach = math.ceil(radius.max(initial=_LEAST_RADIUS_PX))
    offsets = np.arange(-reach, reach + 1)
    u, v = (grid.ravel() for grid in np.meshgrid(offsets, offsets))
    u, v = u[u * u + v * v <= reach * reach], v[u * u + v * v <= reach * reach]
    middle = np.rint(starts).astype(np.int64)
    columns, rows = middle[:, :1] + u, middle[:, 1:] + v
    is_inside = (columns >= 0) & (columns < width) & (rows >= 0) & (rows < height)
    grey = picture[rows.clip(0, height - 1), columns.clip(0, width - 1)].astype(np.float64)
    x, y = columns - starts[:, :1], rows - starts[:, 1:]
    is_used = x * x + y * y <= radius[:, None] ** 2
    if math.isfinite(gap_of_side):
        along_u = np.abs(x * side_v[:, 1:] - y * side_v[:, :1])
        along_v = np.abs(y * side_u[:, :1] - x * side_u[:, 1:])
        # In pixels across the edges: a marker begins where both exceed its gap.
        clear_u = gap_of_side * np.abs(cross) / length_v - _CLEAR_OF_MARKER_PX
        clear_v = gap_of_side * np.abs(cross) / length_u - _CLEAR_OF_MARKER_PX
        is_marker = (along_u / length_v[:, None] > clear_u[:, None]) & (
            along_v / length_u[:, None] > clear_v[:, None]
        )
        is_used &= ~is_marker
    n_wanted = is_used.sum(axis=1)
    is_used &= is_inside
    is_seen = is_wide & (is_used.sum(axis=1) >= np.maximum(_LEAST_SEEN * n_wanted, 2 * _N_PARAMETERS))
    return _Windows(middle, u.astype(np.float64), v.astype(np.float64), grey, is_used.astype(np.float64), is_seen)


def _fit(picture: GreyImage, starts: Array, side_u: Array, side_v: Array, gap_of_side: float) -> CornerFits:
    windows = _windows(picture, starts, side_u, side_v, gap_of_side)
    n_corners = len(starts)
    # Columns: u, v from the window's middle, angles of both edges, blur, level, half contrast, slopes of light.
    state = np.zeros((n_corners, _N_PARAMETERS))
    state[:, :2] = starts - windows.middle
    state[:, 2] = np.arctan2(side_u[:, 1], side_u[:, 0])
    state[:, 3] = np.arctan2(side_v[:, 1], side_v[:, 0])
    state[:, 4] = _FIRST_BLUR_PX
    has_failed = ~windows.is_seen
    converged = np.zeros(n_corners, dtype=bool)
    _set_levels(windows, state)
    for _ in range(_ITERATIONS):
        residual, jacobian = _residual(windows, state)
        normal, gradient = _normal_equations(windows, residual, jacobian)
        has_failed |= ~np.isfinite(normal).all(axis=(1, 2)) | (np.abs(normal[:, 6, 6]) < 1e-9)
        step = _solved(normal, gradient, has_failed)
        step[:, :2] = step[:, :2].clip(-_LARGEST_STEP_PX, _LARGEST_STEP_PX)
        step[:, 2:4] = step[:, 2:4].clip(-_LARGEST_STEP_RAD, _LARGEST_STEP_RAD)
        step[:, 4] = step[:, 4].clip(-0.5 * state[:, 4], state[:, 4])
        # What has converged stays as it is: the answer does not depend on its neighbours in the batch.
        step[converged | has_failed] = 0.0
        state += step
        state[:, 4] = state[:, 4].clip(*_BLUR_RANGE_PX)
        converged |= (np.abs(step[:, :2]).max(axis=1) < _CONVERGED_PX) & ~has_failed
        if (converged | has_failed).all():
            break
    residual, jacobian = _residual(windows, state)
    normal, _ = _normal_equations(windows, residual, jacobian)
    freedom = windows.weight.sum(axis=1) - _N_PARAMETERS
    variance = (windows.weight * residual**2).sum(axis=1) / np.maximum(freedom, 1.0)
    is_good = (
        converged
        & (np.linalg.norm(state[:, :2] + windows.middle - starts, axis=1) < _FARTHEST_PX)
        & (np.abs(state[:, 6]) > np.maximum(_LEAST_CONTRAST_GREY, np.sqrt(variance)))
    )
    is_good[is_good] = _determines_all(normal[is_good])
    corners = np.where(is_good[:, None], state[:, :2] + windows.middle, np.nan)
    covariance = np.full((n_corners, 2, 2), np.nan)
    covariance[is_good] = np.linalg.inv(normal[is_good])[:, :2, :2] * variance[is_good, None, None]
    return CornerFits(corners, covariance, np.where(is_good, state[:, 6], 0.0))


def _set_levels(windows: _Windows, state: Array) -> None:
    """Start the levels, which are linear, at their best values for the given geometry."""
    shape, *_ = _corner_shape(windows, state)
    basis = np.empty((*shape.shape, 4))
    basis[..., 0] = 1.0
    basis[..., 1] = shape
    basis[..., 2], basis[..., 3] = windows.u, windows.v
    weighted = np.swapaxes(basis * windows.weight[..., None], 1, 2)
    right_side = weighted @ windows.grey[..., None]
    state[:, 5:9] = _solved(weighted @ basis, right_side[..., 0], ~windows.is_seen)


def _corner_shape(windows: _Windows, state: Array) -> tuple[Array, Array, Array, Array, Array]:
    """Q, its derivatives by a and b, and a and b: each (n, p)."""
    x, y = windows.u - state[:, 0:1], windows.v - state[:, 1:2]
    blur = state[:, 4:5]
    cos_u, sin_u = np.cos(state[:, 2:3]), np.sin(state[:, 2:3])
    cos_v, sin_v = np.cos(state[:, 3:4]), np.sin(state[:, 3:4])
    a = (cos_u * y - sin_u * x) / blur
    b = (cos_v * y - sin_v * x) / blur
    rho = sin_u * sin_v + cos_u * cos_v
    below_a, density_a = normal_distribution(a)
    below_b, density_b = normal_distribution(b)
    both = below_a * below_b + rho * density_a * density_b * (1.0 + 0.5 * rho * a * b)
    shape = 4.0 * both - 2.0 * (below_a + below_b) + 1.0
    spread = np.sqrt(np.maximum(1.0 - rho * rho, 1e-6))
    # dΦ₂/da = φ(a) Φ((b − ρa)/√(1−ρ²)), exact for every ρ.
    by_a = density_a * (4.0 * normal_distribution((b - rho * a) / spread)[0] - 2.0)
    by_b = density_b * (4.0 * normal_distribution((a - rho * b) / spread)[0] - 2.0)
    return shape, by_a, by_b, a, b


def _residual(windows: _Windows, state: Array) -> tuple[Array, Array]:
    shape, by_a, by_b, a, b = _corner_shape(windows, state)
    level, contrast, slope_u, slope_v = (state[:, column : column + 1] for column in (5, 6, 7, 8))
    residual = windows.grey - (level + contrast * shape + slope_u * windows.u + slope_v * windows.v)
    x, y = windows.u - state[:, 0:1], windows.v - state[:, 1:2]
    per_blur = contrast / state[:, 4:5]
    cos_u, sin_u = np.cos(state[:, 2:3]), np.sin(state[:, 2:3])
    cos_v, sin_v = np.cos(state[:, 3:4]), np.sin(state[:, 3:4])
    jacobian = np.empty((*shape.shape, _N_PARAMETERS))
    jacobian[..., 0] = per_blur * (by_a * sin_u + by_b * sin_v)
    jacobian[..., 1] = -per_blur * (by_a * cos_u + by_b * cos_v)
    jacobian[..., 2] = -per_blur * by_a * (cos_u * x + sin_u * y)
    jacobian[..., 3] = -per_blur * by_b * (cos_v * x + sin_v * y)
    jacobian[..., 4] = -per_blur * (by_a * a + by_b * b)
    jacobian[..., 5] = 1.0
    jacobian[..., 6] = shape
    jacobian[..., 7], jacobian[..., 8] = windows.u, windows.v
    return residual, jacobian


def _normal_equations(windows: _Windows, residual: Array, jacobian: Array) -> tuple[Array, Array]:
    weighted = np.swapaxes(jacobian * windows.weight[..., None], 1, 2)
    return weighted @ jacobian, (weighted @ residual[..., None])[..., 0]


def _determines_all(normal: Array) -> npt.NDArray[np.bool_]:
    """Tell which systems (n, p, p) determine all unknowns: a strip of a window says nothing across it."""
    own = np.sqrt(np.diagonal(normal, axis1=1, axis2=2))
    scale = np.where(own > 0.0, own, 1.0)
    shares = np.linalg.eigvalsh(normal / (scale[:, :, None] * scale[:, None, :]))
    return np.asarray(shares[:, 0] > _LEAST_OWN_SHARE)


def _solved(normal: Array, gradient: Array, is_hopeless: npt.NDArray[np.bool_]) -> Array:
    """Solve each system; 0 for the hopeless ones."""
    size = normal.shape[1]
    # A trace of damping keeps a corner without contrast from spoiling its batch.
    damping = 1e-9 * np.trace(normal, axis1=1, axis2=2)[:, None, None] * np.eye(size)
    safe = np.where(is_hopeless[:, None, None], np.eye(size), normal + damping)
    step: Array = np.linalg.solve(safe, np.where(is_hopeless[:, None], 0.0, gradient)[..., None])[..., 0]
    return step
