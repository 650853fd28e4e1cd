"""The noise model against dense matrices, and against what was put in."""

from __future__ import annotations

import numpy as np
import pytest
from hidden_machine import Noise, Plan, machine, measure, motion
from scipy import linalg, optimize

from geoerr.diagnose.space import beyond, orthonormal, space_of, unseen_residual
from geoerr.fit import FitOptions, Fitted, fit_terms
from geoerr.fit.noise_model import NoiseSums, blocks_of, fit_noise, offset_weights, without_drift

SMALL = Plan(n_sessions=2, n_lines=8, n_points=12)


def _fitted(seed: int, noise: Noise, plan: Plan = SMALL) -> Fitted:
    rng = np.random.default_rng(seed)
    observations = measure(rng, motion(rng, plan), noise, plan=plan)
    return fit_terms(machine(), [observations], options=FitOptions(threads=1, components="none"))


def _problem(seed: int) -> tuple[NoiseSums, np.ndarray, np.ndarray, np.ndarray]:
    fitted = _fitted(seed, Noise(offset=4.0, drift=4.0))
    rng = np.random.default_rng(seed)
    weights = offset_weights(fitted.sightings, fitted.solved.used)
    basis = orthonormal(rng.normal(size=(weights.size, 9))).reshape(*weights.shape, 9)
    residual = rng.normal(size=weights.shape)
    return NoiseSums(blocks_of(fitted.sightings), weights, residual, basis), weights, residual, basis


PARAMETERS = np.array([0.1, -2.0, -1.5, -1.0, -0.2, -3.0, -1.0, -0.5, 0.3, -1.0, -2.5, 0.2])


@pytest.mark.parametrize("restricted", [True, False])
def test_likelihood_is_the_dense_one(restricted: bool) -> None:
    sums, weights, residual, basis = _problem(1)
    blocks = sums.blocks
    dense = []
    for c in range(3):
        s2, a2, b2, tau = np.exp(PARAMETERS[4 * c : 4 * c + 4])
        b = blocks.block
        same = (blocks.pass_number[b][:, None] == blocks.pass_number[b]).astype(float)
        together = (blocks.session[b][:, None] == blocks.session[b]).astype(float)
        drift = together * np.exp(-np.abs(blocks.time[b][:, None] - blocks.time[b]) / tau)
        z = weights[:, c]
        dense.append(s2 * (np.eye(len(z)) + np.outer(z, z) * (a2 * same + b2 * drift)))
    v = linalg.block_diag(*dense)
    y, a = residual.T.ravel(), np.concatenate([basis[:, c] for c in range(3)])
    inverse = np.linalg.inv(v)
    h = a.T @ inverse @ a
    rest = y - a @ np.linalg.solve(h, a.T @ inverse @ y)
    expected = np.linalg.slogdet(v)[1] + rest @ inverse @ rest
    expected += np.linalg.slogdet(h)[1] if restricted else 0.0
    value, _ = sums.minus_twice_log_likelihood(PARAMETERS.reshape(3, 4), restricted=restricted)
    assert value == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("restricted", [True, False])
def test_gradient_is_that_of_differences(restricted: bool) -> None:
    sums, *_ = _problem(2)
    _, gradient = sums.minus_twice_log_likelihood(PARAMETERS.reshape(3, 4), restricted=restricted)
    by_differences = optimize.approx_fprime(
        PARAMETERS, lambda p: sums.minus_twice_log_likelihood(p.reshape(3, 4), restricted=restricted)[0], 1e-6
    )
    # One-sided differences of numbers of 1e3 with a step of 1e-6: rounding 1e-7, curvature 1e-4.
    assert gradient.ravel() == pytest.approx(by_differences, abs=2e-3)


@pytest.mark.parametrize("hidden", [Noise(), Noise(offset=5.0), Noise(drift=8.0), Noise(offset=3.0, drift=30.0)])
def test_no_other_minimiser_finds_more(hidden: Noise) -> None:
    fitted = _fitted(6, hidden, Plan(n_sessions=3, n_lines=12, n_points=30))
    weights = offset_weights(fitted.sightings, fitted.solved.used)
    residual = fitted.solved.whitened * (weights > 0.0)
    basis = orthonormal(np.random.default_rng(6).normal(size=(weights.size, 5))).reshape(*weights.shape, 5)
    sums = NoiseSums(blocks_of(fitted.sightings), weights, residual, basis)
    found = sums.fit()

    def value_and_slope(p: np.ndarray) -> tuple[float, np.ndarray]:
        value, slope = sums.minus_twice_log_likelihood(p.reshape(3, 4))
        return value, slope.ravel()

    shortest = np.log(sums.blocks.shortest)
    bounds = [(None, None), (-16.0, 9.0), (-16.0, 9.0), (shortest, np.log(2.0))] * 3
    least = np.inf
    for start in ([0.0, -3.0, -3.0, -1.0], [0.5, -1.0, 1.0, 0.0], [0.0, -1.0, -6.0, -2.0]):
        other = optimize.minimize(
            value_and_slope, np.tile(start, 3), jac=True, method="L-BFGS-B", bounds=bounds, options={"ftol": 1e-12}
        )
        least = min(least, float(other.fun))
    # A maximum of many is not that of all: a drift of next to nothing has a memory of its own in every corner.
    assert -2.0 * found.log_likelihood < least + 0.5


