"""Corners of a printed square marker at the noise limit, by fitting its whole picture.

A corner detector looks at a few pixels round each corner and is pulled inwards where a dark corner meets a
light background (0.16 px for a marker 130 px wide). Here every pixel near an edge takes part: the known pattern
is mapped by a homography, blurred by the camera, lit unevenly, and all of that is adjusted by Gauss–Newton until
the differences are noise. The scatter of what is left gives the covariance.

Model
-----
With (u, v) a pixel, (x, y) the straight ray that it sees, and (s, t) the place on the marker in modules::

    (s, t)  = H (x, y, 1)                                       plane seen without distortion: exact
    picture = B(u, v) + [W(u, v) − B(u, v)] · P(s, t)           B, W: quadratic, for light that falls unevenly
    P       = 1 + Σ_ij Δ_ij Φ₂((s − i)/σ_s, (t − j)/σ_t; ρ)     blurred pattern, 0 black, 1 white

| symbol | meaning | unit |
|---|---|---|
| Δ_ij | mixed second difference of the pattern at grid vertex (i, j) | – |
| Φ₂(a, b; ρ) | bivariate normal distribution, ΦΦ + ρφφ + ½ρ²abφφ + … (tetrachoric series) | – |
| σ_s, σ_t, ρ | the blur's 2×2 covariance (px²), carried to the marker through d(s, t)/d(u, v) | module |

The blur is Gaussian with three free parameters, so defocus, a lens that draws differently along and across,
and a marker in slow motion are all in it; the pixel's own square is covered by its variance. A derivative by a
blur parameter is a second derivative by place (the heat equation). Saturated pixels only say "at least 255".

Only pixels within half a module of the marker are used: a printed quiet zone of one module is enough.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from geoerr.vision.camera import Camera, distort_jacobian
from geoerr.vision.normal import normal_distribution

Array = npt.NDArray[np.float64]
# Always float32 here; NumPy's own types cannot say that a Python number leaves it so.
Single = npt.NDArray[np.floating[Any]]
GreyImage = npt.NDArray[np.uint8]

QUIET_MODULES = 0.5
"""How far beyond the marker pixels are used."""

# Pixels further than this many blurs from every edge carry no place, only brightness.
_REACH_SIGMAS = 3.0
# With more pixels than this, pixels are thinned: the time stays bounded, the corner is known well enough.
_MAX_EDGE_PIXELS = 20_000
_MAX_FLAT_PIXELS = 40_000
_MAX_COARSE_PIXELS = 2_500
_ITERATIONS = 25
# Steps shrink at least tenfold each time near the end: what is left after one of this size is nothing.
_CONVERGED_PX = 2e-4
_COARSE_PX = 0.05
_COARSE_BLUR_PX = 1.5
_ROWS_AT_A_TIME = 16
_N_HOMOGRAPHY = 8
_N_BLUR = 3
_N_LIGHT = 6
_N_LEVELS = 2 * _N_LIGHT
_SMALLEST_MODULE_PX = 3.0
_LEAST_CONTRAST_GREY = 5.0
_SATURATED_GREY = 255.0
_LEAST_BLUR_PX2 = 0.04
_STEEP = 0.05
_ROUNDING_GREY = 0.289  # of a whole number: 1/√12
# A pixel that is this far off shows dirt, a scratch or a reflection, not the marker.
_OUTLIER_SIGMAS = 6.0
_OUTLIER_CONTRAST = 0.08
_OUTLIER_ROUNDS = 4
# More pixels than this that are wrong by so much of the contrast: it is something else.
_WRONG_CONTRAST = 0.3
_MOST_WRONG = 0.1


@dataclass(frozen=True)
class MarkerFit:
    """Four corners of one marker in one picture.

    Attributes
    ----------
    corners_px
        (4, 2) *undistorted* pixels, clockwise from the marker's own top left corner.
    covariance_px2
        (8, 8) of (u0, v0, u1, v1, ...).
    method
        `photometric`, or `corner` where that fit failed and corners of a local detector stand in.
    noise_grey
        Standard deviation of what the model leaves, grey levels; NaN for `corner`.
    contrast_grey
        White minus black at the marker's centre.
    blur_px
        Standard deviations of the blur along its long and short axis, the pixel's own square included.
    misfit
        Residual near edges over residual in flat areas: 1 where the model is right, larger for dirt,
        a bent plate, or a wrong lens model.
    why
        For `corner`: why the photometric fit was not used.
    """

    corners_px: Array
    covariance_px2: Array
    method: str
    noise_grey: float
    contrast_grey: float
    blur_px: tuple[float, float]
    misfit: float
    why: str = ""


class MarkerFitError(ValueError):
    """The photometric fit has no trustworthy answer here; the message says why."""


class NotThisMarkerError(MarkerFitError):
    """The picture here is not that of this marker: something else, or most of it is covered."""


def fit_marker(picture: GreyImage, camera: Camera, pattern: npt.NDArray[np.bool_], corners_px: Array) -> MarkerFit:
    """Fit the whole picture of one marker.

    Parameters
    ----------
    picture
        (h, w) uint8.
    camera
        Its lens.
    pattern
        (n, n) of the whole marker, black border included; True is white.
    corners_px
        (4, 2) distorted pixels, within about a fifth of a module; clockwise from the marker's own top left.

    Raises
    ------
    MarkerFitError
        where the fit does not converge, or to something that is not this marker.

    Notes
    -----
    Verified against supersampled renderings (tests/vision/test_marker_fit.py): mean error over sub-pixel phases
    below 0.005 px, and scatter over noise draws as the covariance says.
    """
    scene = _Scene(picture, camera, pattern, np.asarray(corners_px, dtype=np.float64))
    state = scene.starting_state()
    # First few pixels and a blur that is held wide, which pulls from further away; then everything free.
    coarse = scene.select(state, _MAX_COARSE_PIXELS, stride=1 + int(scene.half_px) // 40)
    state = _adjust(scene, coarse, state, free_blur=False, iterations=8, tolerance_px=_COARSE_PX).state
    scene.check(state)
    state = _adjust(scene, coarse, state, free_blur=True, iterations=4, tolerance_px=_COARSE_PX).state
    scene.check(state)
    fine = scene.select(state, _MAX_EDGE_PIXELS)
    for _ in range(_OUTLIER_ROUNDS):
        fit = _adjust(scene, fine, state, free_blur=True, iterations=_ITERATIONS, tolerance_px=_CONVERGED_PX)
        cleaned = _without_outliers(scene, fine, fit)
        if cleaned is fine:
            break
        fine, state = cleaned, fit.state
    if not fit.converged:
        raise MarkerFitError("the fit did not converge")
    scene.check(fit.state)
    return _result(scene, fine, fit)


@dataclass
class _State:
    """What is being adjusted.

    `homography` row by row, last entry 1; `blur_px2` uu, uv, vv; `levels` of black, then of white: six
    coefficients each, of 1, u, v, u², uv, v².
    """

    homography: Array
    blur_px2: Array
    levels: Array


@dataclass(frozen=True)
class _Pixels:
    """Pixels that take part, with what stays the same from step to step.

    Single precision: its rounding is 1e-5 of a grey level and of a pixel, and it takes half the time.
    """

    light: Single
    x: Single
    y: Single
    grey: Single
    line_s: Single
    line_t: Single
    base: Single
    step_s: Single
    step_t: Single
    vertex: Single
    kept: Single
    flat: _Flat


@dataclass(frozen=True)
class _Flat:
    """Pixels far from every edge: they say how bright black and white are, whatever the corners do.

    Attributes
    ----------
    light
        (12, n) their derivatives by the levels: they are wholly black or wholly white.
    grey
        (n,)
    gram, right
        (12, 12) and (12,) of their normal equations, which never change.
    """

    light: Single
    grey: Single
    gram: Array
    right: Array


class _Scene:
    """One marker in one picture: the pixels around it and their rays, scaled to about ±1."""

    def __init__(self, picture: GreyImage, camera: Camera, pattern: npt.NDArray[np.bool_], corners: Array) -> None:
        self.camera = camera
        self.n_modules = pattern.shape[0]
        self.module_px = _mean_side(corners) / self.n_modules
        if not self.module_px >= _SMALLEST_MODULE_PX:
            raise MarkerFitError(f"the marker is too small: {self.module_px:.1f} px a module")
        # White all round: four more modules, so that every look-up near the border has its neighbours.
        self.pad = 4
        self.pattern = np.pad(pattern.astype(np.float64), self.pad, constant_values=1.0)
        margin = QUIET_MODULES * self.module_px * 1.5 + 2.0
        height, width = picture.shape
        low = np.floor(corners.min(axis=0) - margin).astype(int)
        high = np.ceil(corners.max(axis=0) + margin).astype(int)
        self.left, self.top = max(low[0], 0), max(low[1], 0)
        right, bottom = min(high[0] + 1, width), min(high[1] + 1, height)
        self.grey = picture[self.top : bottom, self.left : right]
        self.shape = self.grey.shape
        # Most neighbours differ by noise alone, whatever the picture shows.
        steps = np.abs(np.diff(self.grey.astype(np.int16), axis=1))
        self.noise_grey = max(1.4826 * float(np.median(steps)) / math.sqrt(2.0), _ROUNDING_GREY)
        rays = camera.normalised_from_pixel(corners)
        if not np.isfinite(rays).all():
            raise MarkerFitError("the lens model has no inverse here")
        self.ray_centre = rays.mean(axis=0)
        self.ray_scale = float(np.abs(rays - self.ray_centre).max())
        self.x, self.y = self._rays_of_block()
        self.centre_px = corners.mean(axis=0)
        self.half_px = 0.5 * self.module_px * self.n_modules
        # d(u, v)/d(scaled ray) at the centre: for the blur only, which needs no better.
        _, by_ray, _ = distort_jacobian(self.ray_centre, camera.distortion)
        self.ray_from_pixel = np.linalg.inv(by_ray * camera.focal_px[:, None] * self.ray_scale)
        n = float(self.n_modules)
        self.marker_corners = np.array([[0.0, 0.0], [n, 0.0], [n, n], [0.0, n]])
        self.first_rays = (rays - self.ray_centre) / self.ray_scale
        self.first_undistorted_px = camera.undistorted_pixel_from_normalised(rays)

    def _rays_of_block(self) -> tuple[Single, Single]:
        """Scaled rays of all pixels: exact at Chebyshev nodes, interpolated between (to 1e-8 px)."""
        n_nodes = 8
        nodes = np.cos((2.0 * np.arange(n_nodes) + 1.0) * np.pi / (2.0 * n_nodes))
        height, width = self.shape
        half_width, half_height = 0.5 * max(width - 1, 1), 0.5 * max(height - 1, 1)
        u = self.left + half_width * (1.0 + nodes)
        v = self.top + half_height * (1.0 + nodes)
        rays = self.camera.normalised_from_pixel(np.stack(np.meshgrid(u, v), axis=-1))
        rays = (rays - self.ray_centre) / self.ray_scale
        if not np.isfinite(rays).all():
            raise MarkerFitError("the lens model has no inverse here")
        along_u = _lagrange(nodes, np.arange(width) / half_width - 1.0)
        along_v = _lagrange(nodes, np.arange(height) / half_height - 1.0)
        result = np.empty((2, height, width), dtype=np.float32)
        for axis in range(2):
            across = rays[..., axis] @ along_u.T
            # A few rows at a time: for larger products BLAS starts threads, which wait for one another.
            for first in range(0, height, _ROWS_AT_A_TIME):
                rows = slice(first, first + _ROWS_AT_A_TIME)
                result[axis, rows] = along_v[rows] @ across
        return result[0], result[1]

    def starting_state(self) -> _State:
        homography = _homography(self.first_rays, self.marker_corners)
        variance = _COARSE_BLUR_PX**2
        return _State(homography, np.array([variance, 0.0, variance]), np.zeros(_N_LEVELS))

    def select(self, state: _State, max_pixels: int, stride: int = 1) -> _Pixels:
        """Choose pixels: those near an edge, some in the flat; tie each to its nearest grid lines."""
        place = _place(self, state, self.x[::stride, ::stride], self.y[::stride, ::stride])
        s, t = place.s, place.t
        low, high = -QUIET_MODULES, self.n_modules + QUIET_MODULES
        inside = (s > low) & (s < high) & (t > low) & (t < high)
        rows, columns = (stride * index for index in np.nonzero(inside))
        s, t = s[inside], t[inside]
        per_s, per_t = place.per_s[inside], place.per_t[inside]
        nearest_s, nearest_t = np.rint(s).astype(np.int64), np.rint(t).astype(np.int64)
        # Five blurs from a line it no longer matters; in a small or blurred marker neighbouring lines do.
        n_lines = 1 if 0.5 * min(per_s.min(initial=99.0), per_t.min(initial=99.0)) > 5.0 else 3
        tables = self._tables(nearest_s, nearest_t, n_lines)
        close_s = np.abs(s - nearest_s) * per_s < _REACH_SIGMAS
        close_t = np.abs(t - nearest_t) * per_t < _REACH_SIGMAS
        base, step_s, step_t, vertex = tables
        changes_s = (step_s != 0).any(axis=0) | (vertex != 0).any(axis=(0, 1))
        changes_t = (step_t != 0).any(axis=0) | (vertex != 0).any(axis=(0, 1))
        near = (changes_s | changes_t) if n_lines > 1 else (close_s & changes_s) | (close_t & changes_t)
        edge = np.flatnonzero(near)
        edge = edge[:: 1 + len(edge) // max_pixels]
        flat = np.flatnonzero(~near & (self.grey[rows, columns] < _SATURATED_GREY))
        offsets = np.arange(n_lines)[:, None] - n_lines // 2
        grey = _single(self.grey[rows, columns])
        u = (columns + self.left - self.centre_px[0]) / self.half_px
        v = (rows + self.top - self.centre_px[1]) / self.half_px
        light = _single(np.stack([np.ones(len(u)), u, v, u * u, u * v, v * v]))
        flat = flat[:: 1 + len(flat) // _MAX_FLAT_PIXELS]
        column, row = np.floor(s[flat]).astype(np.int64), np.floor(t[flat]).astype(np.int64)
        is_white = self.pattern[row + self.pad, column + self.pad] > 0
        return _Pixels(
            light=light[:, edge],
            x=self.x[rows[edge], columns[edge]],
            y=self.y[rows[edge], columns[edge]],
            grey=grey[edge],
            line_s=_single(nearest_s[edge] + offsets),
            line_t=_single(nearest_t[edge] + offsets),
            base=base[edge],
            step_s=step_s[:, edge],
            step_t=step_t[:, edge],
            vertex=vertex[:, :, edge],
            kept=np.ones(len(edge), dtype=np.float32),
            flat=_flat(np.concatenate([light[:, flat] * ~is_white, light[:, flat] * is_white]), grey[flat]),
        )

    def _tables(
        self, nearest_s: npt.NDArray[np.int64], nearest_t: npt.NDArray[np.int64], n_lines: int
    ) -> tuple[Single, Single, Single, Single]:
        """Pattern around each pixel as a base value and steps over the nearest grid lines.

        Cell (row t, column s) left of and above all lines is `base`; crossing line i in s adds `step_s[i]`,
        line j in t adds `step_t[j]`, both `vertex[i, j]` besides.
        """
        first = self.pad - 1 - n_lines // 2
        width = self.pattern.shape[1]
        corner = (nearest_t + first) * width + (nearest_s + first)
        cell = self.pattern.ravel()
        right = np.append(cell[1:] - cell[:-1], 0.0)
        below = np.append(cell[width:] - cell[:-width], np.zeros(width))
        mixed = np.append(right[width:] - right[:-width], np.zeros(width))
        lines = range(n_lines)
        step_s = np.stack([right[corner + i] for i in lines])
        step_t = np.stack([below[corner + width * j] for j in lines])
        vertex = np.stack([np.stack([mixed[corner + i + width * j] for j in lines]) for i in lines])
        return _single(cell[corner]), _single(step_s), _single(step_t), _single(vertex)

    def rays_of_corners(self, homography: Array) -> Array:
        """(4, 2) scaled rays of the marker's corners."""
        back = np.linalg.inv(np.append(homography, 1.0).reshape(3, 3))
        seen = np.column_stack([self.marker_corners, np.ones(4)]) @ back.T
        result: Array = seen[:, :2] / seen[:, 2:]
        return result

    def corners_px(self, homography: Array) -> Array:
        """(4, 2) undistorted pixels of the marker's corners."""
        rays = self.rays_of_corners(homography) * self.ray_scale + self.ray_centre
        return self.camera.undistorted_pixel_from_normalised(rays)

    def check(self, state: _State) -> None:
        """Refuse an answer that is not this marker."""
        if not np.isfinite(state.homography).all():
            raise MarkerFitError("the fit diverged")
        moved = np.abs(self.corners_px(state.homography) - self.first_undistorted_px).max()
        if not moved < max(0.5 * self.module_px, 2.0):
            raise MarkerFitError(f"the fit moved a corner by {moved:.1f} px")
        largest, smallest = _blur_axes(state.blur_px2)
        if not largest < max(0.5 * self.module_px, 2.0):
            raise MarkerFitError(f"the blur came out as {largest:.2f} by {smallest:.2f} px")
        if not state.levels[_N_LIGHT] - state.levels[0] > _LEAST_CONTRAST_GREY:
            raise NotThisMarkerError("the marker has no contrast")


