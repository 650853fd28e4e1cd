"""What a diagnosis says to do, where a user's own effect may say nothing."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from geoerr.cli.diagnose_text import remedy_lines


@pytest.mark.parametrize(
    ("cause", "remedy", "said"),
    [
        ("play", "take it up", ["    cause: play", "    to do: take it up"]),
        ("", "take it up", ["    to do: take it up"]),
        ("", "", []),
    ],
)
def test_only_what_is_known_is_said(cause: str, remedy: str, said: list[str]) -> None:
    effect = SimpleNamespace(cause=cause, remedy=remedy)
    named: Any = SimpleNamespace(effect=effect, p_value=0.001, is_rig=False, in_model=False, frame_words=None)
    assert list(remedy_lines(named, "the cameras"))[1:] == said
