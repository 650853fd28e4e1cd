"""The photometric fit: without bias, as certain as it says, and it refuses what is not its marker."""

import numpy as np
import pytest
from rendering import Lens, as_picture, marker_plate, render, turned
from scipy.special import ndtr

from geoerr.vision.camera import Camera
from geoerr.vision.marker_fit import MarkerFitError, NotThisMarkerError, fit_marker
from geoerr.vision.markers import refine_marker
from geoerr.vision.patterns import marker_bits

# A corner of a 5 MP sensor, where a lens like this bends most, cut out around the marker.
LENS = Lens(2319.0, 2321.0, -580.0, -430.0, -0.12, 0.15, 6e-4, -4e-4)
SIZE_MM = 56.0


def scene(side_px, tilt, phase=(0.0, 0.0), dictionary="DICT_4X4_50", identity=7, lens=LENS):
    """Plate seen with about `side_px`, near pixel (200, 190) plus phase."""
    bits = marker_bits(dictionary, identity)
    depth = lens.fx * SIZE_MM / side_px
    x, y = lens.straighten(
        np.array((200.0 + phase[0] - lens.cx) / lens.fx), np.array((190.0 + phase[1] - lens.cy) / lens.fy)
    )
    plate = marker_plate(bits, SIZE_MM, turned(*tilt), depth * np.array([x, y, 1.0]))
    corners = plate.points([[0, 0], [SIZE_MM, 0], [SIZE_MM, SIZE_MM], [0, SIZE_MM]])
    return plate, bits.astype(bool), corners


def photographed(plate, blur_px, lens=LENS, **light):
    module = SIZE_MM / len(plate.white)
    return render([plate], lens, (400, 380), blur_px=blur_px, samples=4, margin_mm=module, background=100.0, **light)


def fitted(picture, bits, corners, start_error=0.4, lens=LENS):
    start = lens.pixel(corners) + start_error * np.array([[1, -1], [-1, -1], [-1, 1], [1, 1]]) / np.sqrt(2)
    return fit_marker(picture, Camera(lens.matrix, lens.distortion), bits, start)


def error_px(fit, corners, lens=LENS):
    return fit.corners_px - lens.undistorted_pixel(corners)


CASES = [
    (70.0, (10.0, -15.0, 20.0), 0.5, "DICT_4X4_50", 7),
    (95.0, (-35.0, 25.0, -70.0), 0.8, "DICT_6X6_250", 100),
    (130.0, (0.0, 0.0, 0.0), 0.6, "DICT_4X4_50", 23),
    (130.0, (40.0, 30.0, 130.0), 1.2, "DICT_5X5_100", 41),
    (150.0, (-20.0, 45.0, 45.0), 2.0, "DICT_4X4_50", 7),
    (220.0, (25.0, -20.0, 37.0), 0.9, "DICT_6X6_250", 3),
]


@pytest.mark.parametrize(("side_px", "tilt", "blur_px", "dictionary", "identity"), CASES)
def test_no_bias_at_any_phase(side_px, tilt, blur_px, dictionary, identity):
    """Noise only enough to smear the rounding of grey levels; its own share of the mean error is below 0.001 px."""
    rng = np.random.default_rng(int(side_px))
    errors, sigma = [], []
    for phase in ((0.0, 0.0), (0.3, 0.5), (0.65, 0.8)):
        plate, bits, corners = scene(side_px, tilt, phase, dictionary, identity)
        values = photographed(plate, blur_px)
        fit = fitted(as_picture(values, rng, 0.5), bits, corners)
        errors.append(error_px(fit, corners))
        sigma.append(np.sqrt(np.diag(fit.covariance_px2)).mean())
    assert np.abs(np.mean(errors, axis=0)).max() < 0.005
    assert np.abs(errors).max() < 0.005 + 4.0 * np.mean(sigma)


@pytest.mark.parametrize("case", CASES[1:4:2])
def test_scatter_is_what_the_covariance_says(case):
    side_px, tilt, blur_px, dictionary, identity = case
    rng = np.random.default_rng(5)
    plate, bits, corners = scene(side_px, tilt, (0.3, 0.6), dictionary, identity)
    values = photographed(plate, blur_px)
    n, squares = 30, []
    for _ in range(n):
        fit = fitted(as_picture(values, rng, 3.0), bits, corners)
        error = error_px(fit, corners).ravel()
        squares.append(error @ np.linalg.solve(fit.covariance_px2, error) / 8)
    # χ² of 8 numbers: standard deviation ½ each, 0.09 of the mean of 30; the covariance itself is known to a few %.
    assert 0.7 < np.mean(squares) < 1.35