def test_columns_that_are_added_are_columns_from_the_start() -> None:
    sums, weights, residual, basis = _problem(7)
    columns = np.random.default_rng(8).normal(size=(*weights.shape, 2))
    new = beyond(basis.reshape(-1, 9), columns.reshape(-1, 2)).reshape(*weights.shape, -1)
    added, whole = sums.with_columns(new), NoiseSums(sums.blocks, weights, residual, np.concatenate([basis, new], 2))
    assert added.basis == pytest.approx(whole.basis, abs=0.0)
    logs = PARAMETERS.reshape(3, 4)
    assert added.minus_twice_log_likelihood(logs)[0] == pytest.approx(
        whole.minus_twice_log_likelihood(logs)[0], rel=1e-12
    )


def test_what_columns_add_is_orthonormal_and_off_the_basis() -> None:
    rng = np.random.default_rng(9)
    basis = orthonormal(rng.normal(size=(200, 6)))
    fresh = rng.normal(size=(200, 2))
    # One inside the basis, one twice, and one of which a ten-thousandth is new.
    columns = np.column_stack([basis @ rng.normal(size=6), 1e3 * fresh[:, 0], fresh[:, 0], 1e-4 * fresh[:, 1]])
    columns[:, 3] += basis[:, 0]
    new = beyond(basis, columns)
    assert new.shape == (200, 2)
    assert new.T @ new == pytest.approx(np.eye(2), abs=1e-12)
    assert basis.T @ new == pytest.approx(np.zeros((6, 2)), abs=1e-12)
    both = np.column_stack([basis, new])
    assert both @ (both.T @ fresh) == pytest.approx(fresh, abs=1e-8)


def test_the_fit_has_the_same_bytes_for_any_number_of_threads() -> None:
    sums, weights, residual, basis = _problem(10)
    one, two = (fit_noise(sums.blocks, weights, residual, basis, threads=threads) for threads in (1, 2))
    assert one.logs.tobytes() == two.logs.tobytes()
    assert one.log_likelihood == two.log_likelihood
    # What is whitened by it is by as many: it was by all cores.
    assert (one.threads, two.threads) == (1, 2)


def test_without_drift_offsets_and_scatter_stay() -> None:
    space = space_of(_fitted(11, Noise(offset=4.0, drift=6.0)))
    noise = space.noise
    calm = without_drift(noise)
    assert calm.logs[:, :2].tobytes() == noise.logs[:, :2].tobytes()
    assert not calm.drift.any()
    values = np.random.default_rng(11).normal(size=space.rows.shape)
    assert calm.unwhiten(calm.whiten(values)) == pytest.approx(values, abs=1e-12)
    # Without drift a pass has nothing to do with the others.
    one_pass = space.pass_number == 3
    changed = values + one_pass[:, None]
    differs = (calm.whiten(changed) != calm.whiten(values)).any(axis=1)
    assert differs.tolist() == one_pass.tolist()


def test_whitening_is_the_inverse_root_of_the_covariance() -> None:
    space = space_of(_fitted(3, Noise(offset=4.0, drift=4.0)))
    noise, n = space.noise, len(space.rows)
    unit = np.zeros((n, 3, n))
    unit[:, 1, :] = np.eye(n)
    root = noise.whiten(unit)[:, 1]
    b, blocks = noise.blocks.block, noise.blocks
    same = blocks.pass_number[b][:, None] == blocks.pass_number[b]
    together = blocks.session[b][:, None] == blocks.session[b]
    drift = together * np.exp(-np.abs(blocks.time[b][:, None] - blocks.time[b]) / noise.memory[1])
    z = offset_weights(space.fitted.sightings, space.fitted.solved.used)[:, 1]
    v = np.eye(n) + np.outer(z, z) * (noise.offset[1] ** 2 * same + noise.drift[1] ** 2 * drift)
    assert noise.sigma[1] ** 2 * root @ v @ root.T == pytest.approx(np.eye(n), abs=1e-9)
    back = noise.whiten_transposed(unit)[:, 1]
    assert back == pytest.approx(root.T, abs=1e-12)


def test_finds_the_offsets_that_were_put_in() -> None:
    plan = Plan(n_sessions=4, n_lines=40, n_points=16)
    noise = space_of(_fitted_21(4, Noise(white=(10.0, 10.0, 10.0), offset=5.0), plan)).noise
    total = np.sqrt(noise.offset**2 + noise.drift**2) * noise.sigma
    # 160 offsets known to 5/10 of a standard deviation of a mean each: their spread to about 8 % a component.
    assert total == pytest.approx(np.full(3, 0.5), abs=0.12)
    assert noise.sigma == pytest.approx(np.ones(3), abs=0.06)


def _fitted_21(seed: int, noise: Noise, plan: Plan) -> Fitted:
    rng = np.random.default_rng(seed)
    observations = measure(rng, motion(rng, plan), noise, plan=plan)
    return fit_terms(machine(), [observations], options=FitOptions(threads=1))


def test_unseen_residual_is_that_of_a_refit() -> None:
    rng = np.random.default_rng(5)
    passes = np.repeat(np.arange(6), [4, 9, 2, 20, 5, 5])
    basis = orthonormal(rng.normal(size=(3 * len(passes), 7)))
    y = rng.normal(size=3 * len(passes))
    residual = y - basis @ (basis.T @ y)
    found = unseen_residual(basis.reshape(-1, 3, 7), residual.reshape(-1, 3), passes, 6)
    for number in range(6):
        own = np.repeat(passes == number, 3)
        solution = np.linalg.lstsq(basis[~own], y[~own], rcond=None)[0]
        assert found.reshape(-1)[own] == pytest.approx(y[own] - basis[own] @ solution, abs=1e-9)
