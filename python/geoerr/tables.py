"""Reading tables (CSV or Parquet) row by row honestly: what is wrong is named, the rest goes on.

A table is refused as a whole only where no row can be used (it is missing, empty, no table, or lacks a column).
A row with a wrong value is set aside and listed with file, row and column; the other rows stay.
"""

from __future__ import annotations

import contextlib
import io
import sys
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import polars as pl

from geoerr.column_names import is_temperature
from geoerr.errors import InputFileError
from geoerr.files import refusing_unreadable, whole_or_absent
from geoerr.not_numbers import remedy_of
from geoerr.quoted_cells import is_well_quoted, names_of_header, read_quoted
from geoerr.spelling import meant

# Line 1 of a CSV file is its header.
FIRST_DATA_ROW = 2
# What commands take beside measurements: machines, models, rigs.
_NO_TABLES = (".json", ".toml")
_MOST_OF_A_MESSAGE = 200
_COMMENT = "#"
# What loggers write where a sensor said nothing.
_UNKNOWN = ("n/a", "na", "#n/a", "null", "none", "-", "--", "?")
# Beyond this a square, and then a sum of them, is no number any more.
_LARGEST = 1e100
_NOT_A_NUMBER = "{value!r} is not a number"
_UTF_16 = (b"\xff\xfe", b"\xfe\xff")
_OTHER_SEPARATORS = {";": "semicolons", "\t": "tabs"}


@dataclass(frozen=True)
class RowProblem:
    """One row that was set aside: `row` is the line of the file that a text editor shows, `remedy` '' if unknown."""

    path: str
    row: int
    column: str
    problem: str
    remedy: str = ""

    def __str__(self) -> str:
        """Say it as one line of a message."""
        remedy = f": {self.remedy}" if self.remedy else ""
        return f"{self.path}:{self.row}: {self.column}: {self.problem}{remedy}"


@dataclass(frozen=True)
class Schema:
    """What a table must and may hold; columns not named here are kept as they are.

    Attributes
    ----------
    required
        Columns without which no row can be used.
    numbers
        Columns of finite numbers; a row whose value is not one is set aside.
    whole_numbers
        Columns of whole numbers.
    signs
        Those of them that say a direction: −1, 0 or 1.
    flags
        Those of them that say no or yes: 0 or 1.
    texts
        Columns of free text.
    choices
        Column to the values that it may take.
    filled
        Columns in which an empty cell makes the row unusable.
    """

    required: tuple[str, ...]
    numbers: tuple[str, ...]
    whole_numbers: tuple[str, ...] = ()
    signs: tuple[str, ...] = ()
    flags: tuple[str, ...] = ()
    texts: tuple[str, ...] = ()
    choices: tuple[tuple[str, tuple[str, ...]], ...] = ()
    filled: tuple[str, ...] = ()

    @property
    def columns(self) -> tuple[str, ...]:
        """All columns that have a meaning, each once."""
        groups = (self.required, self.numbers, self.whole_numbers, self.texts, [name for name, _ in self.choices])
        return tuple(dict.fromkeys(name for group in groups for name in group))


def read_raw(path: str | Path) -> pl.DataFrame:
    """Read a table without judging its cells: a CSV file gives text columns, Parquet its own types.

    Parameters
    ----------
    path
        `.parquet`, or anything else as CSV; `-` is CSV on standard input.

    Raises
    ------
    InputFileError
        if the file is missing, empty or no table, or if two columns have one name.
    """
    try:
        if str(path) == "-":
            return _read_csv(sys.stdin.buffer.read(), path)
        with refusing_unreadable(path):
            if Path(path).suffix.lower() == ".parquet":
                return pl.read_parquet(path)
            content = Path(path).read_bytes()
        if Path(path).suffix.lower() in _NO_TABLES:
            raise InputFileError(
                path,
                "is no table of measurements",
                remedy="measurements are .csv or .parquet; a rig belongs to --rig, a machine or a model goes where "
                "the command asks for one",
            )
        return _read_csv(content, path)
    except pl.exceptions.PolarsError as error:
        raise InputFileError(
            path, f"not a readable table: {_first_words(error)}", remedy="save it again, as CSV or .parquet"
        ) from error


