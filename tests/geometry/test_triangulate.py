"""Triangulation from Python: covariance against Monte-Carlo, OpenCV, shapes, threads."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt
import pytest

from geoerr.errors import GeometryError, ShapeError
from geoerr.geometry import TriangulationStatus, triangulate, triangulate_points

Array = npt.NDArray[np.float64]
TASKS = Path("/proc/self/task")


def rig(baseline_mm: float) -> tuple[Array, Array]:
    """Li's lens twice, the right camera turned towards a point 700 mm in front of the left one."""
    focal_px = 8.0 / 0.00345
    k = np.array([[focal_px, 0.0, 1223.5], [0.0, focal_px, 1023.5], [0.0, 0.0, 1.0]])
    angle = np.arctan2(baseline_mm, 700.0)
    c, s = np.cos(angle), np.sin(angle)
    rotation = np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
    left = k @ np.eye(3, 4)
    right = k @ np.column_stack([rotation, rotation @ [-baseline_mm, 0.0, 0.0]])
    return left, right


def project(projection: Array, points_mm: Array) -> Array:
    h = points_mm @ projection[:, :3].T + projection[:, 3]
    return h[:, :2] / h[:, 2:]


def cloud(n: int, seed: int = 1) -> Array:
    return np.random.default_rng(seed).uniform([-140.0, -110.0, 600.0], [140.0, 110.0, 800.0], (n, 3))


@pytest.mark.parametrize(("baseline_mm", "scale"), [(200.0, 1.0), (20.0, 0.3)])
def test_covariance_matches_monte_carlo(baseline_mm: float, scale: float) -> None:
    n = 40_000
    left, right = rig(baseline_mm)
    point = np.array([[60.0, -40.0, 720.0]])
    cov_left = scale**2 * np.array([[0.010, 0.004], [0.004, 0.006]])
    cov_right = scale**2 * np.array([[0.004, -0.002], [-0.002, 0.012]])
    random = np.random.default_rng(7)
    uv_left = project(left, point) + random.multivariate_normal([0.0, 0.0], cov_left, n)
    uv_right = project(right, point) + random.multivariate_normal([0.0, 0.0], cov_right, n)
    found = triangulate(
        left,
        right,
        uv_left,
        uv_right,
        cov_left_px2=np.broadcast_to(cov_left, (n, 2, 2)),
        cov_right_px2=np.broadcast_to(cov_right, (n, 2, 2)),
    )
    assert found.is_ok.all()
    stated = found.covariance_mm2.mean(axis=0)
    whitened = np.linalg.solve(np.linalg.cholesky(stated), (found.points_mm - point).T)
    # A sample covariance of n whitened points differs from 1 by sqrt(2/n), less off the diagonal: five of those.
    assert np.abs(np.cov(whitened) - np.eye(3)).max() < 5.0 * np.sqrt(2.0 / n)
    # Bias is of second order: at most a hundredth of the standard deviation at 0.1 px.
    assert np.abs(whitened.mean(axis=1)).max() < 5.0 / np.sqrt(n) + 0.01


def test_reprojection_has_one_degree_of_freedom() -> None:
    n, sigma_px = 40_000, 0.1
    left, right = rig(200.0)
    points = cloud(n)
    random = np.random.default_rng(3)
    # Four numbers less three unknowns.
    found = triangulate(
        left,
        right,
        project(left, points) + sigma_px * random.standard_normal((n, 2)),
        project(right, points) + sigma_px * random.standard_normal((n, 2)),
        sigma_px=sigma_px,
    )
    chi_squared = 2.0 * found.reprojection_px**2 / sigma_px**2
    assert abs(chi_squared.mean() - 1.0) < 5.0 * np.sqrt(2.0 / n)


def test_agrees_with_opencv_without_noise() -> None:
    left, right = rig(200.0)
    points = cloud(500)
    uv_left, uv_right = project(left, points), project(right, points)
    homogeneous = cv2.triangulatePoints(left, right, uv_left.T.copy(), uv_right.T.copy())
    by_opencv = (homogeneous[:3] / homogeneous[3]).T
    found = triangulate(left, right, uv_left, uv_right)
    # A pixel near 2000 rounded by 2e-13, 0.3 mm/px across and 1.5 mm/px in depth; OpenCV's SVD loses a digit more.
    assert np.abs(found.points_mm - points).max() < 5e-12
    assert np.abs(found.points_mm - by_opencv).max() < 1e-9


