"""Standard errors against the scatter of many draws, and what happens to them when the stated noise is wrong."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from fit_scenes import (
    ROOT_MM,
    Numbers,
    covariance_columns,
    curve_of,
    fitted,
    measured_again,
    nine_lines_seen,
    replaced,
    value_of,
)
from scipy import stats
from virtual_machine import Truth, machine_of

from geoerr.error_functions import LINEAR_AND_ANGULAR
from geoerr.fit import Fitted, result_of
from geoerr.observations import Observations

MACHINE = machine_of("wZbXYt", (10.0, -20.0, -60.0))
N_DRAWS = 250
PLACES_MM = np.array([100.0, 250.0, 400.0])
# Chance that a right quantity is called wrong; there are some hundred of them.
CHANCE = 1e-6


def scene(seed: int) -> tuple[Truth, Observations, Numbers]:
    """Nine lines without noise; roots of the rows' covariances: every third row three times as uncertain."""
    rng = np.random.default_rng(seed)
    truth, exact = nine_lines_seen(rng, MACHINE, has_noise=False)
    size = np.where(np.arange(len(exact)) % 3 == 1, 3.0, 1.0)
    columns = {name: values * size**2 for name, values in covariance_columns(exact).items()}
    return truth, replaced(exact, **columns), size[:, None, None] * ROOT_MM


def noise(rng: np.random.Generator, roots: Numbers) -> Numbers:
    return np.asarray(np.einsum("nij,nj->ni", roots, rng.normal(size=(len(roots), 3))))


@pytest.fixture(scope="module")
def draws() -> tuple[Truth, list[Fitted]]:
    truth, exact, roots = scene(70)
    rng = np.random.default_rng(71)
    return truth, [fitted(MACHINE, measured_again(exact, noise(rng, roots))) for _ in range(N_DRAWS)]


def assert_scatter_is_as_stated(value: Numbers, std: Numbers, true: Numbers | None = None) -> None:
    """Check draws (n, k): variances against chi-squared, pooled ratio within a tenth, means against the truth."""
    n_draws = len(value)
    # Inequalities are for the typical variance: stated ones agree between draws, for weights do not depend on noise.
    ratio = value.var(axis=0, ddof=1) / (std**2).mean(axis=0)
    low, high = stats.chi2.ppf([CHANCE, 1.0 - CHANCE], n_draws - 1) / (n_draws - 1)
    assert ratio.min() > low
    assert ratio.max() < high
    assert 0.9 < np.sqrt(ratio.mean()) < 1.1
    if true is not None:
        z = (value.mean(axis=0) - true) / (std.mean(axis=0) / np.sqrt(n_draws))
        assert np.abs(z).max() < stats.norm.isf(CHANCE / 2)


def over(results: list[Fitted], quantity: Callable[[Fitted], tuple[Numbers, Numbers]]) -> tuple[Numbers, Numbers]:
    pairs = [quantity(result) for result in results]
    return np.array([pair[0] for pair in pairs]), np.array([pair[1] for pair in pairs])


@pytest.mark.parametrize("kind", ["positioning", "straightness", "angle"])
def test_function_values(draws: tuple[Truth, list[Fitted]], kind: str) -> None:
    truth, results = draws
    kinds = {
        name: "angle" if name[1] in "ABC" else "positioning" if name[1] == name[2] else "straightness"
        for name in LINEAR_AND_ANGULAR
    }
    for name in (name for name, own in kinds.items() if own == kind):
        value, std = over(results, lambda result, name=name: curve_of(result, name, PLACES_MM))  # type: ignore[misc]
        true = np.interp(PLACES_MM, truth.q_mm["x"], truth.tables[name])
        assert_scatter_is_as_stated(value, std, true)


def test_coefficients(draws: tuple[Truth, list[Fitted]]) -> None:
    _, results = draws
    value = np.array([[c.value for term in result.terms for c in term.coefficients] for result in results])
    std = np.array([[c.std for term in result.terms for c in term.coefficients] for result in results])
    # A straightness of four cubic coefficients has one that the gauge sets to 0.
    is_free = std.mean(axis=0) > 1e-12
    assert is_free.sum() == 18 * 4 - 6 + 3
    assert_scatter_is_as_stated(value[:, is_free], std[:, is_free])