def _mean_side(corners: Array) -> float:
    return float(np.linalg.norm(corners - np.roll(corners, 1, axis=0), axis=1).mean())


def _lagrange(nodes: Array, at: Array) -> Array:
    """Interpolation matrix from values at the nodes to values at other places."""
    result = np.ones((len(at), len(nodes)))
    for i, node in enumerate(nodes):
        for j, other in enumerate(nodes):
            if i != j:
                result[:, i] *= (at - other) / (node - other)
    return result


def _homography(source: Array, target: Array) -> Array:
    """(8,) entries of the homography that takes four points to four points, last entry 1."""
    rows = np.zeros((8, 8))
    rows[0::2, 0:2] = source
    rows[0::2, 2] = 1.0
    rows[1::2, 3:5] = source
    rows[1::2, 5] = 1.0
    rows[0::2, 6:8] = -source * target[:, :1]
    rows[1::2, 6:8] = -source * target[:, 1:]
    try:
        return _solved(rows, target.ravel())
    except np.linalg.LinAlgError as error:
        raise MarkerFitError("three corners in one line") from error


def _solved(matrix: Array, right: Array) -> Array:
    """Solve a linear system; a singular one raises `LinAlgError`."""
    return np.asarray(np.linalg.solve(matrix, right), dtype=np.float64)


