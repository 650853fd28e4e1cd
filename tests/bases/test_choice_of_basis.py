"""Which basis the data support: scores by second implementations, choices where the truth is known, refusals."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
import pytest
from scipy.stats import chi2, f, multivariate_normal, norm

from geoerr.bases import Choice, Score, basis_of, candidate_bases, choose_basis, choose_coarser_basis, in_words
from geoerr.errors import GeometryError, NotDeterminedError, ShapeError
from geoerr.terms import BasisSpec

Array = npt.NDArray[np.float64]
X = np.linspace(0.0, 400.0, 21)
CANDIDATES = candidate_bases("x", X)


def correlated(n: int, seed: int = 1) -> Array:
    root = np.random.default_rng(seed).standard_normal((n, 2 * n)) * 1e-3
    return np.asarray(root @ root.T / (2 * n) + 1e-7 * np.eye(n))


def score_of(choice: Choice, spec: BasisSpec) -> Score:
    return next(score for score in choice.table if score.spec == spec)


def test_scores_by_generalized_least_squares_written_out() -> None:
    covariance = correlated(len(X))
    y = 1e-2 * (X / 400.0) ** 2 + np.random.default_rng(2).multivariate_normal(np.zeros(len(X)), covariance)
    choice = choose_basis(X, y, covariance, CANDIDATES, trusts_uncertainty=True)
    inverse = np.linalg.inv(covariance)
    for score in choice.table:
        b = basis_of(score.spec).evaluate(X)
        alpha = np.linalg.solve(b.T @ inverse @ b, b.T @ inverse @ y)
        chi_squared = float((y - b @ alpha) @ inverse @ (y - b @ alpha))
        n, k = b.shape
        assert score.n_functions == k
        assert score.chi_squared == pytest.approx(chi_squared, rel=1e-9)
        assert score.bic == pytest.approx(chi_squared + k * math.log(n), rel=1e-9)
        assert score.aicc == pytest.approx(chi_squared + 2 * k * n / (n - k - 1), rel=1e-9)
    b = basis_of(choice.spec).evaluate(X)
    np.testing.assert_allclose(choice.covariance, np.linalg.inv(b.T @ inverse @ b), rtol=1e-7)
    np.testing.assert_allclose(choice.coefficients, choice.covariance @ b.T @ inverse @ y, rtol=1e-7)
    assert sum(score.weight for score in choice.table) == pytest.approx(1.0)


def test_leaving_one_out_by_leaving_each_out() -> None:
    """The closed form against the conditional density of each value, given a fit to all the others."""
    x = np.linspace(0.0, 400.0, 9)
    covariance = correlated(9)
    y = 1e-3 * np.random.default_rng(5).standard_normal(9)
    specs = [
        BasisSpec("linear", "x", knots_mm=(0.0, 400.0)),
        BasisSpec("quadratic", "x", knots_mm=(0.0, 200.0, 400.0)),
    ]
    choice = choose_basis(x, y, covariance, specs, criterion="loo", trusts_uncertainty=True)
    for score in choice.table:
        b = basis_of(score.spec).evaluate(x)
        total = 0.0
        for i in range(9):
            rest = np.arange(9) != i
            inverse = np.linalg.inv(covariance[np.ix_(rest, rest)])
            gain = covariance[i, rest] @ inverse
            of_alpha = np.linalg.inv(b[rest].T @ inverse @ b[rest])
            alpha = of_alpha @ b[rest].T @ inverse @ y[rest]
            row = b[i] - gain @ b[rest]
            mean = b[i] @ alpha + gain @ (y[rest] - b[rest] @ alpha)
            variance = covariance[i, i] - gain @ covariance[rest, i] + row @ of_alpha @ row
            total += -2.0 * float(norm.logpdf(y[i], mean, math.sqrt(variance)))
        assert score.loo == pytest.approx(total, rel=1e-8)


TRUTHS = {
    "line": (lambda q: 8e-3 * q / 400.0, "linear", 2),
    "parabola": (lambda q: 1e-2 * (q / 400.0 - 0.3) ** 2, "quadratic", 3),
    "corner": (lambda q: 1e-2 * abs(q / 400.0 - 0.5), "linear", 3),
}


@pytest.mark.parametrize("truth", TRUTHS)
@pytest.mark.parametrize("criterion", ["aicc", "bic"])
def test_the_truth_is_chosen_where_it_is_clear(truth: str, criterion: str) -> None:
    """With 0.2 µm noise a richer basis wins by chance alone: P(χ²₁ > 4) = 5 % each, of a few nested ones."""
    function, kind, size = TRUTHS[truth]
    hits = 0
    for seed in range(60):
        y = function(X) + 2e-4 * np.random.default_rng(seed).standard_normal(len(X))
        choice = choose_basis(X, y, np.full(len(X), 2e-4), CANDIDATES, criterion=criterion)  # type: ignore[arg-type]
        hits += choice.spec.kind == kind and choice.spec.n_functions == size
    assert hits >= 48


def most_misses(n_seeds: int, n_scales: int) -> float:
    """Bound how often noise on a line makes some richer basis win by more than 2.

    All candidates contain the line, so that each takes off a χ² of k − 2 degrees of freedom, or with ĉ of 11 degrees
    of freedom (21 values, the richest basis with half of them) k − 2 times an F; the sum of all probabilities, and
    three standard deviations of the count.
    """
    chance = 0.0
    for spec in CANDIDATES:
        k = spec.n_functions
        if 2 < k < 21 - n_scales - 1:
            penalty = [2.0 * n * 21.0 / (21.0 - n - 1.0) for n in (2 + n_scales, k + n_scales)]
            least = 2.0 + penalty[1] - penalty[0]
            chance += float(f.sf(least / (k - 2), k - 2, 11) if n_scales else chi2.sf(least, k - 2))
    return n_seeds * chance + 3.0 * math.sqrt(n_seeds * chance)


def test_scatter_beyond_the_stated_buys_no_functions() -> None:
    """A line with noise five times what is stated: without ĉ a rich basis wins, with it the line mostly."""
    n_seeds, misses, truly = 100, 0, 0
    for seed in range(n_seeds):
        y = 8e-3 * X / 400.0 + 1e-3 * np.random.default_rng(seed).standard_normal(len(X))
        allowed = choose_basis(X, y, np.full(len(X), 2e-4), CANDIDATES)
        right = choose_basis(X, y, np.full(len(X), 1e-3), CANDIDATES, trusts_uncertainty=True)
        misses += allowed.spec.n_functions != 2
        truly += right.spec.n_functions != 2
        assert allowed.scale == 1.0 or "as much as stated" in allowed.why
        if seed < 20:
            trusting = choose_basis(X, y, np.full(len(X), 2e-4), CANDIDATES, trusts_uncertainty=True)
            assert trusting.scale == 1.0
            assert trusting.spec.n_functions > 4
    assert misses <= most_misses(n_seeds, 1)
    assert truly <= most_misses(n_seeds, 0)


def test_ties_are_said_and_the_smaller_is_taken() -> None:
    y = 1e-3 * np.random.default_rng(0).standard_normal(len(X))
    choice = choose_basis(X, y, np.full(len(X), 1e-3), CANDIDATES)
    close = [score for score in choice.table if score.delta <= 2.0]
    assert len(close) > 1
    assert choice.spec.n_functions == min(score.n_functions for score in close)
    assert "the data do not tell apart" in choice.why


@pytest.mark.parametrize("n_positions", [3, 4])
def test_equal_fits_are_settled_by_smoothness(n_positions: int) -> None:
    """Three positions, or four even ones, cannot tell one parabola from two straight lines."""
    x = np.linspace(0.0, 300.0, n_positions)
    y = 1e-2 * (x / 300.0) ** 2
    specs = candidate_bases("z", x)
    for order in (specs, specs[::-1]):
        choice = choose_basis(x, y, np.full(n_positions, 1e-4), order, criterion="bic", trusts_uncertainty=True)
        assert in_words(choice.spec) == "1 three-node quadratic element"
        assert "and smoother" in choice.why or "the data do not tell apart" in choice.why


def test_what_the_data_do_not_determine_is_not_chosen() -> None:
    x = np.array([0.0, 1.0, 2.0, 3.0, 4.0, 390.0, 395.0, 400.0])
    gap = BasisSpec("linear", "x", knots_mm=(0.0, 100.0, 200.0, 300.0, 400.0))
    line = BasisSpec("linear", "x", knots_mm=(0.0, 400.0))
    choice = choose_basis(x, x * 1e-5, np.full(8, 1e-4), [gap, line])
    assert choice.spec == line
    assert "do not determine 1 of its functions" in score_of(choice, gap).why_not
    with pytest.raises(NotDeterminedError, match="none of the 1 candidates"):
        choose_basis(x, x * 1e-5, np.full(8, 1e-4), [gap])
    # A value that alone holds a function up is predicted by no other.
    alone = choose_basis(X[:3], np.zeros(3), np.ones(3), candidate_bases("x", X[:3]), criterion="loo")
    assert math.isinf(alone.table[-1].loo)


def rich_fit(n_free: int) -> tuple[BasisSpec, Array, Array, Array, Array, list[tuple[Array, Array]]]:
    """A rich spline fitted to a parabola, with unknown constant (and slope) besides, in two conventions."""
    rng = np.random.default_rng(8)
    x = np.repeat(np.linspace(0.0, 400.0, 14), 3)
    y = 2e-2 * (x / 400.0) ** 2 + 5e-4 * rng.standard_normal(len(x))
    rich = BasisSpec("bspline", "x", knots_mm=tuple(np.linspace(0.0, 400.0, 9).tolist()), degree=3)
    b = basis_of(rich).evaluate(x)
    nuisance = np.column_stack([np.ones_like(x), x - 200.0])[:, :n_free]
    free = np.linalg.lstsq(b, nuisance, rcond=None)[0]
    # Whitened information about the functions once the nuisances have had their say.
    aside = np.eye(len(x)) - nuisance @ np.linalg.pinv(nuisance)
    information = b.T @ aside @ b / 25e-8
    right = b.T @ aside @ y / 25e-8
    least_norm = np.linalg.pinv(information, rcond=1e-10, hermitian=True)
    fits = [(least_norm @ right, least_norm)]
    if n_free:
        rows = np.vstack([basis_of(rich).value_row(0.0), basis_of(rich).slope_row()])[:n_free]
        span = np.linalg.svd(rows)[2][n_free:].T
        gauged = span @ np.linalg.inv(span.T @ information @ span) @ span.T
        fits.append((gauged @ right, gauged))
    return rich, x, y, nuisance, free, fits


@pytest.mark.parametrize("n_free", [0, 1, 2])
def test_a_rich_fit_stands_for_its_data(n_free: int) -> None:
    """For candidates inside the rich basis: χ² as from the data, less the rich fit's own, in any convention."""
    rich, x, y, nuisance, free, fits = rich_fit(n_free)
    candidates = [
        *candidate_bases("x", np.unique(x), kinds=["polynomial"], most_functions=4),
        BasisSpec("bspline", "x", knots_mm=tuple(np.linspace(0.0, 400.0, 5).tolist()), degree=3),
    ]

    def chi_squared(columns: Array) -> tuple[float, int]:
        columns = np.column_stack([columns, nuisance])
        residual = y - columns @ np.linalg.lstsq(columns, y, rcond=1e-10)[0]
        return float(residual @ residual) / 25e-8, int(np.linalg.matrix_rank(columns)) - n_free

    from_rich, rank = chi_squared(basis_of(rich).evaluate(x))
    for theta, covariance in fits:
        choice = choose_coarser_basis(rich, theta, covariance, np.unique(x), candidates, undetermined=free)
        for score in choice.table:
            expected, n_functions = chi_squared(basis_of(score.spec).evaluate(x))
            assert score.chi_squared == pytest.approx(expected - from_rich, rel=1e-6, abs=1e-6)
            assert score.n_functions == n_functions
            assert score.dof == rank - n_functions
            assert score.why_not == ""
        assert choice.spec in candidates[2:]
        truth = 2e-2 * (x / 400.0) ** 2
        difference = basis_of(choice.spec).evaluate(x) @ choice.coefficients - truth
        # Up to what is free, within five standard uncertainties of the mean of 42 values with three functions.
        difference -= nuisance @ np.linalg.lstsq(nuisance, difference, rcond=None)[0] if n_free else 0.0
        assert np.abs(difference).max() < 5.0 * 5e-4
    if n_free:
        # Least norm is the default, as its covariance lacks just what is free.
        default = choose_coarser_basis(rich, *fits[0], np.unique(x), candidates)
        explicit = choose_coarser_basis(rich, *fits[0], np.unique(x), candidates, undetermined=free)
        assert [s.chi_squared for s in default.table] == pytest.approx(
            [s.chi_squared for s in explicit.table], rel=1e-6
        )


