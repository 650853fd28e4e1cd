"""The story without a browser: load, see, learn, add, watch, undo, correct, report, and have it all again."""

from __future__ import annotations

import json
import threading
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("dash")

from dash import dcc, no_update
from flask.testing import FlaskClient
from workbench_scenes import N_LINES, N_POINTS, PLAY_UM, PROGRAM, fitted, loaded, settle, texts

from geoerr.diagnose import Diagnosis, diagnose
from geoerr.effects.values import value_words
from geoerr.errors import GeoerrError, InputFileError
from geoerr.model.document import document_of
from geoerr.report import model_page
from geoerr.terms import Parameter
from geoerr.workbench import actions, marking, wiring
from geoerr.workbench.addition import AHEAD, Addition
from geoerr.workbench.app import make_app
from geoerr.workbench.explained import what_is_shown
from geoerr.workbench.layout import page, status
from geoerr.workbench.own_effect import OwnFormula
from geoerr.workbench.page_words import PASS, ZERO
from geoerr.workbench.panel_missing import tried_value
from geoerr.workbench.panel_where import limits_shown
from geoerr.workbench.parts import breakable, sentence, signed
from geoerr.workbench.pictures import explanation, turned_volume
from geoerr.workbench.program import Wish
from geoerr.workbench.security import Guard
from geoerr.workbench.server import begin_session
from geoerr.workbench.session import Session
from geoerr.workbench.side_by_side import story
from geoerr.workbench.view import CORNER, STANDS

# Diagnosing needs a few seconds: once for all that only read it.
PORT = 8124
HEADERS = {"Host": f"127.0.0.1:{PORT}"}


@pytest.fixture(scope="module")
def learned(tmp_path_factory: pytest.TempPathFactory) -> Session:
    session = fitted(tmp_path_factory.mktemp("learned"))
    wiring.do(session, "diagnose", "")
    settle(session)
    return session


def test_at_first_the_machine_is_compared_as_it_is(tmp_path: Path) -> None:
    session = loaded(tmp_path)
    assert [step.name for step in session.steps] == ["machine without errors"]
    found = wiring.panels(session)
    assert f"{N_LINES * N_POINTS} rows in {N_LINES} passes" in texts(found["given"])
    assert session.view.variable in {option["value"] for option in found["variables"]}
    drawn = wiring.pictures(session, "")
    assert len(drawn["volume"].data[0].x) == 3 * N_LINES * N_POINTS
    assert drawn["residual"].layout.xaxis3.title.text


def test_the_candidate_is_told_with_value_worth_and_certainty(learned: Session) -> None:
    told = texts(wiring.panels(learned)["missing"])
    assert "Backlash of the drive" in told
    for words in ("worth", "held out", "Value:", "Certainty:", "Cause:", "To do:"):
        assert words in told, words


def test_pointing_shows_what_it_would_explain(learned: Session) -> None:
    moved_um = what_is_shown(learned, "backlash:x")
    assert moved_um is not None
    sense = learned.seen.comparison.points.sightings.directions[:, 0]
    gap_um = moved_um[sense > 0, 0].mean() - moved_um[sense < 0, 0].mean()
    # The 21 errors take a part of it where lines were run one way only.
    assert gap_um == pytest.approx(-PLAY_UM, rel=0.35)
    assert what_is_shown(learned, "no-such-effect:x") is None
    drawn = wiring.pictures(learned, "backlash:x")
    assert np.isfinite(np.asarray(drawn["residual"].data[2].y, dtype=float)).any()


