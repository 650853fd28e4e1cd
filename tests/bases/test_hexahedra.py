"""Eight-node elements fitted to scattered errors."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest
from scipy.interpolate import RegularGridInterpolator

from geoerr.bases import HexahedronFit, fit_hexahedra
from geoerr.errors import GeometryError, ShapeError

GRID = (np.array([0.0, 100.0, 400.0]), np.array([0.0, 150.0, 400.0]), np.array([0.0, 300.0]))


def points(n: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).uniform([0.0, 0.0, 0.0], [400.0, 400.0, 300.0], (n, 3))


def test_agrees_with_scipy() -> None:
    nodal = np.random.default_rng(1).standard_normal((3, 3, 2, 3))
    theirs = RegularGridInterpolator(GRID, nodal)
    q = points(500)
    ours = HexahedronFit(GRID, nodal.reshape(-1, 3))
    np.testing.assert_allclose(ours.evaluate(q), theirs(q), rtol=0.0, atol=1e-13)
    np.testing.assert_allclose(ours.evaluate(q + 1000.0), np.tile(nodal[-1, -1, -1], (500, 1)), atol=1e-13)


def test_scattered_errors_give_the_nodes_back() -> None:
    nodal = np.random.default_rng(1).standard_normal((18, 3))
    q = points(200)
    fit = fit_hexahedra(q, HexahedronFit(GRID, nodal).evaluate(q), GRID)
    # Nodes are extrapolated from points within the cells: a condition of some tens.
    np.testing.assert_allclose(fit.nodal_error, nodal, rtol=0.0, atol=1e-11)


def test_nodes_without_data_are_not_determined() -> None:
    q = points(200)
    q = q[q[:, 0] < 100.0]
    fit = fit_hexahedra(q, np.ones((len(q), 1)), GRID)
    unknown = np.isnan(fit.nodal_error[:, 0]).reshape(3, 3, 2)
    assert unknown[2].all()
    assert not unknown[:2].any()
    inside, beyond = fit.evaluate([[50.0, 10.0, 10.0]]), fit.evaluate([[300.0, 10.0, 10.0]])
    assert inside[0, 0] == pytest.approx(1.0)
    assert np.isnan(beyond).all()


def test_many_points_take_memory_with_their_number_only() -> None:
    """The left singular vectors in full were n² numbers: 12,000 points took 14 s and 2.3 GB."""
    q = points(3000)
    errors = np.random.default_rng(2).standard_normal((len(q), 3))
    tracemalloc.start()
    try:
        fit = fit_hexahedra(q, errors, GRID)
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert peak < 20 * q.nbytes * 18 / 3
    rows = HexahedronFit(GRID, np.eye(18)).evaluate(q)
    np.testing.assert_allclose(fit.nodal_error, np.linalg.lstsq(rows, errors)[0], rtol=0.0, atol=1e-12)


@pytest.mark.parametrize("n", [1, 10, 18, 19, 200])
def test_fewer_and_more_points_than_nodes_are_fitted_by_one_rule(n: int) -> None:
    """Nodes that no point determines are NaN, the others those of least norm."""
    q = points(n)
    q[:, 0] = np.minimum(q[:, 0], 100.0)
    errors = np.random.default_rng(2).standard_normal((n, 3))
    rows = HexahedronFit(GRID, np.eye(18)).evaluate(q)
    left, singular, right = np.linalg.svd(rows, full_matrices=True)
    rank = int((singular > 1e-10 * singular[0]).sum())
    expected = right[:rank].T @ ((left[:, :rank].T @ errors) / singular[:rank, None])
    expected[np.sqrt((right[rank:] ** 2).sum(axis=0)) > 1e-6] = np.nan
    np.testing.assert_allclose(fit_hexahedra(q, errors, GRID).nodal_error, expected, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("missing", [np.nan, np.inf])
def test_points_that_are_not_there_are_named(missing: float) -> None:
    """One error that was missing made every node NaN without a word, one position an error of NumPy."""
    q, errors = points(30), np.ones((30, 2))
    errors[[4, 7], 1] = missing
    with pytest.raises(
        GeometryError, match=rf"^error\[4\] is \[1\.0, {missing}\] \(and 1 more\): not finite\nhint: "
    ):
        fit_hexahedra(q, errors, GRID)
    q[3, 0] = missing
    with pytest.raises(GeometryError, match=rf"^position_mm\[3\] is \[{missing}, .*\]: not finite\nhint: "):
        fit_hexahedra(q, errors, GRID)
    masked = np.ma.masked_array(points(30), mask=False)
    masked[3, 0] = np.ma.masked
    with pytest.raises(GeometryError, match=r"^position_mm\[3\] is \[nan, "):
        fit_hexahedra(masked, errors, GRID)


def test_what_does_not_fit_is_refused() -> None:
    with pytest.raises(ShapeError, match="position_mm has shape"):
        fit_hexahedra(np.zeros((4, 2)), np.zeros((4, 1)), GRID)
    with pytest.raises(ShapeError, match="error has shape"):
        fit_hexahedra(np.zeros((4, 3)), np.zeros((3, 1)), GRID)
    with pytest.raises(ShapeError, match="one along each"):
        fit_hexahedra(np.zeros((4, 3)), np.zeros((4, 1)), GRID[:2])
    with pytest.raises(GeometryError, match="grid line 1"):
        fit_hexahedra(np.zeros((4, 3)), np.zeros((4, 1)), (GRID[0], GRID[1], np.array([1.0, 0.0])))
