"""Rotations by a vector, and back. The simulator's own: nothing here is shared with what it tests."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
import numpy.typing as npt

Array: TypeAlias = npt.NDArray[np.float64]


def rotation(vector_rad: Array) -> Array:
    """Turn rotation vectors into matrices, exactly (Rodrigues' formula).

    Parameters
    ----------
    vector_rad
        (..., 3): direction = axis of rotation, length = angle.

    Returns
    -------
    ndarray
        (..., 3, 3)
    """
    vector = np.asarray(vector_rad, dtype=np.float64)
    angle = np.sqrt(np.sum(vector * vector, axis=-1))[..., None, None]
    cross = cross_matrix(vector)
    # sin(x)/x and (1 - cos(x))/x² = ½ (sin(x/2)/(x/2))²: np.sinc is smooth through 0.
    first = np.sinc(angle / np.pi)
    second = 0.5 * np.sinc(0.5 * angle / np.pi) ** 2
    return np.asarray(np.eye(3) + first * cross + second * (cross @ cross))


def rotation_vector(matrix: Array) -> Array:
    """Turn rotation matrices (..., 3, 3) into rotation vectors (..., 3); exact for angles well below π."""
    matrix = np.asarray(matrix, dtype=np.float64)
    twice_sine = np.stack(
        [
            matrix[..., 2, 1] - matrix[..., 1, 2],
            matrix[..., 0, 2] - matrix[..., 2, 0],
            matrix[..., 1, 0] - matrix[..., 0, 1],
        ],
        axis=-1,
    )
    sine = 0.5 * np.sqrt(np.sum(twice_sine * twice_sine, axis=-1))
    cosine = 0.5 * (np.trace(matrix, axis1=-2, axis2=-1) - 1.0)
    angle = np.arctan2(sine, cosine)
    return np.asarray(0.5 * twice_sine / np.sinc(angle / np.pi)[..., None])


def cross_matrix(vector: Array) -> Array:
    """Give the matrix [v]× (..., 3, 3), [v]× w = v × w."""
    x, y, z = vector[..., 0], vector[..., 1], vector[..., 2]
    zero = np.zeros_like(x)
    rows = [[zero, -z, y], [z, zero, -x], [-y, x, zero]]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def looking_along(forward: Array, up: Array) -> Array:
    """Give the axes of something that looks along `forward`: columns right, down, forward (OpenCV's camera axes).

    Parameters
    ----------
    forward, up
        (3,), any length; `up` must not lie along `forward`.

    Returns
    -------
    ndarray
        (3, 3) rotation, world from camera.
    """
    z = forward / np.linalg.norm(forward)
    x = np.cross(z, up)
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(z, x), z], axis=1)