def _blur_axes(blur_px2: Array) -> tuple[float, float]:
    uu, uv, vv = blur_px2
    mean, half = 0.5 * (uu + vv), math.hypot(0.5 * (uu - vv), uv)
    return math.sqrt(max(mean + half, 0.0)), math.sqrt(max(mean - half, 0.0))


def _single(values: npt.NDArray[Any]) -> Single:
    return values.astype(np.float32)


def _flat(light: Single, grey: Single) -> _Flat:
    return _Flat(light, grey, _product(light, light), _product(light, grey[None])[:, 0])


@dataclass(frozen=True)
class _Place:
    """Where pixels lie on the marker, and how the blur looks from there.

    `s_u` is ds/du and so on; `per_s` = 1/σ_s.
    """

    s: Single
    t: Single
    inverse_w: Single
    s_u: Single
    s_v: Single
    t_u: Single
    t_v: Single
    per_s: Single
    per_t: Single
    rho: Single


def _place(scene: _Scene, state: _State, x: Single, y: Single) -> _Place:
    h = [float(value) for value in state.homography]
    inverse_w = 1.0 / (h[6] * x + h[7] * y + 1.0)
    s = (h[0] * x + h[1] * y + h[2]) * inverse_w
    t = (h[3] * x + h[4] * y + h[5]) * inverse_w
    # d(s, t)/d(u, v), with the camera's part taken as constant over the marker: it is for the blur only.
    s_x, s_y = (h[0] - s * h[6]) * inverse_w, (h[1] - s * h[7]) * inverse_w
    t_x, t_y = (h[3] - t * h[6]) * inverse_w, (h[4] - t * h[7]) * inverse_w
    (x_u, x_v), (y_u, y_v) = scene.ray_from_pixel.tolist()
    s_u, s_v = s_x * x_u + s_y * y_u, s_x * x_v + s_y * y_v
    t_u, t_v = t_x * x_u + t_y * y_u, t_x * x_v + t_y * y_v
    uu, uv, vv = (float(value) for value in state.blur_px2)
    per_s = 1.0 / np.sqrt(s_u * s_u * uu + s_u * s_v * (2.0 * uv) + s_v * s_v * vv)
    per_t = 1.0 / np.sqrt(t_u * t_u * uu + t_u * t_v * (2.0 * uv) + t_v * t_v * vv)
    rho = (s_u * t_u * uu + (s_u * t_v + s_v * t_u) * uv + s_v * t_v * vv) * per_s * per_t
    return _Place(s, t, inverse_w, s_u, s_v, t_u, t_v, per_s, per_t, rho)


