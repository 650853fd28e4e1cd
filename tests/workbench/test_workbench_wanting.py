"""What the page says where something has not been given yet, or cannot be shown."""

from __future__ import annotations

import re
from importlib import resources
from pathlib import Path

import pytest

pytest.importorskip("dash")

from workbench_scenes import settle, texts, write_scene

from geoerr.workbench import actions, wiring
from geoerr.workbench.server import begin_session
from geoerr.workbench.session import Session

LENGTHS = b"feature,x1,y1,z1,x2,y2,z2,measured\ngap,50,50,20,90,50,20,40.006\nbore,50,50,20,130,50,20,80.008\n"


def said(session: Session) -> str:
    """Give what stands in the place of the volume, in one line; nothing is drawn there or beside it."""
    drawn = wiring.pictures(session, "")
    for name in ("volume", "residual"):
        assert not any(trace.visible for trace in drawn[name].data)
        assert drawn[name].layout.xaxis.visible is False
    return drawn["volume"].layout.annotations[0].text.replace("<br>", " ")


def test_the_page_says_what_is_wanting_until_nothing_is(tmp_path: Path) -> None:
    machine, table = write_scene(tmp_path)
    session = begin_session([], None, threads=1)
    assert "machine.toml" in said(session)
    assert "measured points" in said(session)
    assert texts(wiring.panels(session)["given"]).count("None yet.") == 3
    actions.take_dropped(session, ["machine.toml"], [machine.read_bytes()])
    settle(session)
    assert "machine.toml" not in said(session)
    # Why nothing can be fitted stands where the buttons are.
    assert said(session) in texts(wiring.panels(session)["given"])
    assert "Needs a machine and measured points" in texts(wiring.panels(session)["missing"])
    actions.take_dropped(session, ["observations.csv"], [table.read_bytes()])
    settle(session)
    assert len(wiring.pictures(session, "")["volume"].data[0].x) > 0
    assert "Add measured points" not in texts(wiring.panels(session)["given"])
    # Without the data their pictures are gone, too.
    wiring.do(session, "put-away", "observations.csv")
    settle(session)
    assert "measured points" in said(session)


def test_of_lengths_alone_the_page_says_what_they_tell_and_what_not(tmp_path: Path) -> None:
    machine, _ = write_scene(tmp_path)
    lengths = tmp_path / "lengths.csv"
    lengths.write_bytes(LENGTHS)
    session = begin_session([machine, lengths], None, threads=1)
    settle(session)
    assert "geoerr diagnose take lengths alone" in said(session)
    told = texts(wiring.panels(session)["given"])
    assert "geoerr diagnose take lengths alone" in told
    residual = f"{session.step.figures['rmse_um']:.1f}"
    _, history = told.split("Models so far")
    assert "Residual, µm" in history
    assert residual in history


def test_the_head_of_the_page_wraps_where_the_window_is_narrow() -> None:
    """Name, links and what is under way in one row were wider than a phone, which then showed all of it smaller."""
    look = (resources.files("geoerr.workbench") / "assets" / "workbench.css").read_text(encoding="utf-8")
    narrow = look.partition("@media (max-width: 1100px)")[2]
    assert re.search(r"header \{[^}]*flex-wrap: wrap", narrow)
