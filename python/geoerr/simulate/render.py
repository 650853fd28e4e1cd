"""Pictures of flat patterns with true sub-pixel edges.

A pattern is a grid of straight lines. Under a Gaussian point spread of σ pixels (the pixel's own width included) an
edge is the normal distribution of the signed pixel distance to it, and where a horizontal and a vertical line
cross, the four cells around them are weighted with the bivariate normal distribution of the two distances; its
correlation is the cosine of the angle between the two gradients in the picture. Distances are (u − u_line) / |∇u|,
with u, v and their pixel gradients exact at every pixel (lens, perspective), so an edge's position has no error;
the curvature of u over the point spread is neglected. Exact while cells are wider than about 6 σ: only the nearest
line each way is looked at.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache
from statistics import NormalDist
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from geoerr.simulate.cameras import Camera
from geoerr.simulate.rotations import Array
from geoerr.vision.patterns import Pattern

Picture: TypeAlias = npt.NDArray[np.float32]
Indices: TypeAlias = npt.NDArray[np.intp]

# The normal distribution is taken from a table: steps of 1/512 and straight lines in between are good to 1.2e-7.
_REACH_SIGMA = 6.0
_STEPS_PER_SIGMA = 512
# Rows at a time: few enough that what is worked on stays in the cache, and enough that threads seldom wait for each
# other's turn at the interpreter.
_PAINT_ROWS = 64
_LATTICE_PX = 8
_EXPOSE_ROWS = 64


@dataclass(frozen=True)
class Sheet:
    """A flat pattern in space.

    Attributes
    ----------
    pattern
        Its cells, u to the right, v downwards.
    base_from_sheet
        (3, 3); columns: directions of u, of v, and away from the viewer.
    origin_mm
        Place of u = v = 0 in the base frame.
    """

    pattern: Pattern
    base_from_sheet: Array
    origin_mm: Array

    def place_mm(self, points_mm: Array) -> Array:
        """Turn (u, v) on the sheet (..., 2) into base coordinates (..., 3)."""
        return np.asarray(self.origin_mm + points_mm @ self.base_from_sheet[:, :2].T)

    @property
    def outline_mm(self) -> Array:
        """Give its four corners in the base frame (4, 3): upper left, upper right, lower right, lower left."""
        return self.place_mm(rectangle(self.pattern))

    def faces(self, camera: Camera) -> bool:
        """Tell whether its printed side is turned to the camera."""
        return bool((camera.centre_mm - self.origin_mm) @ self.base_from_sheet[:, 2] < 0.0)


def rectangle(pattern: Pattern) -> Array:
    """Give the outline of a pattern (4, 2): upper left, upper right, lower right, lower left."""
    left, right = pattern.u_edges_mm[[0, -1]]
    top, bottom = pattern.v_edges_mm[[0, -1]]
    return np.array([[left, top], [right, top], [right, bottom], [left, bottom]])


@dataclass(frozen=True)
class Light:
    """How bright things are, in grey levels of 255, and how sharp.

    Attributes
    ----------
    white_grey, black_grey, background_grey
        Paper, ink and what is behind.
    shading
        Relative change of the light across the picture, smooth.
    vignetting
        Relative loss of light in the picture's corners.
    blur_px
        Standard deviation of the point spread, the pixel's own width included.
    noise_grey
        Standard deviation of the camera's noise.
    """

    white_grey: float = 205.0
    black_grey: float = 28.0
    background_grey: float = 92.0
    shading: float = 0.06
    vignetting: float = 0.10
    blur_px: float = 0.8
    noise_grey: float = 1.5


def illumination(size_px: tuple[int, int], light: Light) -> Picture:
    """Give the relative brightness (height, width) that shading and vignetting make: 1 in the middle."""
    width, height = size_px
    x = (np.arange(width) - 0.5 * (width - 1)) / (0.5 * width)
    y = ((np.arange(height) - 0.5 * (height - 1)) / (0.5 * height))[:, None]
    shade = 1.0 + light.shading * (0.6 * x + 0.3 * y + 0.1 * x * y)
    return (shade * (1.0 - 0.5 * light.vignetting * (x * x + y * y))).astype(np.float32)


def paint(picture: Picture, camera: Camera, sheet: Sheet, light: Light, brightness: Picture) -> None:
    """Draw a sheet into a picture, in place; what lies outside the picture is left out.

    Parameters
    ----------
    picture
        (height, width) grey levels before noise.
    brightness
        From `illumination`.
    """
    region = _region(camera, sheet, light.blur_px)
    if region is None:
        return
    rows, columns = region
    # Around the sheet lies a frame of nothing: reflectance 0 and cover 0, so that its edge is an edge like any other.
    grey = np.pad(np.where(sheet.pattern.white == 1, light.white_grey, light.black_grey), 1)
    cover = np.pad(np.ones(sheet.pattern.white.shape), 1)
    lattice = _Lattice(camera, rows, columns)
    for start in range(rows.start, rows.stop, _PAINT_ROWS):
        band = slice(start, min(start + _PAINT_ROWS, rows.stop))
        weights = _weights(lattice, sheet, light.blur_px, band)
        part = picture[band, columns]
        part *= (1.0 - weights.mix(cover)).astype(np.float32)
        part += brightness[band, columns] * weights.mix(grey).astype(np.float32)


class _Lattice:
    """Undistorted places every few pixels of a region: between them they guess those of all its pixels to 1e-6."""

    def __init__(self, camera: Camera, rows: slice, columns: slice) -> None:
        self.camera = camera
        self.columns = columns
        self._v_px, self._u_px = (_nodes(p) for p in (rows, columns))
        v_px, u_px = np.meshgrid(self._v_px, self._u_px, indexing="ij")
        # Interpolated along the rows at once; between the rows when they are asked for.
        self._x, self._y = (_between(self._u_px, part.T, columns).T for part in camera.ideal(u_px, v_px)[:2])

    def ideal(self, rows: slice) -> tuple[Array, Array, Array]:
        """Undistort some rows of the region; see `Camera.ideal`."""
        v_px, u_px = np.mgrid[rows, self.columns].astype(np.float64)
        start = _between(self._v_px, self._x, rows), _between(self._v_px, self._y, rows)
        return self.camera.ideal(u_px, v_px, start)


def _nodes(pixels: slice) -> Array:
    """Give every `_LATTICE_PX`th pixel and one beyond the last."""
    return np.arange(pixels.start, pixels.stop + _LATTICE_PX, _LATTICE_PX, dtype=np.float64)


def _between(nodes: Array, values: Array, pixels: slice) -> Array:
    """Interpolate along the first axis by straight lines: values (nodes, ...) to (pixels, ...)."""
    places = np.arange(pixels.start, pixels.stop, dtype=np.float64)
    before = np.clip(np.searchsorted(nodes, places, side="right") - 1, 0, len(nodes) - 2)
    share = ((places - nodes[before]) / (nodes[before + 1] - nodes[before]))[:, None]
    return np.asarray(values[before] * (1.0 - share) + values[before + 1] * share)


def _weights(lattice: _Lattice, sheet: Sheet, blur_px: float, rows: slice) -> _Weights:
    u_mm, v_mm, gradient = _on_sheet(lattice.camera, sheet, *lattice.ideal(rows))
    u_per_px = np.hypot(gradient[0, 0], gradient[0, 1])
    v_per_px = np.hypot(gradient[1, 0], gradient[1, 1])
    correlation = np.sum(gradient[0] * gradient[1], axis=0) / (u_per_px * v_per_px)
    column, u_distance_mm = _nearest(sheet.pattern.u_edges_mm, u_mm)
    row, v_distance_mm = _nearest(sheet.pattern.v_edges_mm, v_mm)
    return _Weights(
        row, column, u_distance_mm / (u_per_px * blur_px), v_distance_mm / (v_per_px * blur_px), correlation
    )


class _Weights:
    """How much of each of the four cells around the nearest crossing a pixel sees."""

    def __init__(self, row: Indices, column: Indices, u_sigma: Array, v_sigma: Array, correlation: Array) -> None:
        self._row = row
        self._column = column
        self._a = normal_distribution(u_sigma)
        self._b = normal_distribution(v_sigma)
        self._near = np.nonzero((np.abs(u_sigma) < _REACH_SIGMA) & (np.abs(v_sigma) < _REACH_SIGMA))
        self._joint = _joint_part(u_sigma[self._near], v_sigma[self._near], correlation[self._near])

    def mix(self, cells: Array) -> Array:
        """Give the weighted mean of four neighbouring cells at each pixel."""
        n_columns = cells.shape[1]
        flat = cells.ravel()
        at = self._row * n_columns + self._column
        upper_left, upper_right = flat[at], flat[at + 1]
        at += n_columns
        lower_left, lower_right = flat[at], flat[at + 1]
        upper = upper_left + self._a * (upper_right - upper_left)
        lower = lower_left + self._a * (lower_right - lower_left)
        mixed = upper + self._b * (lower - upper)
        cross = (upper_left + lower_right - upper_right - lower_left)[self._near]
        mixed[self._near] += self._joint * cross
        return np.asarray(mixed)


def _joint_part(a: Array, b: Array, correlation: Array) -> Array:
    """Give P(U < a, V < b) − Φ(a) Φ(b) of correlated normals: the tetrachoric series to the fourth order.

    The fifth term is below ρ⁵ · 0.16 · 9 / 120, 1.5e-5 for ρ = 0.26 (a square tilted by 40° about its diagonal).
    """
    r = correlation
    aa, bb, ab = a * a, b * b, a * b
    density = np.exp(-0.5 * (aa + bb)) / (2.0 * np.pi)
    second = 0.5 * ab
    third = (aa - 1.0) * (bb - 1.0) / 6.0
    fourth = ab * (aa - 3.0) * (bb - 3.0) / 24.0
    return np.asarray(density * r * (1.0 + r * (second + r * (third + r * fourth))))


def _region(camera: Camera, sheet: Sheet, blur_px: float) -> tuple[slice, slice] | None:
    """Give the rows and columns that the sheet can touch, or None if it does not show."""
    if not sheet.faces(camera):
        return None
    # Straight edges bend under distortion: points along them, not the corners alone.
    corners = rectangle(sheet.pattern)
    along = np.linspace(0.0, 1.0, 17)[:-1, None]
    edge = np.concatenate([corners[i] + along * (corners[(i + 1) % 4] - corners[i]) for i in range(4)])
    pixels = camera.project(sheet.place_mm(edge))
    pixels = pixels[np.isfinite(pixels).all(axis=1)]
    if not len(pixels):
        return None
    margin = math.ceil(_REACH_SIGMA * blur_px) + 1
    low = np.floor(pixels.min(axis=0)).astype(int) - margin
    high = np.ceil(pixels.max(axis=0)).astype(int) + margin + 1
    width, height = camera.size_px
    columns = slice(max(int(low[0]), 0), min(int(high[0]), width))
    rows = slice(max(int(low[1]), 0), min(int(high[1]), height))
    return (rows, columns) if rows.start < rows.stop and columns.start < columns.stop else None


def _on_sheet(camera: Camera, sheet: Sheet, x: Array, y: Array, ideal_by_px: Array) -> tuple[Array, Array, Array]:
    """Follow undistorted pixels to the sheet: u, v in mm, gradient [sheet coordinate][pixel axis] (2, 2, ...)."""
    camera_from_sheet = camera.camera_from_base @ sheet.base_from_sheet
    homography = np.column_stack([camera_from_sheet[:, :2], camera.in_camera_mm(sheet.origin_mm)])
    back = np.linalg.inv(homography)
    upper_u, upper_v, below = (row[0] * x + row[1] * y + row[2] for row in back)
    u_mm, v_mm = upper_u / below, upper_v / below
    by_x = np.stack([back[0, 0] - u_mm * back[2, 0], back[1, 0] - v_mm * back[2, 0]]) / below
    by_y = np.stack([back[0, 1] - u_mm * back[2, 1], back[1, 1] - v_mm * back[2, 1]]) / below
    gradient = by_x[:, None] * ideal_by_px[0][None] + by_y[:, None] * ideal_by_px[1][None]
    return u_mm, v_mm, gradient


def _nearest(edges_mm: Array, place_mm: Array) -> tuple[Indices, Array]:
    """Give the nearest line's index, that of the cell before it in the padded pattern, and the signed distance."""
    index = np.searchsorted(0.5 * (edges_mm[1:] + edges_mm[:-1]), place_mm)
    return index, place_mm - edges_mm[index]


