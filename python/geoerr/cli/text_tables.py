"""Text for the terminal: sentences and tables of eighty columns, numbers flush right, readable without colour."""

from __future__ import annotations

import os
import sys
import textwrap
from collections.abc import Iterable, Sequence

import typer

# What a verb writes is no wider, whether a person watches or not: pages show what a terminal does.
WIDTH = 80
# What a library lays out has no width to fit where nobody watches (a pipe, a file).
_WIDTH_OF_A_PIPE = 160
# Below it lines of numbers would fall to pieces.
_LEAST_WIDTH = 40
# A line to copy is not broken.
_TO_COPY = "geoerr "


def wrapped(text: str, indent: str = "") -> list[str]:
    """Break a sentence into lines, the first indented, the next ones more."""
    # A number stays with its sign, its error and its unit.
    for tied in (" µm", " mm", " ± ", " = "):
        text = text.replace(tied, tied.replace(" ", "\u00a0"))
    return [line.replace("\u00a0", " ") for line in _broken(text, WIDTH, indent)]


def _broken(text: str, width: int, indent: str) -> list[str]:
    return textwrap.wrap(
        text,
        width,
        initial_indent=indent,
        subsequent_indent=indent + "  ",
        break_on_hyphens=False,
        # A path or an address is whole, or of no use.
        break_long_words=False,
    )


def named_row(name: str, width: int, cells: str, indent: str = "") -> list[str]:
    """Give a row of a table; a name that is wider than its column has a line of its own."""
    if len(name) < width:
        return [f"{indent}{name:<{width}}{cells}".rstrip()]
    return [f"{indent}{name}", f"{indent}{'':<{width}}{cells}".rstrip()]


def say(text: str, *, is_talk: bool = False) -> None:
    """Print on standard output, or beside it what `is_talk`.

    Where the width is known (a terminal, or COLUMNS says so), lines with more go on below, indented.
    """
    width = _width_to_fit(is_talk=is_talk)
    lines = text.split("\n")
    if width is not None:
        lines = [part for line in lines for part in _folded(line, width)]
    typer.echo("\n".join(lines), err=is_talk)


def _folded(line: str, width: int) -> list[str]:
    words = line.lstrip(" ")
    if len(line) <= width or words.startswith(_TO_COPY):
        return [line]
    return _broken(words, width, " " * (len(line) - len(words)))


def _width_to_fit(*, is_talk: bool) -> int | None:
    stated = os.environ.get("COLUMNS", "")
    if stated.isdecimal() and int(stated):
        return max(int(stated), _LEAST_WIDTH)
    stream = sys.stderr if is_talk else sys.stdout
    if stream is None or not stream.isatty():
        return None
    try:
        columns = os.get_terminal_size(stream.fileno()).columns
    except (OSError, ValueError):
        columns = 0
    return max(columns or WIDTH, _LEAST_WIDTH)


def print_table(header: Sequence[str], rows: Iterable[Sequence[str]], *, n_text_columns: int = 1) -> None:
    """Print a table on standard output; the first `n_text_columns` are flush left, the others right."""
    # It takes longer to load than many a verb to run.
    from rich.console import Console
    from rich.table import Table

    table = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0), header_style="bold")
    for index, title in enumerate(header):
        table.add_column(title, justify="left" if index < n_text_columns else "right")
    for row in rows:
        table.add_row(*row)
    Console(highlight=False, width=_width_to_fit(is_talk=False) or _WIDTH_OF_A_PIPE).print(table)
