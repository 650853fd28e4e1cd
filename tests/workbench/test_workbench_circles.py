"""Circular tests on the page: dropped, drawn as a ball bar draws them, diagnosed, added, refused in words."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("dash")

from workbench_scenes import (
    BOW_UM,
    CIRCLE_MM,
    CIRCLE_POINTS,
    LENGTH_MM,
    PLAY_UM,
    circle_table,
    loaded,
    settle,
    texts,
    write_scene,
)

from geoerr.diagnose.circles import CircleDiagnosis
from geoerr.workbench import actions, marking, wiring
from geoerr.workbench.app import make_app
from geoerr.workbench.explained import what_is_shown
from geoerr.workbench.security import Guard
from geoerr.workbench.server import begin_session
from geoerr.workbench.session import Session
from geoerr.workbench.store import session_document
from geoerr.workbench.told import Told

PORT = 8125
WORST = "bar 2000, counter-clockwise, 2000 mm/min"


def begun(folder: Path, table: bytes) -> Session:
    """Begin with a machine, and drop circular tests on the page."""
    machine, _ = write_scene(folder)
    session = begin_session([machine], None, threads=1)
    settle(session)
    actions.take_dropped(session, ["circle.csv"], [table])
    settle(session)
    return session


@pytest.fixture(scope="module")
def diagnosed(tmp_path_factory: pytest.TempPathFactory) -> Session:
    session = begun(tmp_path_factory.mktemp("circles"), circle_table())
    wiring.do(session, "diagnose", "")
    settle(session)
    return session


def test_the_runs_are_drawn_as_a_ball_bar_draws_them(tmp_path: Path) -> None:
    session = begun(tmp_path, circle_table())
    found = wiring.panels(session)
    assert found["looks"] == {"circle": "circle"}
    assert found["look"] == "circle"
    assert len(found["runs"]) == 4
    assert found["run"] in found["runs"]
    wiring.choose(session, "length", session.view.variable, None, WORST)
    assert (session.view.look, session.view.run) == ("circle", WORST)
    drawn = wiring.pictures(session, "")
    _, measured, model, cause = drawn["volume"].data
    assert {trace.type for trace in drawn["volume"].data} == {"scatterpolar"}
    # The run is closed: its first point comes again.
    assert len(measured.r) == CIRCLE_POINTS + 1
    assert PLAY_UM < np.ptp(measured.r) < PLAY_UM + 2.0 * BOW_UM
    assert np.abs(np.asarray(model.r)).max() < 0.01
    assert not len(cause.r)
    words = drawn["captions"][0]
    assert f"XY plane, radius {CIRCLE_MM:g} mm about (150, 150, 20) mm" in words
    assert "G (ISO 230-4): measured 2" in words
    assert wiring.panels(session)["run"] == WORST


def test_causes_are_told_with_part_value_doubt_and_what_is_left(diagnosed: Session) -> None:
    assert isinstance(diagnosed.diagnosis, CircleDiagnosis)
    told = texts(wiring.panels(diagnosed)["missing"])
    assert "The circle is off by backlash of the drive (backlash:x)" in told
    assert "number 1 by its part" in told
    assert "bow along y" in told
    assert all(one.what for cause in diagnosed.diagnosis.found for one in cause.parameters)
    assert "Times are not stated: they follow from the feed." in told
    assert "µm (lost motion)" in told
    assert "peak to peak" in told
    assert "Certainty:" in told
    assert "unexplained" in told
    assert "noise 0." in told
    play = next(one for one in diagnosed.diagnosis.found if str(one.reference) == "backlash:x").parameters[0]
    assert 1e3 * play.value == pytest.approx(PLAY_UM, abs=4e3 * play.std + 0.01 * PLAY_UM)


def test_the_number_of_a_part_below_nothing_stands_off_the_names(diagnosed: Session) -> None:
    diagnosis = diagnosed.diagnosis
    first, *rest = diagnosis.found
    against = replace(diagnosis, found=(replace(first, percent=-1.2), *rest))
    bars, numbers = against.plot_causes().data
    place = list(bars.y).index(str(first.reference))
    assert bars.x[place] == -1.2
    assert "−1 %" in numbers.text[place]
    # To the right of the bar, however narrow the figure is: at the left are the names.
    assert numbers.x[place] == 0.0
    assert numbers.textposition == "middle right"
    assert bars.text is None


def test_what_the_runs_cannot_tell_apart_is_said_with_what_would(diagnosed: Session) -> None:
    told = texts(wiring.panels(diagnosed)["missing"])
    assert diagnosed.diagnosis.verdict == "ambiguous"
    assert "some of which these runs cannot tell from others" in told
    assert "These runs cannot tell it from:" in told
    assert "To tell it apart:  a second circle" in told


def test_pointing_at_a_cause_shows_it_on_the_circle(diagnosed: Session) -> None:
    diagnosed.view.run = WORST
    moved_um = what_is_shown(diagnosed, "backlash:x")
    assert moved_um is not None
    run = next(one for one in diagnosed.seen.circles if one.name == WORST)
    # Off the centre and the radius of the set-up, the steps of the play at its two reversals stay.
    steps = np.abs(np.diff(moved_um[run.rows, 0]))
    assert np.sort(steps)[-1] == pytest.approx(PLAY_UM, rel=0.1)
    assert what_is_shown(diagnosed, "stick-slip:x") is None
    cause = wiring.pictures(diagnosed, "backlash:x")["volume"].data[3]
    assert len(cause.r) == np.isfinite(moved_um[run.rows, 0]).sum() > 0.9 * CIRCLE_POINTS
    patched, _ = wiring.explanation(diagnosed, diagnosed.seen, moved_um)
    operations = {tuple(one["location"]): one["params"]["value"] for one in patched.to_plotly_json()["operations"]}
    assert operations["data", 3, "r"] == pytest.approx(np.asarray(cause.r), abs=1e-3)


def test_a_box_over_the_residual_marks_the_circle(diagnosed: Session) -> None:
    diagnosed.view.variable, diagnosed.view.run = "x", WORST
    words = marking.mark(diagnosed, "residual", {"range": {"x": [200.0, 250.0]}})
    in_circle = marking.mark_volume(diagnosed)
    operations = {tuple(one["location"]): one["params"]["value"] for one in in_circle.to_plotly_json()["operations"]}
    angle = np.rad2deg(next(one for one in diagnosed.seen.circles if one.name == WORST).measured.angle_rad)
    assert sorted(operations["data", 1, "selectedpoints"]) == np.flatnonzero(np.abs(angle) <= 60.0).tolist()
    assert "rows marked" in texts(words)
    marking.mark(diagnosed, "none", "")


def test_the_page_of_the_circles_can_be_had(diagnosed: Session) -> None:
    guard = Guard(PORT)
    client = make_app(diagnosed, guard).server.test_client()
    headers = {"Host": f"127.0.0.1:{PORT}"}
    client.get(f"/?token={guard.token}", headers=headers)
    wiring.do(diagnosed, "report", "diagnosis")
    settle(diagnosed)
    answer = client.get("/report/diagnosis", headers=headers)
    assert answer.status_code == 200
    assert "circular tests" in answer.get_data(as_text=True)


def test_a_cause_is_added_and_the_circle_of_the_model_follows(tmp_path: Path) -> None:
    session = begun(tmp_path, circle_table())
    before = session.step.figures["rmse_um"]
    wiring.do(session, "add", "backlash:x")
    settle(session)
    assert session.step.figures["rmse_um"] < 0.5 * before
    session.view.run = WORST
    _, measured, model, _ = wiring.pictures(session, "")["volume"].data
    assert np.std(np.asarray(measured.r) - np.asarray(model.r)) < 0.5 * np.std(measured.r)


def test_the_causes_are_kept_with_the_session(diagnosed: Session) -> None:
    document = json.loads(json.dumps(session_document(diagnosed)))
    told = Told.from_document(document["diagnosis"])
    assert told == diagnosed.told
    assert any(card.apart for card in told.cards)


def test_circles_that_cannot_be_diagnosed_say_why_where_it_was_asked(tmp_path: Path) -> None:
    session = begun(tmp_path, circle_table(turn=0.3))
    wiring.do(session, "diagnose", "")
    session.job.wait(60.0)
    told = texts(wiring.panels(session)["missing"])
    assert "No run of the circular test can be diagnosed: the run covers 107° of the circle" in told
    assert "What to do:" in told
    assert "half a turn at least" in told
    actions.take_dropped(session, ["deviation.csv"], [b"line,x,y,z,r\nA,0,0,0,x\n"])
    session.job.wait(60.0)
    told = texts(wiring.panels(session)["given"])
    assert "deviation.csv" in told
    assert str(session.folder) not in told


def test_points_and_circles_together_have_all_views(tmp_path: Path) -> None:
    session = loaded(tmp_path)
    assert "circle" not in wiring.panels(session)["looks"]
    actions.take_dropped(session, ["circle.csv"], [circle_table()])
    settle(session)
    found = wiring.panels(session)
    assert list(found["looks"]) == ["length", "magnitude", "direction", "region", "difference", "circle"]
    assert found["look"] == "length"
    wiring.choose(session, "circle", session.view.variable, None, WORST)
    assert wiring.pictures(session, "")["volume"].data[1].type == "scatterpolar"
    wiring.do(session, "put-away", "circle.csv")
    settle(session)
    assert wiring.panels(session)["look"] == "length"
    assert wiring.pictures(session, "")["volume"].data[0].type == "scatter3d"
    assert session.seen.comparison.points.sightings.commanded_mm.max() <= LENGTH_MM
