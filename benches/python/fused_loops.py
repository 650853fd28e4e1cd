"""What a user would write with Numba: the same work in one loop each. Without Numba there is nothing here to race."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Loop = Callable[..., Any]


def _triangulate(left: Array, right: Array, uv_left: Array, uv_right: Array) -> Array:
    """Solve the normal equations of the four rows of each point by cofactors."""
    points = np.empty((len(uv_left), 3))
    for i in range(len(uv_left)):
        xx = xy = xz = yy = yz = zz = bx = by = bz = 0.0
        for row in range(4):
            m = left if row < 2 else right
            w = uv_left[i, row] if row < 2 else uv_right[i, row - 2]
            k = row % 2
            x, y, z = w * m[2, 0] - m[k, 0], w * m[2, 1] - m[k, 1], w * m[2, 2] - m[k, 2]
            b = m[k, 3] - w * m[2, 3]
            xx += x * x
            xy += x * y
            xz += x * z
            yy += y * y
            yz += y * z
            zz += z * z
            bx += x * b
            by += y * b
            bz += z * b
        cxx, cxy, cxz = yy * zz - yz * yz, xz * yz - xy * zz, xy * yz - xz * yy
        cyy, cyz, czz = xx * zz - xz * xz, xy * xz - xx * yz, xx * yy - xy * xy
        scale = 1.0 / (xx * cxx + xy * cxy + xz * cxz)
        points[i, 0] = (cxx * bx + cxy * by + cxz * bz) * scale
        points[i, 1] = (cxy * bx + cyy * by + cyz * bz) * scale
        points[i, 2] = (cxz * bx + cyz * by + czz * bz) * scale
    return points


def _fit_lines(points: Array) -> tuple[Array, Array, Array]:
    """Give centroids, directions by four steps of power iteration on the scatter matrix, and rms residuals."""
    n_lines, n_points, _ = points.shape
    centroid, direction, rms = np.empty((n_lines, 3)), np.empty((n_lines, 3)), np.empty(n_lines)
    for line in range(n_lines):
        x0, y0, z0 = points[line, 0, 0], points[line, 0, 1], points[line, 0, 2]
        sx = sy = sz = a = b = c = d = e = f = 0.0
        for k in range(n_points):
            x, y, z = points[line, k, 0] - x0, points[line, k, 1] - y0, points[line, k, 2] - z0
            sx += x
            sy += y
            sz += z
            a += x * x
            b += x * y
            c += x * z
            d += y * y
            e += y * z
            f += z * z
        mx, my, mz = sx / n_points, sy / n_points, sz / n_points
        a, b, c, d, e, f = a - sx * mx, b - sx * my, c - sx * mz, d - sy * my, e - sy * mz, f - sz * mz
        if a >= d and a >= f:
            u, v, w = a, b, c
        elif d >= f:
            u, v, w = b, d, e
        else:
            u, v, w = c, e, f
        for _ in range(4):
            s = 1.0 / math.sqrt(u * u + v * v + w * w)
            u, v, w = u * s, v * s, w * s
            u, v, w = a * u + b * v + c * w, b * u + d * v + e * w, c * u + e * v + f * w
        s = 1.0 / math.sqrt(u * u + v * v + w * w)
        u, v, w = u * s, v * s, w * s
        total = 0.0
        for k in range(n_points):
            x, y, z = points[line, k, 0] - x0 - mx, points[line, k, 1] - y0 - my, points[line, k, 2] - z0 - mz
            t = x * u + y * v + z * w
            x, y, z = x - t * u, y - t * v, z - t * w
            total += x * x + y * y + z * z
        centroid[line, 0], centroid[line, 1], centroid[line, 2] = x0 + mx, y0 + my, z0 + mz
        direction[line, 0], direction[line, 1], direction[line, 2] = u, v, w
        rms[line] = math.sqrt(total / n_points)
    return centroid, direction, rms


def _integrate(position: Array, values: Array, slope_weights: Array) -> Array:
    """Add trapezoids up, and take slope and first value off."""
    result = np.empty_like(values)
    for function in range(len(values)):
        total = slope = 0.0
        result[function, 0] = 0.0
        for k in range(1, len(position)):
            step = position[k] - position[k - 1]
            total += 0.5 * step * (values[function, k] + values[function, k - 1])
            result[function, k] = total
            slope += slope_weights[k] * total
        for k in range(len(position)):
            result[function, k] -= slope * (position[k] - position[0])
    return result


try:
    from numba import njit
except ImportError:
    triangulate_loop: Loop | None = None
    fit_lines_loop: Loop | None = None
    integrate_loop: Loop | None = None
else:
    triangulate_loop, fit_lines_loop, integrate_loop = (njit(work) for work in (_triangulate, _fit_lines, _integrate))