@dataclass(frozen=True)
class _Evaluation:
    """Measured minus model (n,), and the model's derivatives (23, n): homography, blur, levels."""

    residual: Single
    columns: Single


def _evaluate(scene: _Scene, pixels: _Pixels, state: _State, free_blur: bool) -> _Evaluation:
    at = _place(scene, state, pixels.x, pixels.y)
    a, b = (at.s - pixels.line_s) * at.per_s, (at.t - pixels.line_t) * at.per_t
    cdf_a, pdf_a = normal_distribution(a)
    cdf_b, pdf_b = normal_distribution(b)
    slope_a, slope_b = -a * pdf_a, -b * pdf_b
    d = pixels.vertex
    d_pdf_b = (d * pdf_b).sum(axis=1)
    d_slope_b = (d * slope_b).sum(axis=1)
    across_s = pixels.step_s + (d * cdf_b).sum(axis=1)
    along_t = pixels.step_t + (d * cdf_a[:, None]).sum(axis=0)
    mixed = (pdf_a * d_pdf_b).sum(axis=0)
    rho = at.rho
    p = pixels.base + (pixels.step_t * cdf_b).sum(axis=0) + (across_s * cdf_a).sum(axis=0)
    p += rho * (mixed + 0.5 * rho * (slope_a * d_slope_b).sum(axis=0))
    p_s = ((across_s * pdf_a).sum(axis=0) + rho * (slope_a * d_pdf_b).sum(axis=0)) * at.per_s
    p_t = ((along_t * pdf_b).sum(axis=0) + rho * (pdf_a * d_slope_b).sum(axis=0)) * at.per_t

    black = _combined(state.levels[:_N_LIGHT], pixels.light)
    contrast = _combined(state.levels[_N_LIGHT:] - state.levels[:_N_LIGHT], pixels.light)
    model = black + contrast * p
    # A saturated pixel says only that there was at least so much light.
    weight = pixels.kept * ~((pixels.grey >= _SATURATED_GREY) & (model >= _SATURATED_GREY))
    residual = (pixels.grey - model) * weight

    columns = np.zeros((_N_HOMOGRAPHY + _N_BLUR + _N_LEVELS, len(p)), dtype=np.float32)
    scaled = contrast * weight
    by_s, by_t = scaled * p_s * at.inverse_w, scaled * p_t * at.inverse_w
    by_w = -(by_s * at.s + by_t * at.t)
    for first, by in ((0, by_s), (3, by_t)):
        np.multiply(by, pixels.x, out=columns[first])
        np.multiply(by, pixels.y, out=columns[first + 1])
        columns[first + 2] = by
    np.multiply(by_w, pixels.x, out=columns[6])
    np.multiply(by_w, pixels.y, out=columns[7])
    if free_blur:
        half_ss = 0.5 * scaled * (across_s * slope_a).sum(axis=0) * at.per_s * at.per_s
        half_tt = 0.5 * scaled * (along_t * slope_b).sum(axis=0) * at.per_t * at.per_t
        cross = scaled * mixed * at.per_s * at.per_t
        columns[8] = half_ss * at.s_u * at.s_u + half_tt * at.t_u * at.t_u + cross * at.s_u * at.t_u
        columns[9] = 2.0 * (half_ss * at.s_u * at.s_v + half_tt * at.t_u * at.t_v) + cross * (
            at.s_u * at.t_v + at.s_v * at.t_u
        )
        columns[10] = half_ss * at.s_v * at.s_v + half_tt * at.t_v * at.t_v + cross * at.s_v * at.t_v
    light = weight * p
    first_level = _N_HOMOGRAPHY + _N_BLUR
    np.multiply(pixels.light, weight - light, out=columns[first_level : first_level + _N_LIGHT])
    np.multiply(pixels.light, light, out=columns[first_level + _N_LIGHT :])
    return _Evaluation(residual, columns)


