"""What a person types: numbers and formulas, as they are read, refused and told."""

from __future__ import annotations

from pathlib import Path

import polars as pl
import pytest

pytest.importorskip("dash")

from workbench_scenes import PROGRAM, loaded, settle, texts, write_scene

from geoerr.errors import InputFileError
from geoerr.machine import Axis, Machine
from geoerr.model import write_model
from geoerr.model.conditions import refusal
from geoerr.workbench import actions, wiring
from geoerr.workbench.own_effect import OwnFormula, own_effect
from geoerr.workbench.panel_missing import tried_value
from geoerr.workbench.parts import problem
from geoerr.workbench.program import Wish, work_offset_mm
from geoerr.workbench.server import begin_session
from geoerr.workbench.session import Session
from geoerr.workbench.typed import typed_number

GROWTH_PER_K = 12e-6
AXES = {axis: Axis((0.0, 300.0)) for axis in "xyz"}


@pytest.mark.parametrize(("text", "number"), [("35,5", 35.5), ("−3", -3.0), (" 1.7e9 ", 1.7e9), ("", None)])
def test_numbers_are_read_as_people_type_them(text: str, number: float | None) -> None:
    assert typed_number("bed", text) == number


@pytest.mark.parametrize("text", ["inf", "-Infinity", "nan", "noon", "1e300", "1e999"])
def test_what_no_machine_can_have_is_no_number(text: str) -> None:
    with pytest.raises(InputFileError, match=r"bed: '.*' is (no number|too large)"):
        typed_number("bed", text)


def test_a_condition_of_which_nothing_finite_follows_leaves_the_pictures(tmp_path: Path) -> None:
    session = loaded(tmp_path)
    actions.try_formula(session, OwnFormula("grows", "along", "x", "c*q*exp(t/1000)"))
    settle(session)
    wiring.do(session, "add-trial", "")
    session.view.conditions["t"] = "inf"
    assert "'inf' is no number" in texts(wiring.panels(session)["conditions"])
    assert "needs conditions" in wiring.pictures(session, "")["captions"][0]
    # A number, but one of which the formula knows nothing.
    session.view.conditions["t"] = "1e9"
    assert "rows" in wiring.pictures(session, "")["captions"][0]


def test_a_formula_of_a_column_has_its_value_and_one_name_everywhere(tmp_path: Path) -> None:
    machine, table = write_scene(tmp_path)
    rows = pl.read_csv(table)
    warm = 20.0 + 20.0 * pl.int_range(pl.len()) / pl.len()
    rows.with_columns(temp_bed=warm, my=pl.col("my") + GROWTH_PER_K * pl.col("y") * (warm - 20.0)).write_csv(table)
    session = begin_session([machine, table], None, threads=1)
    settle(session)
    wiring.do(session, "fit", "12")
    settle(session)
    actions.try_formula(session, OwnFormula("bed growth", "along", "y", "c*q*(temp_bed - 20)"))
    settle(session)
    (term,) = session.trial.terms
    assert term.coefficients[0].value == pytest.approx(GROWTH_PER_K, rel=0.05)
    told = texts(wiring.panels(session)["own"])
    assert f"Value:  {tried_value(term.coefficients[0])} , in the units of the formula" in told
    wiring.do(session, "add-trial", "")
    settle(session)
    assert session.step.name == "+ bed-growth:y@temp_bed"
    assert session.step.name.removeprefix("+ ") in dict(session.step.effects)
    # A program of another temperature is another program: the result says of which this one is.
    actions.compensate(session, "part.gcode", PROGRAM, Wish({}))
    settle(session)
    told = texts(wiring.panels(session)["program"])
    assert f"by the model “{session.step.name}”, at temp_bed 29.98 °C" in told
    assert "Nobody stated temp_bed: it is the middle of what was measured." in told
    actions.compensate(session, "part.gcode", PROGRAM, Wish({"temp_bed": "25"}))
    settle(session)
    told = texts(wiring.panels(session)["program"])
    assert "at temp_bed 25 °C" in told
    assert "Nobody stated" not in told


