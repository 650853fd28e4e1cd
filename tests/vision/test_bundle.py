"""The joint adjustment: derivatives, OpenCV as second opinion, covariance by Monte-Carlo, what is not determined."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from board_scenes import IMAGE_SIZE, board_mm, board_poses, drawn_views, known_rig, seen_by

from geoerr.errors import NotDeterminedError
from geoerr.vision.board_views import BoardView, SeenCorners, sightings_of, total_rms
from geoerr.vision.bundle import Estimate, Poses, adjust, covariance_of, residuals_of
from geoerr.vision.camera import parameters_of
from geoerr.vision.rig import Rig
from geoerr.vision.rotation import rotation_from_vector


def truth(n_views: int, seed: int, tilt_rad: float = 0.6) -> tuple[Rig, Estimate, list[BoardView]]:
    rig, corners_mm = known_rig(), board_mm()
    middle = corners_mm.mean(axis=0)
    poses = board_poses(n_views, np.random.default_rng(seed), tilt_rad)
    estimate = Estimate(
        (rig.left, rig.right),
        rig.right_from_left,
        Poses(np.stack([turn for turn, _ in poses]), np.stack([place - turn @ middle for turn, place in poses])),
    )
    views = [
        BoardView(str(n), *(SeenCorners(corners_mm, px, np.ones(len(px))) for px in seen_by(rig, corners_mm, pose)))
        for n, pose in enumerate(poses)
    ]
    return rig, estimate, views


def both(views: list[BoardView]):
    return tuple(sightings_of(views, camera) for camera in (0, 1))


def rig_of(estimate: Estimate) -> Rig:
    assert estimate.pair is not None
    left, right = estimate.cameras
    return Rig(left.matrix_px, left.distortion, right.matrix_px, right.distortion, estimate.pair, IMAGE_SIZE)


def parameter_change(new: Estimate, old: Estimate) -> np.ndarray:
    assert new.pair is not None
    assert old.pair is not None
    turn = new.pair.R @ old.pair.R.T
    small = 0.5 * np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
    cameras = [parameters_of(a) - parameters_of(b) for a, b in zip(new.cameras, old.cameras, strict=True)]
    return np.concatenate([*cameras, small, new.pair.t_mm - old.pair.t_mm])


def test_true_values_leave_nothing() -> None:
    _, estimate, views = truth(4, 1)
    assert max(np.abs(residual).max() for residual in residuals_of(both(views), estimate)) < 1e-9


def test_information_is_that_of_finite_differences() -> None:
    """Differentiate the residuals by everything numerically, and eliminate the poses by a plain inverse."""
    rig, estimate, views = truth(4, 2)
    sightings = both(views)
    n_rig, n_views = len(rig.parameter_names), len(views)

    def residual(change: np.ndarray) -> np.ndarray:
        changed = rig.changed_by(change[:n_rig])
        steps = change[n_rig:].reshape(n_views, 6)
        poses = Poses(
            rotation_from_vector(steps[:, :3]) @ estimate.poses.turn, estimate.poses.shift_mm + steps[:, 3:]
        )
        moved = Estimate((changed.left, changed.right), changed.right_from_left, poses)
        return np.concatenate([part.ravel() for part in residuals_of(sightings, moved)])

    sizes = np.concatenate([[1e-2] * 4 + [1e-5] * 5] * 2 + [[1e-6] * 3 + [1e-3] * 3] * (1 + n_views))
    jacobian = np.column_stack(
        [(residual(step) - residual(-step)) / (2 * size) for step, size in zip(np.diag(sizes), sizes, strict=True)]
    )
    scale = np.linalg.norm(jacobian, axis=0)
    full = np.linalg.inv((jacobian / scale).T @ (jacobian / scale)) / np.outer(scale, scale)
    stated = covariance_of(adjust(sightings, estimate).information)
    deviation = np.sqrt(np.diag(full)[:n_rig])
    # Central differences carry about 1e-7 relative; the inverse's condition (1e5, scaled) multiplies it.
    assert np.abs((stated - full[:n_rig, :n_rig]) / np.outer(deviation, deviation)).max() < 1e-3


def test_it_finds_the_way_back_and_agrees_with_opencv() -> None:
    rng = np.random.default_rng(5)
    rig, estimate, _ = truth(8, 5)
    views = drawn_views(rig, 8, 0.1, np.random.default_rng(5))
    disturbed = rig.changed_by(
        np.concatenate([[8.0, -6.0, 5.0, -7.0, 0.02, -0.05, 0, 0, 0.01] * 2, [0.01, -0.02, 0.01, 4.0, -3.0, 2.0]])
    )
    steps = rng.normal(0.0, 0.02, (8, 3))
    start = Estimate(
        (disturbed.left, disturbed.right),
        disturbed.right_from_left,
        Poses(rotation_from_vector(steps) @ estimate.poses.turn, estimate.poses.shift_mm + rng.normal(0, 5, (8, 3))),
    )
    fitted = adjust(both(views), start)
    assert fitted.is_converged
    k = [rig.K_left.copy(), rig.dist_left.copy(), rig.K_right.copy(), rig.dist_right.copy()]
    rms, k_left, d_left, k_right, d_right, turn, shift, *_ = cv2.stereoCalibrate(
        [view.left.board_mm.astype(np.float32) for view in views],
        [view.left.pixel.astype(np.float32) for view in views],
        [view.right.pixel.astype(np.float32) for view in views],
        *k,
        IMAGE_SIZE,
        flags=cv2.CALIB_USE_INTRINSIC_GUESS,
        criteria=(cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 200, 1e-14),
    )
    assert total_rms(both(views), fitted.residual_px) == pytest.approx(rms, rel=1e-5)
    found = rig_of(fitted.estimate)
    sigma = np.sqrt(np.diag(covariance_of(fitted.information))) * 0.1
    other = Rig(k_left, d_left.ravel(), k_right, d_right.ravel(), rig.right_from_left, IMAGE_SIZE)
    # OpenCV takes corners in single precision (5e-5 px against 0.1 px of noise) and stops earlier.
    difference = np.concatenate(
        [
            parameters_of(found.left) - parameters_of(other.left),
            parameters_of(found.right) - parameters_of(other.right),
            np.zeros(3),
            found.right_from_left.t_mm - shift.ravel(),
        ]
    )
    assert np.abs(difference / sigma).max() < 0.02
    assert np.abs(found.right_from_left.R - turn).max() < 0.02 * sigma[-6:-3].max()


def test_covariance_by_monte_carlo() -> None:
    """Stated covariance against the scatter of solutions; also for corners that are weighted."""
    rng = np.random.default_rng(7)
    _, estimate, views = truth(6, 7)
    clean = both(views)
    sigma = [np.where(seen.view % 2 == 0, 0.05, 0.15) for seen in clean]
    weighted = tuple(replace(seen, weight=(0.1 / s) ** 2) for seen, s in zip(clean, sigma, strict=True))
    stated = covariance_of(adjust(weighted, estimate).information) * 0.1**2
    n_draws = 120
    changes = []
    for _ in range(n_draws):
        noisy = tuple(
            replace(seen, pixel=seen.pixel + rng.normal(size=seen.pixel.shape) * s[:, None])
            for seen, s in zip(weighted, sigma, strict=True)
        )
        changes.append(parameter_change(adjust(noisy, estimate).estimate, estimate))
    changes = np.array(changes)
    z = changes / np.sqrt(np.diag(stated))
    # A deviation from 120 draws is within 6.5 % (1 σ); 24 of them are looked at, correlated.
    assert np.abs(z.std(axis=0) - 1.0).max() < 0.25
    whole = np.einsum("ni,ij,nj->n", changes, np.linalg.inv(stated), changes)
    # χ² of 24 degrees of freedom: mean 24, deviation 6.9, of the mean of 120 draws 0.63.
    assert whole.mean() == pytest.approx(24.0, abs=4.0 * 0.63)


def test_what_is_held_stays() -> None:
    rig, estimate, views = truth(4, 9)
    off = replace(estimate, pair=rig.changed_by(np.append(np.zeros(21), [1.0, 1.0, 1.0])).right_from_left)
    held = adjust(both(views), off, hold_cameras=True)
    assert held.estimate.cameras[0] is not None
    assert np.array_equal(parameters_of(held.estimate.cameras[0]), parameters_of(rig.left))
    assert held.estimate.pair is not None
    assert np.allclose(held.estimate.pair.t_mm, rig.right_from_left.t_mm, atol=1e-6)
    both_held = adjust(both(views), off, hold_cameras=True, hold_pair=True)
    assert both_held.estimate.pair is off.pair or np.array_equal(both_held.estimate.pair.t_mm, off.pair.t_mm)
    assert both_held.information.shape == (0, 0)


def test_corners_without_weight_have_no_say() -> None:
    _, estimate, views = truth(4, 11)
    sightings = both(views)
    left = sightings[0]
    pixel, weight = left.pixel.copy(), left.weight.copy()
    pixel[7], weight[7] = 1e4, 0.0
    fitted = adjust((replace(left, pixel=pixel, weight=weight), sightings[1]), estimate)
    assert np.abs(parameter_change(fitted.estimate, estimate)).max() < 1e-6


def test_views_without_tilt_do_not_determine_a_lens() -> None:
    _, estimate, views = truth(5, 13, tilt_rad=0.0)
    turn = np.broadcast_to(np.eye(3), (5, 3, 3)).copy()
    flat = replace(estimate, poses=Poses(turn, estimate.poses.shift_mm), pair=None, cameras=estimate.cameras[:1])
    corners = sightings_of(views, 0)
    seen = replace(corners, pixel=corners.pixel - residuals_of((corners,), flat)[0])
    with pytest.raises(NotDeterminedError, match="leave a parameter of the cameras free"):
        covariance_of(adjust((seen,), flat).information)
