"""Curves without a cause: designed, fitted, drawn, kept in a file, taken out again, and corrected in a program."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import geoerr
from geoerr.cli.main import app
from geoerr.diagnose.shape import shape_words
from geoerr.errors import GeoerrError, InputFileError
from geoerr.fit import FitOptions, Fitted, fit_terms, refit
from geoerr.fit.empirical import curve_of, empirical_term
from geoerr.machine import Machine
from geoerr.model import Model, load_model
from geoerr.observations import Observations, observations_from_columns

MACHINE = Machine.from_chain("wbXYZt", (400.0, 300.0, 250.0))
STD_MM = 1e-3
FEEDS = (600.0, 1500.0, 3000.0, 6000.0)


def rise_um(feed: np.ndarray) -> np.ndarray:
    return 20.0 * (feed / 6000.0) ** 2


def bowl_um(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """What no product of two angles is: a saddle of third degree in x."""
    u, w = (x - 200.0) / 200.0, (y - 150.0) / 150.0
    return 15.0 * (2.5 * u**3 - 1.5 * u) * w


def nothing_um(feed: np.ndarray, q: np.ndarray) -> np.ndarray:
    return np.zeros_like(feed)


def observations(
    seed: int = 0, n: int = 300, along_y_um: Callable[[np.ndarray, np.ndarray], np.ndarray] = nothing_um
) -> Observations:
    rng = np.random.default_rng(seed)
    q = rng.uniform(0.0, [400.0, 300.0, 250.0], (n, 3))
    feed = rng.choice(FEEDS, n)
    seen = q + rng.normal(0.0, STD_MM, q.shape)
    seen[:, 0] += 1e-3 * rise_um(feed)
    seen[:, 1] += 1e-3 * along_y_um(feed, q)
    seen[:, 2] += 1e-3 * bowl_um(q[:, 0], q[:, 1])
    columns: dict[str, object] = {"feed": feed, "fixed": np.ones(n), "carrier": ["relative"] * n}
    columns |= {"line": [f"L{number // 20}" for number in range(n)]}
    columns |= {name: q[:, number] for number, name in enumerate("xyz")}
    columns |= {f"m{name}": seen[:, number] for number, name in enumerate("xyz")}
    columns |= {f"s{name}": np.full(n, STD_MM) for name in "xyz"}
    return observations_from_columns(columns)


@pytest.fixture(scope="module")
def base() -> Fitted:
    return fit_terms(MACHINE, [observations()], options=FitOptions(components="none", threads=1))


def test_a_curve_of_one_variable_is_what_was_put_in(base: Fitted) -> None:
    """Beside the other curve, so that nothing but noise is left; a curve is known but for a constant."""
    first = empirical_term(base, "empirical:z@x*y")
    second = refit(base, [first])
    result = refit(second, [*second.terms, empirical_term(second, "empirical:x@feed")])
    curve = curve_of(result, "empirical:x@feed")
    assert curve.at[0].tolist() == list(FEEDS)
    difference = curve.value_um - rise_um(curve.at[0])
    # Four standard errors of each point of four: once in 4,000 by chance.
    assert (np.abs(difference - difference.mean()) < 4.0 * curve.std_um.max()).all()
    assert result.split.lack_of_fit_p is not None
    assert result.split.lack_of_fit_p > 1e-3


def test_a_surface_is_what_was_put_in_and_its_error_is_what_it_says(base: Fitted) -> None:
    term = empirical_term(base, "empirical:z@x*y")
    assert "c3_1" in [parameter.name for parameter in term.coefficients]
    result = refit(base, [term])
    curve = curve_of(result, term.id)
    truth = bowl_um(curve.at[0][:, None], curve.at[1][None, :])
    normal = (curve.value_um - truth - (curve.value_um - truth).mean()) / curve.std_um
    # 289 points with some ten degrees of freedom between them.
    assert np.sqrt((normal**2).mean()) < 2.5
    # Nothing of it is open; corners are known least.
    assert np.median(curve.std_um) < 0.2 * np.ptp(truth)
    assert "cause unknown" in term.title


def test_what_goes_far_along_one_variable_and_bends_a_little_along_the_other_is_followed() -> None:
    """All products up to degrees 3 in x and 5 in y would cost more than the one that is there gains."""

    def surface_um(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        u, w = x / 200.0 - 1.0, y / 150.0 - 1.0
        far = np.polynomial.legendre.legval(w, [0.0, 1.0, 0.0, 1.0, 0.0, 1.0])
        return np.asarray(10.0 * u * far + 1.7 * (2.5 * u**3 - 1.5 * u) * w)

    table = observations(4, 2000, lambda feed, q: surface_um(q[:, 0], q[:, 1]))
    base = fit_terms(MACHINE, [table], options=FitOptions(components="none", threads=1))
    # What else there is, so that noise is left.
    base = refit(base, [empirical_term(base, name) for name in ("empirical:z@x*y", "empirical:x@feed")])
    result = refit(base, [empirical_term(base, "empirical:y@x*y"), *base.terms])
    names = {parameter.name for parameter in result.terms[0].coefficients}
    assert {"c1_1", "c1_3", "c1_5", "c3_1"} <= names
    assert "c3_5" not in names
    curve = curve_of(result, "empirical:y@x*y")
    left = curve.value_um - surface_um(curve.at[0][:, None], curve.at[1][None, :])
    # Without the third degree in x it is off by 0.37 µm rms.
    assert np.sqrt((left**2).mean()) < 0.15


def test_a_surface_that_goes_up_and_down_is_followed() -> None:
    """Two waves along x whose size grows with the feed: no polynomial of the third degree."""

    def wave_um(feed: np.ndarray, x: np.ndarray) -> np.ndarray:
        return 20.0 * np.sin(2.0 * np.pi * x / 200.0) * feed / 6000.0

    table = observations(1, 2000, lambda feed, q: wave_um(feed, q[:, 0]))
    base = fit_terms(MACHINE, [table], options=FitOptions(components="none", threads=1))
    result = refit(base, [empirical_term(base, "empirical:y@feed*x"), empirical_term(base, "empirical:z@x*y")])
    curve = curve_of(result, "empirical:y@feed*x")
    truth = wave_um(curve.at[0][:, None], curve.at[1][None, :])
    difference = curve.value_um - truth
    # Beyond the eighth degree a sine over two turns has 2 J_9(2 pi) = 0.09 of itself, beyond the third 0.7 and more.
    assert np.sqrt(((difference - difference.mean()) ** 2).mean()) < 0.12 * np.sqrt((truth**2).mean())


def test_a_curve_of_three_variables_is_what_was_put_in() -> None:
    """A product of three: cut at one value of the feed it is a surface over the other two."""

    def saddle_um(x: np.ndarray, z: np.ndarray) -> np.ndarray:
        return 30.0 * (x / 200.0 - 1.0) * (z / 125.0 - 1.0)

    table = observations(2, 2000, lambda feed, q: saddle_um(q[:, 0], q[:, 2]) * feed / 6000.0)
    base = fit_terms(MACHINE, [table], options=FitOptions(components="none", threads=1))
    term = empirical_term(base, "empirical:y@feed*x*z")
    assert "over feed, x and z, cause unknown" in term.title
    curve = curve_of(refit(base, [term, empirical_term(base, "empirical:z@x*y")]), term.id)
    assert curve.variables[curve.cut_along] == "feed"
    surface = curve.cut(len(FEEDS) - 1)
    assert surface.variables == ("x", "z")
    difference = surface.value_um - saddle_um(surface.at[0][:, None], surface.at[1][None, :])
    normal = (difference - difference.mean()) / surface.std_um
    assert np.sqrt((normal**2).mean()) < 2.5
    told = re.search(r"; so at feed = 6000, ([\d.]+) times as large at feed = 600", shape_words(curve))
    assert told is not None
    assert float(told.group(1)) == pytest.approx(0.1, abs=0.03)


@pytest.mark.parametrize("name", ["u_1", "u_2", "u_1_3", "u__1", "c1", "c1_1", "c__"])
def test_a_column_may_have_any_name(name: str) -> None:
    """Also one that the curve's formula would give its own parts."""
    table = observations()
    columns = {one: table.frame[one].to_numpy() for one in table.frame.columns if one not in ("feed", "file_row")}
    renamed = observations_from_columns({**columns, name: table.numbers("feed")[:, 0]})
    for reference, own in (
        ("empirical:x@feed*x", f"empirical:x@{name}*x"),
        ("empirical:x@x*feed", f"empirical:x@x*{name}"),
    ):
        plain, other = (
            curve_of(refit(base, [empirical_term(base, text)]), text)
            for text, base in (
                (text, fit_terms(MACHINE, [data], options=FitOptions(components="none", threads=1)))
                for text, data in ((reference, table), (own, renamed))
            )
        )
        assert np.ptp(plain.value_um) > 10.0
        assert other.value_um == pytest.approx(plain.value_um, abs=1e-6)


