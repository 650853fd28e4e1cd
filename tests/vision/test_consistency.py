"""Pooled checks: right covariances pass, wrong ones and a moved camera show."""

import numpy as np
import pytest
from stereo_scenes import rig, rig_covariance

from geoerr.vision.consistency import agreement, measured_size

# So large a picture of a plate that what its fit is wrong by is nothing.
VAST_PX = 1e6


def drawn(rng, scale=1.0, shift=1.0, n=300):
    """Residuals with noise of `scale` and a rig that is off by `shift` times its uncertainty."""
    covariance = rig_covariance()
    by_rig = rng.normal(size=(n, 7, 24)) / np.sqrt(np.diag(covariance)) * 3.0
    error = shift * rng.normal(size=24) * np.sqrt(np.diag(covariance))
    return scale * rng.normal(size=(n, 7)) - by_rig @ error, by_rig


def test_right_covariances_pass():
    residual, by_rig = drawn(np.random.default_rng(0))
    found = agreement(residual, by_rig, rig(rig_covariance()))
    # 2100 residuals: standard deviation of the ratio 0.015; 24 shifts: 0.14.
    assert found.birge_ratio == pytest.approx(1.0, abs=0.05)
    assert found.rig_shift_sigmas == pytest.approx(1.0, abs=0.5)
    assert found.n_residuals == 2100


def test_noise_that_is_larger_than_stated_shows():
    residual, by_rig = drawn(np.random.default_rng(1), scale=2.5)
    assert agreement(residual, by_rig, rig(rig_covariance())).birge_ratio == pytest.approx(2.5, rel=0.05)


def test_a_moved_camera_shows_as_such_and_not_as_noise():
    residual, by_rig = drawn(np.random.default_rng(2), shift=8.0)
    found = agreement(residual, by_rig, rig(rig_covariance()))
    assert found.birge_ratio == pytest.approx(1.0, abs=0.05)
    assert found.rig_shift_sigmas > 5.0


def test_without_a_covariance_all_counts_as_noise():
    residual, by_rig = drawn(np.random.default_rng(3), scale=2.0, shift=0.0)
    found = agreement(residual, by_rig, rig())
    assert found.birge_ratio == pytest.approx(2.0, rel=0.05)
    assert found.rig_shift_sigmas is None


def test_nothing_to_pool():
    assert agreement(np.empty((0, 7)), np.empty((0, 7, 24)), rig()).birge_ratio == 1.0


def test_size_with_the_share_of_calibration():
    rng = np.random.default_rng(4)
    sides = 56.02 + 0.002 * rng.normal(size=(200, 2))
    centres = np.array([[0.0, 0.0, 700.0], [50.0, 20.0, 690.0]])
    along = np.array([[1.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    noise = np.full(200, 0.002 / np.sqrt(2.0))
    alone = measured_size("7", 56.0, sides, noise, np.full(200, VAST_PX), centres, along, rig())
    with_rig = measured_size("7", 56.0, sides, noise, np.full(200, VAST_PX), centres, along, rig(rig_covariance()))
    assert alone.measured_mm == pytest.approx(56.02, abs=5e-4)
    assert alone.relative_error == pytest.approx(0.02 / 56.0, rel=0.05)
    # Scatter alone: 0.002/√400, times √(π/2) for the median.
    assert alone.std_mm == pytest.approx(0.002 / 20 * 1.2533, rel=0.25)
    assert with_rig.std_mm > 3.0 * alone.std_mm
    assert abs(with_rig.sigmas) < abs(alone.sigmas)


@pytest.mark.parametrize("n", [1, 2, 3])
def test_the_size_of_a_few_plates_is_as_uncertain_as_their_noise(n):
    """Of many sets of so few: what is stated is neither nothing nor far from how they scatter."""
    rng = np.random.default_rng(6)
    sides = 40.0 + 0.003 * rng.normal(size=(2000, n, 2))
    noise = np.full(n, 0.003 / np.sqrt(2.0))
    nowhere = np.empty((0, 3))
    found = [measured_size("1", 40.0, own, noise, np.full(n, VAST_PX), nowhere, nowhere, rig()) for own in sides]
    assert min(size.std_mm for size in found) > 0.5 * noise[0] / np.sqrt(n)
    sigmas = np.array([size.sigmas for size in found])
    # 1 within its own scatter of a sixtieth, but for the few in which three lie far apart.
    assert 0.8 < np.sqrt(np.mean(sigmas**2)) < 1.06


@pytest.mark.parametrize("n", [4, 400, 40000])
def test_more_frames_do_not_take_away_what_all_frames_share(n):
    """Corners wrong by 0.005 px each, in all frames alike, are no size: 54 mm on 60 px, 6.4 µm."""
    rng = np.random.default_rng(7)
    shared_mm = 54.0 * 0.005 * np.sqrt(2.0) / 60.0
    sides = 54.0 + shared_mm + 0.0005 * rng.normal(size=(n, 2))
    noise = np.full(n, 0.0005 / np.sqrt(2.0))
    nowhere = np.empty((0, 3))
    found = measured_size("0", 54.0, sides, noise, np.full(n, 60.0), nowhere, nowhere, rig())
    assert found.std_mm == pytest.approx(shared_mm, rel=0.02)
    assert found.sigmas == pytest.approx(1.0, abs=0.1)
