"""What a diagnosis does next, told step by step: how many steps there are depends on what is found."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypeAlias

from geoerr.summaries import counted, listed

# Called with what is done and the total.
Progress: TypeAlias = Callable[[int, int], None]
# Called with what comes next, in words.
OnStep: TypeAlias = Callable[[str], None]

# However little is found, the step that begins is followed by another: words are found for the result.
_AT_LEAST = 2


class Steps:
    """Tells what comes next.

    Parameters
    ----------
    progress
        Called with the steps done and the least number that there will be, which grows.
    on_step
        Called with what comes next. What either raises ends the work between two steps.
    """

    def __init__(self, progress: Progress | None = None, on_step: OnStep | None = None) -> None:
        self._progress = progress or (lambda done, total: None)
        self._on_step = on_step or (lambda what: None)
        self._done = 0

    def next(self, what: str) -> None:
        """Say what comes next."""
        self._progress(self._done, self._done + _AT_LEAST)
        self._on_step(what)
        self._done += 1

    def end(self) -> None:
        """Say that all is done."""
        self._progress(self._done, self._done)


class RoundSteps:
    """Tells the steps of searches that follow each other, by search and round, and what was found meanwhile.

    Parameters
    ----------
    steps
        Of the whole work.
    """

    def __init__(self, steps: Steps) -> None:
        self._steps = steps
        self._search, self._round, self._beside = 0, 0, ""

    def begin_search(self) -> None:
        """Begin another search: its rounds are counted anew."""
        self._search, self._round = self._search + 1, 0

    def begin_round(self, found: Sequence[str], n_candidates: int, n_curves: int) -> None:
        """Begin another round, beside what was found so far."""
        self._round += 1
        self._beside = f", beside {listed(found)}" if found else ""
        candidates, curves = (
            counted(number, name, grouped=True) for number, name in ((n_candidates, "candidate"), (n_curves, "curve"))
        )
        self.next(f"{candidates} and {curves} without a name")

    def next(self, what: str) -> None:
        """Say what comes next in the round."""
        self._steps.next(f"search {self._search}, round {self._round}: {what}{self._beside}")
