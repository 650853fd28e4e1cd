"""`geoerr workbench`: what it prints before the page is served."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any

import pytest
from typer.testing import CliRunner

from geoerr.cli.main import app
from geoerr.workbench import server

URL = "http://127.0.0.1:5000/?token=abc"


@pytest.mark.parametrize("flags", [[], ["--json"]])
def test_the_address_is_all_of_standard_output(monkeypatch: pytest.MonkeyPatch, flags: list[str]) -> None:
    def serve(session: Any, port: int, ready: Callable[[str], None]) -> None:
        ready(URL)

    monkeypatch.setattr(server, "serve", serve)
    done = CliRunner().invoke(app, ["workbench", "--no-open", *flags])
    assert done.exit_code == 0, done.output
    assert (json.loads(done.stdout) if flags else done.stdout) == ({"url": URL} if flags else f"{URL}\n")
