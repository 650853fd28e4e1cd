"""The least-squares core from Python: NumPy, mpmath with 60 digits, refusals."""

from __future__ import annotations

import mpmath as mp
import numpy as np
import numpy.typing as npt
import pytest

from geoerr._core import LeastSquares, solve_least_squares
from geoerr.errors import GeometryError, ShapeError

Array = npt.NDArray[np.float64]
EPSILON = float(np.finfo(np.float64).eps)


def solved(
    a: Array,
    b: Array,
    *,
    constraints: Array | None = None,
    basis: Array | None = None,
    rank_tolerance: float | None = None,
    method: str = "qr",
    threads: int = 0,
) -> LeastSquares:
    return solve_least_squares(
        np.ascontiguousarray(a),
        np.ascontiguousarray(b.reshape(len(b), -1)),
        constraints=constraints,
        basis=basis,
        rank_tolerance=rank_tolerance,
        wants_singular_values=False,
        method=method,
        threads=threads,
    )


def exact(a: Array, b: Array) -> tuple[Array, Array]:
    """Solution and standard errors for unit variance, by normal equations with 60 digits."""
    with mp.workdps(60):
        rows = [[mp.mpf(float(value)) for value in row] for row in a]
        right = [mp.mpf(float(value)) for value in b]
        n = a.shape[1]
        gram = mp.matrix(n, n)
        for i in range(n):
            for j in range(i, n):
                gram[i, j] = gram[j, i] = mp.fsum(row[i] * row[j] for row in rows)
        atb = mp.matrix([mp.fsum(row[i] * value for row, value in zip(rows, right, strict=True)) for i in range(n)])
        inverse = gram**-1
        x = inverse * atb
        errors = [mp.sqrt(inverse[i, i]) for i in range(n)]
        return np.array([float(value) for value in x]), np.array([float(value) for value in errors])


def of_condition(rng: np.random.Generator, m: int, n: int, condition: float) -> Array:
    u, v = (np.linalg.qr(rng.standard_normal((size, n)))[0] for size in (m, n))
    return np.asarray(u * np.logspace(0.0, -np.log10(condition), n) @ v.T)


@pytest.mark.parametrize("method", ["qr", "fastest"])
@pytest.mark.parametrize("condition", [1e1, 1e3, 1e5, 1e8])
@pytest.mark.parametrize("noise", [0.0, 1e-3])
def test_against_sixty_digits(method: str, condition: float, noise: float) -> None:
    rng = np.random.default_rng(1)
    a = of_condition(rng, 60, 6, condition)
    b = a @ rng.standard_normal(6) + noise * rng.standard_normal(60)
    x, errors = exact(a, b)
    solution = solved(a, b, method=method)
    sizes = np.linalg.norm(a, axis=0)
    kappa = solution.condition
    # Wedin: κ of the size of x and b, κ² of the residual, per ε; n for the sums.
    x_size, residual = np.linalg.norm(x * sizes), np.sqrt(solution.residual_ss[0])
    bound = 6.0 * EPSILON * (kappa * (x_size + residual) + kappa**2 * residual)
    assert np.linalg.norm((solution.x[:, 0] - x) * sizes) < bound
    relative = 6.0 * EPSILON * (kappa**2 if solution.is_from_normal_equations else kappa)
    np.testing.assert_allclose(solution.standard_errors(), errors, rtol=max(relative, 1e-14))
    assert solution.is_from_normal_equations == (method == "fastest" and condition <= 1e3)


@pytest.mark.parametrize(("m", "n", "rank"), [(200, 30, 30), (500, 40, 25), (10, 17, 10), (3_000, 8, 5)])
def test_agrees_with_numpy(m: int, n: int, rank: int) -> None:
    rng = np.random.default_rng(2)
    a = rng.standard_normal((m, rank)) @ rng.standard_normal((rank, n))
    a /= np.linalg.norm(a, axis=0)  # of equal sizes, so that NumPy's smallest solution is ours
    b = rng.standard_normal((m, 3))
    x, residual_ss, found_rank, singular = np.linalg.lstsq(a, b, rcond=1e-12)
    solution = solved(a, b)
    assert solution.rank == found_rank == rank
    np.testing.assert_allclose(solution.x, x, atol=1e-13 * solution.condition)
    if rank == n:
        np.testing.assert_allclose(solution.residual_ss, residual_ss, rtol=1e-12)
        covariance = solution.covariance()
        rounding = EPSILON * solution.condition**2 * np.diag(covariance).max()  # of the inverse of AᵀA
        np.testing.assert_allclose(covariance, np.linalg.inv(a.T @ a), rtol=0.0, atol=rounding)
    assert solution.condition == pytest.approx(singular[0] / singular[rank - 1], rel=0.2)
    assert np.abs(a @ solution.null_space).max(initial=0.0) < 1e-12
    assert solution.null_space.shape == (n, n - rank)
    assert solution.degrees_of_freedom == m - rank