def test_a_box_marks_its_rows_in_both_pictures(learned: Session) -> None:
    learned.view.variable = "x"
    words = marking.mark(learned, "residual", {"range": {"x": [100.0, 200.0], "y": [-1e3, 1e3]}})
    fitted = learned.seen.comparison.points
    x = fitted.sightings.commanded_mm[:, 0]
    # A gross outlier takes no part in the fit, and is not drawn.
    expected = (x >= 100.0) & (x <= 200.0) & fitted.solved.used
    assert (~fitted.solved.used).sum() < 3
    assert (learned.selected == expected).all()
    assert f"{expected.sum()} rows marked" in texts(words)
    in_volume = marking.mark_volume(learned)
    operations = {tuple(one["location"]): one["params"]["value"] for one in in_volume.to_plotly_json()["operations"]}
    assert len(operations["data", 2, "x"]) == 3 * expected.sum()
    places = [one["location"] for one in marking.mark_residual(learned).to_plotly_json()["operations"]]
    assert ["data", 0, "selectedpoints"] in places
    # The box stays with what it marked over this variable, and goes with what marks other rows.
    [drawn] = _box_drawn(learned)
    assert [drawn[name] for name in ("xref", "x0", "x1", "yref", "y0", "y1")] == ["x", 100.0, 200.0, "y", -1e3, 1e3]
    [whole] = wiring.pictures(learned, "")["residual"].layout.shapes
    assert (whole.x0, whole.x1) == (100.0, 200.0)
    learned.view.variable = "y"
    assert _box_drawn(learned) == []
    learned.view.variable = "x"
    marking.mark(learned, "volume", {"points": [{"customdata": [0, 0, 0, 0, 0, 0, 20]}]})
    assert learned.selected.sum() == N_POINTS
    assert _box_drawn(learned) == []
    marking.mark(learned, "region", "0")
    assert learned.selected is None or learned.selected.sum() < N_LINES * N_POINTS
    # Two clicks on the picture.
    marking.mark(learned, "residual", None)
    assert learned.selected is None


def test_pictures_that_were_asked_for_before_a_mark_do_not_take_it_back(learned: Session) -> None:
    marking.mark(learned, "none", "")
    drawn = wiring.pictures(learned, "")["drawn"]
    words, _ = marking.after_drawing(learned, drawn)
    assert texts(words).startswith("Nothing is marked")
    marking.mark(learned, "limits", ("100", ""))
    words, is_later = marking.after_drawing(learned, drawn)
    assert f"{learned.selected.sum()} rows marked" in texts(words)
    assert is_later is not no_update
    words, is_later = marking.after_drawing(learned, wiring.pictures(learned, "")["drawn"])
    assert is_later is no_update
    marking.mark(learned, "none", "")


@pytest.mark.parametrize("look", ["length", "magnitude", "region"])
def test_no_mark_moves_the_volume(learned: Session, look: str) -> None:
    learned.view.look = look
    marking.mark(learned, "none", "")
    scene = wiring.pictures(learned, "")["volume"].layout.scene
    ranges = [scene[f"{axis}axis"].range for axis in "xyz"]
    used = learned.seen.comparison.points.solved.used
    marking.mark(learned, "limits", ("-1e9", ""))
    assert learned.selected.sum() == used.sum()
    for axis, (low, high) in zip("xyz", ranges, strict=True):
        strokes = [one["params"]["value"] for one in marking.mark_volume(learned).to_plotly_json()["operations"]
                   if one["location"][-1] == axis]  # fmt: skip
        ends = np.array(strokes[0], dtype=np.float64)
        assert low <= np.nanmin(ends)
        assert np.nanmax(ends) <= high
    marking.mark(learned, "none", "")
    learned.view.look = "length"


def _box_drawn(session: Session) -> list[dict[str, object]]:
    """Give the box over the residual as the page is told to draw it."""
    operations = marking.mark_residual(session).to_plotly_json()["operations"]
    return next(one["params"]["value"] for one in operations if one["location"] == ["layout", "shapes"])


def test_two_limits_mark_what_a_box_marks_without_a_mouse(learned: Session) -> None:
    learned.view.variable = "x"
    marking.mark(learned, "residual", {"range": {"x": [100.0, 200.0], "y": [-1e6, 1e6]}})
    by_box = learned.selected
    words = marking.mark(learned, "limits", ("100", "200,0"))
    assert (learned.selected == by_box).all()
    assert f"{by_box.sum()} rows marked" in texts(words)
    marking.mark(learned, "limits", ("", "150"))
    x = learned.seen.comparison.points.sightings.commanded_mm[:, 0]
    assert learned.selected.any()
    assert x[learned.selected].max() <= 150.0
    with pytest.raises(InputFileError, match="'noon' is no number"):
        marking.mark(learned, "limits", ("noon", ""))
    marking.mark(learned, "limits", ("", " "))
    assert learned.selected is None
    low, high, unit = limits_shown(learned.seen, "x")
    assert (float(low), float(high)) == pytest.approx((x.min(), x.max()), rel=1e-3)
    assert unit == "mm"


