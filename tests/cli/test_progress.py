"""The bar of a verb: only where a person watches, with the step in words where a verb says it."""

from __future__ import annotations

import io
import re
import sys

import pytest

from geoerr.cli.progress import progress_bar


class Terminal(io.StringIO):
    """Standard error that a person watches."""

    def isatty(self) -> bool:
        return True


def watched_terminal(monkeypatch: pytest.MonkeyPatch) -> Terminal:
    """Put it in the place of standard error, which no fixture could: it is another one when the test begins."""
    watched = Terminal()
    monkeypatch.setattr(sys, "stderr", watched)
    monkeypatch.setenv("COLUMNS", "120")
    monkeypatch.setenv("TERM", "xterm")
    return watched


def test_the_step_stands_beside_the_count(monkeypatch: pytest.MonkeyPatch) -> None:
    terminal = watched_terminal(monkeypatch)
    with progress_bar("diagnose", says_steps=True) as advance:
        advance(3, 5)
        advance.say("search 1, round 2: the form of [backlash]:x")
    shown = re.sub(r"\x1b\[[0-9;?]*[a-zA-Z]", "", terminal.getvalue())
    assert "diagnose" in shown
    assert "3/5" in shown
    assert "search 1, round 2: the form of [backlash]:x" in shown


def test_nobody_is_told_where_nobody_watches(monkeypatch: pytest.MonkeyPatch) -> None:
    terminal = watched_terminal(monkeypatch)
    with progress_bar("diagnose", quiet=True, says_steps=True) as advance:
        advance(1, 2)
        advance.say("anything")
    monkeypatch.setattr(terminal, "isatty", lambda: False)
    with progress_bar("fit") as advance:
        advance(1, 2)
    assert terminal.getvalue() == ""
