"""The bar of a verb: only where a person watches, with the step in words where a verb says it."""

from __future__ import annotations

import io
import re
import sys

import pytest

from geoerr.cli.progress import TimeLeft, progress_bar


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


def test_times_and_counts_have_their_room_beside_a_long_step(monkeypatch: pytest.MonkeyPatch) -> None:
    terminal = watched_terminal(monkeypatch)
    monkeypatch.setenv("COLUMNS", "80")
    monkeypatch.setattr(TimeLeft, "__str__", lambda _: "≥ 12 s left")
    with progress_bar("diagnose", says_steps=True) as advance:
        advance(27, 29)
        advance.say("search 2, round 4: each of what was found beside the others, beside cross-coupling:y*x")
    shown = re.sub(r"\x1b\[[0-9;?]*[a-zA-Z]", "", terminal.getvalue())
    (line,) = {line for line in re.split(r"[\r\n]+", shown) if "search 2" in line}
    assert re.search(r"^diagnose \S+ 27/29 0:00:0\d ≥ 12 s left search 2, round 4: \S.*…$", line)
    assert len(line) <= 80


def test_time_left_is_as_rough_as_it_says() -> None:
    now = [100.0]
    left = TimeLeft(lambda: now[0])
    left.tell(0, 2)
    assert str(left) == ""
    now[0] += 30.0
    # One step took 30 s, and there are two more at least.
    left.tell(1, 3)
    assert str(left) == "≥ 60 s left"
    now[0] += 20.0
    assert str(left) == "≥ 40 s left"
    now[0] += 50.0
    assert str(left) == ""
    now[0] += 300.0
    # No more steps came: those that are left are all.
    left.tell(2, 3)
    assert str(left) == "≈ 3 min left"
    left.tell(3, 3)
    assert str(left) == ""


def test_nobody_is_told_where_nobody_watches(monkeypatch: pytest.MonkeyPatch) -> None:
    terminal = watched_terminal(monkeypatch)
    with progress_bar("diagnose", quiet=True, says_steps=True) as advance:
        advance(1, 2)
        advance.say("anything")
    monkeypatch.setattr(terminal, "isatty", lambda: False)
    with progress_bar("fit") as advance:
        advance(1, 2)
    assert terminal.getvalue() == ""
