"""What a person types: numbers and formulas, as they are read, refused and told."""

from __future__ import annotations

from pathlib import Path

import pytest

pytest.importorskip("dash")

from workbench_scenes import loaded, settle, texts

from geoerr.errors import InputFileError
from geoerr.workbench import actions, wiring
from geoerr.workbench.own_effect import OwnFormula
from geoerr.workbench.typed import typed_number


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
