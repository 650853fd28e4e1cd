"""What reaches the server when a button is clicked, as a browser sends it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("dash")

from dash import html
from workbench_scenes import settle, texts, write_scene

from geoerr.workbench import wiring
from geoerr.workbench.app import make_app
from geoerr.workbench.security import Guard
from geoerr.workbench.server import begin_session
from geoerr.workbench.session import Session

PORT = 8126
HEADERS = {"Host": f"127.0.0.1:{PORT}"}


def buttons(component: Any) -> list[html.Button]:
    """Give the buttons of a page's part."""
    if isinstance(component, list | tuple):
        return [found for one in component for found in buttons(one)]
    found = [component] if isinstance(component, html.Button) else []
    return found + buttons(getattr(component, "children", None) or [])


def click(session: Session, button: html.Button) -> Any:
    """Click it, and give the answer: a browser writes ids as JavaScript does, which leaves letters as they are."""
    guard = Guard(PORT)
    app = make_app(session, guard)
    client = app.server.test_client()
    client.get(f"/?token={guard.token}", headers=HEADERS)
    output, inputs = next(
        (name, one["inputs"])
        for name, one in app.callback_map.items()
        if any('"put-away"' in str(asked["id"]) for asked in one["inputs"])
    )
    sent: list[list[dict[str, Any]]] = []
    for one in inputs:
        is_its = json.loads(one["id"])["do"] == button.id["do"]
        sent.append([{"id": button.id, "property": "n_clicks", "value": 1}] if is_its else [])
    name = json.dumps(button.id, sort_keys=True, separators=(",", ":"), ensure_ascii=False)
    tick = {"id": "tick", "property": output.strip(".").rpartition(".")[2]}
    asked = {"output": output, "outputs": tick, "inputs": sent, "changedPropIds": [f"{name}.n_clicks"]}
    answer = client.post("/_dash-update-component", json=asked, headers=HEADERS)
    assert answer.status_code in (200, 204), answer.get_data(as_text=True)
    return answer.get_json(silent=True)


@pytest.mark.parametrize("name", ["Größe.csv", "测量 №1.csv", "100%25 it's.csv"])
def test_a_file_of_any_name_is_put_away_by_its_button(tmp_path: Path, name: str) -> None:
    machine, table = write_scene(tmp_path)
    session = begin_session([machine, table.rename(tmp_path / name)], None, threads=1)
    settle(session)
    (away,) = [one for one in buttons(wiring.panels(session)["given"]) if one.title == f"Do without {name}"]
    click(session, away)
    settle(session)
    assert [one.name for one in session.files] == ["machine.toml"]


def test_what_nobody_has_foreseen_is_said_on_the_page(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    session = begin_session(write_scene(tmp_path), None, threads=1)
    settle(session)

    def slip(*_: object) -> None:
        raise ValueError("a slip of ours")

    monkeypatch.setattr(wiring, "do", slip)
    (away,) = [one for one in buttons(wiring.panels(session)["given"]) if one.id["do"] == "put-away"]
    version = session.version
    answer = click(session, away)
    # The page is asked to draw its panels anew.
    assert answer["sideUpdate"]["tick"]["data"] == session.version > version
    told = texts(wiring.panels(session)["given"])
    assert "This went wrong inside geoerr (ValueError: a slip of ours)." in told
    assert "please report it" in told
