"""An effect of one's own: what was tried is what is shown and added, with how sure it is."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import polars as pl
import pytest

pytest.importorskip("dash")

from workbench_scenes import loaded, settle, texts, write_scene

from geoerr.errors import GeoerrError
from geoerr.fit.from_nothing import chance_of_nothing
from geoerr.workbench import actions, wiring
from geoerr.workbench.own_effect import OwnFormula
from geoerr.workbench.server import begin_session
from geoerr.workbench.session import Session

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


def wave(channel: str, axis: str, searched: str = "P: 1..20") -> OwnFormula:
    return OwnFormula("ripple", channel, axis, "c*sin(2*pi*q/P)", searched)


def tried(session: Session, formula: OwnFormula) -> str:
    """Give what the card of a formula says."""
    actions.try_formula(session, formula)
    settle(session)
    return texts(wiring.panels(session)["own"])


def test_what_helps_is_said_with_how_sure_that_is(tmp_path: Path) -> None:
    session = loaded(tmp_path)
    wiring.do(session, "fit", "12")
    settle(session)
    told = tried(session, GAP)
    assert "It helps." in told
    assert "Certainty:  certain as can be" in told
    trial = session.trial
    session.trial = replace(trial, p_value=0.3)
    told = texts(wiring.panels(session)["own"])
    assert "It may be chance: where there is nothing, as much is often gained." in told
    assert "It helps." not in told
    assert "not beyond chance: chance does as much in 30 of 100 searches" in told


def test_a_period_that_is_searched_for_in_noise_never_helps(tmp_path: Path) -> None:
    session = loaded(tmp_path)
    wiring.do(session, "fit", "12")
    settle(session)
    actions.try_formula(session, GAP)
    settle(session)
    wiring.do(session, "add-trial", "")
    for axis in "xyz":
        told = tried(session, wave("along", axis))
        assert "It helps." not in told
        # Many periods were tried: one of them may well look as large as this alone.
        alone = chance_of_nothing(session.trial.change.after)[f"ripple:{axis}"]
        assert session.trial.p_value >= min(20.0 * alone, 1.0)


def test_what_hangs_together_within_passes_is_no_proof_row_by_row(tmp_path: Path) -> None:
    session = loaded(tmp_path)
    wiring.do(session, "fit", "12")
    settle(session)
    # The play that the model lacks is the same all along a line that stands in x.
    tried(session, wave("across", "y"))
    after = session.trial.change.after
    alone = chance_of_nothing(after.again(after.terms))["ripple:y"]
    assert alone < 1e-9
    assert session.trial.p_value > 1e-3


def test_a_period_of_places_in_even_steps_is_told_with_those_that_look_the_same(tmp_path: Path) -> None:
    machine, table = write_scene(tmp_path)
    rows = pl.read_csv(table)
    # In steps of 10 mm 1/7 of a cycle a mm is 1/7 − 1/10 too.
    even = (rows["x"] / 10.0).round() * 10.0
    ripple_mm = 0.02 * (2.0 * math.pi * even / 7.0).sin()
    rows.with_columns(x=even, mx=pl.col("mx") - pl.col("x") + even + ripple_mm).write_csv(table)
    session = begin_session([machine, table], None, threads=1)
    settle(session)
    wiring.do(session, "fit", "12")
    settle(session)
    told = tried(session, wave("along", "x", "P: 6..9"))
    period_mm = session.trial.terms[0].inner[0].value
    assert period_mm == pytest.approx(7.0, abs=0.05)
    assert f"Other periods:  P may as well be {1.0 / (1.0 / period_mm - 0.1):.4g}, " in told
    assert "the same at these places: measure in uneven steps." in told