def _product(first: Single, second: Single) -> Array:
    """`first @ second.T` in pieces that BLAS does on one thread: same bits whatever else runs."""
    n_pixels = first.shape[1]
    piece = 512
    whole = n_pixels - n_pixels % piece
    left = first[:, :whole].reshape(len(first), -1, piece).transpose(1, 0, 2)
    right = second[:, :whole].reshape(len(second), -1, piece).transpose(1, 2, 0)
    total: Array = np.matmul(left, right).sum(axis=0, dtype=np.float64)
    return total + first[:, whole:] @ second[:, whole:].T


def _combined(factors: Array, rows: Single) -> Single:
    """`factors @ rows`, not by BLAS, which would start threads for it."""
    total = np.zeros(rows.shape[1], dtype=np.float32)
    for factor, row in zip(factors, rows, strict=True):
        total += float(factor) * row
    return total


@dataclass(frozen=True)
class _Fit:
    state: _State
    last: _Evaluation
    converged: bool


def _adjust(
    scene: _Scene, pixels: _Pixels, state: _State, *, free_blur: bool, iterations: int, tolerance_px: float
) -> _Fit:
    """Gauss–Newton until no corner moves by more than the tolerance.

    `last` of the result was evaluated one such step before its state.
    """
    free = np.ones(_N_HOMOGRAPHY + _N_BLUR + _N_LEVELS, dtype=bool)
    free[_N_HOMOGRAPHY : _N_HOMOGRAPHY + _N_BLUR] = free_blur
    if not state.levels.any():
        state = _with_levels(scene, pixels, state)
    corners = scene.corners_px(state.homography)
    for _ in range(iterations):
        evaluation = _evaluate(scene, pixels, state, free_blur)
        columns = evaluation.columns if free_blur else evaluation.columns[free]
        step = np.zeros(len(free))
        gram, right = _product(columns, columns), _product(columns, evaluation.residual[None])[:, 0]
        gram[-_N_LEVELS:, -_N_LEVELS:] += pixels.flat.gram
        right[-_N_LEVELS:] += pixels.flat.right - pixels.flat.gram @ state.levels
        try:
            step[free] = _solved(gram, right)
        except np.linalg.LinAlgError as error:
            raise MarkerFitError("the picture does not determine the marker") from error
        state = _stepped(state, step)
        moved_to = scene.corners_px(state.homography)
        movement = np.abs(moved_to - corners).max()
        corners = moved_to
        if not movement < scene.module_px * scene.n_modules:
            raise MarkerFitError("the fit diverged")
        if movement < tolerance_px:
            return _Fit(state, evaluation, True)
    return _Fit(state, evaluation, False)


