"""The lens model: against OpenCV, its own inverse, and differences."""

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from geoerr.vision.camera import (
    Camera,
    camera_from_parameters,
    distort,
    distort_jacobian,
    parameters_of,
    project,
    project_jacobian,
    undistort,
)

LENSES = {
    4: [-0.12, 0.15, 0.0006, -0.0004],
    5: [-0.12, 0.15, 0.0006, -0.0004, -0.03],
    8: [0.4, -0.2, 0.0006, -0.0004, 0.05, 0.5, -0.1, 0.02],
    12: [0.4, -0.2, 0.0006, -0.0004, 0.05, 0.5, -0.1, 0.02, 0.001, -0.0005, 0.0007, 0.0004],
}


def camera(n=5):
    matrix = np.array([[2319.0, 0.0, 1230.0], [0.0, 2321.0, 1019.0], [0.0, 0.0, 1.0]])
    return Camera(matrix, np.array(LENSES[n]))


def points(n=200):
    rng = np.random.default_rng(1)
    return np.column_stack([rng.uniform(-350, 350, n), rng.uniform(-300, 300, n), rng.uniform(600, 1000, n)])


@pytest.mark.parametrize("n", LENSES)
def test_projects_as_opencv_does(n):
    lens = camera(n)
    seen = cv2.projectPoints(points(), np.zeros(3), np.zeros(3), lens.matrix_px, lens.distortion)[0].reshape(-1, 2)
    assert np.abs(project(points(), lens) - seen).max() < 1e-9


@pytest.mark.parametrize("n", LENSES)
def test_inverse_is_exact_to_rounding(n):
    lens = camera(n)
    pixels = project(points(), lens)
    rays = points()[:, :2] / points()[:, 2:]
    # 1e-13 of a ray is 2e-10 px.
    assert np.abs(lens.normalised_from_pixel(pixels) - rays).max() < 1e-13


def test_inverse_is_that_of_opencv_with_tight_criteria():
    lens = camera()
    pixels = project(points(), lens)
    criteria = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 200, 1e-14)
    # OpenCV 4 has the criteria in a function of its own.
    straighten = getattr(cv2, "undistortPointsIter", cv2.undistortPoints)
    second = straighten(pixels.reshape(-1, 1, 2), lens.matrix_px, lens.distortion, None, None, criteria=criteria)
    second = second.reshape(-1, 2)
    assert np.abs(lens.normalised_from_pixel(pixels) - second).max() < 1e-12


@given(
    st.floats(-0.5, 0.5), st.floats(-0.45, 0.45), st.floats(-0.2, 0.2), st.floats(-0.1, 0.3), st.floats(-2e-3, 2e-3)
)
def test_inverse_undoes_the_lens_or_says_that_it_cannot(x, y, k1, k2, p1):
    lens = np.array([k1, k2, p1, -p1, 0.0])
    bent = distort(np.array([x, y]), lens)
    ray = undistort(bent, lens)
    if np.isfinite(ray).all():
        assert np.abs(distort(ray, lens) - bent).max() < 1e-11
    # This lens does not fold over within the picture, so there is an inverse.
    assert np.isfinite(ray).all()


def test_no_inverse_is_nan():
    # r(1 − 0.5 r²) has its maximum 0.544 at r = 0.816: nothing in front of the lens is drawn beyond.
    lens = np.array([-0.5, 0.0, 0.0, 0.0, 0.0])
    rays = undistort(np.array([[0.4, 0.0], [0.7, 0.0]]), lens)
    assert np.isfinite(rays[0]).all()
    assert np.isnan(rays[1]).all()


@pytest.mark.parametrize("n", LENSES)
def test_derivatives_by_differences(n):
    lens = camera(n)
    places = points(20)
    step = 1e-4
    _, by_point, by_camera = project_jacobian(places, lens)
    for axis in range(3):
        shift = step * np.eye(3)[axis]
        slope = (project(places + shift, lens) - project(places - shift, lens)) / (2 * step)
        assert np.abs(slope - by_point[..., axis]).max() < 1e-6
    parameters = parameters_of(lens)
    for k in range(len(parameters)):
        size = 1e-5 * max(1.0, abs(parameters[k]))
        change = size * np.eye(len(parameters))[k]
        above = project(places, camera_from_parameters(parameters + change))
        below = project(places, camera_from_parameters(parameters - change))
        # Pixels of 1e3 carry rounding of 1e-13 / 1e-5; curvature adds size².
        assert np.abs((above - below) / (2 * size) - by_camera[..., k]).max() < 1e-4


def test_slope_between_straight_and_bent_pixels():
    lens = camera()
    rays = points(20)[:, :2] / points(20)[:, 2:]
    pixel, slope = lens.pixel_slope(rays)
    assert np.allclose(pixel, lens.pixel_from_normalised(rays), atol=0, rtol=0)
    straight = lens.undistorted_pixel_from_normalised(rays)
    for axis in range(2):
        moved = (straight + 1e-3 * np.eye(2)[axis] - lens.principal_point_px) / lens.focal_px
        difference = (lens.pixel_from_normalised(moved) - pixel) / 1e-3
        assert np.abs(difference - slope[..., axis]).max() < 1e-5


def test_a_lens_without_distortion_is_left_alone():
    rays = np.array([[0.1, 0.2]])
    assert np.array_equal(undistort(rays, np.zeros(5)), rays)
    assert np.array_equal(distort_jacobian(rays, np.zeros(5))[1][0], np.eye(2))