def test_reprojects_better_than_opencv() -> None:
    """OpenCV minimises an algebraic error; the pixel minimum cannot be beaten by it in any row."""
    left, right = rig(200.0)
    points = cloud(2000)
    random = np.random.default_rng(5)
    uv_left = project(left, points) + 0.5 * random.standard_normal((2000, 2))
    uv_right = project(right, points) + 0.5 * random.standard_normal((2000, 2))
    homogeneous = cv2.triangulatePoints(left, right, uv_left.T.copy(), uv_right.T.copy())
    by_opencv = (homogeneous[:3] / homogeneous[3]).T
    square = ((project(left, by_opencv) - uv_left) ** 2 + (project(right, by_opencv) - uv_right) ** 2).sum(axis=1)
    found = triangulate(left, right, uv_left, uv_right)
    assert (found.reprojection_px <= np.sqrt(square / 2.0) + 1e-9).all()
    own = ((project(left, found.points_mm) - uv_left) ** 2).sum(axis=1)
    own += ((project(right, found.points_mm) - uv_right) ** 2).sum(axis=1)
    np.testing.assert_allclose(found.reprojection_px, np.sqrt(own / 2.0), rtol=0.0, atol=1e-11)


def test_sigma_scales_the_covariance_and_nothing_else() -> None:
    left, right = rig(100.0)
    points = cloud(20)
    uv_left, uv_right = project(left, points) + 0.1, project(right, points)
    one = triangulate(left, right, uv_left, uv_right)
    quarter = triangulate(left, right, uv_left, uv_right, sigma_px=0.25)
    np.testing.assert_array_equal(one.points_mm, quarter.points_mm)
    np.testing.assert_array_equal(one.covariance_mm2 / 16.0, quarter.covariance_mm2)
    equal = np.broadcast_to(np.eye(2) / 16.0, (20, 2, 2))
    given = triangulate(left, right, uv_left, uv_right, cov_left_px2=equal, cov_right_px2=equal)
    np.testing.assert_array_equal(quarter.covariance_mm2, given.covariance_mm2)


def test_same_bytes_for_any_number_of_threads() -> None:
    left, right = rig(200.0)
    points = cloud(30_000)
    uv_left, uv_right = project(left, points), project(right, points) + 0.2
    results = [triangulate(left, right, uv_left, uv_right, threads=threads) for threads in (1, 2, 8, 0)]
    for other in results[1:]:
        for name in ("points_mm", "covariance_mm2", "reprojection_px", "status"):
            assert getattr(results[0], name).tobytes() == getattr(other, name).tobytes()


@pytest.mark.skipif(not TASKS.is_dir(), reason="the system does not list a process's threads there")
def test_a_million_threads_are_never_started() -> None:
    left, right = rig(200.0)
    points = cloud(1000)
    uv_left, uv_right = project(left, points), project(right, points)
    before = len(list(TASKS.iterdir()))
    many = triangulate(left, right, uv_left, uv_right, threads=10**6)
    assert len(list(TASKS.iterdir())) - before <= 256
    assert many.points_mm.tobytes() == triangulate(left, right, uv_left, uv_right, threads=1).points_mm.tobytes()


def test_bad_rows_are_nan_with_a_status() -> None:
    left, right = rig(200.0)
    points = cloud(5)
    uv_left, uv_right = project(left, points), project(right, points)
    uv_left[1, 0] = np.nan
    # Seen 700 mm behind the left camera.
    uv_left[2], uv_right[2] = project(left, -points[2:3])[0], project(right, -points[2:3])[0]
    # A point 10^9 mm away, where the rays are parallel to 2e-7 rad.
    far = np.array([[1e8, 0.0, 1e9]])
    uv_left[3], uv_right[3] = project(left, far)[0], project(right, far)[0]
    found = triangulate(left, right, uv_left, uv_right)
    assert found.status.tolist() == [
        TriangulationStatus.OK,
        TriangulationStatus.NOT_FINITE,
        TriangulationStatus.BEHIND_CAMERA,
        TriangulationStatus.RAYS_PARALLEL,
        TriangulationStatus.OK,
    ]
    assert found.is_ok.tolist() == [True, False, False, False, True]
    bad = ~found.is_ok
    assert np.isnan(found.points_mm[bad]).all()
    assert np.isnan(found.covariance_mm2[bad]).all()
    assert np.isnan(found.reprojection_px[bad]).all()
    assert np.isfinite(found.points_mm[~bad]).all()


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_masked_pixels_are_missing(dtype: type) -> None:
    """NumPy forgets a mask without a word, and the number beneath was a pixel."""
    left, right = rig(200.0)
    points = cloud(4)
    uv = [np.ma.masked_array(project(p, points), mask=False, dtype=dtype) for p in (left, right)]
    for side, row in zip(uv, (1, 2), strict=True):
        side[row, 0] = np.ma.masked
    expected = [TriangulationStatus.OK, *[TriangulationStatus.NOT_FINITE] * 2, TriangulationStatus.OK]
    whole, alone = triangulate(left, right, *uv), triangulate_points(left, right, *uv)
    for found in (whole, alone):
        assert found.status.tolist() == expected
        assert np.isnan(found.points_mm[1:3]).all()
        assert np.isfinite(found.points_mm[[0, 3]]).all()
    with pytest.raises(ShapeError, match=r"^uv_right_px is a masked array of int64"):
        triangulate_points(left, right, uv[0], uv[1].astype(int))