def _stepped(state: _State, step: Array) -> _State:
    blur = state.blur_px2 + step[_N_HOMOGRAPHY : _N_HOMOGRAPHY + _N_BLUR]
    # Not more than halved or doubled at once, never below half of a pixel's own square, always a covariance.
    for i in (0, 2):
        blur[i] = min(max(blur[i], 0.5 * state.blur_px2[i], _LEAST_BLUR_PX2), 2.0 * state.blur_px2[i])
    limit = 0.8 * math.sqrt(blur[0] * blur[2])
    blur[1] = min(max(blur[1], -limit), limit)
    return _State(state.homography + step[:_N_HOMOGRAPHY], blur, state.levels + step[_N_HOMOGRAPHY + _N_BLUR :])


def _with_levels(scene: _Scene, pixels: _Pixels, state: _State) -> _State:
    """Brightness planes by linear least squares for the homography as it stands."""
    evaluation = _evaluate(scene, pixels, state, False)
    columns = evaluation.columns[_N_HOMOGRAPHY + _N_BLUR :]
    try:
        levels = _solved(
            _product(columns, columns) + pixels.flat.gram,
            _product(columns, pixels.grey[None])[:, 0] + pixels.flat.right,
        )
    except np.linalg.LinAlgError as error:
        raise MarkerFitError("the picture shows no black and white here") from error
    if not levels[_N_LIGHT] - levels[0] > _LEAST_CONTRAST_GREY:
        raise NotThisMarkerError("the marker has no contrast")
    return _State(state.homography, state.blur_px2, levels)