@pytest.mark.parametrize("name", ["pi", "max", "lag"])
def test_a_column_that_formulas_would_read_otherwise_is_no_variable(name: str) -> None:
    table = observations()
    columns = {one: table.frame[one].to_numpy() for one in table.frame.columns if one not in ("feed", "file_row")}
    renamed = observations_from_columns({**columns, name: table.numbers("feed")[:, 0]})
    base = fit_terms(MACHINE, [renamed], options=FitOptions(components="none", threads=1))
    assert any("rename" in note and repr(name) in note for note in base.sightings.notes)
    with pytest.raises(InputFileError, match=f"'{name}' is neither a column"):
        empirical_term(base, f"empirical:x@{name}")


def test_what_the_model_does_already_is_left_out() -> None:
    """Straightness and roll hold what is in x alone, or linear in y: of the saddle nothing but curvature is left."""
    fitted = fit_terms(MACHINE, [observations()], options=FitOptions(threads=1))
    term = empirical_term(fitted, "empirical:z@x*y")
    assert "c1_0" not in [parameter.name for parameter in term.coefficients]
    result = refit(fitted, [*fitted.terms, term])
    assert result.not_determined == fitted.not_determined
    assert result.figures.headline_um is not None
    assert fitted.figures.headline_um is not None
    assert result.figures.headline_um <= fitted.figures.headline_um