def test_accepts_lists_strides_and_float32() -> None:
    left, right = rig(200.0)
    points = cloud(6)
    uv_left, uv_right = project(left, points), project(right, points)
    plain = triangulate(left, right, uv_left, uv_right)
    wide = np.zeros((6, 4))
    wide[:, ::2] = uv_left
    strided = triangulate(left.tolist(), np.asfortranarray(right), wide[:, ::2], uv_right.tolist())
    np.testing.assert_array_equal(plain.points_mm, strided.points_mm)
    single = triangulate(left, right, uv_left.astype(np.float32), uv_right)
    # float32 rounds a pixel near 1500 by 6e-5.
    assert np.abs(single.points_mm - points).max() < 1e-3
    assert triangulate(left, right, np.empty((0, 2)), np.empty((0, 2))).points_mm.shape == (0, 3)


def test_points_alone_are_the_points_with_their_uncertainty() -> None:
    left, right = rig(200.0)
    points = cloud(1000)
    noise = np.random.default_rng(3).normal(0.0, 0.1, (2, 1000, 2))
    uv_left, uv_right = project(left, points) + noise[0], project(right, points) + noise[1]
    uv_right[17, 0] = np.nan
    whole = triangulate(left, right, uv_left, uv_right, reweightings=0)
    alone = triangulate_points(left, right, uv_left, uv_right)
    np.testing.assert_array_equal(alone.status, whole.status)
    assert np.isnan(alone.points_mm[17]).all()
    assert alone.is_ok.sum() == 999
    np.testing.assert_allclose(alone.points_mm, whole.points_mm, rtol=0.0, atol=1e-10)


def test_points_of_single_pixels_are_those_of_the_same_doubles() -> None:
    left, right = rig(2.0)
    points = cloud(1000)
    singles = [project(matrix, points).astype(np.float32) for matrix in (left, right)]
    expected = triangulate_points(left, right, *(uv.astype(np.float64) for uv in singles))
    found = triangulate_points(left, right, *singles)
    assert found.points_mm.dtype == np.float64
    np.testing.assert_array_equal(found.points_mm, expected.points_mm)
    mixed = triangulate_points(left, right, singles[0], singles[1].astype(np.float64))
    np.testing.assert_array_equal(mixed.points_mm, expected.points_mm)
    strided = triangulate_points(left, right, singles[0][::2], singles[1][::2])
    np.testing.assert_array_equal(strided.points_mm, expected.points_mm[::2])


def test_refusals_name_the_argument() -> None:
    left, right = rig(200.0)
    uv = np.zeros((4, 2))
    with pytest.raises(ShapeError, match=r"projection_left must have shape \(3, 4\), got \(3, 3\)"):
        triangulate(left[:, :3], right, uv, uv)
    with pytest.raises(ShapeError, match=r"uv_right_px must have shape \(n, 2\)"):
        triangulate(left, right, uv, uv.T)
    with pytest.raises(ShapeError, match="the right pixels has 3 rows where the left pixels have 4"):
        triangulate(left, right, uv, uv[:3])
    with pytest.raises(ShapeError, match=r"cov_left_px2 must have shape \(n, 2, 2\)"):
        triangulate(left, right, uv, uv, cov_left_px2=np.eye(2))
    with pytest.raises(GeometryError, match="same projection centre"):
        triangulate(left, left, uv, uv)
    with pytest.raises(GeometryError, match="right projection matrix holds a number that is not finite"):
        triangulate(left, right * np.nan, uv, uv)
    with pytest.raises(GeometryError, match="no finite projection centre"):
        triangulate(np.zeros((3, 4)), right, uv, uv)
    with pytest.raises(GeometryError, match="standard deviation 0 is not a positive number"):
        triangulate(left, right, uv, uv, sigma_px=0.0)
    with pytest.raises(GeometryError, match="cannot be negative"):
        triangulate(left, right, uv, uv, reweightings=-1)
