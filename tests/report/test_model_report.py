"""The report of a model: what it shows of any model, what it leaves out and says so, the verb and the call."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from typer.testing import CliRunner, Result

import geoerr
from geoerr.budget import budget_text
from geoerr.cli.main import app
from geoerr.cli.progress import Advance
from geoerr.effects import catalogue
from geoerr.errors import GeoerrError
from geoerr.machine import Machine, write_machine
from geoerr.model import FitRecord, Model
from geoerr.observations import Lengths, observations_from_columns
from geoerr.report import model_report as parts
from geoerr.report.figures import style
from geoerr.report.model_page import model_sections, report_sentences
from geoerr.report.model_report import model_report
from geoerr.report.page import Figure, Table

HOSTILE = "<script>alert('1')</script>"
MACHINE = Machine.from_chain("wbXYZt", (400.0, 300.0, 200.0), name=f"mill {HOSTILE}")
PLAY_MM, SCALE, ALPHA = 0.012, 5e-5, 1.2e-5


def measured() -> geoerr.Observations:
    """Lines along all axes and a space diagonal, both ways, while the bed warms; X has play, Y grows."""
    rng = np.random.default_rng(3)
    ends = {
        f"x {HOSTILE}": ((0, 50, 40), (400, 50, 40)),
        "x back": ((0, 250, 160), (400, 250, 160)),
        "y": ((60, 0, 100), (60, 300, 100)),
        "z": ((200, 150, 0), (200, 150, 200)),
        "diagonal": ((0, 0, 0), (400, 300, 200)),
    }
    rows, names = [], []
    for repeat in range(3):
        for name, (start, end) in ends.items():
            way = np.array(start) + np.linspace(0.0, 1.0, 6)[:, None] * np.subtract(end, start)
            for sense in (1.0, -1.0):
                moved = np.sign(np.subtract(end, start)) * sense
                for q in way[:: int(sense)]:
                    rows.append((repeat, *q, *np.where(moved == 0.0, 1.0, moved)))
                    names.append(name)
    table = np.array(rows, dtype=np.float64)
    q, d = table[:, 1:4], table[:, 4:7]
    bed = np.round(20.0 + 0.1 * np.arange(len(q)), 1)
    error = np.zeros_like(q)
    error[:, 0] = SCALE * q[:, 0] - 0.5 * PLAY_MM * d[:, 0]
    error[:, 1] = ALPHA * (bed - 20.0) * q[:, 1]
    seen = q + error + rng.normal(0.0, 1e-3, q.shape)
    columns = {"repeat": table[:, 0], "temp_bed": bed, "t": 5.0 * np.arange(len(q))}
    columns |= dict(zip(("x", "y", "z", "mx", "my", "mz"), np.hstack([q, seen]).T, strict=True))
    columns |= {f"dir_{axis}": d[:, place] for place, axis in enumerate("xyz")}
    return observations_from_columns(columns | {"carrier": ["relative"] * len(q), "line": names})


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("report")
    observations = measured()
    geoerr.write_observations(path / "points.csv", observations)
    observations = geoerr.read_observations(path / "points.csv")
    fitted = geoerr.fit_model(MACHINE, observations, components="12").model
    for reference in ("backlash:x", "thermal-expansion:y@temp_bed"):
        fitted = geoerr.add_effect(fitted, observations, reference=reference).result.model
    geoerr.write_model(path / "model.json", fitted)
    geoerr.write_errors(path / "errors.json", fitted.error_functions(at={"temp_bed": 20.0}))
    write_machine(path / "machine.toml", MACHINE)
    return path


@pytest.fixture(scope="module")
def full(folder: Path) -> parts.ModelReport:
    model = geoerr.load_model(folder / "model.json")
    return model_report(model, geoerr.read_observations(folder / "points.csv"))


def run(folder: Path, *words: str) -> Result:
    known = {path.name: str(path) for path in folder.iterdir()}
    return CliRunner().invoke(app, ["report", *(known.get(word, word) for word in words)])


def tables(report: parts.ModelReport, title: str) -> list[Table]:
    section = next(section for section in model_sections(report) if section.title == title)
    return [block for block in section.blocks if isinstance(block, Table)]


def test_a_fitted_model_with_its_data_has_every_section(full: parts.ModelReport) -> None:
    titles = [section.title for section in model_sections(full)]
    assert titles == [
        parts.MACHINE,
        parts.DATA,
        parts.ERRORS,
        "Effects beyond the 21 errors",
        parts.FIELD,
        parts.CIRCLES,
        parts.POSITIONING,
        parts.DIAGONALS,
        parts.COMPARISON,
        parts.DIAGNOSIS,
        parts.STORY,
        parts.BUDGET,
        parts.NOT_DETERMINED,
    ]
    assert not full.left_out
    said = " ".join(report_sentences(full))
    assert "temp_bed = 20 °C, the machine's reference temperature" in said
    for standard in ("ISO 230-4", "ISO 230-6"):
        assert standard in said
    names = {row[0] for table in tables(full, parts.ERRORS) for row in table.rows}
    assert {"EXX", "EYX", "ECX", "EC0Y"} <= names
    symbols = {row[1] for table in tables(full, parts.ERRORS) for row in table.rows}
    assert {"δ_xx", "ε_zx", "S_xy"} <= symbols


def test_lengths_beside_points_and_a_circle_are_on_the_page(folder: Path) -> None:
    points = geoerr.read_observations(folder / "points.csv")
    ends = {"x1": [0.0] * 3, "y1": [0.0] * 3, "z1": [0.0] * 3, "x2": [100.0] * 3, "y2": [0.0] * 3, "z2": [0.0] * 3}
    measured = pl.DataFrame({"feature": ["a", "a", "a"], **ends, "measured": [100.01, 100.02, 100.0]})
    report = model_report(Model(MACHINE), points, Lengths(measured, ("lengths.csv",)), search=False)
    (sessions,) = [table for table in tables(report, parts.DATA) if table.caption.startswith("Sessions")]
    assert [row[0] for row in sessions.rows] == ["0"]
    assert any(
        table.caption.startswith("Measured minus predicted length") for table in tables(report, parts.COMPARISON)
    )


def test_figures_of_the_standards_are_those_that_were_put_in(full: parts.ModelReport) -> None:
    assert {one.line.moving for one in full.measured_lines} == {"x", "y", "z"}
    assert [one.line.moving for one in full.measured_diagonals] == ["xyz"]
    along_x = [one.test for one in full.measured_lines if one.line.moving == "x"]
    assert len(along_x) == 2
    for test in along_x:
        assert test.n_runs == 3
        assert test.mean_reversal_um == pytest.approx(-1e3 * PLAY_MM, abs=1.5)
        assert test.mean_um == pytest.approx(1e6 * SCALE * 0.4, abs=2.5)
    assert full.predicted_lines["x"].reversal_um == pytest.approx(1e3 * PLAY_MM, abs=1.0)
    # At the reference temperature nothing has grown.
    assert full.predicted_lines["y"].systematic_um < 3.0
    # A step of b/2 each way where X turns round.
    assert full.circles[0].before[0].circular_deviation_mm > 0.5 * PLAY_MM
    assert [one.before[0].circle.plane for one in full.circles] == ["XY", "YZ", "ZX"]
    length_mm = float(np.linalg.norm([400.0, 300.0, 200.0]))
    assert full.diagonals["PPP"].reversal_um == pytest.approx(1e3 * PLAY_MM * 400.0 / length_mm, abs=1.0)
    for test in (*full.predicted_lines.values(), *full.diagonals.values()):
        assert test.prediction_std_um is not None
        # Twelve components have no angles, whose levers move these lines: how well they are known nobody knows.
        assert np.isnan(test.prediction_std_um).all()
        assert set(test.not_in_model) <= {f"E{about}{axis}" for about in "ABC" for axis in "XYZ"}
    assert full.diagonal_systematic_um == max(one.systematic_um for one in full.diagonals.values())


def test_gathering_and_writing_both_tell_how_far_they_are(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    told: dict[str, list[tuple[int, int]]] = {}
    said: list[str] = []

    @contextmanager
    def watched(title: str, quiet: bool = False, *, says_steps: bool = False) -> Iterator[Advance]:
        def update(**shown: int | str) -> None:
            if "description" in shown:
                assert says_steps
                said.append(str(shown["description"]))
            else:
                told.setdefault(title, []).append((int(shown["completed"]), int(shown["total"])))

        yield Advance(update)

    monkeypatch.setattr("geoerr.cli.report.progress_bar", watched)
    assert run(folder, "model.json", "points.csv", "-o", str(folder / "page.html")).exit_code == 0
    assert list(told) == ["report", "write"]
    for steps in told.values():
        assert [done for done, _ in steps] == sorted(done for done, _ in steps)
        assert len(steps) > 2
    assert said[0] == "the model and the measurements are compared"
    assert any(what.startswith("search 1, round 1: ") for what in said)
    assert said[-1] == "the uncertainty budget"


def test_a_condition_is_the_users(folder: Path) -> None:
    model = geoerr.load_model(folder / "model.json")
    warm = model_report(model, at={"temp_bed": 40.0})
    assert not warm.assumed
    assert warm.predicted_lines["y"].systematic_um == pytest.approx(1e3 * ALPHA * 20.0 * 300.0, rel=0.1)
    with pytest.raises(GeoerrError, match="does not depend on 'spool'"):
        model_report(model, at={"spool": 1.0})


def test_what_the_input_cannot_support_is_left_out_and_said(folder: Path) -> None:
    alone = model_report(geoerr.load_model(folder / "model.json"))
    assert {one.section for one in alone.left_out} == {parts.COMPARISON, parts.DIAGNOSIS}
    titles = [section.title for section in model_sections(alone)]
    assert titles[-1] == "Not in this report"
    assert parts.DATA in titles
    (predicted,) = tables(alone, parts.POSITIONING)
    assert [row[0] for row in predicted.rows] == ["X", "Y", "Z"]
    of_tables = model_report(geoerr.load_model(folder / "errors.json"))
    assert {parts.STORY, parts.BUDGET, parts.DATA} <= {one.section for one in of_tables.left_out}
    assert "geoerr fit" in next(one.why for one in of_tables.left_out if one.section == parts.BUDGET)
    nominal = model_report(Model(MACHINE))
    assert [section.title for section in model_sections(nominal)] == [parts.MACHINE, "Not in this report"]
    with_data = model_report(Model(MACHINE), geoerr.read_observations(folder / "points.csv"), search=False)
    assert with_data.measured_lines
    left_out = {one.section for one in with_data.left_out}
    assert parts.DIAGNOSIS in left_out
    assert parts.POSITIONING not in left_out


def test_a_condition_that_is_no_temperature_is_asked_for(folder: Path) -> None:
    text = (folder / "model.json").read_text(encoding="utf-8").replace("temp_bed", "load")
    (folder / "load.json").write_text(text, encoding="utf-8")
    report = model_report(geoerr.load_model(folder / "load.json"))
    whys = {one.section: one.why for one in report.left_out}
    assert "load" in whys[parts.FIELD]
    assert {parts.FIELD, parts.CIRCLES, parts.POSITIONING, parts.DIAGONALS, parts.BUDGET} <= set(whys)
    assert parts.ERRORS in [section.title for section in model_sections(report)]


def test_a_model_without_error_functions_shows_no_empty_plots(full: parts.ModelReport) -> None:
    report = replace(full, errors=replace(full.errors, functions={}))
    (section,) = [one for one in model_sections(report) if one.title == parts.ERRORS]
    assert not any(isinstance(block, Figure) for block in section.blocks)
    assert "none of the 18 functions" in section.blocks[0].text
    assert [block.caption for block in section.blocks if isinstance(block, Table)] == ["The three squarenesses"]


def test_an_axis_that_was_not_measured_has_no_prediction(folder: Path) -> None:
    """A laser along X: its line, and neither flat lines of Y and Z nor circles and diagonals that need them."""
    points = geoerr.read_observations(folder / "points.csv")
    laser = points.select([name == "x back" for name in points.texts("line")])
    laser = geoerr.Observations(laser.frame.drop("my", "mz"), laser.sources)
    report = model_report(geoerr.fit_model(MACHINE, laser, components="12").model, laser, search=False)
    assert list(report.predicted_lines) == ["x"]
    assert len(report.measured_lines) == 1
    assert not report.circles
    assert not report.has_field
    whys = {one.section: one.why for one in report.left_out}
    for section in (parts.FIELD, parts.CIRCLES, parts.DIAGONALS):
        assert "do not determine EYY, EZZ" in whys[section]
    said = " ".join(report_sentences(report))
    assert "predictions take them as 0: " in said
    assert "EYY" in said


def test_the_page_is_whole_escaped_and_the_same_every_time(folder: Path, tmp_path: Path) -> None:
    first, second = tmp_path / "first.html", tmp_path / "second.html"
    model, observations = geoerr.load_model(folder / "model.json"), geoerr.read_observations(folder / "points.csv")
    for path, threads in ((first, 1), (second, 2)):
        report = geoerr.write_model_report(path, model, observations, threads=threads)
    assert report.comparison is not None
    page = first.read_text(encoding="utf-8")
    assert page == second.read_text(encoding="utf-8")
    assert HOSTILE not in page
    assert "mill &lt;script&gt;" in page
    shown = page.partition("<script>")[0]
    assert "://" not in shown
    assert "default-src 'none'" in page
    assert "geoerr.write_model_report(...)" in page
    assert str(folder / "points.csv") in page
    assert not re.search(r"\b20\d\d-\d\d-\d\d\b", shown)


def test_the_verb_writes_prints_and_refuses(folder: Path, tmp_path: Path) -> None:
    page = tmp_path / "report.html"
    done = run(folder, "model.json", "points.csv", "--no-search", "-o", str(page))
    assert done.exit_code == 0, done.output
    assert page.is_file()
    assert "Space diagonals" in page.read_text(encoding="utf-8")
    assert "(G, ISO 230-4)" in done.stdout
    assert "left out: What is missing" in done.stderr
    printed = run(folder, "model.json", "points.csv", "--no-search", "--json")
    document = json.loads(printed.stdout)
    assert document["report"] is None
    assert {one["axes"] for one in document["iso_230_2"]["measured"]} == {"x", "y", "z"}
    assert document["iso_230_6"]["E_d_um"] > 0.0
    assert [one["plane"] for one in document["iso_230_4"]] == ["XY", "YZ", "ZX"]
    assert document["conditions"] == {"temp_bed": "reference"}
    assert document["provenance"]["inputs"]
    assert document["left_out"] == [{"section": parts.DIAGNOSIS, "why": "the search was not wanted"}]
    refused = run(folder, "model.json", "-o", str(folder / "model.json"))
    assert refused.exit_code == 1
    assert "is an input of this command" in str(refused.exception)
    absent = run(folder, "model.json", "nowhere.csv", "-o", str(page))
    assert absent.exit_code == 1
    wrong = run(folder, "model.json", "--at", "temp_bed")
    assert wrong.exit_code == 2


def by_hand(*effects: str, machine: Machine = MACHINE) -> Model:
    """A model of some effects as a fit leaves it: every parameter has a value and an uncertainty."""
    terms = []
    for reference in effects:
        effect, placed = catalogue().resolve(reference)
        found = effect.at(placed.axis, placed.covariate).terms(machine)
        terms += [one.with_values([1e-4] * len(one.coefficients)) for one in found]
    n = sum(len(term.coefficients) + len(term.inner) for term in terms)
    spans = {axis: (0.0, 200.0) for axis in "xyz"}
    record = FitRecord(1e-12 * np.eye(n), np.zeros((n, 0)), range_mm=spans)
    return Model(machine, None, tuple(terms), record)


def test_what_is_not_in_the_model_is_not_told_as_known() -> None:
    """Circles in the XY plane tell play and squareness: nothing of how far the axes go, or of Z."""
    report = model_report(by_hand("backlash:x", "squareness:xy"), at={})
    assert report.not_in_model[:4] == ("EXX", "EYX", "EZX", "EAX")
    assert "EC0Y" not in report.not_in_model
    assert not report.predicted_lines
    assert not report.diagonals
    assert not report.circles
    assert not report.has_field
    assert {parts.POSITIONING, parts.CIRCLES, parts.DIAGONALS, parts.FIELD} <= {
        one.section for one in report.left_out
    }
    said = " ".join(report_sentences(report))
    assert "Not in the model, taken as 0: EXX" in said
    assert "known to" not in said
    assert "which it knows" not in said
    shown = [block for one in model_sections(report) if one.title == parts.NOT_DETERMINED for block in one.blocks]
    assert [block.caption for block in shown if isinstance(block, Table)] == ["Not in the model: taken as 0"]
    assert not [block for block in shown if "determine all 21" in str(block)]
    assert report.budget is not None
    positioning = [stage for stage in report.budget.to_document()["stages"] if stage["what"] == "positioning"]
    assert [stage["std"] for stage in positioning] == [None]


def test_a_figure_is_stated_by_the_axes_that_it_needs() -> None:
    """Scales of X and Y and their squareness: their lines and circle, and no other."""
    report = model_report(by_hand("scale:x", "scale:y", "squareness:xy"))
    assert list(report.predicted_lines) == ["x", "y"]
    assert [one.before[0].circle.plane for one in report.circles] == ["XY"]
    assert not report.diagonals
    assert report.budget is not None
    assert np.isnan(report.budget.standard_um()[:, 2]).all()
    along_y = report.budget.at_places([(100.0, 100.0, 0.0)]).standard_um()
    assert np.isfinite(along_y[0, :2]).all()


def test_a_part_stays_within_what_is_counted_and_the_rest_is_named() -> None:
    whole = by_hand("scale:x", "scale:y", "scale:z", "squareness:xy", "squareness:xz", "squareness:yz")
    (said,) = [one for one in report_sentences(model_report(whole)) if "compensated part" in one]
    assert "not counting: not in the model, taken as 0: EYX, EZX, " in said
    for what in ("the nine angles; ", "misfit of the model; ", "repeatability of the machine; "):
        assert what in said


def test_what_is_below_all_digits_is_not_up_to_below() -> None:
    assert style.up_to_um(0.001) == "less than 0.01 µm"
    assert style.up_to_um(12.34) == "up to 12.3 µm"


def test_a_fit_that_has_not_settled_is_said_before_all_else() -> None:
    model = by_hand("scale:x", "scale:y", "scale:z", "squareness:xy", "squareness:xz", "squareness:yz")
    assert model.record is not None
    unsettled = replace(model, record=replace(model.record, has_settled=False))
    report = model_report(unsettled)
    assert report_sentences(report)[0].startswith("The fit has not settled: its numbers are not to be used")
    assert report.budget is not None
    assert budget_text(report.budget).startswith("The fit has not settled")
    assert report.budget.not_counted[0].startswith("the fit has not settled")
    assert not budget_text(model_report(model).budget or report.budget).startswith("The fit has not settled")