def test_the_volume_is_looked_at_from_where_a_button_says(learned: Session) -> None:
    learned.view.look = "length"
    turned = {}
    for name, text in STANDS.items():
        assert text in texts(page(learned))
        learned.view.look_from(name)
        changes = turned_volume(learned).to_plotly_json()["operations"]
        turned[name] = {one["location"][-1]: one["params"]["value"] for one in changes}
        scene = wiring.pictures(learned, "")["volume"].layout.scene
        assert scene.camera.eye.to_plotly_json() == turned[name]["eye"]
        assert scene.camera.up.to_plotly_json() == turned[name]["up"]
        # Flat views leave out the axis that they look along.
        named = [axis.title.text for axis in (scene.xaxis, scene.yaxis, scene.zaxis) if axis.showticklabels]
        assert [text for text in ("X, mm", "Y, mm", "Z, mm") if text in named] == named
        assert len(named) == (3 if name == CORNER else 2)
        # Plotly leaves an axis without its name for ever once it was invisible.
        assert all(axis.visible is None for axis in (scene.xaxis, scene.yaxis, scene.zaxis))
        # A new revision: Plotly would keep how a person has turned it.
        assert scene.uirevision == turned[name]["uirevision"]
    assert len({str(one["eye"]) for one in turned.values()}) == len(STANDS)
    before = turned_volume(learned).to_plotly_json()
    learned.view.look_from(learned.view.stand)
    assert turned_volume(learned).to_plotly_json() != before


def test_without_webgl_a_sentence_stands_for_the_volume_and_the_rest_goes_on(learned: Session) -> None:
    learned.has_webgl, learned.view.variable = False, "x"
    try:
        drawn = wiring.pictures(learned, "backlash:x")
        assert "no WebGL" in drawn["volume"].layout.annotations[0].text
        for picture in (drawn["volume"], drawn["residual"]):
            assert {trace.type for trace in picture.data} == {"scatter"}
        assert len(drawn["residual"].data[0].x) == N_LINES * N_POINTS
        # What marks and causes change in the volume has a place there that is not seen.
        assert not any(trace.visible for trace in drawn["volume"].data)
        marking.mark(learned, "limits", ("100", "200"))
        explained = explanation(learned, learned.seen, what_is_shown(learned, "backlash:x"))[0]
        for changed in (marking.mark_volume(learned), explained):
            places = {one["location"][1] for one in changed.to_plotly_json()["operations"]}
            assert max(places) < len(drawn["volume"].data)
    finally:
        learned.has_webgl = True
        marking.mark(learned, "none", "")
    kinds = {trace.type for picture in wiring.pictures(learned, "").values() if hasattr(picture, "data")
             for trace in picture.data}  # fmt: skip
    assert {"scatter3d", "scattergl"} <= kinds


def test_regions_come_worst_first(learned: Session) -> None:
    learned.view.look = "region"
    shown = wiring.pictures(learned, "")
    table = shown["regions"].children[1]
    sizes = [float(texts(row.children[1])) for row in table.children[1].children]
    assert sizes == sorted(sizes, reverse=True)
    head, rows = table.children[0].children, table.children[1].children
    assert [texts(cell) for cell in head.children] == ["region, mm", "rms, µm", "x, µm", "y, µm", "z, µm", "rows"]
    assert [word for word in texts(rows[0].children[0]).split() if word in "xyz"] == ["x", "y", "z"]
    used = learned.seen.comparison.points.solved.used
    assert sum(int(texts(row.children[-1])) for row in rows) == used.sum()
    # Strokes of means, each of which marks the rows of its region.
    means = shown["volume"].data[0]
    assert len(means.x) == 3 * len(sizes)
    told = means.customdata[0]
    marking.mark(learned, "volume", {"points": [{"customdata": told.tolist()}]})
    assert learned.selected.sum() == learned.seen.comparison.regions[int(told[-1])].n == int(told[7])
    marking.mark(learned, "none", "")
    learned.view.look = "length"


