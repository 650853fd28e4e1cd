"""Passes left out by turns, against fits that never saw them."""

from __future__ import annotations

import itertools

import numpy as np
import polars as pl
import pytest
from fit_scenes import (
    COVARIANCE_MM2,
    CUBICS,
    ROOT_MM,
    Numbers,
    camera_near_base,
    cubic,
    cubic_truth,
    fitted,
    measured_again,
    nine_lines_seen,
    points,
    seen,
)
from virtual_machine import LENGTH_MM, machine_of

from geoerr.diagnose.comparison import compare
from geoerr.fit import Fitted, result_of, sightings_of
from geoerr.fit.held_out import folds_of
from geoerr.fit.start import nominal_mm
from geoerr.model import Model
from geoerr.observations import CARRIERS, CircularTest, Observations

MACHINE = machine_of("wZbXYt")
SIDE = np.linspace(0.0, LENGTH_MM, 5)


def volume(seed: int, *, has_noise: bool = True) -> Observations:
    """Tool against work: a line along x in each of 25 places, of which every second runs back."""
    rng = np.random.default_rng(seed)
    rows, names = [], []
    for number, (y, z) in enumerate(itertools.product(SIDE, SIDE)):
        for x in SIDE[:: 1 - 2 * (number % 2)]:
            rows.append(("relative", np.array([x, y, z]), (0.0, 0.0, 0.0)))
            names.append(f"line {number // 3}")
    return seen(MACHINE, cubic_truth(rng), camera_near_base(rng), rows, rng if has_noise else None, line=names)


def rows_of(observations: Observations, keep: np.ndarray) -> Observations:
    return Observations(observations.frame.filter(keep), observations.sources)


def predicted_by(result: Fitted, observations: Observations) -> Numbers:
    """Give residuals (n, 3) in base axes of rows that a fit may not have seen, in its frame."""
    sightings = sightings_of(observations)
    model, state = result_of(result).model, result.solved.state
    place = nominal_mm(MACHINE, sightings)
    for carrier in CARRIERS:
        rows = sightings.carrier == CARRIERS.index(carrier)
        if rows.any():
            place[rows] += model.displacement_mm(
                sightings.commanded_mm[rows], sightings.offset_mm[rows], carrier=carrier
            )
    # In the frame: R p + t; back in base axes the rotation is that of the whole fit, which differs by microradians.
    return (sightings.measured_mm - state.translations_mm[0]) @ state.rotations[0] - place


def test_held_out_residuals_are_those_of_refits() -> None:
    """Nine passes of a session, the frame known from the others; second order is a thousandth of the noise."""
    observations = volume(600)
    whole = fitted(MACHINE, observations, is_robust=False)
    passes = whole.sightings.pass_number
    fold = folds_of(whole.sightings)
    assert len(np.unique(fold)) == min(len(np.unique(passes)), 20)
    assert whole.held_out.n_not_computable == 0
    for number in np.unique(fold):
        out = fold == number
        rest = fitted(MACHINE, rows_of(observations, ~out), is_robust=False)
        expected = predicted_by(rest, rows_of(observations, out))
        assert np.abs(whole.held_out.residual_mm[out] - expected).max() < 1e-2 * ROOT_MM.max()
    assert whole.held_out.figures is not None
    everywhere = np.sqrt((whole.held_out.residual_mm**2).mean(axis=0).sum())
    assert whole.held_out.figures.rmse_um == pytest.approx(1e3 * everywhere, rel=1e-12)
    assert whole.held_out.figures.rmse_um > whole.figures.rmse_um  # type: ignore[operator]


def test_expected_held_out_error_of_a_right_model() -> None:
    """Its mean square over 60 draws is that of the noise and of the prediction's covariance."""
    exact = volume(601, has_noise=False)
    rng = np.random.default_rng(602)
    squares, expected = [], []
    for _ in range(60):
        result = fitted(MACHINE, measured_again(exact, rng.normal(size=(len(exact), 3)) @ ROOT_MM.T), is_robust=False)
        assert result.held_out.figures is not None
        squares.append(result.held_out.figures.rmse_um**2)  # type: ignore[operator]
        expected.append(result.expected_held_out_um**2)  # type: ignore[operator]
    assert min(expected) > float(np.trace(COVARIANCE_MM2)) * 1e6
    # 60 times 125 rows, of which the depth counts most: √(2/7500) is 1.6 %, Birge's scale now and then adds.
    assert np.mean(squares) / np.mean(expected) == pytest.approx(1.0, abs=0.07)


