"""The table of the tests that take long is of those that there are, and all of them passed."""

from __future__ import annotations

import re
from pathlib import Path

from validation.hard_cases import RESULTS, TESTS

_ROW = re.compile(r"^\| `(\w+\.py)::(\w+)(?:\[.*\])?` \| .* \| (\w+) \|$", re.MULTILINE)


def marked(path: Path) -> bool:
    return "hard_case" in path.read_text(encoding="utf-8") and path.name != Path(__file__).name


def test_every_one_is_in_the_table_and_passed() -> None:
    rows = _ROW.findall(RESULTS.read_text(encoding="utf-8"))
    assert {name for name, _, _ in rows} == {path.name for path in TESTS.glob("test_*.py") if marked(path)}
    assert all(f"def {test}(" in (TESTS / name).read_text(encoding="utf-8") for name, test, _ in rows)
    assert {outcome for _, _, outcome in rows} == {"passed"}
