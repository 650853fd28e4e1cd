"""What lies between measured places, and off measured lines, is told by leaving those out."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import polars as pl
import pytest
from validation.fine_errors import KINDS, MACHINE, measured, nothing

from geoerr.diagnose import add_effect, diagnose
from geoerr.fit import Fitted, fit_model, refit
from geoerr.fit.elsewhere import (
    _lines_of,
    between_the_places,
    beyond_the_lines_um,
    beyond_the_lines_words,
    lines_left_out,
    off_between_places,
    places_left_out,
)
from geoerr.fit.empirical import empirical_term
from geoerr.machine import AXES
from geoerr.observations import CARRIERS, Lengths, Observations, observations_from_columns

NOISE_UM = 2.0
LENGTH_MM = 400.0


@cache
def of_places(kind: str, n_places: int | None, seed: int = 3) -> tuple[Fitted, dict[str, float]]:
    """Fit a machine that is off by a curve along each axis; how far the fit is off all along each, µm rms."""
    rng = np.random.default_rng([seed, n_places or 0])
    curves = [KINDS.get(kind, nothing)(rng) for _ in AXES]
    result = fit_model(MACHINE, measured(rng, curves, NOISE_UM, n_places))
    seen_mm = result.fitted.sightings.commanded_mm
    off_um = {}
    for index, axis in enumerate(AXES):
        q = np.full((2000, 3), 200.0)
        q[:, index] = np.linspace(seen_mm[:, index].min(), seen_mm[:, index].max(), len(q))
        left_um = 1e3 * result.model.displacement_mm(q)[:, index] - curves[index](q[:, index])
        # Where its frame stands, and how long its millimetre is, no curve along one axis tells.
        left_um -= np.polyval(np.polyfit(q[:, index], left_um, 1), q[:, index])
        off_um[axis] = float(np.sqrt(np.mean(left_um**2)))
    return result.fitted, off_um


@pytest.mark.parametrize("kind", ["step", "bump", "table", "polynomial"])
@pytest.mark.parametrize("n_places", [21, 41])
def test_places_that_are_left_out_show_what_lies_between(kind: str, n_places: int) -> None:
    """Of what is off between places no figure said anything: passes that are left out are seen at the same places."""
    fitted, off_um = of_places(kind, n_places)
    beyond, true = [], []
    for axis in AXES:
        left_out = places_left_out(fitted, axis)
        assert left_out is not None
        missed_um = left_out.um()
        assert missed_um is not None
        beyond.append(missed_um**2 - 3.0 * NOISE_UM**2)
        true.append(off_um[axis] ** 2)
    ratio = np.sqrt(np.mean(beyond) / np.mean(true))
    # A place that is left out has neighbours twice as far away as what lies between two places has.
    assert 0.7 < ratio < 3.0


def test_a_rough_machine_is_told_and_a_smooth_one_is_not() -> None:
    (said,) = between_the_places(of_places("step", 21)[0])
    assert "along x" in said
    assert "measure at places in between" in said
    for n_places in (11, 21, 41):
        assert not list(between_the_places(of_places("nothing", n_places)[0]))


@pytest.mark.parametrize("kind", ["step", "bump", "table", "polynomial"])
def test_what_a_rough_machine_is_off_by_between_its_places_is_about_what_is_stated(kind: str) -> None:
    """Nothing was stated of it: of such machines the ± of the numbers were a tenth of what the model was off by."""
    stated, true = [], []
    for seed in range(3, 7):
        fitted, off_um = of_places(kind, 21, seed)
        between = off_between_places(fitted)
        assert between is not None
        assert between.n_places > 15
        stated.append(np.sum((1e3 * between.std_mm) ** 2))
        true.append(sum(value**2 for value in off_um.values()))
    assert 0.5 < np.sqrt(np.mean(stated) / np.mean(true)) < 2.0


def test_of_smooth_machines_nothing_is_stated_to_be_off() -> None:
    """The level is a hundredth of fits: two in sixteen would be seldom."""
    found = [off_between_places(of_places("nothing", n, seed)[0]) for n in (11, 21) for seed in range(8)]
    assert all(one is not None for one in found)
    assert sum(one is not None and one.std_mm.any() for one in found) < 2


def test_places_that_are_drawn_anew_need_no_such_figure() -> None:
    fitted, _ = of_places("step", None)
    assert all(places_left_out(fitted, axis) is None for axis in AXES)
    assert lines_left_out(fitted) is None
    assert off_between_places(fitted) is None


def along_lines(error_um: Callable[[np.ndarray, np.ndarray], np.ndarray], n_lines: int = 24) -> Observations:
    """Measure lines along axes and diagonals, four times each, of a machine that is off by this along z."""
    rng = np.random.default_rng(8)
    ways = np.array([(1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 0), (1, 0, 1), (1, 1, 1)])
    q, line, repeat = [], [], []
    for number in range(n_lines):
        along = np.sort(rng.uniform(0.0, LENGTH_MM, 10))[:, None]
        places = np.where(ways[number % 6] > 0, along, rng.uniform(0.0, LENGTH_MM, 3))
        for one in range(4):
            q.append(places[:: 1 if one % 2 else -1])
            line += [f"L{number}"] * len(places)
            repeat += [float(one)] * len(places)
    at = np.concatenate(q)
    bed = 25.0 + 20.0 * rng.uniform(size=n_lines * 4).repeat(10)
    seen = at + 1e-3 * NOISE_UM * rng.normal(size=at.shape)
    seen[:, 2] += 1e-3 * error_um(at, bed)
    columns: dict[str, object] = {"line": line, "repeat": repeat, "temp_bed": bed, "carrier": ["tool"] * len(at)}
    for index, axis in enumerate(AXES):
        columns |= {axis: at[:, index], f"m{axis}": seen[:, index], f"t{axis}": np.zeros(len(at))}
        columns[f"s{axis}"] = np.full(len(at), 1e-3 * NOISE_UM)
    return observations_from_columns(columns)


def over_a_plane(q: np.ndarray, _: np.ndarray) -> np.ndarray:
    return np.asarray(15.0 * np.sin(q[:, 0] / 20.0) * np.sin(q[:, 1] / 25.0))


def over_a_temperature(q: np.ndarray, bed: np.ndarray) -> np.ndarray:
    return np.asarray(12.0 * np.sin(q[:, 0] / 40.0) * (bed - 35.0) / 10.0)


def both(error_um: Callable[[np.ndarray, np.ndarray], np.ndarray], reference: str) -> tuple[Fitted, Fitted]:
    fitted = fit_model(MACHINE, along_lines(error_um)).fitted
    return fitted, refit(fitted, [*fitted.terms, empirical_term(fitted, reference)])


def test_a_curve_that_holds_on_its_lines_alone_is_told() -> None:
    """It fell with passes left out, was 115 µm in a corner that no line came to, and was offered without a word."""
    before, after = both(over_a_plane, "empirical:z@x*y")
    assert before.held_out.figures is not None
    assert after.held_out.figures is not None
    assert before.held_out.figures.headline_um is not None
    assert after.held_out.figures.headline_um is not None
    assert after.held_out.figures.headline_um < before.held_out.figures.headline_um
    missed_um = beyond_the_lines_um(before, after)
    assert missed_um is not None
    assert missed_um[1] > missed_um[0]
    assert "it does harm; measure more lines" in beyond_the_lines_words(missed_um)


def test_a_curve_that_holds_off_its_lines_is_not() -> None:
    before, after = both(over_a_temperature, "empirical:z@x*temp_bed")
    missed_um = beyond_the_lines_um(before, after)
    assert missed_um is not None
    assert missed_um[1] < 0.8 * missed_um[0]
    assert "harm" not in beyond_the_lines_words(missed_um)


def test_a_diagnosis_and_what_adds_its_curve_say_so() -> None:
    data = along_lines(over_a_temperature)
    result = fit_model(MACHINE, data)
    unknown = diagnose(result.fitted, threads=1).unknown
    assert unknown is not None
    assert unknown.beyond_the_lines_um is not None
    assert "with whole lines left out" in unknown.words()
    change = add_effect(result.model, data, reference=unknown.reference, threads=1)
    again_um = beyond_the_lines_um(change.before, change.after)
    assert again_um == pytest.approx(unknown.beyond_the_lines_um, rel=0.1)
    assert unknown.to_document()["held_out_by_line_um"]["after"] == unknown.beyond_the_lines_um[1]


def test_passes_of_one_line_are_one_whatever_they_are_called() -> None:
    """The third joins the first two: there and back they have names of their own."""
    data = along_lines(over_a_plane, n_lines=8)
    lines = data.texts("line")
    back = np.arange(len(lines)) // 10 % 2 == 1
    named = [f"{name} back" if is_back else name for name, is_back in zip(lines, back, strict=True)]
    apart = replace(data, frame=data.frame.with_columns(line=pl.Series(named)))
    for one in (data, apart):
        assert int(_lines_of(fit_model(MACHINE, one).fitted.sightings).max()) + 1 == 8


def test_markers_take_no_part() -> None:
    """No axis moves them: they made what is missed look smaller."""
    data = along_lines(over_a_plane)
    marker = data.frame.gather_every(4).with_columns(
        carrier=pl.lit("base"), target=pl.lit("M"), **{f"m{axis}": pl.lit(50.0) for axis in AXES}
    )
    seen = fit_model(MACHINE, replace(data, frame=pl.concat([data.frame, marker], how="diagonal_relaxed"))).fitted
    left_out = lines_left_out(seen)
    assert left_out is not None
    is_marker = seen.sightings.carrier == CARRIERS.index("base")
    assert is_marker.any()
    assert left_out.is_told[~is_marker].any()
    assert not left_out.is_told[is_marker].any()


def test_lengths_have_no_such_figure() -> None:
    """One end of a length was left out without the other: 3.7 µm for 1.8 of a machine without errors."""
    rng = np.random.default_rng(4)
    ends = np.repeat(rng.integers(1, 8, (60, 2, 3)) * 50.0, 3, axis=0)
    ends[:, 1] += np.where(np.ptp(ends, axis=1).any(axis=1), 0.0, 50.0)[:, None]
    columns = {f"{axis}{end + 1}": ends[:, end, index] for index, axis in enumerate(AXES) for end in (0, 1)}
    measured_mm = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) + 2e-3 * rng.normal(size=len(ends))
    names = [f"f{number // 3}" for number in range(len(ends))]
    frame = pl.DataFrame({"feature": names, **columns, "measured": measured_mm, "repeat": np.tile(np.arange(3), 60)})
    fitted = fit_model(MACHINE, Lengths(frame, ("lengths.csv",)), components="none", effects=("scale:x",)).fitted
    assert "lengths" in fitted.sightings.frames
    assert all(places_left_out(fitted, axis) is None for axis in AXES)
    assert lines_left_out(fitted) is None


def test_lines_that_are_run_once_have_no_such_figure() -> None:
    data = along_lines(over_a_plane)
    once = data.select(data.numbers("repeat").ravel() == 0.0)
    assert lines_left_out(fit_model(MACHINE, once).fitted) is None