def test_nine_lines_once_are_not_computable() -> None:
    """Any of the three passes carries what no other measures: counted, never guessed."""
    _, observations = nine_lines_seen(np.random.default_rng(603), MACHINE)
    result = fitted(MACHINE, observations)
    assert result.held_out.figures is None
    assert result.held_out.n_folds == 0
    assert result.held_out.n_not_computable == len(observations)
    assert np.isnan(result.held_out.residual_mm).all()


def test_nine_lines_twice_are_two_folds_each_and_computable() -> None:
    _, observations = nine_lines_seen(np.random.default_rng(604), MACHINE, n_repeats=2)
    result = fitted(MACHINE, observations)
    assert result.held_out.n_folds == 6
    assert result.held_out.n_not_computable == 0
    assert result.held_out.figures is not None


def test_one_axis_measured_once_is_the_only_one_that_is_not_computable() -> None:
    _, observations = nine_lines_seen(np.random.default_rng(605), MACHINE, n_repeats=2)
    keep = (np.asarray(observations.texts("line")) != "z") | (observations.numbers("repeat")[:, 0] == 0)
    result = fitted(MACHINE, rows_of(observations, keep))
    assert result.held_out.n_folds == 4
    assert result.held_out.n_not_computable == 27
    is_z = np.asarray(result.sightings.texts("line")) == "z"
    assert np.isnan(result.held_out.residual_mm).all(axis=1).tolist() == is_z.tolist()


def laser(n_sessions: int, seed: int, axes: str = "x", std_mm: float = 1e-3) -> Observations:
    """Runs of a laser along axes, each a session of its own with its own zero."""
    rng = np.random.default_rng(seed)
    q_mm, measured, session = [], [], []
    for axis, number in itertools.product(axes, range(n_sessions)):
        for q in np.linspace(0.0, LENGTH_MM, 9):
            command, seen_mm = np.zeros(3), np.full(3, np.nan)
            command["xyz".index(axis)] = q
            seen_mm["xyz".index(axis)] = q * (1.0 + 50e-6) + 1000.0 * number + std_mm * rng.normal()
            q_mm.append(command)
            measured.append(seen_mm)
            session.append(f"{axis}{number}")
    std = {f"s{name}": np.full(len(q_mm), std_mm) for name in "xyz"}
    q = np.array(q_mm)
    return points(
        q, 0.0 * q, np.array(measured), covariance_mm2=None, session=session, carrier=["relative"] * len(q), **std
    )


def test_a_pass_that_is_a_session_keeps_its_own_zero() -> None:
    """By hand: the mean line of the other runs, and the left-out run's own mean off."""
    runs = laser(4, 606)
    result = fitted(MACHINE, runs, bases=CUBICS | {"EXX": cubic("x", degree=1)})
    assert result.held_out.n_folds == 4
    assert result.held_out.n_not_computable == 0
    q = runs.commanded_mm[:9, 0]
    error = (runs.measured_mm[:, 0] - runs.commanded_mm[:, 0]).reshape(4, 9)
    centred = error - error.mean(axis=1, keepdims=True)
    about = q - q.mean()
    for number in range(4):
        slope = np.delete(centred, number, axis=0).mean(axis=0) @ about / (about @ about)
        expected = centred[number] - slope * about
        got = result.held_out.residual_mm[9 * number : 9 * number + 9, 0]
        # A scale of 50 ppm acts on its own product: 1 nm.
        assert np.abs(got - expected).max() < 2e-6


@pytest.mark.parametrize("off_mm", [0.0, 0.03, 0.3])
def test_a_circle_that_is_a_session_keeps_its_own_centre_and_radius(off_mm: float) -> None:
    """Four runs, each clamped anew, held against a machine as it is: the others say nothing of a run's set-up."""
    rng, theta, radius_mm = np.random.default_rng(612), np.linspace(0.0, 2.0 * np.pi, 60, endpoint=False), 100.0
    x, y = radius_mm * np.cos(theta), radius_mm * np.sin(theta)
    runs = [
        pl.DataFrame(
            {
                "line": [f"run {number}"] * 60,
                "session": [f"set-up {number}"] * 60,
                "x": 200.0 + x,
                "y": 200.0 + y,
                "z": np.full(60, 50.0),
                "r": np.hypot(x - off_mm * np.cos(number), y - off_mm * np.sin(number)) + 1e-3 * rng.normal(size=60),
            }
        )
        for number in range(4)
    ]
    compared = compare(Model(MACHINE), CircularTest(pl.concat(runs))).points
    assert compared is not None
    held = compared.held_out
    assert held.n_folds == 4
    assert held.n_not_computable == 0
    assert np.abs(held.residual_mm - compared.residual_mm).max() < 1e-9


