"""Cameras against OpenCV; pictures against brute force."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from scipy.stats import multivariate_normal, norm

from geoerr.errors import GeometryError
from geoerr.simulate.cameras import Camera, StereoPair
from geoerr.simulate.render import (
    Light,
    Sheet,
    _joint_part,
    _on_sheet,
    expose,
    illumination,
    normal_distribution,
    paint,
)
from geoerr.simulate.rotations import looking_along, rotation
from geoerr.vision.patterns import charuco_layout, marker_pattern

DISTORTION = (-0.098, 0.121, 3.1e-4, -2.2e-4, -0.021)
VIEW = looking_along(np.array([0.3, 1.0, -0.4]), np.array([0.0, 0.1, 1.0]))
CAMERA = Camera((2448, 2048), (2319.0, 2317.0), (1229.8, 1019.4), DISTORTION, VIEW.T, np.array([10.0, -700.0, 250.0]))
FLAT = Light(shading=0.0, vignetting=0.0)


def opencv_pixels(camera, points):
    rotation_vector, _ = cv2.Rodrigues(camera.camera_from_base)
    shift = -camera.camera_from_base @ camera.centre_mm
    pixels, _ = cv2.projectPoints(points, rotation_vector, shift, camera.matrix, np.array(camera.distortion))
    return pixels.reshape(-1, 2)


def test_projection_is_opencv_s():
    rng = np.random.default_rng(0)
    place = rng.uniform([-350, -300, 600], [350, 300, 1200], (200, 3))
    points = place @ CAMERA.camera_from_base + CAMERA.centre_mm
    assert np.abs(CAMERA.project(points) - opencv_pixels(CAMERA, points)).max() < 1e-9


def test_the_way_back_is_exact_and_its_derivative_is_the_difference_quotient():
    u, v = np.meshgrid(np.linspace(0, 2447, 13), np.linspace(0, 2047, 11))
    x, y, derivative = CAMERA.ideal(u, v)
    rays = np.stack([x, y, np.ones_like(x)], axis=-1) @ CAMERA.camera_from_base + CAMERA.centre_mm
    assert np.abs(CAMERA.project(rays) - np.stack([u, v], axis=-1)).max() < 1e-9
    step = 1e-3
    for axis, (du, dv) in enumerate(((step, 0.0), (0.0, step))):
        ahead, behind = CAMERA.ideal(u + du, v + dv), CAMERA.ideal(u - du, v - dv)
        for coordinate in (0, 1):
            quotient = (ahead[coordinate] - behind[coordinate]) / (2 * step)
            # Relative to 1/f = 4.3e-4 the derivative is promised to 1e-6.
            assert np.abs(derivative[coordinate, axis] - quotient).max() < 1e-9


def test_what_no_lens_shows_is_not_projected():
    behind = CAMERA.centre_mm - 500.0 * VIEW[:, 2]
    aside = CAMERA.centre_mm + 500.0 * VIEW[:, 2] + 3000.0 * VIEW[:, 0]
    assert np.isnan(CAMERA.project(np.array([behind, aside]))).all()
    assert not CAMERA.sees(CAMERA.project(np.array([behind, aside]))).any()


def test_a_lens_that_cannot_be_undone_is_refused():
    with pytest.raises(GeometryError, match="distortion"):
        replace(CAMERA, distortion=(-2.0, 0.0, 0.0, 0.0, 0.0)).ideal(np.array([0.0]), np.array([0.0]))


def test_a_moved_pair_keeps_its_own_geometry():
    right = replace(CAMERA, centre_mm=CAMERA.centre_mm + 300.0 * VIEW[:, 0])
    pair = StereoPair(CAMERA, right)
    moved = pair.moved(np.array([0.1, -0.2, 0.3]), np.array([1e-3, 2e-3, -1e-3]))
    for before, after in zip(pair.right_from_left, moved.right_from_left, strict=True):
        assert np.allclose(before, after, atol=1e-12)
    point = np.array([[50.0, 100.0, 20.0]])
    turn = rotation(np.array([1e-3, 2e-3, -1e-3]))
    carried = (point - CAMERA.centre_mm) @ turn.T + CAMERA.centre_mm + [0.1, -0.2, 0.3]
    assert np.allclose(moved.right.project(carried), pair.right.project(point), atol=1e-9)


def test_the_normal_distribution_and_its_joint_part_agree_with_scipy():
    argument = np.linspace(-7.0, 7.0, 5001)
    assert np.abs(normal_distribution(argument) - norm.cdf(argument)).max() < 2e-7
    for correlation in (-0.26, 0.1, 0.26):
        both = multivariate_normal([0, 0], [[1, correlation], [correlation, 1]])
        for a, b in ((0.0, 0.0), (0.5, -1.0), (1.3, 1.2), (-2.0, 0.3)):
            joint = both.cdf([a, b]) - norm.cdf(a) * norm.cdf(b)
            found = _joint_part(np.array([a]), np.array([b]), np.array([correlation]))[0]
            # The first term that the series leaves out, with the largest Hermite product in reach, 9 / 120 · φφ.
            assert found == pytest.approx(joint, abs=abs(correlation) ** 5 * 9 / 120 * 0.16 + 1e-6)


def sheet_before(camera, pixel, distance_mm, tilt, size_mm=54.0):
    """A marker plate whose middle projects to `pixel`, tilted out of the picture's plane."""
    x, y, _ = camera.ideal(np.array([pixel[0]]), np.array([pixel[1]]))
    place = camera.centre_mm + distance_mm * camera.camera_from_base.T @ np.array([x[0], y[0], 1.0])
    turn = camera.camera_from_base.T @ rotation(np.array(tilt))
    pattern = marker_pattern("DICT_4X4_50", 7, size_mm).with_margin(6.0)
    return Sheet(pattern, turn, place - turn @ np.array([size_mm / 2, size_mm / 2, 0.0]))