def test_adding_makes_the_error_fall_and_undo_takes_it_back(tmp_path: Path) -> None:
    session = fitted(tmp_path)
    wiring.do(session, "add", "backlash:x")
    settle(session)
    stages = story(session.steps, session.current, session.beside)
    inside, held = ([stage.figure(name) for stage in stages] for name in ("rmse_um", "held_out_rmse_um"))
    assert inside[2] < 0.8 * inside[1] < inside[0]
    assert held[2] < 0.8 * held[1]
    assert dict(session.step.effects) == {"backlash:x": "Backlash of the drive"}
    wiring.do(session, "refer", "1")
    assert session.reference == 1
    session.view.look = "difference"
    drawn = wiring.pictures(session, "")
    model, reference = session.model, session.steps[1].model
    at_mm, told_um = drawn["volume"].data[0].customdata[:, :3], drawn["volume"].data[0].customdata[:, 3:]
    known = np.isfinite(at_mm).all(axis=1)
    at = {name: 1.0 if name.startswith("d_") else 0.0 for name in model.conditions}
    difference_mm = model.error_mm(at_mm[known], at=at) - reference.error_mm(at_mm[known])
    assert told_um[known] == pytest.approx(1e3 * difference_mm, abs=1e-9)
    wiring.do(session, "refer", str(session.current))
    assert "the reference" in wiring.pictures(session, "")["volume"].layout.annotations[0].text
    wiring.do(session, "refer", "1")
    session.view.look = "length"
    assert "−" in texts(wiring.panels(session)["given"])
    wiring.do(session, "undo", "")
    settle(session)
    assert session.current == 1
    wiring.do(session, "show", "2")
    settle(session)
    wiring.do(session, "remove", "backlash:x")
    settle(session)
    assert session.step.name == "− backlash:x"
    # The bases stay as they were chosen beside the play; what was before is what undo gives.
    assert 1.25 * held[2] < session.step.figures["held_out_rmse_um"] < held[1]


def test_bars_have_the_height_that_a_window_leaves_them(learned: Session) -> None:
    (fall,) = graphs_in(wiring.panels(learned)["fall"])
    margin = fall.figure.layout.margin
    # All of the rest is the bars': the legend stands outside, where a second line of it costs them nothing.
    assert fall.style == {"height": f"calc({margin.t + margin.b}px + 2 * var(--bars))"}
    assert fall.figure.layout.showlegend is False
    assert "residual: rows that it saw  held out: rows that the fit did not see" in texts(
        wiring.panels(learned)["fall"]
    )
    assert fall.responsive is True
    for text in ("4. + thermal-expansion:y@temp_bed", "2. 21 errors fitted"):
        parts = breakable(text)
        assert "".join(part for part in parts if isinstance(part, str)) == text
        assert len(parts) == (3 if "@" in text else 1)


def test_the_legend_of_the_residual_takes_no_width_from_the_name_of_its_axis(learned: Session) -> None:
    # Plotly keeps as much as a legend is wide free beside the plots, where it belongs to the panel sideways alone.
    legend = wiring.pictures(learned, "")["residual"].layout.legend
    assert (legend.xref, legend.yref) == ("container", "container")


def tried(tmp_path: Path, formula: OwnFormula) -> Session:
    session = fitted(tmp_path)
    actions.try_formula(session, formula)
    settle(session)
    return session


def test_an_own_formula_is_tried_and_then_added(tmp_path: Path) -> None:
    session = tried(tmp_path, OwnFormula("Gap of x", "along", "x", "g*d/2"))
    assert "It helps." in texts(wiring.panels(session)["own"])
    value = session.trial.change.result.model.parameter("gap-of-x:x.g").value
    assert 1e3 * value == pytest.approx(-PLAY_UM, abs=2.0)
    wiring.do(session, "add-trial", "")
    assert session.step.name == "+ gap-of-x:x"
    # Other data, and the 21 errors fitted anew, leave it where it is.
    actions.read_again(session, tuple(session.files), is_new_model=False, keeps=False)
    settle(session)
    assert [one.id for one in session.known_effects] == ["gap-of-x"]
    actions.fit_classic(session, "21")
    settle(session)
    again = session.model.parameter("gap-of-x:x.g").value
    assert 1e3 * again == pytest.approx(-PLAY_UM, abs=2.0)
    assert any(term.kind == "classic" for term in session.model.machine_terms)
    with pytest.raises(GeoerrError, match="your formula"):
        actions.try_formula(session, OwnFormula("bad", "along", "x", "c*(q"))
    with pytest.raises(InputFileError, match="no number to be found"):
        actions.try_formula(session, OwnFormula("bad", "along", "x", "q"))