def write_table(path: str | Path, frame: pl.DataFrame) -> None:
    """Write a table, whole or not at all: `.parquet`, `-` as CSV on standard output, else CSV."""
    if str(path) == "-":
        sys.stdout.write(frame.write_csv())
        return
    with whole_or_absent(path) as temporary:
        if Path(path).suffix.lower() == ".parquet":
            frame.write_parquet(temporary)
        else:
            frame.write_csv(temporary)


def check(raw: pl.DataFrame, schema: Schema, path: str | Path) -> tuple[pl.DataFrame, tuple[RowProblem, ...]]:
    """Give the usable rows with typed columns, and a list of the rows that were set aside.

    The result has a column `file_row`: the line of the file each row came from.

    Raises
    ------
    InputFileError
        if a required column is missing or no usable row is left.
    """
    missing = [name for name in schema.required if name not in raw.columns]
    if missing:
        needs = f"a table of this kind needs {', '.join(schema.required)}"
        raise InputFileError(
            path,
            f"the column is missing; the file has {', '.join(raw.columns)}",
            row=1,
            column=missing[0],
            remedy=remedy_of_names(raw.columns, missing, schema) or needs,
        )
    frame = raw.with_columns(pl.int_range(FIRST_DATA_ROW, pl.len() + FIRST_DATA_ROW).alias("file_row"))
    empty = pl.all_horizontal(pl.exclude("file_row").is_null())
    frame = frame.filter(~empty)
    frame, problems = _without_comments(frame, schema, path)
    for name in frame.columns:
        if name == "file_row":
            continue
        if _is_nested(frame[name]):
            if name in schema.columns:
                what = f"{frame[name].dtype} is neither numbers nor text"
                raise InputFileError(path, what, column=name, remedy="write the column as numbers or text")
            frame = frame.drop(name)
            continue
        typed, found = _typed(frame[name], name, schema, frame["file_row"], path)
        frame = frame.with_columns(typed)
        problems.extend(found)
    bad_rows = {problem.row for problem in problems}
    frame = frame.filter(~pl.col("file_row").is_in(sorted(bad_rows)))
    if frame.is_empty():
        if problems:
            first = problems[0]
            raise InputFileError(
                path,
                f"{first.problem}; no usable row is left",
                row=first.row,
                column=first.column,
                remedy=first.remedy or "correct the rows; all of them are wrong",
            )
        raise InputFileError(path, "has a header but no rows", remedy="give at least one row")
    return frame, tuple(sorted(problems, key=lambda problem: problem.row))


def remedy_of_names(columns: Sequence[str], missing: Sequence[str], schema: Schema) -> str | None:
    """Say what the names of columns that are missing are in the file, as far as others are like them."""
    if {name.lower() for name in columns}.issuperset(missing):
        return "write the names of columns in lower case"
    for name in columns:
        word = None if name in schema.columns else meant(name.lower(), missing)
        if word is not None:
            return f"did you mean {word}, where the file has {name}?"
    return None


def _without_comments(frame: pl.DataFrame, schema: Schema, path: str | Path) -> tuple[pl.DataFrame, list[RowProblem]]:
    """Set comments among the rows aside, each once, and not for every cell that has no number.

    A comment begins with its mark and has none of the numbers that a row needs: a line may be named `#7`.
    """
    first = frame.columns[0]
    if frame.dtypes[0] != pl.String:
        return frame, []
    begins = pl.col(first).str.strip_chars_start().str.starts_with(_COMMENT).fill_null(value=False)
    needed = [name for name in schema.required if name in schema.numbers]
    numbers = [pl.col(name).cast(pl.Float64, strict=False).is_null() for name in needed]
    is_comment = frame.select(pl.all_horizontal(begins, *numbers)).to_series()
    said = f"begins with {_COMMENT}, as a comment: a table has none; remove the line"
    rows = frame["file_row"].filter(is_comment)
    return frame.filter(~is_comment), [RowProblem(str(path), row, first, said) for row in rows]


