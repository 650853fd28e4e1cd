"""Gains and the null of the search against least squares written out, and against chance."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from hidden_machine import Noise, Plan, machine, measure, motion
from numpy_scan import judge
from scipy import stats

from geoerr.diagnose.candidates import Candidate, candidates_of
from geoerr.diagnose.functions import Functions
from geoerr.diagnose.null import Null, largest_surprise, surprise
from geoerr.diagnose.probe_variables import variables_of
from geoerr.diagnose.probes import Probe, probes_of
from geoerr.diagnose.scan import Scanner, all_channels, estimate, off_model
from geoerr.diagnose.space import Channels, Space, space_of
from geoerr.effects import catalogue
from geoerr.effects.collection import Catalogue, load_effects
from geoerr.fit import FitOptions, fit_terms
from geoerr.fit.owned import OWNED
from geoerr.model.compile import core_part

NAMES = ("backlash", "thermal-expansion", "lag", "step", "camera-drift", "thermal-bending", "screw-heating", "scale")
N_DRAWS = 7


@cache
def _scene(n_lines: int = 16) -> tuple[Space, Channels, list[Candidate], list[Probe], Functions]:
    rng = np.random.default_rng(1)
    plan = Plan(n_sessions=2, n_lines=n_lines, n_points=12)
    observations = measure(rng, motion(rng, plan), Noise(offset=3.0, drift=3.0), plan=plan)
    fitted = fit_terms(machine(), [observations], options=FitOptions(threads=1))
    space = space_of(fitted)
    known = Catalogue({name: catalogue()[name] for name in NAMES})
    candidates, _, functions = candidates_of(fitted, known)
    return (
        space,
        Channels(fitted, space.rows),
        candidates,
        probes_of(fitted, functions, variables_of(fitted)),
        functions,
    )


def _scanner(*, threads: int = 1, n_lines: int = 16) -> Scanner:
    space, channels, candidates, probes, functions = _scene(n_lines)
    names = all_channels([shapes for one in [*candidates, *probes] for shapes in one.shapes])
    return Scanner(space, channels, functions, names=names, n_draws=N_DRAWS, threads=threads)


@pytest.mark.parametrize("name", NAMES)
def test_gains_ranks_shares_and_draws_are_those_of_least_squares(name: str) -> None:
    space, channels, candidates, _, functions = _scene()
    scanner, draws = _scanner(), space.draws(N_DRAWS).astype(np.float64)
    candidate = next(one for one in candidates if one.effect.id == name)
    # Single precision: errors of sums over all rows, of which a direction may be as small a share as counts.
    single = 8.0 * float(np.finfo(np.float32).eps) * np.sqrt(len(space.rows)) / OWNED
    for shapes, quick in zip(candidate.shapes, scanner.scan(candidate.shapes), strict=True):
        exact = scanner.exact(shapes)
        largest = np.full(quick.largest.shape, -1.0)
        for trial in range(len(shapes.trials)):
            expected = judge(space, channels, shapes, functions.values(shapes.codes[trial]), draws)
            assert exact.rank[trial] == quick.rank[trial] == expected.rank
            assert exact.gain[trial] == pytest.approx(expected.gain, rel=1e-7, abs=1e-9)
            assert quick.gain[trial] == pytest.approx(expected.gain, rel=single, abs=single)
            if expected.rank:
                assert exact.share[trial] == pytest.approx(expected.share, rel=1e-6)
                largest[expected.rank] = np.maximum(largest[expected.rank], expected.of_draws)
        assert quick.largest[1:] == pytest.approx(largest[1:], rel=single, abs=single)


def test_waves_and_jumps_at_nodes_are_those_over_all_rows() -> None:
    rng = np.random.default_rng(3)
    plan = Plan(n_sessions=2, n_lines=40, n_points=24)
    observations = measure(rng, motion(rng, plan), Noise(offset=3.0), plan=plan)
    fitted = fit_terms(machine(), [observations], options=FitOptions(threads=1))
    space = space_of(fitted)
    known = Catalogue({name: catalogue()[name] for name in ("periodic", "step")})
    candidates, _, functions = candidates_of(fitted, known)
    shapes = [shapes for one in candidates for shapes in one.shapes]
    scanner = Scanner(
        space, Channels(fitted, space.rows), functions, names=all_channels(shapes), n_draws=N_DRAWS, threads=1
    )
    off = []
    for one, quick in zip(shapes, scanner.scan(shapes), strict=True):
        exact = scanner.exact(one)
        # A share so small that rounding decides whether it counts.
        clear = (exact.share > 0.01) & (quick.rank == exact.rank)
        assert clear.mean() > 0.9
        off.append((quick.gain - exact.gain)[clear] / (1.0 + exact.gain[clear]))
    # Interpolation is good to a ten-thousandth of a wave, of which the model leaves a hundredth at the least.
    assert np.abs(np.concatenate(off)).max() < 0.02
    assert np.median(np.abs(np.concatenate(off))) < 2e-4


@pytest.mark.parametrize("name", ["thermal-bending", "thermal-expansion", "screw-heating"])
def test_shared_columns_make_what_the_formula_says(name: str) -> None:
    _, _, candidates, _, functions = _scene()
    n_differences = 0
    for candidate in [one for one in candidates if one.effect.id == name]:
        for shapes in [one for one in candidate.shapes if not one.corners[0]]:
            assert shapes.term is not None
            n_differences += len(shapes.columns) > len(shapes.term.parts)
            for trial, codes in [*zip(shapes.trials, shapes.codes, strict=True)][::3]:
                found: dict[tuple[str, int], np.ndarray] = {}
                for (part, place), column in zip(shapes.columns, functions.values(codes), strict=True):
                    channel, factor = shapes.channels[part]
                    found[channel, place] = found.get((channel, place), 0.0) + factor * column
                for part in shapes.term.parts:
                    _, factor, _, formula, places, inner = core_part(shapes.term, part, functions.names)
                    own = np.array([trial[place] for place in inner])
                    columns = formula.coefficient_columns(
                        functions.variables, own, functions.starts, functions.times, 1
                    )
                    for place, column in zip(places, columns.T, strict=True):
                        size = float(np.abs(column).max())
                        assert found[part.channel, place] == pytest.approx(factor * column, rel=1e-9, abs=1e-9 * size)
    assert n_differences > 0 or name != "thermal-bending"


def test_what_only_grows_with_a_temperature_is_not_proportional_to_it(tmp_path: Path) -> None:
    own = tmp_path / "own.toml"
    own.write_text(
        '[[effect]]\nid = "mine"\nchannel = "along"\naxes = ["x"]\nexpression = "k*abs(T)*x"\ncovariates = ["temp"]\n'
        '[effect.coefficients.k]\nunit = "1/K"\n'
    )
    rng = np.random.default_rng(5)
    plan = Plan(n_sessions=2, n_lines=16, n_points=12)
    observations = measure(rng, motion(rng, plan), Noise(offset=3.0), plan=plan)
    temperatures = [name for name in observations.frame.columns if name.startswith("temp_")]
    # On both sides of the 20 °C from which a temperature is counted.
    colder = observations.frame.with_columns(
        (pl.col(name) - pl.col(name).mean() + 20.0).alias(name) for name in temperatures
    )
    fitted = fit_terms(machine(), [replace(observations, frame=colder)], options=FitOptions(threads=1))
    space = space_of(fitted)
    candidates, _, functions = candidates_of(fitted, Catalogue({one.id: one for one in load_effects(own)}))
    shapes = [shapes for one in candidates for shapes in one.shapes]
    channels = Channels(fitted, space.rows)
    scanner = Scanner(space, channels, functions, names=all_channels(shapes), n_draws=N_DRAWS, threads=1)
    draws = space.draws(N_DRAWS).astype(np.float64)
    assert shapes
    for one, quick in zip(shapes, scanner.scan(shapes), strict=True):
        for trial in range(len(one.trials)):
            expected = judge(space, channels, one, functions.values(one.codes[trial]), draws)
            assert quick.gain[trial] == pytest.approx(expected.gain, rel=1e-3, abs=1e-3)


def test_probes_are_judged_alike() -> None:
    space, channels, _, probes, functions = _scene()
    scanner, draws = _scanner(), space.draws(N_DRAWS).astype(np.float64)
    for probe in probes[:: max(len(probes) // 12, 1)]:
        shapes = probe.shapes[-1]
        expected = judge(space, channels, shapes, functions.values(shapes.codes[0]), draws)
        exact = scanner.exact(shapes)
        assert exact.rank[0] == expected.rank
        assert exact.gain[0] == pytest.approx(expected.gain, rel=1e-7, abs=1e-9)


def test_estimate_is_that_of_least_squares() -> None:
    space, _, candidates, _, _ = _scene()
    scanner = _scanner()
    shapes = next(one for one in candidates if one.effect.id == "thermal-expansion").shapes[0]
    raw = scanner.raw_columns(shapes, 0)
    coefficients, root, gain = estimate(space, raw)
    beyond = off_model(space, raw).reshape(-1, raw.shape[2])
    expected = np.linalg.lstsq(beyond, space.residual.reshape(-1), rcond=None)[0]
    assert coefficients == pytest.approx(expected, rel=1e-6)
    assert root @ root.T == pytest.approx(np.linalg.inv(beyond.T @ beyond), rel=1e-6)
    assert float(gain) == pytest.approx(scanner.exact(shapes).gain[0], rel=1e-7)


def test_same_bytes_for_any_number_of_threads() -> None:
    _, _, candidates, probes, _ = _scene()
    shapes = [shapes for one in [*candidates, *probes] for shapes in one.shapes]
    for one, other in zip(_scanner(threads=1).scan(shapes), _scanner(threads=3).scan(shapes), strict=True):
        assert one.gain.tobytes() == other.gain.tobytes()
        assert one.largest.tobytes() == other.largest.tobytes()


@pytest.mark.parametrize("name", ["backlash", "thermal-bending"])
def test_one_candidate_over_many_rows_is_summed_in_parts_and_says_the_same(name: str) -> None:
    n_lines = 220
    space, channels, candidates, _, functions = _scene(n_lines)
    # Rows of two parts at least.
    assert len(space.rows) >= 2 * 2048
    draws = space.draws(1).astype(np.float64)
    shapes = next(one for one in candidates if one.effect.id == name).shapes[0]
    found = _scanner(threads=1, n_lines=n_lines).exact(shapes)
    by_threads = _scanner(threads=3, n_lines=n_lines).exact(shapes)
    assert found.gain.tobytes() == by_threads.gain.tobytes()
    for trial in {0, len(shapes.trials) - 1}:
        expected = judge(space, channels, shapes, functions.values(shapes.codes[trial]), draws)
        assert found.rank[trial] == expected.rank
        assert found.gain[trial] == pytest.approx(expected.gain, rel=1e-7, abs=1e-9)


def test_what_the_rigid_machine_owns_is_not_measurable() -> None:
    _, _, candidates, _, _ = _scene()
    scanner = _scanner()
    scale = next(one for one in candidates if one.effect.id == "scale")
    assert all((scanner.exact(shapes).rank == 0).all() for shapes in scale.shapes)


def test_affine_parameters_need_no_trials() -> None:
    _, _, candidates, _, _ = _scene()
    growth = next(one for one in candidates if one.effect.id == "thermal-expansion")
    at_once = growth.shapes[0]
    assert len(at_once.trials) == 1
    assert at_once.n_coefficients == 2


def test_a_lag_is_tried_at_twelve_values_that_span_its_range() -> None:
    _, _, candidates, _, _ = _scene()
    growth = next(one for one in candidates if one.effect.id == "thermal-expansion")
    lagged = growth.shapes[1]
    assert lagged.term is not None
    place = next(place for place, one in enumerate(lagged.term.inner) if one.name == "tau")
    lags_s = np.array([trial[place] for trial in lagged.trials])
    assert len(lags_s) == 12
    assert (lags_s[0], lags_s[-1]) == pytest.approx((lagged.term.inner[place].low, lagged.term.inner[place].high))
    assert (lags_s[1:] < 2.0 * lags_s[:-1]).all()


def test_draws_are_white_off_the_model_and_always_the_same() -> None:
    space = _scene()[0]
    draws = space.draws(40)
    basis = space.basis.reshape(-1, space.basis.shape[2])
    flat = draws.reshape(40, -1)
    # Single precision, over the root of the number of rows that each product sums.
    assert float(np.abs(flat @ basis).max()) < 1e-4
    free = space.n_numbers - basis.shape[1]
    # Sums of squares of `free` numbers with the tails of the residual: kurtosis below 10, 40 draws.
    assert float((flat**2).sum() / 40) == pytest.approx(free, rel=4.0 * np.sqrt(10.0 / (40 * free)))
    assert (draws == space.draws(40)).all()


def test_draws_are_of_the_size_that_winsorising_left() -> None:
    """Tails that were cut are no part of what the residual's gains are made of."""
    space = _scene()[0]
    small = replace(space, residual=0.9 * space.residual)
    assert (small.draws(8)).std() == pytest.approx(0.9 * space.draws(8).std(), rel=1e-5)


