"""One progress bar for every verb: on standard error, only where a person watches."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any


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


@contextmanager
def progress_bar(title: str, quiet: bool = False, *, says_steps: bool = False) -> Iterator[Advance]:
    """Show a bar with counts while the block runs, and time left; give what advances it.

    Where it `says_steps` their number is not known beforehand: what comes next stands in the place of the time left.
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

    last = (
        TextColumn("{task.description}", markup=False, table_column=Column(no_wrap=True, overflow="ellipsis"))
        if says_steps
        else TimeRemainingColumn()
    )
    columns = (
        TextColumn(title),
        BarColumn(20 if says_steps else 40),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        last,
    )
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("", total=None)
        yield Advance(lambda **shown: bar.update(task, **shown))