@pytest.mark.parametrize(
    ("formula", "searched", "told"),
    [
        ("c*(", "", "the formula ends where a value is needed\n  c*(\n     ^"),
        ("c*q", "P: 20..1", "P: [20.0, 1.0] is not a range from low to high\nhint: write P: low..high"),
        ("c*sin(2*pi*q/P)", "", "here c, P: write a column, or search one between limits"),
        ("c*temp_xyz", "", "temp_xyz is no column of the data\nhint: write its column: temp_bed"),
        ("c*T*q", "", "T is no column of the data\nhint: write its column: temp_bed"),
    ],
)
def test_a_formula_is_refused_in_the_words_of_its_fields(
    tmp_path: Path, formula: str, searched: str, told: str
) -> None:
    with pytest.raises(InputFileError) as refused:
        own_effect(OwnFormula("mine", "along", "x", formula, searched), ("x", "y", "z", "temp_bed"), tmp_path)
    said = str(refused.value)
    assert told in said
    for word in ("README", "effect '", "inner", "coefficient", "covariates"):
        assert word not in said, said


def test_the_place_of_a_mistake_stays_below_its_letter() -> None:
    session = Session(threads=1)
    session.show_problem(actions.OWN, "your formula: an operator is needed here\n  c,q\n   ^\nhint: look")
    box = problem(session, actions.OWN)
    said, marked, remedy, _ = box.children
    assert said.children == "Your formula: an operator is needed here."
    # As it is written, in letters of one width.
    assert type(marked).__name__ == "Pre"
    assert marked.children == "  c,q\n   ^"
    assert texts(remedy) == "What to do:  look"


def test_what_a_model_of_other_data_needs_is_said_in_the_words_of_the_page(tmp_path: Path) -> None:
    session = loaded(tmp_path)
    wiring.do(session, "fit", "12")
    settle(session)
    write_model(tmp_path / "model.json", session.model)
    table = tmp_path / "observations.csv"
    pl.read_csv(table)[1:].write_csv(table)
    other = begin_session([tmp_path / "model.json", table], None, threads=1)
    settle(other)
    wiring.do(other, "diagnose", "")
    settle(other)
    (note,) = [one for one in other.told.sentences if "come from other data" in one]
    assert "“Fit the 21 errors” fits them to these data" in note
    assert "--" not in note


def test_conditions_that_are_not_stated_are_asked_for_where_their_fields_are() -> None:
    session = Session(threads=1)
    session.show_problem(actions.PROGRAM, refusal(["temp_bed", "feed"], Machine("m", "wbXYZt", AXES)))
    assert session.problems[actions.PROGRAM].endswith("hint: state them in their fields, above the program")


@pytest.mark.parametrize(
    ("text", "offset_mm"),
    [
        ("0, 0, 0", (0.0, 0.0, 0.0)),
        ("1,2,3", (1.0, 2.0, 3.0)),
        ("0,5, 0,5, 0", (0.5, 0.5, 0.0)),
        ("0,5; 0,5; −2", (0.5, 0.5, -2.0)),
        ("1 ,5 ,2", (1.0, 5.0, 2.0)),
        ("1.5 2 3", (1.5, 2.0, 3.0)),
    ],
)
def test_a_programs_zero_is_read_with_either_decimal_sign(text: str, offset_mm: tuple[float, ...]) -> None:
    assert work_offset_mm(text) == offset_mm


@pytest.mark.parametrize("text", ["", "1, 2", "1,2,3,4", "1,,2", "inf, 0, 0", "1e300, 0, 0", "x"])
def test_what_is_no_programs_zero_is_refused(text: str) -> None:
    with pytest.raises(InputFileError, match="the program's zero"):
        work_offset_mm(text)
