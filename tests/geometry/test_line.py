"""Lines from Python: NumPy's SVD, Monte-Carlo covariance, shapes, refusals."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest

from geoerr.errors import GeometryError, ShapeError
from geoerr.geometry import LineStatus, fit_line, fit_lines

Array = npt.NDArray[np.float64]
REFERENCE = Path(__file__).parents[1] / "reference" / "line"


def reference_points() -> tuple[Array, list[int]]:
    """Give the points of every reference line, and where each line starts."""
    with (REFERENCE / "points.csv").open(newline="") as stream:
        rows = list(csv.reader(stream))[1:]
    lines = [int(row[0]) for row in rows]
    points = np.array([[float(text) for text in row[1:]] for row in rows])
    return points, [i for i, line in enumerate(lines) if i == 0 or lines[i - 1] != line]


def test_agrees_with_svd() -> None:
    points, starts = reference_points()
    found = fit_lines(points, starts)
    assert found.is_ok.all()
    assert len(starts) == 60
    for i, cloud in enumerate(np.split(points, starts[1:])):
        centred = cloud - cloud.mean(axis=0)
        _, sizes, rows = np.linalg.svd(centred, full_matrices=False)
        direction = rows[0] * np.sign(rows[0] @ (cloud[-1] - cloud[0]))
        # The vector's condition is s1² / (s1² - s2²); SVD and centring round some ten times, of 2e4 mm over 100.
        condition = sizes[0] ** 2 / (sizes[0] ** 2 - sizes[1] ** 2)
        rounding = 10.0 * np.finfo(float).eps * (1.0 + np.abs(cloud).max() / sizes[0])
        assert np.abs(found.direction[i] - direction).max() < condition * rounding
        rms = np.sqrt((sizes[1:] ** 2).sum() / len(cloud))
        assert abs(found.rms_mm[i] - rms) < rounding * sizes[0]
        along = (cloud - cloud[0]) @ direction
        start = starts[i]
        assert np.abs(found.along_mm[start : start + len(cloud)] - along).max() < condition * rounding * sizes[0]


@pytest.mark.parametrize("threads", [1, 2])
def test_lines_without_distances_are_the_same_lines(threads: int) -> None:
    points, starts = reference_points()
    whole, alone = (fit_lines(points, starts, along=along, threads=threads) for along in (True, False))
    assert whole.along_mm.shape == (len(points),)
    assert alone.along_mm.shape == (0,)
    for name in ("centroid_mm", "direction", "rms_mm", "direction_covariance", "status"):
        assert getattr(alone, name).tobytes() == getattr(whole, name).tobytes()


@pytest.mark.parametrize("known", [False, True])
def test_direction_covariance_matches_monte_carlo(known: bool) -> None:
    n_trials, n_points, sigma_mm = 20_000, 21, 0.02
    random = np.random.default_rng(11)
    direction = np.array([2.0, -1.0, 2.0]) / 3.0
    exact = np.linspace(0.0, 400.0, n_points)[:, None] * direction + [10.0, 20.0, 600.0]
    # Depth is worse than the rest, as a camera pair has it; the residuals alone can only tell equal noise.
    factor = sigma_mm * (np.diag([0.5, 0.5, 2.0]) if known else np.eye(3))
    points = exact + random.standard_normal((n_trials, n_points, 3)) @ factor
    covariance = np.broadcast_to(factor @ factor, (n_trials * n_points, 3, 3)) if known else None
    starts = np.arange(n_trials) * n_points
    found = fit_lines(points.reshape(-1, 3), starts, covariance_mm2=covariance)
    across = np.linalg.svd(direction[None])[2][1:]
    stated = across @ found.direction_covariance.mean(axis=0) @ across.T
    seen = np.cov(across @ (found.direction - direction).T)
    # A sample covariance differs by sqrt(2/n): five of those, relative to the largest element.
    assert np.abs(seen - stated).max() < 5.0 * np.sqrt(2.0 / n_trials) * np.abs(stated).max()
    # The unit vector cannot err along itself; the product is rounded like its factors.
    along = np.abs(found.direction_covariance @ found.direction[:, :, None]).max()
    assert along < 10.0 * np.finfo(float).eps * np.abs(found.direction_covariance).max()


def test_points_know_their_distance_from_the_first() -> None:
    points = np.array([[5.0, 1.0, 1.0], [3.0, 1.0, 1.0], [4.0, 1.0, 1.0], [0.0, 1.0, 1.0]])
    line = fit_line(points)
    np.testing.assert_allclose(line.direction, [-1.0, 0.0, 0.0], atol=1e-15)
    np.testing.assert_allclose(line.along_mm, [0.0, 2.0, 1.0, 5.0], atol=1e-14)
    np.testing.assert_allclose(line.centroid_mm, [3.0, 1.0, 1.0], atol=1e-15)
    assert line.rms_mm < 1e-15


def test_bad_lines_do_not_spoil_the_batch() -> None:
    good = [[0.0, 0.0, 0.0], [0.0, 3.0, 0.0]]
    points = np.array([*good, [1.0, 1.0, 1.0], *[[2.0, 2.0, 2.0]] * 3, [np.nan, 0.0, 0.0], [1.0, 0.0, 0.0], *good])
    found = fit_lines(points, [0, 2, 3, 6, 8])
    assert found.status.tolist() == [
        LineStatus.OK,
        LineStatus.TOO_FEW_POINTS,
        LineStatus.COINCIDENT,
        LineStatus.NOT_FINITE,
        LineStatus.OK,
    ]
    assert np.isnan(found.direction[~found.is_ok]).all()
    np.testing.assert_array_equal(found.direction[found.is_ok], [[0.0, 1.0, 0.0]] * 2)
    np.testing.assert_array_equal(np.isnan(found.along_mm), [False, False, *[True] * 6, False, False])


def test_masked_points_are_missing() -> None:
    """NumPy forgets a mask without a word, and the number beneath was a point."""
    points = np.ma.masked_array(np.arange(12.0).reshape(4, 3), mask=False)
    points[1, 2] = np.ma.masked
    assert fit_lines(points, [0, 2]).status.tolist() == [LineStatus.NOT_FINITE, LineStatus.OK]
    with pytest.raises(GeometryError, match="no line fits 4 points: a coordinate or covariance is not finite"):
        fit_line(points)
    covariance = np.ma.masked_invalid(np.where(np.arange(4)[:, None, None] == 3, np.nan, np.eye(3)))
    covariance.data[3] = 1.0
    found = fit_lines(points.data, [0, 2], covariance_mm2=covariance)
    assert found.status.tolist() == [LineStatus.OK, LineStatus.NOT_FINITE]
    # A mask that masks nothing changes nothing.
    whole = np.ma.masked_array(points.data, mask=False)
    assert fit_line(whole).direction.tobytes() == fit_line(points.data).direction.tobytes()
    assert fit_line(whole.astype(int)).direction.tobytes() == fit_line(points.data).direction.tobytes()


def test_masked_whole_numbers_are_refused() -> None:
    points = np.ma.masked_equal(np.arange(12).reshape(4, 3), 5)
    with pytest.raises(ShapeError, match=r"^points_mm is a masked array of int64, .*\nhint: give an array of floats"):
        fit_line(points)
    with pytest.raises(ShapeError, match=r"^starts is a masked array of int64"):
        fit_lines(points.data, np.ma.masked_equal([0, 2], 2))


@pytest.mark.parametrize(
    ("points", "why"),
    [
        ([[1.0, 2.0, 3.0]], "two are needed"),
        ([[1.0, 2.0, 3.0]] * 4, "all in one place"),
        ([[1.0, 2.0, np.inf], [0.0, 0.0, 0.0]], "not finite"),
        ([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]], "spread equally"),
    ],
)
def test_a_single_line_that_cannot_be_fitted_is_refused(points: list[list[float]], why: str) -> None:
    with pytest.raises(GeometryError, match=why):
        fit_line(points)


def test_refusals_name_the_argument() -> None:
    points = np.zeros((4, 3))
    with pytest.raises(ShapeError, match=r"points_mm must have shape \(n, 3\), got \(4, 2\)"):
        fit_lines(points[:, :2], [0])
    with pytest.raises(ShapeError, match="starts must be whole numbers"):
        fit_lines(points, [0.0, 1.0])
    with pytest.raises(ShapeError, match="start 1 is -1"):
        fit_lines(points, [0, -1])
    with pytest.raises(ShapeError, match=r"start 1 is 9: .* within the 4 points"):
        fit_lines(points, [0, 9])
    with pytest.raises(ShapeError, match="no start is given"):
        fit_lines(points, [])
    with pytest.raises(ShapeError, match="1 covariances for 4 points"):
        fit_lines(points, [0], covariance_mm2=np.zeros((1, 3, 3)))
    assert fit_lines(np.empty((0, 3)), []).status.shape == (0,)
