"""One progress bar for every verb: on standard error, only where a person watches."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager

# Called with what is done and the total.
Advance = Callable[[int, int], None]


@contextmanager
def progress_bar(title: str, quiet: bool = False) -> Iterator[Advance]:
    """Show a bar with counts and time left while the block runs; give the function that advances it."""
    if quiet or not sys.stderr.isatty():
        yield lambda done, total: None
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

    columns = (TextColumn(title), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(), TimeRemainingColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(title, total=None)
        yield lambda done, total: bar.update(task, completed=done, total=total)
