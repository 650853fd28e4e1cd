"""An effect of one's own: what was tried is what is shown and added."""

from __future__ import annotations

from pathlib import Path

import pytest

pytest.importorskip("dash")

from workbench_scenes import loaded, settle, texts

from geoerr.errors import GeoerrError
from geoerr.workbench import actions, wiring
from geoerr.workbench.own_effect import OwnFormula

GAP = OwnFormula("gap of x", "along", "x", "c*d")
# Of no place on this machine is it a number.
NOWHERE = OwnFormula("nowhere", "along", "x", "c*log(q - 500)")


def test_the_card_of_a_formula_names_it_and_goes_when_another_is_tried(tmp_path: Path) -> None:
    session = loaded(tmp_path)
    actions.try_formula(session, GAP)
    settle(session)
    told = texts(wiring.panels(session)["own"])
    assert "gap of x gap-of-x:x :  c*d" in told
    actions.try_formula(session, NOWHERE)
    session.job.wait(60.0)
    assert actions.OWN in session.problems
    assert "Add it" not in texts(wiring.panels(session)["own"])
    n_steps = len(session.steps)
    wiring.do(session, "add-trial", "")
    assert "try the formula first" in session.problems[actions.OWN]
    assert len(session.steps) == n_steps


def test_a_formula_that_cannot_be_read_takes_the_place_of_the_one_before(tmp_path: Path) -> None:
    session = loaded(tmp_path)
    actions.try_formula(session, GAP)
    settle(session)
    with pytest.raises(GeoerrError):
        actions.try_formula(session, OwnFormula("mine", "along", "x", "c*("))
    assert session.trial is None


@pytest.mark.parametrize(("action", "what"), [("undo", ""), ("fit", "21")])
def test_what_was_refused_of_one_model_is_not_said_of_another(tmp_path: Path, action: str, what: str) -> None:
    session = loaded(tmp_path)
    wiring.do(session, "fit", "12")
    settle(session)
    actions.try_formula(session, NOWHERE)
    session.job.wait(60.0)
    assert actions.OWN in session.problems
    wiring.do(session, action, what)
    # It insists that nothing is said any more.
    settle(session)
