"""What a person types: numbers and formulas, as they are read, refused and told."""

from __future__ import annotations

from pathlib import Path

import polars as pl
import pytest

pytest.importorskip("dash")

from workbench_scenes import loaded, settle, texts, write_scene

from geoerr.errors import InputFileError
from geoerr.workbench import actions, wiring
from geoerr.workbench.own_effect import OwnFormula
from geoerr.workbench.panel_missing import tried_value
from geoerr.workbench.server import begin_session
from geoerr.workbench.typed import typed_number

GROWTH_PER_K = 12e-6


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