def _read_csv(content: bytes, path: str | Path) -> pl.DataFrame:
    if not content.strip():
        raise InputFileError(path, "the file is empty", remedy="give a header line and at least one row")
    if content.startswith(_UTF_16):
        raise InputFileError(
            path,
            'is UTF-16 text, as a spreadsheet\'s "Unicode text" is',
            remedy='save it as UTF-8, in a spreadsheet as "CSV UTF-8"',
        )
    if b"\0" in content[:4096]:
        raise InputFileError(path, "not a text table (it holds NUL bytes)", remedy="save it as CSV or .parquet")
    try:
        content.decode("utf-8")
    except UnicodeDecodeError as error:
        row = content.count(b"\n", 0, error.start) + 1
        raise InputFileError(
            path, f"byte {error.start} is not UTF-8", row=row, remedy="save it as UTF-8 text"
        ) from error
    if b"\n" not in content:
        # Lines as old spreadsheets end them.
        content = content.replace(b"\r", b"\n")
    header = content.lstrip(b"\xef\xbb\xbf").split(b"\n", 1)[0].decode("utf-8")
    names = names_of_header(header.rstrip("\r"))
    separator = next((word for mark, word in _OTHER_SEPARATORS.items() if mark in header), None)
    if len(names) == 1 and separator is not None:
        raise InputFileError(
            path,
            f"its cells are separated by {separator}",
            row=1,
            remedy="save it with commas between cells, and points in numbers",
        )
    _refuse_comment(content, names, path)
    _refuse_repeated(names, path)
    content = _with_short_comments(content, len(names))
    _refuse_long_rows(content, len(names), path)
    frame = _cells(content, path)
    # A column without a name, as spreadsheets leave them behind the last one, says nothing.
    named = [column for column, name in zip(frame.columns, names, strict=True) if name]
    return frame.select(named).rename(dict(zip(named, filter(None, names), strict=True)))


def _cells(content: bytes, path: str | Path) -> pl.DataFrame:
    if is_well_quoted(content):
        # What Polars says is meant for programmers; the other reader says which row it is.
        with contextlib.suppress(pl.exceptions.PolarsError):
            return pl.read_csv(io.BytesIO(content), infer_schema=False)
    return read_quoted(content, path)


def _first_words(error: Exception) -> str:
    """Give the first line of a library's message: hints to its own callers follow."""
    return str(error).strip().partition("\n")[0][:_MOST_OF_A_MESSAGE]


def _refuse_repeated(names: Sequence[str], path: str | Path) -> None:
    repeated = [name for name, count in Counter(filter(None, names)).items() if count > 1]
    if repeated:
        raise InputFileError(
            path, "two columns have this name", row=1, column=repeated[0], remedy="rename or remove one"
        )


def _refuse_comment(content: bytes, names: Sequence[str], path: str | Path) -> None:
    """Refuse a comment where the names of columns belong; a column may be named `#`, as one of running numbers is."""
    if not names[0].startswith(_COMMENT):
        return
    line = next(iter(content.splitlines()[1:]), b"")
    if b'"' in line or line.count(b",") + 1 != len(names):
        raise InputFileError(
            path,
            f"begins with {_COMMENT}, as a comment: a table has none",
            row=1,
            remedy="remove the line: the first one has the names of the columns",
        )


def _with_short_comments(content: bytes, n_columns: int) -> bytes:
    """Cut a comment of more commas than a row has at the first: one row to set aside is no reason to refuse."""
    mark = _COMMENT.encode()
    if b'"' in content or b"\n" + mark not in content:
        return content
    lines = content.splitlines(keepends=True)
    is_long = [line.startswith(mark) and line.count(b",") >= n_columns for line in lines]
    cut = (line.partition(b",")[0] + b"\n" if long else line for line, long in zip(lines, is_long, strict=True))
    return b"".join(cut) if any(is_long) else content


def _refuse_long_rows(content: bytes, n_columns: int, path: str | Path) -> None:
    """Name the row that has more cells than the header (a decimal comma is the usual cause)."""
    if b'"' in content:
        return
    for row, line in enumerate(content.splitlines(), start=1):
        if line.count(b",") >= n_columns:
            raise InputFileError(
                path,
                f"{line.count(b',') + 1} cells under {n_columns} column names",
                row=row,
                remedy="check for decimal commas: numbers are written with a point",
            )


