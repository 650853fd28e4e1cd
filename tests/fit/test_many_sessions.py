"""Fits of which most unknowns are those of sessions: as the dense solution of the same columns, in linear time."""

from __future__ import annotations

import pickle
import time

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from geoerr import _core
from geoerr.fit import FitOptions, Fitted, fit_terms
from geoerr.fit.classic import gauge_rows
from geoerr.fit.held_out import folds_of
from geoerr.fit.rolls import held_rolls
from geoerr.machine import AXES, Axis, Machine
from geoerr.observations import CARRIERS, MeasuredTable, observations_from_columns
from geoerr.terms import BasisSpec

LENGTH_MM, STD_MM = 400.0, 3e-3
MACHINE = Machine("m", "wZbXYt", {axis: Axis((0.0, LENGTH_MM)) for axis in AXES})

OFFSETS_MM = np.array([[0.0, 0.0, 0.0], [150.0, 0.0, 80.0], [0.0, 150.0, -60.0]])
# Of what is seen of one place: sessions of one row and of two tell no pose.
HEIGHTS = [*([20] * 60), 1, 2, 1]
PRACTICAL_RANK = 1e-5


def table(heights: list[int], n_targets: int, seed: int = 3) -> MeasuredTable:
    """Measure a machine with a scale error in sessions of so many rows, each with a pose of its own."""
    rng = np.random.default_rng(seed)
    n = sum(heights)
    session = np.repeat(np.arange(len(heights)), heights)
    q = rng.uniform(0.0, LENGTH_MM, (n, 3))
    offset = OFFSETS_MM[rng.integers(0, n_targets, n)]
    channels = np.zeros((n, 30))
    channels[:, 0] = 5e-5 * q[:, 0]
    carrier = np.full(n, CARRIERS.index("relative"), dtype=np.uint8)
    place = _core.chain_positions(MACHINE.chain, "position", carrier, q, offset, MACHINE.tool_offset_mm, channels, 0)
    turns = Rotation.random(len(heights), rng=seed).as_matrix()
    seen = np.einsum("nij,nj->ni", turns[session], place) + rng.uniform(-500.0, 500.0, (len(heights), 3))[session]
    seen += STD_MM * rng.normal(size=seen.shape)
    columns: dict[str, list[str] | np.ndarray] = {
        "carrier": ["relative"] * n,
        "session": [f"s{number}" for number in session],
        "pass": [str(2 * number + place % 2) for place, number in enumerate(session)],
    }
    for axis, name in enumerate("xyz"):
        columns |= {name: q[:, axis], f"t{name}": offset[:, axis], f"m{name}": seen[:, axis]}
        columns[f"s{name}"] = np.full(n, STD_MM)
    return observations_from_columns(columns)


def fit_of(heights: list[int], n_targets: int, threads: int = 1) -> Fitted:
    """Fit quadratic functions."""
    bases = {
        name: BasisSpec("polynomial", name[2].lower(), degree=2, low_mm=0.0, high_mm=LENGTH_MM)
        for name in (f"E{c}{a}" for a in "XYZ" for c in "XYZABC")
    }
    return fit_terms(MACHINE, [table(heights, n_targets)], options=FitOptions(bases=bases, threads=threads))


@pytest.fixture(scope="module", params=[1, 3])
def fitted(request: pytest.FixtureRequest) -> Fitted:
    """Give the fit to one target, which leaves angles open, or to three, places of which are unknowns of sessions."""
    return fit_of(HEIGHTS, request.param)


def dense(fitted: Fitted) -> tuple[np.ndarray, np.ndarray]:
    """Give the whitened columns and a root of the covariance, by NumPy."""
    problem, solved = fitted.problem, fitted.solved
    design = problem.design(solved.design_state, solved.row_scale, 0, len(fitted.sightings), 1)
    norms = np.linalg.norm(design, axis=0)
    norms = np.where(norms > 0.0, norms, 1.0)
    rows = gauge_rows(fitted.terms)
    gauge = np.zeros((len(rows), problem.n_columns))
    gauge[:, : rows.shape[1]] = rows
    # A bound method by its type as any: what a fit was posed with, its frames too, is kept nowhere else.
    posed = fitted.fit_of_terms.__self__  # type: ignore[attr-defined]
    # Of two rows the turn about the line between them is held.
    gauge = np.concatenate([gauge, held_rolls(posed.frames, fitted.sightings, problem)])
    _, _, right = np.linalg.svd(gauge / norms)
    keeping = right[len(gauge) :].T
    _, size, turn = np.linalg.svd((design / norms) @ keeping, full_matrices=False)
    kept = size > PRACTICAL_RANK * size[0]
    return design, keeping @ (turn[kept].T / size[kept]) / norms[:, None]


