"""Both cameras, their pair and every board pose adjusted at once.

Least squares on all corner pixels of all views. Every view has a board pose of its own, which only that view's
pixels know: the poses are eliminated view by view (Schur complement), so that each step solves for the rig's 24
numbers and the poses follow. The inverse of the reduced matrix is the rig's covariance, poses free.

| symbol | meaning | unit |
|---|---|---|
| p = R_v X + t_v | board corner X of view v, left camera's frame | mm |
| p' = R p + t | the same in the right camera's frame | mm |
| θ | both lenses (fx, fy, cx, cy, distortion), turn and shift of the pair: `Rig.parameter_names` | px, –, rad, mm |
| φ_v | turn and shift of view v's board | rad, mm |
| [A B; Bᵀ D] | normal matrix of (θ, φ); D is block-diagonal | – |

Turns are small rotations to the left of the present one: `R_new = exp([turn]×) R`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from geoerr.errors import NotDeterminedError
from geoerr.vision.camera import Camera, camera_from_parameters, parameters_of, project_jacobian
from geoerr.vision.rig import RightFromLeft
from geoerr.vision.rotation import cross_matrix, rotation_from_vector

Array = npt.NDArray[np.float64]
Rows = npt.NDArray[np.intp]

_ITERATIONS = 200
# The last step, in standard deviations of what it changes.
_CONVERGED_SIGMAS = 1e-4
_FIRST_DAMPING = 1e-3
_LEAST_DAMPING = 1e-12
_LARGEST_DAMPING = 1e8
_POSE_SIZE = 6
# Reciprocal condition of the scaled matrix at which double precision has no digit left to answer with.
_LEAST_CONDITION = 1e-14


@dataclass(frozen=True)
class Sightings:
    """All corners that one camera saw, view after view.

    Attributes
    ----------
    view
        (m,) number of the view, ascending.
    board_mm
        (m, 3) the corner on the board.
    pixel
        (m, 2) distorted pixels.
    weight
        (m,) 1 = takes part, 0 = set aside; anything between counts that much.
    """

    view: npt.NDArray[np.int64]
    board_mm: Array
    pixel: Array
    weight: Array

    def of_views(self, views: Sequence[int]) -> Sightings:
        """Give the corners of some views, numbered anew from 0 in the given (ascending) order."""
        number = {old: new for new, old in enumerate(views)}
        rows = np.flatnonzero(np.isin(self.view, list(views)))
        view = np.array([number[int(old)] for old in self.view[rows]], dtype=np.int64)
        return Sightings(view, self.board_mm[rows], self.pixel[rows], self.weight[rows])

    def rows_of_views(self, n_views: int) -> list[slice]:
        """Give each view's rows."""
        edges = np.searchsorted(self.view, np.arange(n_views + 1))
        return [slice(int(first), int(end)) for first, end in pairwise(edges)]


@dataclass(frozen=True)
class Poses:
    """Board poses `p_left = turn @ X + shift_mm`: turn (n, 3, 3), shift_mm (n, 3)."""

    turn: Array
    shift_mm: Array

    def __len__(self) -> int:
        return len(self.turn)

    def of_views(self, views: Sequence[int]) -> Poses:
        """Give some views' poses."""
        return Poses(self.turn[list(views)], self.shift_mm[list(views)])


@dataclass(frozen=True)
class Estimate:
    """Everything that is being adjusted: one camera, or two and their pair; a board pose for each view."""

    cameras: tuple[Camera, ...]
    pair: RightFromLeft | None
    poses: Poses


@dataclass(frozen=True)
class Adjusted:
    """What an adjustment ended with.

    Attributes
    ----------
    estimate
        The estimate.
    residual_px
        For each camera (m, 2), seen minus expected, of every corner, those set aside too.
    is_converged
        Whether the last step was nothing against the uncertainty.
    iterations
        Steps that were tried.
    information
        (g, g) inverse covariance of θ for pixels of unit variance, poses free; (0, 0) where θ was held.
    """

    estimate: Estimate
    residual_px: tuple[Array, ...]
    is_converged: bool
    iterations: int
    information: Array


@dataclass
class _Normal:
    """Normal equations: A (g, g), B (n, g, 6), D (n, 6, 6) and the right sides."""

    a: Array
    b: Array
    d: Array
    right_a: Array
    right_d: Array
    cost: float