@cache
def _normal_table() -> Array:
    n_steps = int(_REACH_SIGMA * _STEPS_PER_SIGMA)
    arguments = np.arange(-n_steps, n_steps + 1) / _STEPS_PER_SIGMA
    table = np.array([0.5 * math.erfc(-value / math.sqrt(2.0)) for value in arguments])
    table[0], table[-1] = 0.0, 1.0
    return table


def normal_distribution(argument: Array) -> Array:
    """Give Φ, exactly 0 and 1 beyond 6 σ; good to 2e-7 between."""
    table = _normal_table()
    place = np.clip((argument + _REACH_SIGMA) * _STEPS_PER_SIGMA, 0.0, len(table) - 1.000001)
    index = place.astype(np.intp)
    return np.asarray(table[index] + (place - index) * (table[index + 1] - table[index]))


@cache
def _normal_quantiles() -> Picture:
    """Give the normal quantiles of (i + ½) / 65536."""
    usual = NormalDist()
    return np.array([usual.inv_cdf((i + 0.5) / 65536.0) for i in range(65536)], dtype=np.float32)


def expose(picture: Picture, noise_grey: float, seed: np.random.SeedSequence) -> npt.NDArray[np.uint8]:
    """Add the camera's noise and round to 8 bits.

    The noise is Gaussian, taken from 65536 quantiles by random 16-bit numbers: a quarter of the time that a normal
    generator takes, nothing beyond 4.2 σ, standard deviation within 1e-4 of σ.
    """
    n_words = -(-picture.size // 4)
    words = np.random.SFC64(seed).random_raw(n_words)
    draws = words.astype("<u8").view("<u2")[: picture.size].reshape(picture.shape)
    noise = _normal_quantiles() * np.float32(noise_grey)
    exposed = np.empty(picture.shape, dtype=np.uint8)
    for start in range(0, picture.shape[0], _EXPOSE_ROWS):
        rows = slice(start, start + _EXPOSE_ROWS)
        grey = noise[draws[rows]]
        grey += picture[rows]
        # Adding a half and cutting off is rounding, once the values are not negative.
        grey += np.float32(0.5)
        np.clip(grey, 0.0, 255.0, out=grey)
        exposed[rows] = grey
    return exposed