def test_uncertainty_is_near_the_bound_of_all_pixels():
    """131 px, noise 2, contrast 160: the Cramér–Rao bound of a corner is 0.003 px (centre 0.0013)."""
    rng = np.random.default_rng(2)
    plate, bits, corners = scene(131.0, (15.0, 10.0, 20.0))
    fit = fitted(as_picture(photographed(plate, 0.8), rng, 2.0), bits, corners)
    assert np.sqrt(np.diag(fit.covariance_px2)).mean() < 0.005
    centre = np.tile(np.eye(2), 4) / 4
    assert np.sqrt(np.diag(centre @ fit.covariance_px2 @ centre.T)).max() < 0.002
    assert fit.method == "photometric"
    assert fit.noise_grey == pytest.approx(2.02, rel=0.05)  # rounding adds 0.29² to the variance
    assert fit.misfit == pytest.approx(1.0, abs=0.1)
    # The blur and the pixel's own square: √(0.8² + 1/12) = 0.851.
    assert fit.blur_px == pytest.approx((0.851, 0.851), abs=0.03)


def test_uneven_light():
    rng = np.random.default_rng(3)
    plate, bits, corners = scene(150.0, (20.0, -25.0, 10.0))
    v, u = np.mgrid[:380, :400]
    light = 1.0 + 0.2 * (u - 200) / 200 - 0.15 * (v - 190) / 190 - 0.06 * ((u - 150) ** 2 + (v - 200) ** 2) / 200**2
    fit = fitted(as_picture(photographed(plate, 0.9) * light, rng, 0.5), bits, corners)
    assert np.abs(error_px(fit, corners)).max() < 0.008


def shaded(values, corners, rng, factor, soft_px):
    """Everything on one side of a line, somewhere across the plate, is darker."""
    at = LENS.pixel(corners)
    side_px = np.linalg.norm(at - np.roll(at, 1, axis=0), axis=1).mean()
    v, u = np.mgrid[: values.shape[0], : values.shape[1]] - at.mean(axis=0)[::-1, None, None]
    angle, off = rng.uniform(0.0, 2.0 * np.pi), rng.uniform(-0.4, 0.4) * side_px
    light = ndtr((u * np.cos(angle) + v * np.sin(angle) - off) / max(soft_px, 0.3))
    return values * (factor + (1.0 - factor) * light)


@pytest.mark.parametrize("factor", [0.95, 0.8])
def test_corners_under_a_shadow_are_off_by_what_they_state(factor):
    """Taken pixel by pixel, errors were 3.5 and 6.8 standard deviations in the root mean square."""
    rng = np.random.default_rng(round(100 * factor))
    off, of_centre = [], []
    centre = np.tile(np.eye(2), 4) / 4
    for side_px, tilt, blur_px, dictionary, identity in CASES:
        plate, bits, corners = scene(side_px, tilt, (0.3, 0.6), dictionary, identity)
        values = photographed(plate, blur_px)
        for soft_px in (0.0, 0.0, 3.0, 3.0, 10.0, 10.0):
            picture = as_picture(shaded(values, corners, rng, factor, soft_px), rng, 2.0)
            try:
                fit = fitted(picture, bits, corners)
            except MarkerFitError:
                continue
            error = error_px(fit, corners).ravel()
            off.append(error / np.sqrt(np.diag(fit.covariance_px2)))
            of_centre.append(centre @ error / np.sqrt(np.diag(centre @ fit.covariance_px2 @ centre.T)))
    assert len(off) >= 30
    for one in (off, of_centre):
        assert np.sqrt(np.mean(np.square(one))) < 1.5
        assert np.quantile(np.abs(one), 0.95) < 3.0


def test_even_light_leaves_the_covariance_as_it_is():
    """Of 72 plates, in light that a quadratic follows: to the last digit, for the share of parts is not even made."""
    rng = np.random.default_rng(14)
    v, u = (np.mgrid[:380, :400] - 190.0) / 190.0
    for side_px, tilt, blur_px, dictionary, identity in CASES:
        plate, bits, corners = scene(side_px, tilt, (0.3, 0.6), dictionary, identity)
        values = photographed(plate, blur_px)
        for noise in (1.0, 2.0, 3.0) * 4:
            a, b = rng.uniform(-0.15, 0.15, 2)
            light = 1.0 + a * u + b * v - 0.1 * (u * u + v * v)
            assert fitted(as_picture(values * light, rng, noise), bits, corners).unevenness == 1.0


