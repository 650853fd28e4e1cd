"""The residual in parts: repeats say the noise, and lack of fit is what is beyond it."""

from __future__ import annotations

import itertools

import numpy as np
import polars as pl
import pytest
from fit_scenes import Numbers, camera_near_base, fitted, measured_again, no_errors, replaced, seen
from scipy import stats
from virtual_machine import machine_of

from geoerr.effects import catalogue
from geoerr.errors import GeometryError
from geoerr.fit import Fitted
from geoerr.fit.joined import sightings_of
from geoerr.fit.noise import groups_of, repeats_of
from geoerr.observations import CircularTest, Observations, observations_from_columns

MACHINE = machine_of("wZbXYt")
STD_MM = np.array([2e-3, 3e-3, 5e-3])
SIDE = np.linspace(0.0, 400.0, 5)
GRID = [np.array([x, y, 0.0]) for x in SIDE for y in SIDE]


def passes(n_repeats: int, *, gap_mm: float = 0.0, is_stated: bool = True, seed: int = 0) -> Observations:
    """A grid seen there and back, exact; `gap_mm` is a backlash of x."""
    rows, line, repeat, direction = [], [], [], []
    for number, way in itertools.product(range(n_repeats), (1, -1)):
        for q in GRID[::way]:
            rows.append(("relative", q, (0.0, 0.0, 0.0)))
            line.append("grid")
            repeat.append(number)
            direction.append(way)
    exact = seen(
        MACHINE,
        no_errors(),
        camera_near_base(np.random.default_rng(seed)),
        rows,
        covariance_mm2=np.diag(STD_MM**2),
        line=line,
        repeat=np.array(repeat, dtype=np.float64),
        dir_x=np.array(direction, dtype=np.float64),
        dir_y=np.array(direction, dtype=np.float64),
        dir_z=np.array(direction, dtype=np.float64),
    )
    gap = np.zeros((len(rows), 3))
    gap[:, 0] = -0.5 * gap_mm * np.array(direction)
    shifted = measured_again(exact, gap)
    names = ("cxx", "cxy", "cxz", "cyy", "cyz", "czz")
    return shifted if is_stated else Observations(shifted.frame.drop(*names), shifted.sources)


EFFECTS = [
    catalogue()["scale"].term("x", None, MACHINE),
    catalogue()["scale"].term("y", None, MACHINE),
    catalogue()["squareness"].term("xy", None, MACHINE),
]


def small_fit(observations: Observations) -> Fitted:
    return fitted(MACHINE, observations, effects=EFFECTS, components="none", is_robust=False)


def noisy(observations: Observations, rng: np.random.Generator) -> Observations:
    return measured_again(observations, rng.normal(size=(len(observations), 3)) * STD_MM)


def test_floor_is_the_pooled_deviation_of_repeats() -> None:
    """By hand: variance of each pose and direction, n − 1, pooled, summed over components."""
    observations = noisy(passes(3), np.random.default_rng(500))
    result = small_fit(observations)
    keys = np.column_stack([observations.commanded_mm, observations.numbers("dir_x")])
    # Seen from the base axes, in which residuals are: the frame is turned by some hundredths.
    rotation = result.solved.state.rotations[0]
    measured = observations.measured_mm @ rotation
    total, dof = np.zeros(3), 0
    for key in np.unique(keys, axis=0):
        group = measured[(keys == key).all(axis=1)]
        total += ((group - group.mean(axis=0)) ** 2).sum(axis=0)
        dof += len(group) - 1
    assert dof == 2 * 2 * len(GRID)
    assert result.repeats.dof.tolist() == [dof] * 3
    assert np.allclose(result.repeats.variance_mm2, total / dof, rtol=1e-5)
    assert result.repeats.floor_um == pytest.approx(1e3 * np.sqrt((total / dof).sum()), rel=1e-5)
    assert result.split.is_from_repeats
    assert result.split.noise_um == result.repeats.floor_um


def test_floor_within_passes_does_not_see_a_pass_that_is_off() -> None:
    """One pass 50 µm off: the floor across passes knows, that within passes does not."""
    observations = noisy(passes(4), np.random.default_rng(501))
    off = np.zeros((len(observations), 3))
    off[observations.numbers("repeat")[:, 0] == 2.0] = 50e-3
    result = small_fit(measured_again(observations, off))
    expected_um = 1e3 * np.sqrt((STD_MM**2).sum())
    assert result.repeats.floor_um is not None
    assert result.repeats.within_pass_floor_um is not None
    assert result.repeats.floor_um > 5.0 * expected_um
    # 136 degrees of freedom in each component: √(0.5/136) is 6 %.
    assert result.repeats.within_pass_floor_um == pytest.approx(expected_um, rel=0.2)


