"""Sets on which a diagnosis once went wrong, and that take long: whether they are told right.

    python -m validation.hard_cases

Each is a test of `tests/hard_cases`, which `pytest` alone leaves out: this runs them and writes what came out. Exit
status as pytest's.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

import pytest
from validation.hidden_effects.tables import table

RESULTS = Path(__file__).with_name("hard_cases.md")
TESTS = Path(__file__).parents[1] / "tests" / "hard_cases"


class Outcomes:
    """What pytest runs, in words, and what comes of it."""

    def __init__(self) -> None:
        self.rows: list[list[str]] = []
        self._words: dict[str, str] = {}

    def pytest_collection_finish(self, session: pytest.Session) -> None:
        """Keep what each test is of: what its own text says first, or its name."""
        for item in session.items:
            assert isinstance(item, pytest.Function)
            text = item.function.__doc__ or item.originalname.removeprefix("test_").replace("_", " ")
            self._words[item.nodeid] = text.strip().splitlines()[0]

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Add a row for a test that has run, or that could not."""
        if report.when == "call" or not report.passed:
            name = report.nodeid.rpartition("/")[2]
            self.rows.append([f"`{name}`", self._words[report.nodeid], report.outcome])


def main(arguments: Sequence[str] = ()) -> int:
    """Run them, and write the table."""
    outcomes = Outcomes()
    status = pytest.main(["-q", str(TESTS), *arguments], plugins=[outcomes])
    n_right = sum(outcome == "passed" for *_, outcome in outcomes.rows)
    text = "# Hard cases\n\n`python -m validation.hard_cases`\n\n"
    text += f"Told right: {n_right} of {len(outcomes.rows)}.\n\n"
    RESULTS.write_text(text + table(["test", "of", "outcome"], outcomes.rows), encoding="utf-8")
    return int(status)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
