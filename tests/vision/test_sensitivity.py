"""How points depend on the rig: against differences and Monte-Carlo."""

import numpy as np
import pytest
from scipy.optimize import least_squares
from stereo_scenes import LEFT, RIGHT, rig, rig_covariance, right_of

from geoerr.errors import GeometryError
from geoerr.observations import observations_from_columns
from geoerr.vision.sensitivity import points_from_pixels, project_to_both, rig_sensitivity


def points():
    rng = np.random.default_rng(0)
    return np.column_stack([rng.uniform(-120, 120, 12), rng.uniform(-90, 90, 12), rng.uniform(600, 800, 12)])


def observations(pixels):
    names = ("u_left", "v_left", "u_right", "v_right")
    columns = {name: np.zeros(len(pixels)) for name in ("x", "y", "z")}
    return observations_from_columns({**columns, **{name: pixels[:, k] for k, name in enumerate(names)}})


def pixels():
    return np.column_stack([LEFT.pixel(points()), RIGHT.pixel(right_of(points()))])


def test_pixels_and_back():
    assert np.abs(project_to_both(rig(), points()).pixel - pixels()).max() < 1e-9
    assert np.abs(points_from_pixels(rig(), pixels()) - points()).max() < 1e-8


def test_derivatives_of_the_projection_by_differences():
    seen = project_to_both(rig(), points())
    for axis in range(3):
        shift = 1e-3 * np.eye(3)[axis]
        above, below = (project_to_both(rig(), points() + sign * shift).pixel for sign in (1, -1))
        assert np.abs((above - below) / 2e-3 - seen.by_point[..., axis]).max() < 1e-6
    for k in range(24):
        size = 1e-6
        above, below = (project_to_both(rig().changed_by(s * size * np.eye(24)[k]), points()).pixel for s in (1, -1))
        difference = (above - below) / (2 * size)
        assert np.abs(difference - seen.by_rig[..., k]).max() < 1e-6 * max(1.0, np.abs(difference).max())


def nearest_points(pair, shown):
    """Points whose distorted pixels are nearest to those shown: SciPy, point by point."""
    start = points_from_pixels(pair, shown)
    solved = [
        least_squares(
            lambda x, own=own: project_to_both(pair, x[None]).pixel[0] - own,
            first,
            xtol=1e-15,
            ftol=1e-15,
            gtol=1e-15,
        ).x
        for first, own in zip(start, shown, strict=True)
    ]
    return np.array(solved)


def test_sensitivity_is_that_of_triangulating_again():
    some = pixels()[::3]
    found = rig_sensitivity(rig(), observations(some))
    assert found.shape == (4, 3, 24)
    for k in range(24):
        size = 1e-2 if k < 18 and k % 9 < 4 else 1e-4
        above, below = (nearest_points(rig().changed_by(s * size * np.eye(24)[k]), some) for s in (1, -1))
        difference = (above - below) / (2 * size)
        assert np.abs(difference - found[..., k]).max() < 1e-3 * np.abs(difference).max() + 1e-6


def test_calibration_uncertainty_by_monte_carlo():
    rng = np.random.default_rng(1)
    covariance = rig_covariance()
    found = rig_sensitivity(rig(covariance), observations(pixels()))
    predicted = np.einsum("nip,pq,mjq->nimj", found, covariance, found).reshape(36, 36)
    changes = rng.multivariate_normal(np.zeros(24), covariance, 2000)
    drawn = np.array([(points_from_pixels(rig().changed_by(c), pixels()) - points()).ravel() for c in changes])
    # 2000 draws: standard deviations to 1.6 %.
    assert np.abs(drawn.std(axis=0) / np.sqrt(np.diag(predicted)) - 1.0).max() < 0.07
    deviations = np.sqrt(np.diag(predicted))
    assert np.abs(np.corrcoef(drawn.T) - predicted / np.outer(deviations, deviations)).max() < 0.1


def test_rows_without_pixels_are_unknown():
    shown = pixels()
    shown[3, 2] = np.nan
    columns = observations(pixels())
    frame = columns.frame.with_columns(u_right=shown[:, 2]).with_columns()
    frame = frame.fill_nan(None)
    found = rig_sensitivity(rig(), type(columns)(frame))
    assert np.isnan(found[3]).all()
    assert np.isfinite(found[[0, 1, 2, *range(4, 12)]]).all()


def test_no_pixels_at_all_is_refused():
    columns = {name: np.zeros(3) for name in ("x", "y", "z", "mx", "my", "mz")}
    with pytest.raises(GeometryError, match="no pixels"):
        rig_sensitivity(rig(), observations_from_columns(columns))
