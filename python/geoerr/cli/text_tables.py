"""Tables on the terminal: columns that fit, numbers flush right, readable without colour."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Sequence

from rich.console import Console
from rich.table import Table

# Where nobody watches (a pipe, a file) there is no width to fit.
_WIDTH_OF_A_PIPE = 160


def print_table(header: Sequence[str], rows: Iterable[Sequence[str]], *, n_text_columns: int = 1) -> None:
    """Print a table on standard output; the first `n_text_columns` are flush left, the others right."""
    table = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0), header_style="bold")
    for index, title in enumerate(header):
        table.add_column(title, justify="left" if index < n_text_columns else "right")
    for row in rows:
        table.add_row(*row)
    Console(highlight=False, width=None if sys.stdout.isatty() else _WIDTH_OF_A_PIPE).print(table)