def test_floor_within_short_passes_is_that_of_least_squares_in_two_ways() -> None:
    """Passes of few places, of which some repeat others': each was counted as a mean, many of them for none."""
    rng = np.random.default_rng(502)
    places = [np.sort(rng.choice(12, size=3, replace=False)) for _ in range(30)]
    at = np.concatenate(places)
    n = len(at)
    still = np.zeros(n)
    table = observations_from_columns(
        {
            "line": np.repeat([f"pass {number}" for number in range(len(places))], 3).tolist(),
            "carrier": ["relative"] * n,
            **{"x": 30.0 * at, "y": still, "z": still, "mx": 30.0 * at, "my": still, "mz": still},
            **{f"dir_{axis}": np.ones(n) for axis in "xyz"},
        }
    )
    sightings = sightings_of(table)
    residual_mm = rng.normal(size=(n, 3)) + 40.0 * rng.normal(size=(sightings.n_passes, 1))[sightings.pass_number]
    repeats = repeats_of(sightings, residual_mm, np.ones(n, dtype=bool))
    again = np.bincount(repeats.group)[repeats.group] > 1
    design = np.zeros((n, repeats.group.max() + 1 + sightings.n_passes))
    design[np.arange(n), repeats.group] = 1.0
    design[np.arange(n), repeats.group.max() + 1 + sightings.pass_number] = 1.0
    left = residual_mm[again] - design[again] @ np.linalg.lstsq(design[again], residual_mm[again], rcond=None)[0]
    n_free = int(again.sum()) - int(np.linalg.matrix_rank(design[again]))
    assert n_free > 20
    assert repeats.within_pass_dof.tolist() == [n_free] * 3
    np.testing.assert_allclose(repeats.within_pass_variance_mm2, (left**2).sum(axis=0) / n_free, rtol=1e-6)


def test_other_conditions_are_no_repeats() -> None:
    """Rows whose temperature differs by more than a twentieth of its spread measure another thing."""
    observations = passes(2)
    warm = replaced(observations, temp=np.linspace(20.0, 40.0, len(observations)))
    assert small_fit(warm).repeats.floor_um is None
    # A sensor's last digit is no other condition: 0.02 K of 400 mm of aluminium are 0.2 µm.
    rng = np.random.default_rng(507)
    level = replaced(
        observations, temp=20.0 + rng.uniform(0.0, 0.02, len(observations)), load=5.0 + 1e-4 * rng.random(100)
    )
    assert small_fit(level).repeats.dof.tolist() == small_fit(observations).repeats.dof.tolist()


