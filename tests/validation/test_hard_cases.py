"""The table of the tests that take long is of those that there are, and all of them passed."""

from __future__ import annotations

import re
from pathlib import Path

from validation.hard_cases import RESULTS, TESTS

_ROW = re.compile(r"^\| `(\w+\.py)::(\w+)(?:\[.*\])?` \| .* \| (\w+) \|$", re.MULTILINE)


def named_in(path: Path) -> set[tuple[str, str]]:
    """Give the tests of a file."""
    names = re.findall(r"^def (test_\w+)\(", path.read_text(encoding="utf-8"), re.MULTILINE)
    return {(path.name, name) for name in names}


def test_every_one_is_in_the_table_and_passed() -> None:
    rows = _ROW.findall(RESULTS.read_text(encoding="utf-8"))
    files = list(TESTS.glob("test_*.py"))
    assert files
    assert {(name, test) for name, test, _ in rows} == set().union(*map(named_in, files))
    assert {outcome for _, _, outcome in rows} == {"passed"}
