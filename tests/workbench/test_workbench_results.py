"""What stands on the page is so now: results of programs, refusals, what the residual is drawn over, other pages."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("dash")

from plotly.io.json import to_json_plotly
from workbench_scenes import PROGRAM, loaded, settle, texts

from geoerr.workbench import actions, wiring
from geoerr.workbench.app import make_app
from geoerr.workbench.program import Wish
from geoerr.workbench.security import Guard
from geoerr.workbench.session import Session
from geoerr.workbench.view import View

PORT = 8127
HEADERS = {"Host": f"127.0.0.1:{PORT}"}


def beat(session: Session, tick: int) -> Any:
    """Ask for news as a page does that has seen the session at `tick`."""
    guard = Guard(PORT)
    app = make_app(session, guard)
    client = app.server.test_client()
    client.get(f"/?token={guard.token}", headers=HEADERS)
    output = next(name for name, one in app.callback_map.items() if one["inputs"][0]["id"] == "beat")
    news = [part.rpartition(".") for part in output.strip(".").split("...")]
    asked = {
        "output": output,
        "outputs": [{"id": name, "property": what} for name, _, what in news],
        "inputs": [{"id": "beat", "property": "n_intervals", "value": 1}],
        "state": [{"id": "tick", "property": "data", "value": tick}],
        "changedPropIds": ["beat.n_intervals"],
    }
    answer = client.post("/_dash-update-component", json=asked, headers=HEADERS)
    return (answer.get_json(silent=True) or {}).get("response", {})


def test_a_second_page_learns_at_rest_what_the_first_one_did(tmp_path: Path) -> None:
    session = loaded(tmp_path)
    seen = session.version
    at_rest_ms = wiring.panels(session)["beat"]
    assert beat(session, seen) == {}
    wiring.do(session, "fit", "12")
    assert 0 < wiring.panels(session)["beat"] < at_rest_ms
    settle(session)
    assert beat(session, seen)["tick"]["data"] == session.version


def test_that_work_begins_or_is_stopped_draws_no_panel_anew(tmp_path: Path) -> None:
    """Buttons that would begin other work are marked, and the page itself switches them off."""
    session = loaded(tmp_path)
    before, shown = wiring.drawn_panels(session), session.content
    wiring.do(session, "fit", "12")
    during, drawn = session.content, wiring.drawn_panels(session)
    wiring.do(session, "stop", "")
    assert (during, session.content) == (shown, shown)
    assert to_json_plotly(drawn) == to_json_plotly(before)
    assert '"className":"rests"' in to_json_plotly(before["given"]).replace(" ", "")
    # What began earlier work said of itself goes when other work begins: that is drawn.
    session.show_problem(actions.DATA, "no")
    wiring.do(session, "fit", "12")
    assert session.content > shown
    settle(session)
    assert to_json_plotly(wiring.drawn_panels(session)) != to_json_plotly(before)


def test_a_program_that_nothing_is_corrected_of_says_why_and_is_no_download(tmp_path: Path) -> None:
    session = loaded(tmp_path)
    actions.compensate(session, "part.gcode", PROGRAM, Wish({}))
    settle(session)
    assert session.program.content == PROGRAM
    told = texts(wiring.panels(session)["program"])
    assert "Nothing was corrected: this is a machine without errors; fit the 21 errors first." in told
    assert "Download" not in told


@pytest.mark.parametrize(
    ("program", "why"),
    [
        (b"", "the program has no moves."),
        (b"; nothing\nM3 S100\n", "the program has no moves."),
        (b"G21\nG91\nG1 X10 Y10 Z1 F600\nG1 X100\n", "where the program starts is not known"),
        (b"G21\nG90\nG1 X50\nG1 X60\n", "where the program starts is not known"),
        (b"G21\nG90\nG2 X60 Y60 I5 J5\n", "none of its moves is of a kind that is corrected."),
    ],
)
def test_a_program_without_a_known_path_has_no_figures_and_the_true_reason(
    tmp_path: Path, program: bytes, why: str
) -> None:
    session = loaded(tmp_path)
    wiring.do(session, "fit", "12")
    settle(session)
    actions.compensate(session, "part.gcode", program, Wish({}, passes_unsupported=True))
    settle(session)
    told = texts(wiring.panels(session)["program"])
    assert f"Nothing was corrected: {why}" in told
    assert "rounds to nothing" not in told
    assert "largest distance from the programmed path – – distance from it, rms – – moves" in told


def test_the_one_place_of_a_program_is_corrected_and_told_to_be_no_path(tmp_path: Path) -> None:
    session = loaded(tmp_path)
    wiring.do(session, "fit", "12")
    settle(session)
    actions.compensate(session, "part.gcode", b"G21\nG90\nG1 X50 Y50 Z50\n", Wish({}))
    settle(session)
    told = texts(wiring.panels(session)["program"])
    assert "Download part-corrected.gcode" in told
    assert "There is no path to compare" in told
    assert "largest distance from the programmed path – – distance from it, rms – – moves 1 1" in told


def test_what_was_refused_stands_alone_and_goes_with_the_data_that_it_was_refused_with(tmp_path: Path) -> None:
    session = loaded(tmp_path)
    wiring.do(session, "fit", "12")
    settle(session)
    actions.compensate(session, "part.gcode", PROGRAM, Wish({}))
    settle(session)
    assert "Download part-corrected.gcode" in texts(wiring.panels(session)["program"])
    actions.compensate(session, "far.gcode", PROGRAM.replace(b"X250", b"X9000"), Wish({}))
    session.job.wait(60.0)
    told = texts(wiring.panels(session)["program"])
    assert "far.gcode" in told
    assert "Download" not in told
    actions.take_dropped(session, ["more.csv"], [(tmp_path / "observations.csv").read_bytes()])
    session.job.wait(60.0)
    assert session.problems == {}


def test_the_residual_is_drawn_over_what_it_follows_now_unless_a_person_has_chosen() -> None:
    view = View()
    view.settle(("x", "y", "d_x"), ("y", "x"), ("length",), ())
    assert view.variable == "y"
    view.settle(("x", "y", "d_x"), ("d_x", "x"), ("length",), ())
    assert view.variable == "d_x"
    view.variable = "x"
    view.settle(("x", "y", "d_x"), ("y",), ("length",), ())
    assert view.variable == "x"
    again = View.from_document(view.to_document())
    again.settle(("x", "y", "d_x"), ("d_x",), ("length",), ())
    assert again.variable == "x"
    again.settle(("y", "d_x"), ("d_x",), ("length",), ())
    assert again.variable == "d_x"
