"""Rotations as 3×3 matrices and rotation vectors."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


def cross_matrix(vector: Array) -> Array:
    """`[v]×` with `[v]× w = v × w`; shape (..., 3) to (..., 3, 3)."""
    x, y, z = vector[..., 0], vector[..., 1], vector[..., 2]
    zero = np.zeros_like(x)
    rows = [np.stack([zero, -z, y], -1), np.stack([z, zero, -x], -1), np.stack([-y, x, zero], -1)]
    return np.stack(rows, axis=-2)


def rotation_from_vector(vector: Array) -> Array:
    """Rotation by |v| about v (Rodrigues), shape (..., 3) to (..., 3, 3); exact for a small v too."""
    angle2 = (vector * vector).sum(axis=-1)[..., None, None]
    angle = np.sqrt(angle2)
    k = cross_matrix(vector)
    # sin(a)/a and (1 - cos a)/a² by way of sinc, which has no hole at 0.
    first = np.sinc(angle / np.pi)
    second = 0.5 * np.sinc(angle / (2.0 * np.pi)) ** 2
    result: Array = np.eye(3) + first * k + second * (k @ k)
    return result


def angle_between_rad(first: Array, second: Array) -> float:
    """Angle of the rotation that leads from one orientation to another."""
    turn = first.T @ second
    sine = np.linalg.norm([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]]) / 2.0
    return float(np.arctan2(sine, (np.trace(turn) - 1.0) / 2.0))


def nearest_rotation(matrix: Array) -> Array:
    """Give the rotation nearest to a 3×3 matrix."""
    u, _, vt = np.linalg.svd(matrix)
    flip = np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ vt))])
    result: Array = u @ flip @ vt
    return result