def _without_outliers(scene: _Scene, pixels: _Pixels, fit: _Fit) -> _Pixels:
    """Take pixels out that show something else than the marker; the same object where nothing changes."""
    contrast = float(fit.state.levels[_N_LIGHT] - fit.state.levels[0])
    residual = fit.last.residual
    if not pixels.kept.all():
        residual = _evaluate(scene, replace(pixels, kept=np.ones_like(pixels.kept)), fit.state, False).residual
    flat = pixels.flat
    flat_residual = flat.grey - _combined(fit.state.levels, flat.light)
    wrong = float((np.abs(np.concatenate([residual, flat_residual])) > _WRONG_CONTRAST * contrast).mean())
    if wrong > _MOST_WRONG:
        raise NotThisMarkerError(f"{100.0 * wrong:.0f} % of its pixels do not show this marker")
    # A camera that sharpens its pictures is off near every edge, alike on both sides: that is not dirt.
    usual = 1.4826 * float(np.median(np.abs(residual)))
    limit = max(_OUTLIER_SIGMAS * max(scene.noise_grey, usual), _OUTLIER_CONTRAST * contrast)
    kept, flat_kept = np.abs(residual) < limit, np.abs(flat_residual) < limit
    if flat_kept.all() and np.array_equal(kept, pixels.kept > 0.0):
        return pixels
    light, grey = flat.light[:, flat_kept], flat.grey[flat_kept]
    return replace(pixels, kept=_single(kept), flat=_flat(light, grey))