def test_a_lasers_zero_is_one_unknown_and_hides_no_slope() -> None:
    """One run for each axis, scales only: leaving a run out leaves its scale open, and is not computable."""
    lines = {name: cubic(name[2].lower(), degree=1) for name in ("EXX", "EYY", "EZZ")}
    result = fitted(MACHINE, laser(1, 607, axes="xyz"), bases=CUBICS | lines)
    assert result.held_out.n_folds == 0
    assert result.held_out.n_not_computable == 27
    assert result.held_out.figures is None


def test_more_than_twenty_passes_are_dealt_out() -> None:
    runs = sightings_of(laser(45, 608))
    fold = folds_of(runs)
    assert runs.n_passes == 45
    assert np.unique(fold).tolist() == list(range(20))
    # Whole passes: none is in two folds.
    assert all(len(np.unique(fold[runs.pass_number == number])) == 1 for number in range(45))


def test_one_pass_is_cut_into_ten_blocks() -> None:
    """In time where there is time, else along the longest direction."""
    rng = np.random.default_rng(609)
    q = np.column_stack([np.linspace(0.0, LENGTH_MM, 40), np.zeros(40), np.zeros(40)])
    rows = [("relative", one, (0.0, 0.0, 0.0)) for one in q]
    in_space = sightings_of(seen(MACHINE, cubic_truth(rng), camera_near_base(rng), rows, rng))
    assert np.diff(folds_of(in_space)).tolist().count(0) == 30
    assert np.bincount(folds_of(in_space)).tolist() == [4] * 10
    jumbled = rng.permutation(40).astype(np.float64)
    in_time = sightings_of(
        seen(MACHINE, cubic_truth(rng), camera_near_base(rng), rows, rng, t=jumbled, dir_x=np.ones(40))
    )
    if in_time.n_passes == 1:
        order = np.argsort(in_time.numbers("t"))
        assert (np.diff(folds_of(in_time)[order]) >= 0).all()


def test_two_folds_are_too_few_for_a_figure() -> None:
    result = fitted(MACHINE, laser(2, 610), bases=CUBICS | {"EXX": cubic("x", degree=1)})
    assert result.held_out.n_folds == 2
    assert result.held_out.figures is None


@pytest.mark.parametrize("n_repeats", [1, 40])
@pytest.mark.parametrize("is_alike", [True, False])
def test_variance_of_a_prediction_is_that_of_dense_algebra(n_repeats: int, is_alike: bool) -> None:
    """Of folds below and beyond the size from which sums of products serve; rows surer than others, or all alike."""
    rng = np.random.default_rng(8)
    whole = pl.concat([volume(9).frame.with_columns(repeat=pl.lit(number)) for number in range(n_repeats)])
    size = np.ones(len(whole)) if is_alike else rng.uniform(0.3, 3.0, len(whole))
    columns = {name: whole[name] * pl.Series(size**2) for name in ("cxx", "cxy", "cxz", "cyy", "cyz", "czz")}
    fit = fitted(MACHINE, Observations(whole.with_columns(**columns)), is_robust=False)
    n_rows, fold = len(fit.sightings), np.arange(len(fit.sightings)) % 3
    design = fit.problem.design(fit.solved.design_state, np.ones(n_rows), 0, n_rows, 1)
    root = fit.solved.solution.covariance_root
    expected = 0.0
    for number in range(3):
        rows = np.flatnonzero(np.repeat(fold == number, 3))
        seen_by = design[rows] @ root
        without = seen_by @ np.linalg.inv(np.eye(root.shape[1]) - seen_by.T @ seen_by) @ seen_by.T
        spread = np.diag(without).reshape(-1, 3)
        expected += float(np.einsum("nij,nj->", fit.sightings.unwhitening[fold == number] ** 2, spread))
    assert fit.leave_out(fold).prediction_variance_mm2 == pytest.approx(expected / n_rows, rel=1e-7)
