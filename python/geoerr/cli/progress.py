"""One progress bar for every verb: on standard error, only where a person watches."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

# Less is no second; more is told in minutes.
_LEAST_TOLD_S, _MOST_IN_SECONDS_S = 0.5, 99.5


class Advance:
    """What a verb tells of its work.

    Parameters
    ----------
    update
        Called with what the bar shows from now on; None where nobody watches.
    """

    def __init__(self, update: Callable[..., Any] | None = None) -> None:
        self._update = update or (lambda **_: None)

    def __call__(self, done: int, total: int) -> None:
        """Tell the steps done and their number."""
        self._update(completed=done, total=total)

    def say(self, what: str) -> None:
        """Tell what comes next."""
        self._update(description=what)


class TimeLeft:
    """How long work goes on whose steps become more as it goes, as its text: from the steps done, or nothing.

    A step is taken to last as long as those before it did on average. `≥` stands where the last step made the steps
    more: there are at least so many left, and `≈` where it did not. While a step lasts longer than what is left by
    that, nothing can be said.

    Parameters
    ----------
    now_s
        A clock.
    """

    def __init__(self, now_s: Callable[[], float] = time.monotonic) -> None:
        self._now_s = now_s
        self._began_s = self._told_s = now_s()
        self._done = self._total = 0
        self._is_more = False

    def tell(self, done: int, total: int) -> None:
        """Tell the steps done and their number."""
        self._is_more = total > self._total
        self._done, self._total, self._told_s = done, total, self._now_s()

    def __str__(self) -> str:
        if not 0 < self._done < self._total:
            return ""
        left_s = (self._told_s - self._began_s) * (self._total - self._done) / self._done
        left_s -= self._now_s() - self._told_s
        if left_s < _LEAST_TOLD_S:
            return ""
        size = f"{left_s / 60.0:.0f} min" if left_s >= _MOST_IN_SECONDS_S else f"{left_s:.0f} s"
        return f"{'≥' if self._is_more else '≈'} {size} left"


@contextmanager
def progress_bar(title: str, quiet: bool = False, *, says_steps: bool = False) -> Iterator[Advance]:
    """Show a bar with counts while the block runs, and time left; give what advances it.

    Where it `says_steps` their number is not known beforehand: the time left is as rough as `TimeLeft` says, and
    what comes next stands behind it.
    """
    if quiet or not sys.stderr.isatty():
        yield Advance()
        return
    # Rich takes longer to load than many a verb to run.
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )
    from rich.table import Column

    # What is said has the room that counts and times leave.
    rest = Column(no_wrap=True, overflow="ellipsis", ratio=1)
    last = (
        (TextColumn("{task.fields[left]}"), TextColumn("{task.description}", markup=False, table_column=rest))
        if says_steps
        else (TimeRemainingColumn(),)
    )
    columns = (
        TextColumn(title),
        BarColumn(10 if says_steps else 40),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        *last,
    )
    with Progress(*columns, console=Console(stderr=True), transient=True, expand=says_steps) as bar:
        left = TimeLeft()
        task = bar.add_task("", total=None, left=left)

        def update(**shown: Any) -> None:
            if "completed" in shown:
                left.tell(shown["completed"], shown["total"])
            bar.update(task, **shown)

        yield Advance(update)