def test_candidates_grow_at_quantiles() -> None:
    x = np.concatenate((np.linspace(0.0, 10.0, 11), [400.0]))
    linear = candidate_bases("y", np.tile(x, 3), kinds=["linear"])
    assert [spec.n_functions for spec in linear] == list(range(2, 13))
    assert all(spec.knots_mm[0] == 0.0 and spec.knots_mm[-1] == 400.0 for spec in linear)
    assert linear[1].knots_mm[1] == pytest.approx(5.5)
    everything = candidate_bases("y", x, kinds=["linear", "quadratic", "bspline", "polynomial"], most_functions=9)
    sizes = [spec.n_functions for spec in everything]
    assert sizes == sorted(sizes)
    assert max(sizes) == 9
    for spec in everything:
        assert len(basis_of(spec)) == spec.n_functions
        assert in_words(spec)
    assert in_words(linear[2]) == "3 two-node linear elements"


def test_the_same_choice_in_any_order() -> None:
    y = 1e-2 * (X / 400.0) ** 2 + 1e-3 * np.random.default_rng(3).standard_normal(len(X))
    std = np.linspace(0.5e-3, 2e-3, len(X))
    order = np.random.default_rng(1).permutation(len(X))
    one, other = choose_basis(X, y, std, CANDIDATES), choose_basis(X[order], y[order], std[order], CANDIDATES)
    matrix = choose_basis(X, y, np.diag(std**2), CANDIDATES)
    assert one.spec == other.spec == matrix.spec
    np.testing.assert_allclose(one.coefficients, other.coefficients, rtol=1e-9)
    np.testing.assert_allclose(one.covariance, matrix.covariance, rtol=1e-9)