def _result(scene: _Scene, pixels: _Pixels, fit: _Fit) -> MarkerFit:
    """Corners, and their covariance from the scatter of what is left."""
    state, columns, residual = fit.state, fit.last.columns, fit.last.residual
    n_free, used = len(columns), int(pixels.kept.sum())
    if used < 10 * n_free:
        raise MarkerFitError("too few pixels")
    flat_residual = pixels.flat.grey - _combined(state.levels, pixels.flat.light)
    # Each pixel with its own squared residual (White's covariance): bright pixels are noisier than dark ones.
    information = _product(columns, columns)
    middle = _product(columns, columns * (residual * residual))
    information[-_N_LEVELS:, -_N_LEVELS:] += pixels.flat.gram
    middle[-_N_LEVELS:, -_N_LEVELS:] += _product(
        pixels.flat.light, pixels.flat.light * (flat_residual * flat_residual)
    )
    inverse = _solved(information, np.eye(n_free))
    covariance = inverse @ middle @ inverse * (used / (used - n_free))
    by_homography = _corner_jacobian(state.homography, scene.rays_of_corners(state.homography))
    by_homography *= scene.ray_scale * np.tile(scene.camera.focal_px, 4)[:, None]
    kept = pixels.kept > 0.0
    slope = np.hypot(columns[2], columns[5])
    steep = slope > _STEEP * slope.max()
    level = np.concatenate([residual[kept & ~steep], flat_residual])
    return MarkerFit(
        scene.corners_px(state.homography),
        by_homography @ covariance[:_N_HOMOGRAPHY, :_N_HOMOGRAPHY] @ by_homography.T,
        "photometric",
        _rms(np.concatenate([residual[kept], flat_residual])),
        float(state.levels[_N_LIGHT] - state.levels[0]),
        _blur_axes(state.blur_px2),
        _rms(residual[kept & steep]) / max(_rms(level), _ROUNDING_GREY),
    )


def _rms(values: Single) -> float:
    return math.sqrt(float(np.square(values, dtype=np.float64).mean())) if len(values) else 0.0


def _corner_jacobian(h: Array, rays: Array) -> Array:
    """(8, 8) derivative of the corners' scaled rays by the homography: the place on the marker stays."""
    x, y = rays[:, 0], rays[:, 1]
    inverse_w = 1.0 / (h[6] * x + h[7] * y + 1.0)
    s, t = (h[0] * x + h[1] * y + h[2]) * inverse_w, (h[3] * x + h[4] * y + h[5]) * inverse_w
    by_h = np.zeros((4, 2, 8))
    by_h[:, 0, 0], by_h[:, 0, 1], by_h[:, 0, 2] = x * inverse_w, y * inverse_w, inverse_w
    by_h[:, 1, 3], by_h[:, 1, 4], by_h[:, 1, 5] = x * inverse_w, y * inverse_w, inverse_w
    by_h[:, 0, 6], by_h[:, 0, 7] = -s * x * inverse_w, -s * y * inverse_w
    by_h[:, 1, 6], by_h[:, 1, 7] = -t * x * inverse_w, -t * y * inverse_w
    by_ray = np.empty((4, 2, 2))
    by_ray[:, 0, 0], by_ray[:, 0, 1] = (h[0] - s * h[6]) * inverse_w, (h[1] - s * h[7]) * inverse_w
    by_ray[:, 1, 0], by_ray[:, 1, 1] = (h[3] - t * h[6]) * inverse_w, (h[4] - t * h[7]) * inverse_w
    result: Array = -_solved(by_ray, by_h).reshape(8, 8)
    return result
