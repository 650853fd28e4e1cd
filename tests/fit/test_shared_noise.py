"""What rows share, in the uncertainties of a fit: by dense matrices, and by Monte-Carlo."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest

from geoerr.budget import uncertainty_budget
from geoerr.fit import FitOptions, Fitted, fit_model, fit_terms, shared_noise
from geoerr.fit.noise_model import Blocks, NoiseModel, blocks_of, offset_weights
from geoerr.fit.shared_noise import _moved, _UnitColumns
from geoerr.machine import Axis, Machine
from geoerr.observations import Observations, observations_from_columns

MACHINE = Machine("test", "wbXYZt", {axis: Axis((0.0, 300.0)) for axis in "xyz"}, tool_offset_mm=(0.0, 0.0, 0.0))
EFFECTS = ["scale:x", "scale:y", "squareness:xy", "scale:z"]
TRUTH = {"scale:x": 40e-6, "scale:y": -25e-6, "squareness:xy": 60e-6, "scale:z": 30e-6}
N_PASSES, N_POINTS, SECONDS = 24, 10, 6.0
WHITE_UM = (3.0, 3.0, 3.0)


def _observations(
    seed: int,
    *,
    offset_um: float | tuple[float, float, float] = 0.0,
    drift_um: float = 0.0,
    white_um: tuple[float, float, float] = WHITE_UM,
    n_passes: int = N_PASSES,
) -> Observations:
    """Measure lines along axes and diagonals with a device whose passes have offsets, and that drifts."""
    rng = np.random.default_rng(seed)
    places, line = [], []
    for number in range(n_passes):
        along = (np.eye(3)[number % 3], np.array([1.0, 1.0, 0.0]), np.array([1.0, -1.0, 0.5]))[number // 3 % 3]
        begin = rng.uniform(100.0, 200.0, 3)
        reach = np.linspace(-95.0, 95.0, N_POINTS) * (1.0 if number % 2 else -1.0)
        places.append(begin + reach[:, None] * along)
        line.append(np.full(N_POINTS, number))
    q, line_of_row = np.concatenate(places), np.concatenate(line)
    t = SECONDS * np.arange(len(q))
    error = np.zeros_like(q)
    error[:, 0] = TRUTH["scale:x"] * q[:, 0] - TRUTH["squareness:xy"] * q[:, 1]
    error[:, 1] = TRUTH["scale:y"] * q[:, 1]
    error[:, 2] = TRUTH["scale:z"] * q[:, 2]
    noise = np.array(white_um) * rng.normal(size=q.shape)
    noise += np.array(offset_um) * rng.normal(size=(n_passes, 3))[line_of_row]
    apart = np.abs(t[:, None] - t[None, :])
    value, vector = np.linalg.eigh(np.exp(-apart / 300.0))
    noise += drift_um * (vector * np.sqrt(np.maximum(value, 0.0))) @ rng.normal(size=q.shape)
    m = q + error + 1e-3 * noise
    columns: dict[str, object] = {
        "x": q[:, 0],
        "y": q[:, 1],
        "z": q[:, 2],
        "t": t,
        "line": [f"L{n}" for n in line_of_row],
    }
    columns |= {"mx": m[:, 0], "my": m[:, 1], "mz": m[:, 2]}
    columns |= {f"s{axis}": np.full(len(q), 1e-3 * WHITE_UM[0]) for axis in "xyz"}
    return observations_from_columns(columns)


def _fitted(observations: Observations) -> Fitted:
    return fit_model(MACHINE, observations, components="none", effects=EFFECTS, options=FitOptions(threads=1)).fitted


def _z(fitted: Fitted) -> list[float]:
    values = {term.id: term.coefficients[0] for term in fitted.terms}
    return [(values[name].value - TRUTH[name]) / values[name].std for name in EFFECTS]


def _plain(observations: Observations) -> Fitted:
    """Fit as if each row scattered by itself."""
    fitted = _fitted(observations)
    return fit_terms(MACHINE, [observations], effects=fitted.terms, options=FitOptions(components="none", threads=1))


@pytest.mark.parametrize("shared", [{"offset_um": 4.0}, {"drift_um": 5.0}], ids=["offsets", "drift"])
def test_intervals_hold_where_rows_share_something(shared: dict[str, float]) -> None:
    made = [_observations(seed, **shared) for seed in range(60)]
    counted = np.array([_z(_fitted(one)) for one in made])
    # Of 240 squares of standard normal numbers, four by four nearly independent, the mean.
    assert 0.7 < (counted**2).mean() < 1.35
    plain = np.array([_z(_plain(one)) for one in made])
    assert (plain**2).mean() > 1.8, "rows that share nothing would have done"


def test_a_component_that_scatters_more_is_told_so() -> None:
    """The offsets are of x and y; z scatters three times as far as all three do in the mean of squares."""
    made = [_observations(seed, offset_um=(4.0, 4.0, 0.0), white_um=(2.0, 2.0, 10.0)) for seed in range(60)]
    z = np.array([_z(_fitted(one)) for one in made])[:, EFFECTS.index("scale:z")]
    # 60 squares; their mean is beyond 1.6 once in a thousand.
    assert (z**2).mean() < 1.7


def test_the_mean_scatter_is_that_of_what_was_measured() -> None:
    frame = _observations(4, offset_um=4.0).frame.drop("mz", "sx", "sy", "sz")
    fitted = fit_model(MACHINE, Observations(frame), components="none", effects=EFFECTS[:3]).fitted
    assert fitted.shared_noise is not None
    assert 1e3 * fitted.shared_noise.mean_scatter == pytest.approx(WHITE_UM[0], rel=0.15)


def test_every_so_manieth_pass_stands_for_many(monkeypatch: pytest.MonkeyPatch) -> None:
    observations = _observations(7, offset_um=4.0, n_passes=96)
    whole = _fitted(observations)
    monkeypatch.setattr(shared_noise, "_MOST_BLOCKS", 40)
    thinned = _fitted(observations)
    assert thinned.shared_noise is not None
    assert whole.shared_noise is not None
    assert thinned.shared_noise.root.shape[1] <= thinned.problem.n_columns
    ratio = np.sqrt(np.diagonal(thinned.covariance) / np.diagonal(whole.covariance))
    assert (np.abs(ratio - 1.0) < 0.3).all()
    assert (ratio != 1.0).any()


def test_nothing_changes_where_rows_share_nothing() -> None:
    n_counted = 0
    for seed in range(60):
        fitted, plain = _fitted(made := _observations(seed)), _plain(made)
        if fitted.shared_noise is not None:
            n_counted += 1
            continue
        assert np.array_equal(fitted.covariance, plain.covariance)
    # One of a hundred by chance.
    assert n_counted <= 3


@pytest.mark.parametrize("at_once", [5, 256])
def test_the_formula_is_that_of_dense_matrices(at_once: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shared_noise, "_BLOCKS_AT_ONCE", at_once)
    plain = _plain(_observations(3, offset_um=4.0))
    blocks = blocks_of(plain.sightings)
    weights = offset_weights(plain.sightings, plain.solved.used)
    sigma, offset, drift = np.array([[1.2, 0.9, 1.5], [1.0, 0.0, 2.0], [0.5, 1.5, 0.0]])
    memory = np.array([0.3, 0.1, 1.0])
    noise = NoiseModel(blocks, sigma, offset, drift, memory, weights, 0.0)
    made = _UnitColumns(plain)
    columns = made.of(np.arange(len(weights)))
    root, used = plain.solved.solution.covariance_root, plain.solved.used.astype(np.float64)
    design = plain.problem.design(plain.problem.start, used, 0, len(weights), 1)
    np.testing.assert_allclose(columns, (design @ root).reshape(columns.shape), atol=1e-12)
    np.testing.assert_array_equal(made.of(np.arange(3, 40, 4)), columns[3:40:4])
    grams, by_block = made.sums(weights, blocks)
    np.testing.assert_allclose(grams, np.einsum("ncr,ncs->crs", columns, columns), atol=1e-12)
    shared = np.zeros((columns.shape[2],) * 2)
    for c in range(3):
        same_pass = blocks.pass_number[:, None] == blocks.pass_number
        same_session = blocks.session[:, None] == blocks.session
        apart = np.abs(blocks.time[:, None] - blocks.time)
        inner = offset[c] ** 2 * same_pass + drift[c] ** 2 * same_session * np.exp(-apart / memory[c])
        z = weights[:, c, None] * (blocks.block[:, None] == np.arange(len(blocks)))
        shared += sigma[c] ** 2 * columns[:, c].T @ z @ inner @ z.T @ columns[:, c]
    moved = _moved(noise, by_block)
    np.testing.assert_allclose(moved @ moved.T, shared, rtol=1e-9, atol=1e-12 * np.abs(shared).max())


def test_what_many_short_passes_share_costs_no_square() -> None:
    """100,000 rows in passes of two took 3.6 GB and three minutes: each block was held against each."""
    n_blocks, r = 20_000, 4
    rng = np.random.default_rng(1)
    time = np.sort(rng.uniform(0.0, 1.0, n_blocks))
    number = np.arange(n_blocks)
    ones = np.ones(3)
    noise = NoiseModel(Blocks(number, 0 * number, number, time, 0.1), ones, ones, ones, 0.1 * ones, ones, 0.0)
    by_block = rng.normal(size=(3, n_blocks, r))
    tracemalloc.start()
    moved = _moved(noise, by_block)
    most_bytes = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert most_bytes < 10 * by_block.nbytes
    assert np.isfinite(moved).all()


def test_parts_add_up_to_the_covariance() -> None:
    fitted = _fitted(_observations(5, offset_um=4.0, drift_um=3.0))
    parts = fitted.shared_noise
    assert parts is not None
    scatter = parts.scatter_root()
    np.testing.assert_allclose(
        scatter @ scatter.T + parts.root @ parts.root.T,
        fitted.covariance,
        rtol=1e-9,
        atol=1e-12 * float(np.abs(fitted.covariance).max()),
    )
    std = [one.std for term in fitted.terms for one in term.coefficients]
    np.testing.assert_allclose(std, np.sqrt(np.diagonal(fitted.covariance)), rtol=1e-12)
    own = {source.name: source for source in uncertainty_budget(fitted, {"far": (290.0, 290.0, 290.0)}).sources}
    assert "shared" in own


def test_many_rows_are_thinned_for_the_noise_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    observations = _observations(7, offset_um=4.0)
    whole = _fitted(observations)
    monkeypatch.setattr(shared_noise, "_MOST_NUMBERS", 3 * len(observations) * 4)
    thinned = _fitted(observations)
    assert thinned.shared_noise is not None
    assert whole.shared_noise is not None
    ratio = np.sqrt(np.diagonal(thinned.covariance) / np.diagonal(whole.covariance))
    assert (np.abs(ratio - 1.0) < 0.25).all()
    assert (ratio != 1.0).any()


def test_what_a_prior_knew_keeps_its_part() -> None:
    options = FitOptions(freedom="smooth", threads=1)
    fitted = fit_model(MACHINE, _observations(2, offset_um=4.0), components="12", options=options).fitted
    assert fitted.prior is not None
    assert fitted.shared_noise is not None
    assert (np.diagonal(fitted.covariance) >= 0.0).all()
    gain = fitted.shared_noise.gain
    by_prior = gain @ (fitted.prior @ fitted.solved.solution.covariance_root).T
    scatter, shared = fitted.shared_noise.scatter_root(), fitted.shared_noise.root
    expected = sum(fitted.unit**n * part @ part.T for n, part in ((2, by_prior), (0, scatter), (0, shared)))
    np.testing.assert_allclose(fitted.covariance, expected, rtol=1e-9, atol=1e-12 * np.abs(fitted.covariance).max())
    # All the noise of unit size, and what the prior knew, are the unit covariance.
    whole = np.einsum("cij->ij", fitted.shared_noise.grams)
    own = fitted.prior @ fitted.solved.solution.covariance_root
    np.testing.assert_allclose(whole + own.T @ own, np.eye(len(whole)), atol=1e-6)