def test_the_covariance_holds_what_happens() -> None:
    """The mean of (α̂ − α)ᵀ C⁻¹ (α̂ − α) over 400 draws is k = 3, within five of its standard deviations √(2k/400)."""
    spec = BasisSpec("quadratic", "x", knots_mm=(0.0, 200.0, 400.0))
    covariance, alpha = correlated(len(X)), np.array([0.0, 1e-3, 4e-3])
    values = multivariate_normal(basis_of(spec).evaluate(X) @ alpha, covariance, seed=4).rvs(400)  # type: ignore[call-arg]
    squares = []
    for y in values:
        choice = choose_basis(X, y, covariance, [spec], trusts_uncertainty=True)
        squares.append(
            (choice.coefficients - alpha) @ np.linalg.solve(choice.covariance, choice.coefficients - alpha)
        )
    assert abs(np.mean(squares) - 3.0) < 5.0 * math.sqrt(6.0 / 400.0)


def test_what_does_not_fit_is_refused() -> None:
    y, std = np.zeros(len(X)), np.full(len(X), 1e-3)
    with pytest.raises(ShapeError, match="21 positions and 20 values"):
        choose_basis(X, y[1:], std, CANDIDATES)
    with pytest.raises(GeometryError, match="value 4 is nan"):
        choose_basis(X, np.where(np.arange(21) == 4, np.nan, y), std, CANDIDATES)
    with pytest.raises(ShapeError, match=r"\(21,\) or \(21, 21\)"):
        choose_basis(X, y, std[1:], CANDIDATES)
    for bad in (0.0, -1.0, math.nan, math.inf):
        with pytest.raises(GeometryError, match="standard uncertainty"):
            choose_basis(X, y, np.where(np.arange(21) == 4, bad, std), CANDIDATES)
    with pytest.raises(GeometryError, match="not positive definite"):
        choose_basis(X, y, np.ones((21, 21)), CANDIDATES)
    with pytest.raises(GeometryError, match="variances above 0"):
        choose_basis(X, y, np.diag(np.arange(21.0)), CANDIDATES)
    with pytest.raises(ShapeError, match="no candidates"):
        choose_basis(X, y, std, [])
    with pytest.raises(ShapeError, match="two distinct"):
        candidate_bases("x", [3.0, 3.0])
    with pytest.raises(ShapeError, match="no sizes"):
        candidate_bases("x", X, kinds=["fourier"])
    rich, x, _, _, _, fits = rich_fit(1)
    theta, covariance = fits[0]
    with pytest.raises(ShapeError, match="11 functions: 10 coefficients"):
        choose_coarser_basis(rich, theta[1:], covariance, np.unique(x), CANDIDATES)
    with pytest.raises(ShapeError, match="do not determine the rich basis"):
        choose_coarser_basis(rich, theta, covariance, np.unique(x)[:8], CANDIDATES)
    with pytest.raises(ShapeError, match="rank 10"):
        choose_coarser_basis(rich, theta, covariance, np.unique(x), CANDIDATES, undetermined=np.ones((11, 2)))
    with pytest.raises(GeometryError, match="not symmetric"):
        choose_coarser_basis(rich, theta, np.tril(covariance), np.unique(x), CANDIDATES)
