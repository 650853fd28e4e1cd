"""What stands in bold in the summary of validation/README.md stands in the table that it is of."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

VALIDATION = Path(__file__).parents[2] / "validation"
_ROW = re.compile(r"^\| \[[\w.]+\]\((?P<table>\w+\.md)\) \| (?P<said>.*) \|$", re.MULTILINE)
_BOLD = re.compile(r"\*\*(.+?)\*\*")


def summary() -> dict[str, list[str]]:
    """Give the figures in bold by the table that they are of."""
    text = (VALIDATION / "README.md").read_text(encoding="utf-8")
    section = text.partition("\n## What came out\n")[2].partition("\n## ")[0]
    return {row["table"]: _BOLD.findall(row["said"]) for row in _ROW.finditer(section)}


def test_every_table_is_there() -> None:
    assert set(summary()) == {path.name for path in VALIDATION.glob("*.md")} - {"README.md"}


@pytest.mark.parametrize("table", sorted(summary()))
def test_figures_stand_in_their_table(table: str) -> None:
    figures = summary()[table]
    assert figures
    text = (VALIDATION / table).read_text(encoding="utf-8")
    missing = [figure for figure in figures if not stands_in(figure, text)]
    assert not missing


def stands_in(figure: str, text: str) -> bool:
    """Tell whether a figure is there by itself, and not as a part of another number."""
    return re.search(rf"(?<![\w./]){re.escape(figure)}(?![\w/]|\.\d)", text) is not None


def test_a_part_of_a_number_is_no_figure() -> None:
    assert stands_in("8", "| both | 200 | 8 | 15 |")
    assert stands_in("9.5", "and 9.5. Then")
    assert not any(stands_in("8", text) for text in ("18", "8.1", "0.8", "8/50", "5/8"))
