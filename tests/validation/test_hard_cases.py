"""The table of the tests that take long is of those that there are, and all of them passed."""

from __future__ import annotations

import re
from pathlib import Path

from validation.hard_cases import RESULTS, TESTS

_ROW = re.compile(r"^\| `(\w+\.py)::(\w+)(?:\[.*\])?` \| .* \| (\w+) \|$", re.MULTILINE)


def marked_in(path: Path) -> set[tuple[str, str]]:
    """Give the tests of a file that has the mark."""
    text = path.read_text(encoding="utf-8")
    has_mark = "\npytestmark = pytest.mark.hard_case\n" in text
    return {(path.name, name) for name in re.findall(r"^def (test_\w+)\(", text, re.MULTILINE)} if has_mark else set()


def test_every_one_is_in_the_table_and_passed() -> None:
    rows = _ROW.findall(RESULTS.read_text(encoding="utf-8"))
    assert {(name, test) for name, test, _ in rows} == set().union(*map(marked_in, TESTS.glob("test_*.py")))
    assert {outcome for _, _, outcome in rows} == {"passed"}