def test_a_formula_that_the_model_has_already_makes_no_difference(tmp_path: Path) -> None:
    session = tried(tmp_path, OwnFormula("Bow", "along", "x", "c*(q - 150)^2"))
    told = texts(wiring.panels(session)["own"])
    assert "It makes no difference" in told
    assert "It helps." not in told


def test_a_refusal_is_shown_in_its_panel_with_its_hint(tmp_path: Path) -> None:
    session = Session(threads=1)
    wiring.do(session, "diagnose", "")
    told = texts(wiring.panels(session)["missing"])
    assert "There is no machine yet." in told
    assert "What to do:" in told
    wiring.do(session, "dismiss", actions.MISSING)
    assert session.problems == {}
    actions.take_dropped(session, ["bad.csv"], [b"a,b\n1,2\n"])
    session.job.wait(60.0)
    told = texts(wiring.panels(session)["given"])
    assert "bad.csv" in told
    assert str(session.folder) not in told


def test_a_program_is_corrected_and_its_path_is_better(tmp_path: Path) -> None:
    session = fitted(tmp_path)
    actions.compensate(session, "part.gcode", PROGRAM, Wish({}))
    settle(session)
    corrected = session.program
    assert corrected.corrected_name == "part-corrected.gcode"
    assert corrected.content != PROGRAM
    trace = corrected.trace
    assert trace.result.rms_um_after < 0.2 * trace.result.rms_um_before
    assert len(trace.distance_mm) == len(trace.before_mm) == len(trace.after_mm)
    assert "Download part-corrected.gcode" in texts(wiring.panels(session)["program"])
    actions.compensate(session, "bad.gcode", b"G2 X10 Y10 I5 J5\n", Wish({}))
    session.job.wait(60.0)
    assert "bad.gcode:1" in session.problems[actions.PROGRAM]


def test_a_program_that_is_refused_is_corrected_again_as_the_page_says(tmp_path: Path) -> None:
    session = fitted(tmp_path)
    arc = PROGRAM.replace(b"M30", b"G2 X60 Y60 I5 J5\nM30")
    assert "again" not in texts(wiring.panels(session)["program"])
    actions.compensate(session, "arc.gcode", arc, Wish({}))
    session.job.wait(60.0)
    told = texts(wiring.panels(session)["program"])
    # In the page's words, which has no options of a command line.
    assert f"“{PASS}”" in told
    assert "--" not in told
    assert "Correct arc.gcode again" in told
    actions.dismiss(session, actions.PROGRAM)
    actions.compensate(session, *session.dropped, Wish({}, passes_unsupported=True))
    settle(session)
    told = texts(wiring.panels(session)["program"])
    assert "Download arc-corrected.gcode" in told
    assert "--" not in told
    outside = b"G21\nG90\nG1 X50 Y50 Z50 F2000\nG1 X9000\nM30\n"
    actions.compensate(session, "far.gcode", outside, Wish({}))
    session.job.wait(60.0)
    assert f"“{ZERO}”" in session.problems[actions.PROGRAM]
    assert "--" not in session.problems[actions.PROGRAM]


def test_undo_has_what_was_found_missing_again_at_once(tmp_path: Path) -> None:
    session = fitted(tmp_path)
    wiring.do(session, "diagnose", "")
    settle(session)
    seen, diagnosis, ahead = session.seen, session.diagnosis, session.prepared[:1]
    wiring.do(session, "add", "backlash:x")
    assert session.job is None
    assert session.diagnosis is None
    assert session.prepared == ()
    added = session.seen
    wiring.do(session, "undo", "")
    assert session.job is None
    assert session.current == 1
    assert session.seen is seen
    assert session.diagnosis is diagnosis
    assert session.prepared[:1] == ahead
    assert "Backlash of the drive" in texts(wiring.panels(session)["missing"])
    wiring.do(session, "show", "2")
    assert session.job is None
    assert session.seen is added
    assert session.diagnosis is None
    assert session.prepared == ()
    # Other data: what was seen of the earlier ones is nothing to come back to.
    wiring.do(session, "put-away", "observations.csv")
    settle(session)
    assert session.before is None