def test_rank_and_covariance_are_those_of_the_dense_solution(fitted: Fitted) -> None:
    solution = fitted.solved.solution
    design, root = dense(fitted)
    assert fitted.problem.n_columns > 380
    assert solution.rank == root.shape[1]
    own = np.asarray(solution.covariance_root)
    hats = [design @ one for one in (own, root)]
    np.testing.assert_allclose(hats[0] @ hats[0].T, hats[1] @ hats[1].T, atol=1e-9)
    covariance, expected = own @ own.T, root @ root.T
    # What the gauge holds at 0 is known to rounding, which has no correlations.
    is_held = np.sqrt(np.diag(expected)) * np.linalg.norm(design, axis=0) < 1e-9
    known = np.flatnonzero(np.asarray(solution.is_determined) & ~is_held)
    assert 300 < len(known) < len(own)
    size = np.sqrt(np.diag(expected)[known])
    scaled = [one[np.ix_(known, known)] / np.outer(size, size) for one in (covariance, expected)]
    np.testing.assert_allclose(scaled[0], scaled[1], atol=1e-8)
    np.testing.assert_allclose(solution.spread[known], size, rtol=1e-8)
    np.testing.assert_allclose(solution.covariance_root_of_first(7), own[:7], atol=0.0)
    # What is open moves no point, and what moves along it is told.
    null = np.asarray(solution.null_space)
    assert np.linalg.matrix_rank(null) == null.shape[1] > 0
    assert np.abs(design @ null).max() < 1e-4 * np.abs(design).max()
    np.testing.assert_array_equal(np.asarray(solution.is_determined), ~null.any(axis=1))


def test_the_coefficients_are_at_the_minimum(fitted: Fitted) -> None:
    solved = fitted.solved
    _, root = dense(fitted)
    gradient = fitted.problem.gradient(solved.design_state, solved.residual_mm, solved.row_scale, 1)
    # What a step would still change, in standard errors.
    assert solved.converged
    assert np.abs(root.T @ gradient).max() < 1e-3


def test_what_is_held_out_is_what_the_dense_hat_matrix_says(fitted: Fitted) -> None:
    solved, sightings = fitted.solved, fitted.sightings
    design, root = dense(fitted)
    spread = design @ root
    fold = folds_of(sightings)
    held = fitted.leave_out(fold)
    assert solved.used.all()
    n_checked = 0
    for number in range(held.n_folds):
        rows = np.flatnonzero(fold == number)
        own = spread.reshape(len(sightings), 3, -1)[rows].reshape(3 * len(rows), -1)
        value, vector = np.linalg.eigh(own.T @ own)
        gain = np.where(value < 1.0 - 1e-7, 1.0 / np.maximum(1.0 - value, 1e-300), 0.0)
        residual = solved.whitened[rows].ravel()
        expected = residual + own @ (vector @ (gain * (vector.T @ (own.T @ residual))))
        found = held.residual_mm[rows]
        if np.isnan(found).any():
            continue
        n_checked += 1
        length = np.linalg.norm(expected.reshape(-1, 3), axis=1) * STD_MM
        np.testing.assert_allclose(np.linalg.norm(found, axis=1), length, rtol=1e-5, atol=1e-7)
        variance = float(((own @ vector) ** 2 @ gain).sum()) * STD_MM**2 / len(rows)
        assert held.variance_of_fold_mm2[number] == pytest.approx(variance, rel=1e-6)
    assert n_checked >= 15


def test_threads_and_a_pickle_change_no_byte(fitted: Fitted) -> None:
    n_targets = 1 if fitted.shared is None else 3
    other = fit_of(HEIGHTS, n_targets, threads=2)
    for one in (other, pickle.loads(pickle.dumps(fitted.solved))):
        solved = one if not isinstance(one, Fitted) else one.solved
        np.testing.assert_array_equal(solved.state.coefficients, fitted.solved.state.coefficients)
        np.testing.assert_array_equal(solved.solution.covariance_root, fitted.solved.solution.covariance_root)
    np.testing.assert_array_equal(other.held_out.residual_mm, fitted.held_out.residual_mm)


def test_the_cost_grows_with_the_rows() -> None:
    def seconds(n_sessions: int) -> float:
        begin = time.process_time()
        assert np.isfinite(fit_of([12] * n_sessions, 1).held_out.residual_mm).any()
        return time.process_time() - begin

    seconds(60)
    few, many = min(seconds(100) for _ in range(2)), seconds(600)
    # As the cube it would be two hundred times.
    assert many < 15.0 * few
