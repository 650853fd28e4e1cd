"""CSV text with quotation marks: cells as RFC 4180 has them, and the row of a mark that makes them unreadable."""

from __future__ import annotations

import csv
import io
import re
from pathlib import Path

import polars as pl

from geoerr.errors import InputFileError

# Cells with all of their marks around them and each one inside doubled, or without any.
_WELL_QUOTED = re.compile(
    rb'(?:(?:"[^"]*+"(?:"[^"]*+")*+|[^",\r\n]*+)(?:,|\r?\n))*+(?:"[^"]*+"(?:"[^"]*+")*+|[^",\r\n]*+)'
)
_REMEDY = 'around a cell marks come in pairs, and one inside such a cell is doubled, as in "5"" bar"; or remove it'


def is_well_quoted(content: bytes) -> bool:
    """Tell whether marks stand nowhere but around whole cells, or doubled inside them."""
    return b'"' not in content or _WELL_QUOTED.fullmatch(content) is not None


def names_of_header(header: str) -> list[str]:
    """Give the names of a header line, without spaces and marks around them."""
    names = next(csv.reader([header]), [""]) if '"' in header else header.split(",")
    return [name.strip().strip('"') for name in names]


def read_quoted(content: bytes, path: str | Path) -> pl.DataFrame:
    """Read CSV text in which a mark may be a plain character of a cell that does not begin with one.

    Columns are named by their number, for names may be empty.

    Raises
    ------
    InputFileError
        with its row, for a cell whose marks do not close, and for a row of more cells than the header has.
    """
    reader = csv.reader(io.StringIO(content.decode("utf-8-sig"), newline=""), strict=True)
    rows: list[list[str]] = []
    n_lines = 0
    try:
        for cells in reader:
            if rows and len(cells) > len(rows[0]):
                raise InputFileError(
                    path,
                    f"{len(cells)} cells under {len(rows[0])} column names",
                    row=n_lines + 1,
                    remedy="check for decimal commas, and for quotation marks around cells with a comma",
                )
            rows.append(cells)
            n_lines = reader.line_num
    except csv.Error as error:
        raise InputFileError(
            path,
            "a quotation mark at the beginning of a cell is not closed at its end",
            row=n_lines + 1,
            remedy=_REMEDY,
        ) from error
    n_columns = len(rows[0])
    filled = [[cell or None for cell in cells] + [None] * (n_columns - len(cells)) for cells in rows[1:]]
    columns = list(zip(*filled, strict=True)) or [()] * n_columns
    return pl.DataFrame({str(number): pl.Series(cells, dtype=pl.String) for number, cells in enumerate(columns)})