def test_a_column_is_told_to_hide_repeats() -> None:
    table = passes(2)
    assert not [note for note in sightings_of(table).notes if "repeat of another" in note]
    number = np.arange(len(table), dtype=np.float64)
    counted = replaced(table, order=number, load=np.ones(len(table)))
    notes = [note for note in sightings_of(counted).notes if "repeat of another" in note]
    assert len(notes) == 1
    assert "for order rises from row to row" in notes[0]
    # So is a sensor whose digits roll, where nothing can depend on it; that is for its reader to know.
    rolling = replaced(table, load=np.random.default_rng(508).uniform(0.0, 100.0, len(table)))
    (note,) = [note for note in sightings_of(rolling).notes if "repeat of another" in note]
    assert "for load differs from row to row and is a condition" in note
    # What was changed from visit to visit is a condition.
    changed = replaced(table, spool=number // 50)
    assert not [note for note in sightings_of(changed).notes if "repeat of another" in note]


@pytest.mark.parametrize("is_stated", [True, False])
def test_lack_of_fit_of_a_right_model_is_uniform(is_stated: bool) -> None:
    """Of 200 fits; Kolmogorov and Smirnov would call a right one wrong once in a thousand."""
    exact = passes(2, is_stated=is_stated)
    rng = np.random.default_rng(502)
    # One weight for all is right only for noise that is alike in all components.
    std = STD_MM if is_stated else np.full(3, 3e-3)
    draws = [measured_again(exact, rng.normal(size=(len(exact), 3)) * std) for _ in range(200)]
    p = [small_fit(draw).split.lack_of_fit_p for draw in draws]
    assert stats.kstest(np.array(p, dtype=np.float64), "uniform").pvalue > 1e-3


def test_lack_of_fit_from_stated_noise_is_uniform() -> None:
    """Without repeats the stated covariances are what residuals are held against."""
    exact = passes(1)
    rng = np.random.default_rng(503)
    results = [small_fit(noisy(exact, rng)) for _ in range(200)]
    assert not any(result.split.is_from_repeats for result in results)
    p = np.array([result.split.lack_of_fit_p for result in results], dtype=np.float64)
    assert stats.kstest(p, "uniform").pvalue > 1e-3
    assert results[0].split.noise_um == pytest.approx(1e3 * np.sqrt((STD_MM**2).sum()), rel=1e-3)


def test_a_missing_term_shows() -> None:
    """A backlash of 4 µm, twice the noise of x: lack of fit, of the size that it makes."""
    result = small_fit(noisy(passes(3, gap_mm=4e-3), np.random.default_rng(504)))
    assert result.split.lack_of_fit_p is not None
    assert result.split.lack_of_fit_p < 1e-6
    assert result.split.lack_of_fit_um is not None
    # Half of 4 µm either way; total and noise are uncertain by 5 % of 6 µm each, and it is the root of a difference.
    assert result.split.lack_of_fit_um == pytest.approx(2.0, abs=0.8)
    backlash = catalogue()["backlash"].term("x", None, MACHINE)
    with_it = fitted(
        MACHINE,
        noisy(passes(3, gap_mm=4e-3), np.random.default_rng(504)),
        effects=[*EFFECTS, backlash],
        components="none",
        is_robust=False,
    )
    assert with_it.split.lack_of_fit_p is not None
    assert with_it.split.lack_of_fit_p > 0.01


def test_nothing_tells_the_noise() -> None:
    """No repeats, no stated uncertainty: no noise, no probability, and standard errors from the residual."""
    observations = noisy(passes(1, is_stated=False), np.random.default_rng(505))
    result = small_fit(observations)
    assert (result.split.noise_um, result.split.lack_of_fit_p) == (None, None)
    assert result.scale > 0.0


def residual_of(values: Numbers) -> float:
    return float(np.sqrt((values**2).mean(axis=0).sum()))


def test_figures_are_roots_of_summed_mean_squares() -> None:
    observations = noisy(passes(2), np.random.default_rng(506))
    result = small_fit(observations)
    assert result.figures.rmse_um == pytest.approx(1e3 * residual_of(result.residual_mm), rel=1e-12)
    assert result.figures.n_components == (100, 100, 100)


def test_the_other_sense_of_a_circle_is_no_repeat() -> None:
    """Counter-clockwise and back: one place was measured twice where it turned, and each time another way."""
    angle = np.radians(np.arange(0.0, 360.0, 3.0))
    angle, sense = np.concatenate([angle, angle[::-1]]), np.repeat([1, -1], len(angle))
    columns = {"x": 200.0 + 100.0 * np.cos(angle), "y": 200.0 + 100.0 * np.sin(angle), "z": np.zeros(len(angle))}
    radius_mm = 100.0 + 6e-3 * sense * np.sign(np.sin(angle))
    test = CircularTest(pl.DataFrame({**columns, "r": radius_mm, "dir": sense}), ("circle.csv",))
    assert sightings_of(test).once("groups", groups_of).max() + 1 == len(angle)


def test_an_axis_that_may_have_come_from_beyond_its_end_repeats_nothing() -> None:
    """ISO 230-2 without stated directions: the end is looked at twice, reached the one way and then the other."""
    there = np.array([0.0, 100.0, 200.0])
    x = np.concatenate([there, there[::-1]] * 3)
    table = {"x": x, "y": 0.0 * x, "z": 0.0 * x, "mx": x, "t": 5.0 * np.arange(len(x))}
    group = groups_of(sightings_of(observations_from_columns(table)))
    ends = [(2, 3), (5, 6), (8, 9), (11, 12), (14, 15)]
    assert all(group[one] != group[other] for one, other in ends)
    # From cycle to cycle they repeat: what was reached from below, and what was looked at again.
    assert len({group[row] for row in (2, 8, 14)}) == len({group[row] for row in (3, 9, 15)}) == 1


@pytest.mark.parametrize("factor", [10.0, 1000.0])
def test_measured_positions_in_another_unit_follow_nothing(factor: float) -> None:
    """A thousand times too far they were all set aside as mistakes, and the table had no measured component."""
    table = passes(2)
    measured = {name: factor * table.numbers(name)[:, 0] for name in ("mx", "my", "mz")}
    with pytest.raises(GeometryError, match="do not follow the commanded ones"):
        small_fit(replaced(table, **measured))
