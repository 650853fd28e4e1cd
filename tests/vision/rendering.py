"""Brute-force pictures of printed cells, for tests: every pixel the mean of many rays, sharing no code with geoerr.

Ray by ray: pixel → lens inverse by fixed-point iteration → plane of the plate → black or white cell.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter
from scipy.spatial.transform import Rotation


@dataclass(frozen=True)
class Lens:
    fx: float
    fy: float
    cx: float
    cy: float
    k1: float = 0.0
    k2: float = 0.0
    p1: float = 0.0
    p2: float = 0.0
    k3: float = 0.0

    @property
    def matrix(self):
        return np.array([[self.fx, 0.0, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]])

    @property
    def distortion(self):
        return np.array([self.k1, self.k2, self.p1, self.p2, self.k3])

    def _shift(self, x, y):
        r2 = x * x + y * y
        # Horner: powers of arrays take longer than all the rest of a picture.
        radial = 1.0 + r2 * (self.k1 + r2 * (self.k2 + r2 * self.k3))
        return (
            radial,
            2 * self.p1 * x * y + self.p2 * (r2 + 2 * x * x),
            self.p1 * (r2 + 2 * y * y) + 2 * self.p2 * x * y,
        )

    def bend(self, x, y):
        radial, dx, dy = self._shift(x, y)
        return x * radial + dx, y * radial + dy

    def straighten(self, xd, yd):
        x, y = xd, yd
        for _ in range(14):
            radial, dx, dy = self._shift(x, y)
            before = x
            x, y = (xd - dx) / radial, (yd - dy) / radial
            if np.abs(x - before).max() < 1e-15:
                break
        return x, y

    def pixel(self, points):
        points = np.asarray(points, dtype=float)
        x, y = self.bend(points[..., 0] / points[..., 2], points[..., 1] / points[..., 2])
        return np.stack([self.fx * x + self.cx, self.fy * y + self.cy], axis=-1)

    def undistorted_pixel(self, points):
        points = np.asarray(points, dtype=float)
        return points[..., :2] / points[..., 2:] * [self.fx, self.fy] + [self.cx, self.cy]


@dataclass(frozen=True)
class Plate:
    """Cells between lines on a plane: `edges_u`, `edges_v` in mm, `white` (rows, columns); white outside."""

    edges_u: np.ndarray
    edges_v: np.ndarray
    white: np.ndarray
    rotation: np.ndarray
    origin: np.ndarray  # camera frame, of the point (0, 0)

    def points(self, uv):
        uv = np.asarray(uv, dtype=float)
        return self.origin + uv[..., :1] * self.rotation[:, 0] + uv[..., 1:] * self.rotation[:, 1]

    def seen_from(self, rotation, shift):
        return Plate(self.edges_u, self.edges_v, self.white, rotation @ self.rotation, rotation @ self.origin + shift)

    def outline(self, margin=0.0):
        low_u, high_u = self.edges_u[0] - margin, self.edges_u[-1] + margin
        low_v, high_v = self.edges_v[0] - margin, self.edges_v[-1] + margin
        return self.points([[low_u, low_v], [high_u, low_v], [high_u, high_v], [low_u, high_v]])


def turned(rx_deg, ry_deg, rz_deg):
    return Rotation.from_euler("xyz", [rx_deg, ry_deg, rz_deg], degrees=True).as_matrix()


def marker_plate(bits, size_mm, rotation, centre):
    bits = np.asarray(bits)
    edges = np.linspace(0.0, size_mm, bits.shape[0] + 1)
    half = 0.5 * size_mm
    origin = np.asarray(centre, dtype=float) - half * rotation[:, 0] - half * rotation[:, 1]
    return Plate(edges, edges, bits, rotation, origin)


def render(plates, lens, size, *, blur_px=0.8, samples=4, black=40.0, white=200.0, background=None, margin_mm=8.0):
    """Float picture (height, width), without noise, of plates that do not overlap.

    `blur_px` is one number, or a pair (along u, along v). `background` is the grey between the plates (white if
    None); each plate has a white margin of `margin_mm`.
    """
    width, height = size
    picture = np.full((height, width), white if background is None else float(background))
    blur = np.broadcast_to(np.asarray(blur_px, dtype=float), (2,))
    for plate in plates:
        outline = lens.pixel(plate.outline(margin_mm))
        extra = 5.0 * blur.max() + 2.0
        low = np.maximum(np.floor(outline.min(axis=0) - extra).astype(int), 0)
        high = np.minimum(np.ceil(outline.max(axis=0) + extra).astype(int), [width - 1, height - 1])
        block = _render_block(plate, lens, low, high, blur, samples, black, white, background, margin_mm)
        picture[low[1] : high[1] + 1, low[0] : high[0] + 1] = block
    return picture


def _render_block(plate, lens, low, high, blur, samples, black, white, background, margin_mm):
    pad = int(np.ceil(4.5 * blur.max())) + 1
    n_u, n_v = high - low + 1 + 2 * pad
    sub_u = low[0] - pad + (np.arange(n_u * samples) + 0.5) / samples - 0.5
    sub_v = low[1] - pad + (np.arange(n_v * samples) + 0.5) / samples - 0.5
    xd, yd = np.meshgrid((sub_u - lens.cx) / lens.fx, (sub_v - lens.cy) / lens.fy)
    x, y = lens.straighten(xd, yd)
    # ray (x, y, 1) λ = origin + a e1 + b e2
    to_plane = np.linalg.inv(np.column_stack([plate.rotation[:, 0], plate.rotation[:, 1], plate.origin]))
    a = to_plane[0, 0] * x + to_plane[0, 1] * y + to_plane[0, 2]
    b = to_plane[1, 0] * x + to_plane[1, 1] * y + to_plane[1, 2]
    w = to_plane[2, 0] * x + to_plane[2, 1] * y + to_plane[2, 2]
    a, b = a / w, b / w
    # A sub-sample that an edge crosses is worth the part of it that lies on each side, or edges with a simple slope
    # would all err alike.
    column, right = _sides(a, plate.edges_u)
    row, below = _sides(b, plate.edges_v)
    cells = np.pad(np.where(plate.white, float(white), float(black)), 1, constant_values=float(white))
    value = (1 - below) * ((1 - right) * cells[row, column] + right * cells[row, column + 1]) + below * (
        (1 - right) * cells[row + 1, column] + right * cells[row + 1, column + 1]
    )
    if background is not None:
        off = (
            (a < plate.edges_u[0] - margin_mm)
            | (a > plate.edges_u[-1] + margin_mm)
            | (b < plate.edges_v[0] - margin_mm)
            | (b > plate.edges_v[-1] + margin_mm)
        )
        value[off] = background
    if blur.max() > 0:
        value = gaussian_filter(value, (blur[1] * samples, blur[0] * samples), truncate=4.5, mode="nearest")
    value = value.reshape(n_v, samples, n_u, samples).mean(axis=(1, 3))
    return value[pad:-pad, pad:-pad]


def _sides(place, edges):
    """Index of the nearest line and the share of the sub-sample that lies beyond it."""
    line = np.searchsorted(0.5 * (edges[1:] + edges[:-1]), place)
    by_v, by_u = np.gradient(place)
    return line, np.clip(0.5 + (place - edges[line]) / (np.abs(by_u) + np.abs(by_v)), 0.0, 1.0)


def as_picture(values, rng=None, noise=0.0):
    """Noise, rounding, 8 bits."""
    if noise:
        values = values + rng.normal(0.0, noise, values.shape)
    return np.clip(np.rint(values), 0, 255).astype(np.uint8)
