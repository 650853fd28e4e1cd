"""Plates in space: unbiased, as certain as they say, better than four corners one by one."""

from dataclasses import replace

import numpy as np
import pytest
from stereo_scenes import LEFT, RIGHT, ROTATION, SHIFT, plates_at, rig, rig_covariance, right_of

from geoerr.geometry import triangulate
from geoerr.vision.plate import N_RESIDUALS, SeenPlates, locate_plates


def corner_covariance(rng, sigma_px=0.004):
    """Correlated as a photometric fit's corners are: a common part, and one for each."""
    common = rng.normal(size=(8, 3)) * 0.5 * sigma_px
    return common @ common.T + np.eye(8) * sigma_px**2


def seen(n, rng, noisy=True):
    """The first plate of frame 0, n times, with fresh noise each time."""
    plates, centres = plates_at(0)
    edge = plates[0].edges_u[-1]
    corners = plates[0].points([[0, 0], [edge, 0], [edge, edge], [0, edge]])
    covariances = (corner_covariance(rng), corner_covariance(rng))
    sides = []
    for lens, points, covariance in ((LEFT, corners, covariances[0]), (RIGHT, right_of(corners), covariances[1])):
        exact = lens.undistorted_pixel(points)
        # By Cholesky: of equal eigenvalues every machine has its own eigenvectors, and so its own draws.
        drawn = rng.multivariate_normal(np.zeros(8), covariance, n, method="cholesky")
        noise = (drawn if noisy else 0.0 * drawn).reshape(n, 4, 2)
        sides.append((exact + noise, np.tile(covariance, (n, 1, 1))))
    return SeenPlates(*sides[0], *sides[1]), centres[0], edge


def test_exact_corners_give_the_exact_plate():
    given, centre, edge = seen(1, np.random.default_rng(0), noisy=False)
    plates = locate_plates(rig(), given)
    assert np.abs(plates.centre_mm - centre).max() < 1e-9
    assert np.abs(plates.sides_mm - edge).max() < 1e-9
    assert abs(plates.right_angle_error_rad[0]) < 1e-11
    assert plates.reprojection_px[0] < 1e-9
    assert plates.why == ("",)


def test_scatter_is_the_covariance_and_residuals_have_unit_variance():
    n = 2000
    given, centre, _ = seen(n, np.random.default_rng(1))
    plates = locate_plates(rig(), given)
    error = plates.centre_mm - centre
    normalised = np.einsum("ni,nij,nj->n", error, np.linalg.inv(plates.covariance_mm2), error)
    # Means over n: χ²₃/3 has a standard deviation of √(2/3n) = 0.018, χ²₇/7 of 0.012.
    assert np.mean(normalised) / 3 == pytest.approx(1.0, abs=0.06)
    assert np.mean(plates.whitened_residual**2) == pytest.approx(1.0, abs=0.04)
    # And so are the sides: the standard deviation of one from 2000 draws is known to 1.6 %.
    assert np.std(plates.sides_mm.mean(axis=1)) == pytest.approx(plates.side_std_mm.mean(), rel=0.06)
    assert np.abs(np.mean(error, axis=0) / np.sqrt(np.diag(plates.covariance_mm2[0]) / n)).max() < 4.0


def test_better_than_the_mean_of_four_corners():
    n = 2000
    given, centre, _ = seen(n, np.random.default_rng(2))
    plates = locate_plates(rig(), given)
    blocks = [
        np.stack([c[:, 2 * k : 2 * k + 2, 2 * k : 2 * k + 2] for k in range(4)], axis=1).reshape(-1, 2, 2)
        for c in (given.left_covariance_px2, given.right_covariance_px2)
    ]
    pair = rig()
    corners = triangulate(
        pair.projection_left_px,
        pair.projection_right_px,
        given.left_px.reshape(-1, 2),
        given.right_px.reshape(-1, 2),
        cov_left_px2=blocks[0],
        cov_right_px2=blocks[1],
    ).points_mm.reshape(n, 4, 3)
    ours = np.sqrt(np.mean((plates.centre_mm - centre) ** 2, axis=0))
    theirs = np.sqrt(np.mean((corners.mean(axis=1) - centre) ** 2, axis=0))
    assert (ours < theirs).all()


def test_whitened_derivative_by_the_rig():
    given, _, _ = seen(1, np.random.default_rng(3))
    before = locate_plates(rig(), given)
    # The pixels that the pictures show stay; undistorted ones belong to the lens. So hold the distorted ones.
    n = len(rig().parameter_names)
    for k in range(n):
        size = 1e-6 if k % 9 >= 4 or k >= 18 else 1e-3
        residuals = []
        for sign in (1.0, -1.0):
            changed = rig().changed_by(sign * size * np.eye(n)[k])
            straight = []
            for old, new, points in (
                (rig().left, changed.left, given.left_px),
                (rig().right, changed.right, given.right_px),
            ):
                shown = old.pixel_from_normalised((points - old.principal_point_px) / old.focal_px)
                straight.append(new.undistorted_pixel_from_normalised(new.normalised_from_pixel(shown)))
            moved = SeenPlates(straight[0], given.left_covariance_px2, straight[1], given.right_covariance_px2)
            residuals.append(locate_plates(changed, moved).whitened_residual[0])
        difference = (residuals[0] - residuals[1]) / (2 * size)
        expected = before.whitened_by_rig[0, :, k]
        # The seven directions may turn among themselves when the rig changes: their length does not.
        assert np.linalg.norm(difference) == pytest.approx(np.linalg.norm(expected), rel=0.02, abs=1e-3)


def test_points_behind_the_cameras_say_so():
    given, _, _ = seen(1, np.random.default_rng(4), noisy=False)
    # Seen further right by the right camera than by the left one: the rays part.
    plates = locate_plates(rig(), replace(given, right_px=given.right_px + np.array([900.0, 0.0])))
    assert np.isnan(plates.centre_mm).all()
    assert "behind" in plates.why[0] or "parallel" in plates.why[0]


def test_one_bad_plate_does_not_spoil_the_others():
    given, centre, _ = seen(3, np.random.default_rng(5), noisy=False)
    left = given.left_px.copy()
    left[1, 2] = np.nan
    plates = locate_plates(rig(), replace(given, left_px=left))
    assert plates.why[1] == "a corner has no place in the picture"
    assert np.abs(plates.centre_mm[[0, 2]] - centre).max() < 1e-9
    assert plates.whitened_by_rig.shape == (3, N_RESIDUALS, 24)


def test_geometry_of_the_scene():
    """The tests' own rig and geoerr's agree on where the right camera is."""
    pair = rig(rig_covariance())
    assert np.array_equal(pair.right_from_left.R, ROTATION)
    assert np.array_equal(pair.right_from_left.t_mm, SHIFT)