def adjust(
    sightings: tuple[Sightings, ...],
    start: Estimate,
    *,
    hold_cameras: bool = False,
    hold_pair: bool = False,
    iterations: int = _ITERATIONS,
) -> Adjusted:
    """Adjust by Levenberg–Marquardt until the step is nothing against the uncertainty.

    Parameters
    ----------
    sightings
        Of the left camera, or of both.
    start
        Near enough: poses within a few degrees.
    hold_cameras, hold_pair
        Keep lenses, or the pair's pose, as they are.
    iterations
        Steps to try at most; a handful do unless the views hardly determine the lenses.

    Raises
    ------
    NotDeterminedError
        where the views leave a parameter free.

    Notes
    -----
    Derivatives are verified against finite differences, the result against `cv2.stereoCalibrate`, the covariance by
    Monte-Carlo (tests/vision/test_bundle.py).
    """
    free = _free_parameters(start, hold_cameras, hold_pair)
    estimate, damping = start, _FIRST_DAMPING
    normal, residuals = _normal_equations(sightings, estimate, free)
    n_numbers = 2.0 * sum(float(seen.weight.sum()) for seen in sightings)
    freedom = max(n_numbers - len(free) - _POSE_SIZE * len(start.poses), 1.0)
    is_converged = False
    growth = 2.0
    tries = 0
    while tries < iterations and not is_converged and damping < _LARGEST_DAMPING:
        tries += 1
        step_a, step_d = _step(normal, damping)
        tried = _moved(estimate, free, step_a, step_d)
        tried_normal, tried_residuals = _normal_equations(sightings, tried, free)
        expected = float(step_a @ normal.right_a + np.sum(step_d * normal.right_d))
        is_converged = expected <= _CONVERGED_SIGMAS**2 * max(normal.cost / freedom, 1e-20) and damping < 1.0
        if tried_normal.cost <= normal.cost:
            # Nielsen's rule: the better the linear prediction was, the bolder the next step.
            gain = (normal.cost - tried_normal.cost) / max(_predicted_gain(normal, step_a, step_d, damping), 1e-300)
            damping = max(damping * max(0.1, 1.0 - (2.0 * gain - 1.0) ** 3), _LEAST_DAMPING)
            growth = 2.0
            estimate, normal, residuals = tried, tried_normal, tried_residuals
        elif not is_converged:
            damping *= growth
            growth *= 2.0
    return Adjusted(estimate, residuals, is_converged, tries, _information(normal))


def residuals_of(sightings: tuple[Sightings, ...], estimate: Estimate) -> tuple[Array, ...]:
    """Seen minus expected pixels, (m, 2) for each camera."""
    return tuple(_camera_rows(number, seen, estimate)[0] for number, seen in enumerate(sightings))


def covariance_of(information: Array) -> Array:
    """Inverse of an information matrix, by way of unit-free numbers.

    Raises
    ------
    NotDeterminedError
        where it has none.
    """
    scale = np.sqrt(np.diag(information))
    if not (scale > 0.0).all():
        raise NotDeterminedError("the views leave a parameter of the cameras free")
    values, vectors = np.linalg.eigh(information / np.outer(scale, scale))
    if not values[0] > _LEAST_CONDITION * values[-1]:
        raise NotDeterminedError("the views leave a parameter of the cameras free")
    half = vectors / np.sqrt(values) / scale[:, None]
    return np.asarray(half @ half.T)


def parameters_of_estimate(estimate: Estimate) -> int:
    """Count θ: cameras and pair, without the poses."""
    return sum(4 + len(camera.distortion) for camera in estimate.cameras) + (0 if estimate.pair is None else 6)


def _free_parameters(estimate: Estimate, hold_cameras: bool, hold_pair: bool) -> Rows:
    n_camera = sum(4 + len(camera.distortion) for camera in estimate.cameras)
    is_free = np.ones(parameters_of_estimate(estimate), dtype=bool)
    is_free[:n_camera] = not hold_cameras
    is_free[n_camera:] = not hold_pair
    return np.flatnonzero(is_free)


def _normal_equations(
    sightings: tuple[Sightings, ...], estimate: Estimate, free: Rows
) -> tuple[_Normal, tuple[Array, ...]]:
    n_views, n_free = len(estimate.poses), len(free)
    normal = _Normal(
        np.zeros((n_free, n_free)),
        np.zeros((n_views, n_free, _POSE_SIZE)),
        np.zeros((n_views, _POSE_SIZE, _POSE_SIZE)),
        np.zeros(n_free),
        np.zeros((n_views, _POSE_SIZE)),
        0.0,
    )
    residuals = []
    for number, seen in enumerate(sightings):
        residual, by_rig, by_pose = _camera_rows(number, seen, estimate)
        residuals.append(residual)
        root = np.sqrt(seen.weight)[:, None]
        residual = residual * root
        by_rig, by_pose = by_rig[:, :, free] * root[..., None], by_pose * root[..., None]
        normal.cost += float(np.sum(residual * residual))
        for view, rows in enumerate(seen.rows_of_views(n_views)):
            g = by_rig[rows].reshape(2 * (rows.stop - rows.start), n_free)
            p = by_pose[rows].reshape(-1, _POSE_SIZE)
            r = residual[rows].ravel()
            normal.a += g.T @ g
            normal.b[view] += g.T @ p
            normal.d[view] += p.T @ p
            normal.right_a += g.T @ r
            normal.right_d[view] += p.T @ r
    return normal, tuple(residuals)