def by_brute_force(camera, sheet, light, rows, columns, fine=41):
    """The picture as sums over `fine` × `fine` samples a pixel under the same point spread.

    Edges along the grid or at 45° to it would be sampled with an error of up to 88 / 2 `fine` grey levels; the plates
    below are turned otherwise, and with 41 the error is below 0.1 (0.25 with 20, 0.03 with 63).
    """
    pad = 6
    samples = [
        np.arange((window.stop - window.start + 2 * pad) * fine) / fine + window.start - pad - 0.5 + 0.5 / fine
        for window in (rows, columns)
    ]
    v_px, u_px = np.meshgrid(*samples, indexing="ij")
    u_mm, v_mm, _ = _on_sheet(camera, sheet, *camera.ideal(u_px, v_px))
    pattern = sheet.pattern
    column = np.searchsorted(pattern.u_edges_mm, u_mm) - 1
    row = np.searchsorted(pattern.v_edges_mm, v_mm) - 1
    inside = (column >= 0) & (row >= 0) & (column < pattern.white.shape[1]) & (row < pattern.white.shape[0])
    white = pattern.white[np.where(inside, row, 0), np.where(inside, column, 0)] == 1
    sharp = np.where(inside, np.where(white, light.white_grey, light.black_grey), light.background_grey)
    spread = []
    for window, sample in zip((rows, columns), samples, strict=True):
        weights = norm.pdf(np.arange(window.start, window.stop)[:, None], sample, light.blur_px)
        spread.append(weights / weights.sum(axis=1, keepdims=True))
    return spread[0] @ sharp @ spread[1].T


@pytest.mark.parametrize(
    ("pixel", "tilt"),
    [
        ((300.3, 420.7), (0.1, -0.2, 0.15)),
        ((2100.2, 1700.9), (0.45, 0.5, 0.4)),
        ((1200.6, 1000.1), (-0.6, 0.1, -0.55)),
    ],
)
def test_pictures_are_those_of_brute_force(pixel, tilt):
    sheet = sheet_before(CAMERA, pixel, 700.0, tilt)
    corners = CAMERA.project(sheet.place_mm(np.array([[0.0, 0.0], [54.0, 54.0]])))
    picture = illumination(CAMERA.size_px, FLAT) * np.float32(FLAT.background_grey)
    paint(picture, CAMERA, sheet, FLAT, illumination(CAMERA.size_px, FLAT))
    for u, v in corners.astype(int):
        rows, columns = slice(v - 16, v + 17), slice(u - 16, u + 17)
        exact = by_brute_force(CAMERA, sheet, FLAT, rows, columns)
        difference = picture[rows, columns].astype(np.float64) - exact
        # 0.002 px on the steepest edge, (white − black) / (σ √2π) = 88 grey levels a pixel.
        assert np.abs(difference).max() < 0.002 * 88
        assert np.sqrt(np.mean(difference**2)) < 0.02
        # Places of edges: the shift along the gradient that explains the difference, window by window.
        by_v, by_u = np.gradient(exact)
        for top in (0, 16):
            for left in (0, 16):
                part = (slice(top, top + 16), slice(left, left + 16))
                g = np.stack([by_u[part].ravel(), by_v[part].ravel()])
                values, vectors = np.linalg.eigh(g @ g.T)
                if values[1] > 3e4:
                    along = vectors[:, 1] @ g
                    assert abs(along @ difference[part].ravel() / (along @ along)) < 0.002