def test_a_draw_that_drifts_is_whitened_by_its_own_noise() -> None:
    """As the residual is: what looks like a drift is taken for one, and a search finds less of it."""
    space = _scene()[0]
    rng = np.random.default_rng(3)
    drawn = rng.standard_normal((*space.rows.shape, 2)) * space.rows[:, :, None]
    slow = np.sin(np.linspace(0.0, 9.0, len(space.rows)))[:, None] * space.rows
    drawn[:, :, 1] += slow
    flat = space.basis.reshape(-1, space.basis.shape[2])

    def along(values: np.ndarray) -> np.ndarray:
        left = values.reshape(-1, 2)
        return (slow.ravel() / np.linalg.norm(slow)) @ (left - flat @ (flat.T @ left))

    was = along(drawn)
    whitened = drawn.astype(np.float32)
    space.noise.take_off(whitened, space.basis)
    # Single precision, over the root of the number of rows that each product sums.
    assert float(np.abs(flat.T @ whitened.reshape(-1, 2)).max()) < 1e-4
    change = along(whitened) - was
    # What chance does not do is taken off only as far as chance goes: trial values end two deviations from the noise.
    assert was[1] > 10.0
    assert -0.5 * was[1] < change[1] < -0.1 * was[1]
    assert abs(change[0]) < 1.5