@pytest.mark.parametrize(
    ("reference", "problem"),
    [
        ("empirical:x@nothing", "no column nothing"),
        ("empirical:x@line", "the column line holds no numbers"),
        ("empirical:x@file_row", "file_row says where a row stands"),
        ("empirical:x@fixed", "never changes"),
        ("empirical:xy@feed", "along which axis"),
        ("empirical:x", "names no curve"),
        ("empirical:x@feed*x*y*z", "neither a column nor two or three"),
        ("empirical:x@feed*feed", "neither a column nor two or three"),
    ],
)
def test_refusals(base: Fitted, reference: str, problem: str) -> None:
    with pytest.raises(InputFileError, match=problem):
        empirical_term(base, reference)


def test_a_body_that_nothing_shows_has_no_curve() -> None:
    """The cameras see targets on the tool: it is not that the model does already what the work does."""
    table = observations()
    columns = {one: table.frame[one].to_numpy() for one in table.frame.columns if one != "file_row"}
    on_tool = observations_from_columns({**columns, "carrier": ["tool"] * len(table)})
    base = fit_terms(MACHINE, [on_tool], options=FitOptions(components="none", threads=1))
    with pytest.raises(
        InputFileError, match=r"nothing in these data shows where the work is\nhint: write empirical:x@feed"
    ):
        empirical_term(base, "empirical:work-x@feed")


def test_an_effect_of_that_id_is_refused(tmp_path: Path) -> None:
    own = tmp_path / "own.toml"
    own.write_text(
        '[[effect]]\nid = "empirical"\ntitle = "Mine"\nchannel = "tool"\naxes = ["z"]\nexpression = "k*x"\n'
        'covariates = []\nlooks_like = ""\nsource = ""\n[effect.coefficients.k]\nunit = "1"\n'
    )
    with pytest.raises(GeoerrError, match="curve without a cause"):
        geoerr.load_effects(own)


def test_added_written_read_taken_away(tmp_path: Path) -> None:
    table, first, second = tmp_path / "obs.csv", tmp_path / "1.json", tmp_path / "2.json"
    geoerr.write_observations(table, observations())
    geoerr.write_model(first, Model(MACHINE))
    runner = CliRunner()
    outcome = runner.invoke(app, ["add", str(first), str(table), "empirical:x@feed", "-o", str(second), "--json"])
    assert outcome.exit_code == 0, outcome.output
    document = json.loads(outcome.stdout)
    assert document["after"]["held_out_rmse_um"] < document["before"]["held_out_rmse_um"]
    assert document["history"][0]["effect"] == "empirical:x@feed"
    model = load_model(second)
    slow, fast = (model.error_mm([[100.0, 100.0, 100.0]], at={"feed": feed}) for feed in (600.0, 6000.0))
    assert 1e3 * (fast - slow)[0, 0] == pytest.approx(rise_um(np.array(6000.0)) - rise_um(np.array(600.0)), abs=1.0)
    program, corrected = tmp_path / "in.gcode", tmp_path / "out.gcode"
    program.write_text("G21\nG90\nG1 X100 Y100 Z100 F6000\nG1 X200 Y100 Z100 F6000\nG1 X100 F600\n")
    done = runner.invoke(app, ["compensate", str(second), str(program), "-o", str(corrected)])
    assert done.exit_code == 0, done.output
    ends = [float(found) for found in re.findall(r"X([-0-9.]+)", corrected.read_text())]
    # The same place, fast and slow: what is taken off differs by the curve.
    assert 1e3 * (ends[-1] - ends[0]) == pytest.approx(1e3 * (fast - slow)[0, 0], abs=1.0)
    text = runner.invoke(app, ["remove", str(second), str(table), "empirical:x@feed"])
    assert text.exit_code == 0, text.output
    again = runner.invoke(app, ["add", str(second), str(table), "empirical:x@feed"])
    assert again.exit_code == 1
    assert "Empirical curve" in runner.invoke(app, ["add", str(first), str(table), "empirical:x@feed"]).stdout