def test_a_sheet_leaves_everything_else_alone_and_may_hang_over_the_edge():
    light = Light()
    brightness = illumination(CAMERA.size_px, light)
    untouched = brightness * np.float32(light.background_grey)
    for pixel, shows in (((10.0, 1000.0), True), ((2440.0, 2040.0), True)):
        picture = untouched.copy()
        paint(picture, CAMERA, sheet_before(CAMERA, pixel, 700.0, (0.2, 0.1, 0.3)), light, brightness)
        changed = np.argwhere(picture != untouched)
        assert (len(changed) > 0) == shows
        assert np.abs(changed - np.array(pixel)[::-1]).max() < 200
    turned_away = sheet_before(CAMERA, (1000.0, 1000.0), 700.0, (np.pi - 0.1, 0.0, 0.0))
    picture = untouched.copy()
    paint(picture, CAMERA, turned_away, light, brightness)
    assert np.array_equal(picture, untouched)


def test_grey_levels_are_those_of_the_light():
    light = Light(shading=0.0, vignetting=0.2)
    brightness = illumination(CAMERA.size_px, light)
    assert brightness[1023, 1223] == pytest.approx(1.0, abs=1e-6)
    assert brightness[0, 0] == pytest.approx(0.8, abs=1e-3)
    sheet = sheet_before(CAMERA, (1223.0, 1023.0), 700.0, (0.0, 0.0, 0.0))
    picture = brightness * np.float32(light.background_grey)
    paint(picture, CAMERA, sheet, light, brightness)
    u, v = CAMERA.project(sheet.place_mm(np.array([[4.5, 4.5], [-3.0, 20.0]]))).round().astype(int).T
    assert picture[v, u].tolist() == pytest.approx([light.black_grey, light.white_grey], rel=5e-3)


def test_noise_is_gaussian_and_of_the_size_asked_for():
    flat = np.full((1024, 1024), 100.25, dtype=np.float32)
    noise = expose(flat, 4.0, np.random.SeedSequence(1)).astype(np.float64) - 100.25
    n = noise.size
    # Rounding adds 1/12; the bounds are four standard errors.
    assert noise.mean() == pytest.approx(0.0, abs=4 * 4.0 / np.sqrt(n))
    assert noise.var() == pytest.approx(16.0 + 1 / 12, rel=4 * np.sqrt(2 / n) + 2e-4)
    assert np.mean(noise**4) / noise.var() ** 2 == pytest.approx(3.0, abs=4 * np.sqrt(24 / n) + 2e-3)
    assert abs(np.corrcoef(noise[:, 1:].ravel(), noise[:, :-1].ravel())[0, 1]) < 4 / np.sqrt(n)
    assert abs(np.corrcoef(noise[1:].ravel(), noise[:-1].ravel())[0, 1]) < 4 / np.sqrt(n)


def test_values_are_rounded_and_kept_within_eight_bits():
    grey = np.array([[-3.0, 0.49, 0.51, 99.5, 254.6, 300.0]], dtype=np.float32)
    assert expose(grey, 0.0, np.random.SeedSequence(0)).tolist() == [[0, 0, 1, 100, 255, 255]]


def test_an_independent_detector_finds_the_board_where_it_is():
    board = charuco_layout((14, 10), 25.0, 18.0, "DICT_5X5_100")
    turn = CAMERA.camera_from_base.T @ rotation(np.array([0.3, 0.25, 0.1]))
    middle = CAMERA.centre_mm + 850.0 * VIEW[:, 2]
    sheet = Sheet(board.pattern.with_margin(12.5), turn, middle - turn @ np.array([175.0, 125.0, 0.0]))
    light = Light()
    brightness = illumination(CAMERA.size_px, light)
    picture = brightness * np.float32(light.background_grey)
    paint(picture, CAMERA, sheet, light, brightness)
    seen = expose(picture, light.noise_grey, np.random.SeedSequence(3))
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_5X5_100)
    detector = cv2.aruco.CharucoDetector(cv2.aruco.CharucoBoard((14, 10), 25.0, 18.0, dictionary))
    corners, ids, _, _ = detector.detectBoard(seen)
    assert len(ids) == 117
    rough = np.ascontiguousarray(corners.reshape(-1, 1, 2), dtype=np.float32)
    stop = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 100, 1e-4)
    fine = cv2.cornerSubPix(seen, rough, (4, 4), (-1, -1), stop).reshape(-1, 2)
    off = fine - CAMERA.project(sheet.place_mm(board.corners_mm))[np.ravel(ids)]
    # A saddle's own uncertainty at this noise and blur is about 0.01 px; the mean of 117 must show no shift.
    assert np.abs(off).max() < 0.1
    assert np.abs(off.mean(axis=0)).max() < 0.01