def test_a_null_space_in_words() -> None:
    rng = np.random.default_rng(3)
    a = rng.standard_normal((100, 4))
    a[:, 3] = 1e-3 * a[:, 1]
    solution = solved(a, rng.standard_normal(100))
    np.testing.assert_allclose(solution.null_space[:, 0], [0.0, -1e-3, 0.0, 1.0], rtol=1e-12)
    assert solution.is_determined.tolist() == [True, False, True, False]
    assert solution.is_estimable(np.array([1.0, 1.0, 0.0, 1e-3]))
    assert not solution.is_estimable(np.array([0.0, 1.0, 0.0, 0.0]))
    assert solution.functional(np.array([0.0, 1.0, 0.0, 0.0]), 0) is None
    assert solution.rank_gap > 1e10
    assert np.isnan(solution.standard_errors()).tolist() == [False, True, False, True]


def test_constraints_and_basis_describe_the_same_subspace() -> None:
    rng = np.random.default_rng(4)
    a, b = rng.standard_normal((80, 5)), rng.standard_normal(80)
    constraints = rng.standard_normal((2, 5))
    basis = np.ascontiguousarray(np.linalg.svd(constraints)[2][2:].T)
    for method in ("qr", "fastest"):
        by_rows = solved(a, b, constraints=constraints, method=method)
        by_columns = solved(a, b, basis=basis, method=method)
        np.testing.assert_allclose(by_rows.x, by_columns.x, atol=1e-14)
        np.testing.assert_allclose(by_rows.covariance(), by_columns.covariance(), atol=1e-16)
        np.testing.assert_allclose(constraints @ by_rows.x, 0.0, atol=1e-14)
        assert by_rows.n_free == 3


def test_blocks_left_out_as_numpy_leaves_them_out() -> None:
    rng = np.random.default_rng(5)
    a, b = rng.standard_normal((60, 4)), rng.standard_normal((60, 1))
    starts = [0, 3, 20, 21]
    solution = solved(a, b)
    residual, held_out, determined = solution.leave_blocks_out(a, b, starts, 0, 0)
    for low, high in zip(starts, [*starts[1:], 60], strict=True):
        kept = np.r_[0:low, high:60]
        x = np.linalg.lstsq(a[kept], b[kept, 0], rcond=None)[0]
        np.testing.assert_allclose(held_out[low:high], b[low:high, 0] - a[low:high] @ x, atol=1e-13)
    np.testing.assert_allclose(residual, b[:, 0] - a @ solution.x[:, 0], atol=1e-15)
    assert determined.all()


def test_growth_is_the_f_test_numerator() -> None:
    rng = np.random.default_rng(6)
    a, b = rng.standard_normal((50, 5)), rng.standard_normal(50)
    functionals = np.ascontiguousarray(np.eye(5)[:, [1, 3]])
    growth = solved(a, b).growth_without(functionals, 0)
    sums = [np.linalg.lstsq(a[:, columns], b, rcond=None)[1][0] for columns in ([0, 2, 4], [0, 1, 2, 3, 4])]
    assert growth == pytest.approx(sums[0] - sums[1], rel=1e-11)


@pytest.mark.parametrize("method", ["qr", "fastest"])
def test_threads_do_not_change_a_byte(method: str) -> None:
    rng = np.random.default_rng(7)
    a, b = rng.standard_normal((4_000, 30)), rng.standard_normal(4_000)
    results = [solved(a, b, method=method, threads=threads) for threads in (1, 2, 5)]
    assert len({result.x.tobytes() + result.covariance().tobytes() for result in results}) == 1


def test_refusals() -> None:
    a, b = np.ones((4, 2)), np.ones((4, 1))
    with pytest.raises(ShapeError, match="3 rows where 4 are needed"):
        solved(a, b[:3])
    with pytest.raises(ShapeError, match="no columns"):
        solved(a[:, :0], b)
    with pytest.raises(ShapeError, match="3 columns where 2 are needed"):
        solved(a, b, constraints=np.ones((1, 3)))
    bad = a.copy()
    bad[2, 1] = np.nan
    with pytest.raises(GeometryError, match="row 2, column 1 is not a finite number"):
        solved(bad, b)
    with pytest.raises(GeometryError, match="tolerance"):
        solved(a, b, rank_tolerance=2.0)
    with pytest.raises(ValueError, match="unknown method"):
        solved(a, b, method="svd")
    with pytest.raises(ValueError, match="exclude one another"):
        solved(a, b, constraints=np.ones((1, 2)), basis=np.ones((2, 1)))
    solution = solved(a, b)
    with pytest.raises(ShapeError, match="right-hand side 1 of 1"):
        solution.functional(np.ones(2), 1)
    with pytest.raises(ShapeError, match="block 1"):
        solution.leave_blocks_out(a, b, [0, 9], 0, 1)