def test_what_was_found_was_added_ahead_as_it_is_when_asked_for(learned: Session) -> None:
    diagnosis = learned.diagnosis
    assert isinstance(diagnosis, Diagnosis)
    names = dict.fromkeys(str(one.reference) for one in (*diagnosis.found, *diagnosis.tied))
    first = list(names)[:AHEAD]
    # Others follow while the person reads.
    assert [one.reference for one in learned.prepared[: len(first)]] == first
    for ahead in learned.prepared[: len(first)]:
        asked = Addition.to(learned).of(ahead.reference, diagnosis)
        comparison = ahead.seen.comparison
        assert document_of(comparison.model) == document_of(asked.result.model)
        assert comparison.points.held_out.figures == asked.after.held_out.figures


def test_trying_adding_and_removing_say_what_they_do(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    said: list[str] = []
    monkeypatch.setattr("geoerr.workbench.job.Advance.say", lambda _, what: said.append(what))
    session = tried(tmp_path, OwnFormula("Gap of x", "along", "x", "g*d/2"))
    assert "the fit with gap-of-x:x" in said
    assert said[-2:] == ["what chance finds", "what looks the same"]
    said.clear()
    wiring.do(session, "add", "backlash:x")
    settle(session)
    assert session.step.name == "+ backlash:x"
    assert "the fit with backlash:x" in said
    said.clear()
    wiring.do(session, "remove", "backlash:x")
    settle(session)
    assert session.step.name == "− backlash:x"
    assert "the fit without backlash:x" in said


def test_no_picture_offers_to_upload_itself(learned: Session) -> None:
    actions.compensate(learned, "part.gcode", PROGRAM, Wish({}))
    settle(learned)
    graphs = graphs_in([page(learned), *wiring.panels(learned).values()])
    assert {"volume", "residual"} <= {getattr(graph, "id", None) for graph in graphs}
    # And the fall, and both of the program.
    assert len(graphs) >= 5
    assert all(graph.config["showSendToCloud"] is False for graph in graphs)


def test_a_report_is_made_without_holding_up_the_page(learned: Session, monkeypatch: pytest.MonkeyPatch) -> None:
    free = threading.Event()

    def ask() -> None:
        with learned.lock:
            free.set()

    def write(path: Path, *_: object) -> None:
        threading.Thread(target=ask, daemon=True).start()
        path.write_text(f"free: {free.wait(5.0)}")

    monkeypatch.setattr("geoerr.workbench.reports.write_comparison_page", write)
    assert written(learned, "comparison") == "free: True"
    learned.reports = {}


def test_a_report_tells_how_far_it_is_and_can_be_stopped(learned: Session, monkeypatch: pytest.MonkeyPatch) -> None:
    begun, goes_on, told = threading.Event(), threading.Event(), []
    steps = model_page.made

    def made(makers, progress):
        def tell(done, total):
            progress(done, total)
            told.append(learned.job.progress if learned.job else None)
            begun.set()
            goes_on.wait(30.0)

        return steps(makers, tell)

    monkeypatch.setattr(model_page, "made", made)
    assert "Write" in texts(wiring.panels(learned)["reports"])
    wiring.do(learned, "report", "model")
    job = learned.job
    assert begun.wait(60.0)
    done, total = told[0]
    # The numbers are there, and the first section of the page.
    assert total / 2 < done < total
    assert "writing the report" in texts(status(learned))
    wiring.do(learned, "stop", "")
    goes_on.set()
    job.wait(30.0)
    # It ended where it next told its progress.
    assert len(told) == 1
    assert learned.reports == {}
    assert client_of(learned).get("/report/model", headers=HEADERS).status_code == 404


def test_a_report_is_kept_until_what_it_tells_changes(tmp_path: Path) -> None:
    session = loaded(tmp_path)
    assert "what is known of its errors" in written(session, "model")
    assert "Open: All that is known" in texts(wiring.panels(session)["reports"])
    wiring.do(session, "fit", "21")
    settle(session)
    assert session.reports == {}
    wiring.do(session, "report", "diagnosis")
    assert "nothing to report" in session.problems[actions.REPORT]


def test_what_is_no_number_is_said_beside_its_field_and_in_the_report(tmp_path: Path) -> None:
    session = fitted(tmp_path)
    actions.try_formula(session, OwnFormula("grows", "along", "x", "c*q*(t - 20)"))
    settle(session)
    wiring.do(session, "add-trial", "")
    assert "t" in session.model.conditions
    session.view.conditions["t"] = "noon"
    told = "'noon' is no number"
    assert told in texts(wiring.panels(session)["conditions"])
    # The pictures go on, without what needs the number.
    assert "needs conditions" in wiring.pictures(session, "")["captions"][0]
    wiring.do(session, "report", "model")
    assert told in texts(wiring.panels(session)["reports"])


def test_a_value_that_the_model_leaves_nothing_of_is_said_so() -> None:
    known = Parameter("c", "1/mm", 3.2e-8, 1e-9)
    assert tried_value(known) == value_words(known)
    assert tried_value(replace(known, value=-5.7e-20)) == "c cannot be told from what the model has already"


def test_figures_are_explained_where_they_stand_and_no_text_is_marked_up_for_a_terminal(learned: Session) -> None:
    told = texts(wiring.panels(learned)["given"])
    assert "What these figures mean" in told
    assert "held out: The same on passes that the fit did not see" in told
    assert sentence("line 3: `G1 X50`: left as it is") == "Line 3: “G1 X50”: left as it is."


def test_what_rounds_to_nothing_has_no_sign() -> None:
    assert [signed(value) for value in (-0.04, 0.04, 0.0, -1.26, 2.0)] == ["0.0", "0.0", "0.0", "−1.3", "+2.0"]


def graphs_in(component: object) -> list[dcc.Graph]:
    """Give the graphs of a page's part."""
    if isinstance(component, dcc.Graph):
        return [component]
    if isinstance(component, list | tuple):
        return [graph for one in component for graph in graphs_in(one)]
    # A graph has no parts, and is false.
    parts = getattr(component, "children", None)
    return [] if parts is None else graphs_in(parts)


def written(session: Session, name: str) -> str:
    """Write a report and open it."""
    wiring.do(session, "report", name)
    settle(session)
    answer = client_of(session).get(f"/report/{name}", headers=HEADERS)
    assert answer.status_code == 200
    return answer.get_data(as_text=True)


def client_of(session: Session) -> FlaskClient:
    """Give a client that has the token."""
    guard = Guard(PORT)
    client = make_app(session, guard).server.test_client()
    client.get(f"/?token={guard.token}", headers=HEADERS)
    return client


def test_reports_and_the_model_can_be_had(learned: Session) -> None:
    guard = Guard(PORT)
    client = make_app(learned, guard).server.test_client()
    headers = {"Host": f"127.0.0.1:{PORT}"}
    client.get(f"/?token={guard.token}", headers=headers)
    pages = (
        ("model", "what is known of its errors"),
        ("comparison", "model against measurements"),
        ("diagnosis", "what is missing"),
    )
    for path, words in pages:
        assert words in written(learned, path)
    assert client.get("/model.json", headers=headers).get_json()["schema"].startswith("geoerr-model")


def test_a_saved_session_is_the_same_again(tmp_path: Path) -> None:
    saved = tmp_path / "session.json"
    session = fitted(tmp_path, saved)
    session.view.variable, session.view.power = "d_x", 1.0
    marking.mark(session, "residual", {"range": {"x": [0.5, 1.5]}})
    wiring.do(session, "refer", "1")
    again = begin_session([], saved, threads=1)
    settle(again)
    assert [step.name for step in again.steps] == [step.name for step in session.steps]
    assert (again.current, again.reference) == (1, 1)
    assert (again.selected == session.selected).all()
    assert again.view == session.view
    assert again.step.figures == pytest.approx(dict(session.step.figures))
    table = tmp_path / "observations.csv"
    table.write_bytes(table.read_bytes() + b"\n")
    with pytest.raises(InputFileError, match="has changed"):
        begin_session([], saved)


def test_a_saved_session_says_again_what_is_missing_and_what_it_takes_to_see_it(tmp_path: Path) -> None:
    saved = tmp_path / "session.json"
    session = fitted(tmp_path, saved)
    wiring.do(session, "diagnose", "")
    settle(session)
    again = begin_session([], saved, threads=1)
    settle(again)
    assert again.told == session.told
    before, after = (texts(wiring.panels(one)["missing"]) for one in (session, again))
    kept = "Kept from the saved session, in words."
    assert kept not in before
    assert kept in after
    for words in ("Backlash of the drive", "Value:", "Certainty:", "To do:"):
        assert after.count(words) == before.count(words) > 0, words
    assert after.count("Show") == before.count("Show") + 1
    report = "the saved session has it in words only Look again"
    assert report in texts(wiring.panels(again)["reports"])
    # It takes a search, after which the pictures have it.
    sight = again.sight
    assert what_is_shown(again, "backlash:x") is None
    assert wiring.pin(again, "backlash:x", "") == "backlash:x"
    assert "looking for what is missing" in texts(status(again))
    settle(again)
    assert again.sight > sight
    assert again.told == session.told
    assert what_is_shown(again, "backlash:x") == pytest.approx(what_is_shown(session, "backlash:x"))
    assert kept not in texts(wiring.panels(again)["missing"])
    assert "Write" in texts(wiring.panels(again)["reports"])
    assert wiring.pin(again, "backlash:x", "backlash:x") == ""
    wiring.do(again, "add", "backlash:x")
    settle(again)
    assert again.step.name == "+ backlash:x"
    assert again.told is None
    assert "diagnosis" in json.loads(saved.read_text())
    assert json.loads(saved.read_text())["diagnosis"] is None


def test_a_session_from_before_diagnoses_were_kept_is_read_and_a_damaged_one_refused(tmp_path: Path) -> None:
    saved = tmp_path / "session.json"
    session = loaded(tmp_path, saved)
    wiring.do(session, "refer", "0")
    document = json.loads(saved.read_text())
    del document["diagnosis"]
    saved.write_text(json.dumps(document))
    again = begin_session([], saved, threads=1)
    settle(again)
    assert again.told is None
    saved.write_text(json.dumps(document | {"diagnosis": {"verdict": "fine"}}))
    with pytest.raises(InputFileError, match="is damaged"):
        begin_session([], saved)


def test_the_page_is_there_again_after_a_reload(learned: Session) -> None:
    guard = Guard(PORT)
    client = make_app(learned, guard).server.test_client()
    headers = {"Host": f"127.0.0.1:{PORT}"}
    client.get(f"/?token={guard.token}", headers=headers)
    parts = client.get("/_dash-layout", headers=headers).get_json()["props"]["children"]
    stores = {one["props"].get("id"): one["props"].get("data") for one in parts}
    assert stores["tick"] == learned.version
    assert "Backlash of the drive" in texts(wiring.panels(learned)["missing"])
    assert texts(page(learned))


def test_a_search_says_which_round_it_is_in_and_ends_there_when_it_is_stopped(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    session = loaded(tmp_path)
    told, goes_on, in_round = list[str](), threading.Event(), threading.Event()

    def spied(*arguments: object, on_step: Callable[[str], None], **options: object) -> object:
        def tell(what: str) -> None:
            on_step(what)
            told.append(what)
            if "round 1" in what:
                in_round.set()
                goes_on.wait(60.0)

        return diagnose(*arguments, on_step=tell, **options)

    monkeypatch.setattr(actions, "diagnose", spied)
    wiring.do(session, "fit", "21")
    settle(session)
    wiring.do(session, "diagnose", "")
    job = session.job
    assert in_round.wait(60.0)
    said = texts(status(session))
    assert "looking for what is missing: search 1, round 1: " in said
    assert "candidates" in said
    assert job.progress[0] > 0
    wiring.do(session, "stop", "")
    goes_on.set()
    job.wait(60.0)
    # It ended before the next step.
    assert "round 1" in told[-1]
    assert sum("round 1" in what for what in told) == 1
    assert session.diagnosis is None


def test_work_can_be_stopped_and_then_changes_nothing(tmp_path: Path) -> None:
    session = loaded(tmp_path)
    goes_on, steps = threading.Event(), list(session.steps)

    def work(advance):
        advance(1, 2)
        goes_on.wait(30.0)
        advance(2, 2)
        return lambda: pytest.fail("a stopped job was applied")

    session.begin("long work", actions.MISSING, work)
    job = session.job
    assert "long work" in texts(status(session))
    wiring.do(session, "diagnose", "")
    assert "long work is still under way" in session.problems[actions.MISSING]
    wiring.do(session, "stop", "")
    goes_on.set()
    job.wait(30.0)
    assert session.job is None
    assert session.steps == steps