def test_surprise_is_the_tail_of_chi_squared_even_where_it_has_no_number() -> None:
    for rank in (1, 2, 5):
        gains = np.array([0.5, 10.0, 300.0, 1190.0])
        assert surprise(gains, rank, 4) == pytest.approx(-stats.chi2.logsf(gains, rank) - np.log(4.0), rel=1e-9)
        at_the_seam = surprise(np.array([1199.9, 1200.1]), rank, 1)
        assert np.diff(at_the_seam)[0] == pytest.approx(0.1, abs=0.01)
    assert np.isfinite(surprise(np.array([1e6]), 3, 1)).all()


def test_largest_surprise_is_over_ranks_and_groups() -> None:
    first = np.array([[-1.0, -1.0], [4.0, 9.0], [-1.0, -1.0], [12.0, 3.0]])
    second = np.array([[-1.0, -1.0], [11.0, 2.0]])
    of_first = np.maximum(surprise(first[1], 1, 5), surprise(first[3], 3, 5))
    assert largest_surprise([(first, 5)], 2) == pytest.approx(of_first)
    # Of one number of trials and of another: what more trials found is less of a surprise.
    for n_trials in (5, 400):
        expected = np.maximum(of_first, surprise(second[1], 1, n_trials))
        assert largest_surprise([(first, 5), (second, n_trials)], 2) == pytest.approx(expected)
    assert (largest_surprise([], 2) == -np.inf).all()


def test_tail_of_the_null_is_that_of_the_largest_of_many() -> None:
    rng = np.random.default_rng(2)
    largest = surprise(stats.chi2.rvs(3, size=(50, 199), random_state=rng), 3, 1).max(axis=0)
    null = Null(largest)
    # Beyond the draws: 50 chances of e^-s, exactly.
    for s in (12.0, 20.0):
        assert np.log(null.p_value(s)) == pytest.approx(np.log(50.0) - s, abs=1.5)
    assert null.p_value(float(np.median(largest))) == pytest.approx(0.5, abs=0.01)