def test_squareness(draws: tuple[Truth, list[Fitted]]) -> None:
    truth, results = draws
    for pair, true in truth.s_rad.items():
        value, std = over(results, lambda result, pair=pair: _columns(value_of(result, f"S_{pair}")))  # type: ignore[misc]
        assert_scatter_is_as_stated(value, std, np.array([true]))


def _columns(pair: tuple[float, float]) -> tuple[Numbers, Numbers]:
    return np.array(pair[:1]), np.array(pair[1:])


def test_predictions_at_another_tool_length(draws: tuple[Truth, list[Fitted]]) -> None:
    _, results = draws
    q, offset = np.array([[400.0, 0.0, 0.0], [120.0, 300.0, 250.0], [400.0, 400.0, 400.0]]), (30.0, 0.0, -100.0)
    models = [result_of(result).model for result in results[::2]]
    value = np.array([model.error_mm(q, offset).ravel() for model in models])
    spread = [np.diagonal(model.prediction_covariance_mm2(q, offset), axis1=1, axis2=2) for model in models[:10]]
    std = np.sqrt(np.array(spread)).reshape(10, -1)
    assert_scatter_is_as_stated(value, np.broadcast_to(std.mean(axis=0), value.shape))


def test_chi_squared_of_the_residual(draws: tuple[Truth, list[Fitted]]) -> None:
    """Its mean is the number of degrees of freedom, which counts places of targets and the pose."""
    _, results = draws
    dof = results[0].split.dof[0]
    n_places = 6
    assert dof == 3 * 81 - (18 * 4 - 24 + 3) - 6 - 3 * (n_places - 1)
    total = sum(result.solved.chi_squared for result in results)
    assert stats.chi2.cdf(total, dof * N_DRAWS) > CHANCE
    assert stats.chi2.sf(total, dof * N_DRAWS) > CHANCE


@pytest.mark.parametrize(("factor", "expected"), [(2.0, 2.0), (0.5, 1.0)])
def test_birge_scaling(factor: float, expected: float) -> None:
    """Twice the stated noise doubles standard errors; half of it does not make stated uncertainties smaller."""
    _, exact, roots = scene(72)
    rng = np.random.default_rng(73)
    honest = fitted(MACHINE, measured_again(exact, noise(rng, roots)))
    result = fitted(MACHINE, measured_again(exact, factor * noise(rng, roots)))
    dof = result.split.dof[0]
    # χ²/dof scatters by √(2/dof), its root by half as much.
    tolerance = 5.0 * expected * np.sqrt(0.5 / dof) if expected != 1.0 else 0.0
    assert abs(result.scale - expected) <= tolerance
    assert value_of(result, "S_xz")[1] == pytest.approx(
        result.scale * value_of(honest, "S_xz")[1] / honest.scale, rel=1e-3
    )


def test_noise_that_nobody_states_comes_from_the_residual() -> None:
    """Standard errors then are those of the scatter: here 5 µm in every component."""
    _, exact, _ = scene(74)
    rng = np.random.default_rng(75)
    plain = Observations(exact.frame.drop("cxx", "cxy", "cxz", "cyy", "cyz", "czz"), exact.sources)
    noisy = measured_again(plain, 5e-3 * rng.normal(size=(len(plain), 3)))
    result = fitted(MACHINE, noisy)
    dof = result.split.dof[0]
    assert result.scale == pytest.approx(5e-3, rel=5.0 * np.sqrt(0.5 / dof))
    stated = replaced(noisy, **{name: np.full(len(plain), result.scale) for name in ("sx", "sy", "sz")})
    again = fitted(MACHINE, stated)
    for term, other in zip(result.terms, again.terms, strict=True):
        for one, two in zip(term.coefficients, other.coefficients, strict=True):
            assert one.value == pytest.approx(two.value, rel=1e-6, abs=1e-3 * max(two.std, 1e-12))
            assert one.std == pytest.approx(two.std, rel=1e-3, abs=1e-12)