def _camera_rows(number: int, seen: Sightings, estimate: Estimate) -> tuple[Array, Array, Array]:
    """Residual (m, 2) and the derivatives of the expected pixel by θ (m, 2, g) and by the pose (m, 2, 6)."""
    camera = estimate.cameras[number]
    turned = np.einsum("mij,mj->mi", estimate.poses.turn[seen.view], seen.board_mm)
    left_mm = turned + estimate.poses.shift_mm[seen.view]
    n_camera = [4 + len(one.distortion) for one in estimate.cameras]
    first = sum(n_camera[:number])
    by_rig = np.zeros((len(seen.view), 2, parameters_of_estimate(estimate)))
    if number == 0:
        expected, by_left, by_camera = project_jacobian(left_mm, camera)
    else:
        assert estimate.pair is not None
        rotated = left_mm @ estimate.pair.R.T
        expected, by_right, by_camera = project_jacobian(rotated + estimate.pair.t_mm, camera)
        by_rig[:, :, -6:-3] = -by_right @ cross_matrix(rotated)
        by_rig[:, :, -3:] = by_right
        by_left = by_right @ estimate.pair.R
    by_rig[:, :, first : first + n_camera[number]] = by_camera
    by_pose = np.concatenate([-by_left @ cross_matrix(turned), by_left], axis=2)
    return seen.pixel - expected, by_rig, by_pose


def _step(normal: _Normal, damping: float) -> tuple[Array, Array]:
    """Solve the damped normal equations: poses eliminated, then found by substitution."""
    d = normal.d + damping * _diagonal(normal.d)
    d_inverse = np.linalg.inv(d)
    b_d = normal.b @ d_inverse
    step_a = np.zeros(len(normal.right_a))
    if len(step_a):
        a = normal.a + damping * np.diag(np.diag(normal.a))
        reduced = a - np.einsum("vgi,vhi->gh", b_d, normal.b)
        right = normal.right_a - np.einsum("vgi,vi->g", b_d, normal.right_d)
        scale = np.sqrt(np.maximum(np.diag(a), 1e-300))
        step_a = np.linalg.solve(reduced / np.outer(scale, scale), right / scale) / scale
    right_d = normal.right_d - np.einsum("vgi,g->vi", normal.b, step_a)
    return step_a, np.einsum("vij,vj->vi", d_inverse, right_d)


def _predicted_gain(normal: _Normal, step_a: Array, step_d: Array, damping: float) -> float:
    """By how much the linear model says that the cost falls."""
    towards = float(step_a @ normal.right_a + np.sum(step_d * normal.right_d))
    held = float(step_a**2 @ np.diag(normal.a) + np.sum(step_d**2 * np.einsum("vii->vi", normal.d)))
    return towards + damping * held


def _diagonal(blocks: Array) -> Array:
    return np.asarray(np.einsum("vii->vi", blocks)[..., None] * np.eye(blocks.shape[-1]))


def _information(normal: _Normal) -> Array:
    if not len(normal.right_a):
        return np.zeros((0, 0))
    return np.asarray(normal.a - np.einsum("vgi,vhi->gh", normal.b @ np.linalg.inv(normal.d), normal.b))


def _moved(estimate: Estimate, free: Rows, step_a: Array, step_d: Array) -> Estimate:
    step = np.zeros(parameters_of_estimate(estimate))
    step[free] = step_a
    cameras, place = [], 0
    for camera in estimate.cameras:
        size = 4 + len(camera.distortion)
        cameras.append(camera_from_parameters(parameters_of(camera) + step[place : place + size]))
        place += size
    pair = estimate.pair
    if pair is not None:
        pair = RightFromLeft(rotation_from_vector(step[place : place + 3]) @ pair.R, pair.t_mm + step[place + 3 :])
    poses = Poses(rotation_from_vector(step_d[:, :3]) @ estimate.poses.turn, estimate.poses.shift_mm + step_d[:, 3:])
    return replace(estimate, cameras=tuple(cameras), pair=pair, poses=poses)