def test_a_shadow_that_spoils_the_fit_leaves_the_corners_to_a_detector():
    rng = np.random.default_rng(15)
    plate, bits, corners = scene(220.0, (10.0, -15.0, 20.0))
    values = photographed(plate, 0.8)
    column = round(float(LENS.pixel(corners)[:, 0].mean()))
    values[:, column:] *= 0.55
    picture = as_picture(values, rng, 2.0)
    with pytest.raises(MarkerFitError, match="a shadow's edge or a reflection on it"):
        fitted(picture, bits, corners)
    fit = refine_marker(picture, Camera(LENS.matrix, LENS.distortion), ("DICT_4X4_50", 7), LENS.pixel(corners))
    assert fit.method == "corner"
    assert "a shadow's edge" in fit.why


def test_motion_blur():
    rng = np.random.default_rng(4)
    plate, bits, corners = scene(150.0, (20.0, -25.0, 10.0))
    fit = fitted(as_picture(photographed(plate, (2.0, 0.7)), rng, 0.5), bits, corners)
    assert np.abs(error_px(fit, corners)).max() < 0.008
    assert fit.blur_px == pytest.approx((np.hypot(2.0, 0.289), np.hypot(0.7, 0.289)), rel=0.03)


def test_saturated_white_does_not_shrink_the_marker():
    """White at 290 of 255: half of every edge is cut off; taken as it is, edges would move by half a blur."""
    rng = np.random.default_rng(5)
    plate, bits, corners = scene(150.0, (20.0, -25.0, 10.0))
    picture = as_picture(photographed(plate, 0.9, white=290.0), rng, 1.0)
    assert (picture == 255).mean() > 0.05
    fit = fitted(picture, bits, corners)
    assert np.abs(error_px(fit, corners)).max() < 0.02


@pytest.mark.parametrize("contrast", [200.0, 50.0])
def test_a_quarter_of_the_contrast_is_four_times_the_uncertainty(contrast):
    """12 dB of light."""
    rng = np.random.default_rng(6)
    plate, bits, corners = scene(120.0, (10.0, 10.0, 10.0))
    fit = fitted(as_picture(photographed(plate, 0.8, black=20.0, white=20.0 + contrast), rng, 2.0), bits, corners)
    sigma = np.sqrt(np.diag(fit.covariance_px2)).mean()
    assert sigma * contrast == pytest.approx(0.65, rel=0.2)
    assert np.abs(error_px(fit, corners)).max() < 4.0 * sigma
    assert fit.contrast_grey == pytest.approx(contrast, rel=0.02)


def test_starts_from_two_pixels_off():
    rng = np.random.default_rng(7)
    plate, bits, corners = scene(150.0, (20.0, -25.0, 10.0))
    picture = as_picture(photographed(plate, 0.8), rng, 2.0)
    near, far = fitted(picture, bits, corners, 0.1), fitted(picture, bits, corners, 2.0)
    assert np.abs(near.corners_px - far.corners_px).max() < 2e-4


def test_dirt_is_set_aside():
    rng = np.random.default_rng(8)
    plate, bits, corners = scene(150.0, (10.0, -15.0, 10.0))
    clean = as_picture(photographed(plate, 0.8), rng, 2.0)
    dirty = clean.copy()
    u, v = LENS.pixel(corners)[0].astype(int)
    dirty[v + 20 : v + 34, u + 5 : u + 17] = 230  # a fleck over the black border's edge
    fit, undisturbed = fitted(dirty, bits, corners), fitted(clean, bits, corners)
    # The fleck's pixels are lost, those around it are not pulled: within a fraction of the uncertainty.
    sigma = np.sqrt(np.diag(undisturbed.covariance_px2)).mean()
    assert np.abs(fit.corners_px - undisturbed.corners_px).max() < 2.0 * sigma
    assert np.abs(error_px(fit, corners)).max() < 4.0 * sigma


def test_another_marker_is_refused():
    rng = np.random.default_rng(9)
    plate, bits, corners = scene(150.0, (10.0, -15.0, 10.0))
    picture = as_picture(photographed(plate, 0.8), rng, 2.0)
    with pytest.raises(NotThisMarkerError):
        fitted(picture, np.rot90(bits), corners)


def test_nothing_there_is_refused():
    picture = as_picture(np.full((380, 400), 120.0), np.random.default_rng(0), 2.0)
    _, bits, corners = scene(150.0, (10.0, -15.0, 10.0))
    with pytest.raises(NotThisMarkerError, match="no contrast"):
        fitted(picture, bits, corners)


def test_too_small_is_refused():
    picture = as_picture(np.full((380, 400), 120.0))
    _, bits, corners = scene(15.0, (0.0, 0.0, 0.0))
    with pytest.raises(MarkerFitError, match=r"too small: 2\.\d px a module"):
        fitted(picture, bits, corners)