def _is_nested(column: pl.Series) -> bool:
    """Tell whether a column, of a Parquet file, holds what no cell of a table can be."""
    return column.dtype.is_nested() or column.dtype in (pl.Binary, pl.Duration, pl.Object)


def _typed(
    column: pl.Series, name: str, schema: Schema, rows: pl.Series, path: str | Path
) -> tuple[pl.Series, list[RowProblem]]:
    problems: list[RowProblem] = []

    def refuse(where: pl.Series, problem: str) -> None:
        for row, value in zip(rows.filter(where), column.filter(where), strict=True):
            remedy = remedy_of(str(value).strip(), name) if problem == _NOT_A_NUMBER else None
            problems.append(RowProblem(str(path), row, name, problem.format(value=value), remedy or ""))

    text, as_numbers = _cell_texts(column, name)
    if name in schema.filled:
        refuse(text.is_null(), "the cell is empty")
    allowed = dict(schema.choices).get(name)
    if allowed is not None:
        refuse(text.is_not_null() & ~text.is_in(list(allowed)), f"{{value!r}} is not one of {', '.join(allowed)}")
        return text, problems
    if name in schema.texts:
        return text, problems
    numbers = as_numbers.cast(pl.Float64, strict=False)
    if name in schema.numbers or name in schema.whole_numbers:
        for where, problem in _wrong_numbers(name, schema, text, numbers):
            refuse(where, problem)
        return (numbers.cast(pl.Int64, strict=False) if name in schema.whole_numbers else numbers), problems
    # A column of the user's own: numbers where all its cells are, else text. NaN is how tools write "unknown".
    # A temperature is a number: a cell that is none is a mistake, and makes no column of texts.
    if is_temperature(name):
        refuse(text.is_not_null() & numbers.is_null(), _NOT_A_NUMBER)
        refuse(numbers.is_infinite(), "{value!r} is not a finite number")
    elif _is_text(text, as_numbers, numbers):
        return text, problems
    return numbers.fill_nan(None), problems


def _cell_texts(column: pl.Series, name: str) -> tuple[pl.Series, pl.Series]:
    """Give cells as they are, null where they are empty, and as numbers are read of them: null where unknown, too."""
    text = (column.cast(pl.Int8) if column.dtype == pl.Boolean else column).cast(pl.String).str.strip_chars()
    text = text.set(text == "", None)
    as_numbers = text.set(text.str.to_lowercase().is_in(_UNKNOWN), None)
    return (as_numbers if is_temperature(name) else text), as_numbers


def _is_text(text: pl.Series, as_numbers: pl.Series, numbers: pl.Series) -> bool:
    """Tell whether a column of the user's own is one of texts: some cell is no word for unknown, or none a number."""
    is_other = as_numbers.is_not_null() & numbers.is_null()
    return bool(is_other.any() or (numbers.is_null().all() and text.is_not_null().any()))


def _wrong_numbers(name: str, schema: Schema, text: pl.Series, numbers: pl.Series) -> Iterator[tuple[pl.Series, str]]:
    """Give the rows whose cell is not the number that its column has, and what is wrong with it."""
    yield text.is_not_null() & numbers.is_null(), _NOT_A_NUMBER
    yield numbers.is_not_null() & ~numbers.is_finite(), "{value!r} is not a finite number"
    if name in schema.whole_numbers:
        yield numbers.is_finite() & (numbers != numbers.round()), "{value!r} is not a whole number"
    if name in schema.signs:
        yield numbers.is_finite() & (numbers.abs() > 1.0), "{value!r} is no direction: −1, 0 or 1"
    if name in schema.flags:
        yield numbers.is_finite() & ~numbers.is_in([0.0, 1.0]), "{value!r} is neither 0 (no) nor 1 (yes)"
    if name in schema.numbers and not is_temperature(name):
        yield numbers.is_finite() & (numbers.abs() > _LARGEST), "{value!r} is larger than anything that is measured"
