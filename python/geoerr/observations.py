"""Observations: the one table between measuring and modelling.

One row for each target point seen once, in the order of measurement. A laser, a ball bar or a probe enters here and
needs no camera. Three kinds of file are told apart by their columns: points (`mx my mz`), circular tests (`r`) and
lengths (`x1 ... measured`).
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from numbers import Number
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
import numpy.typing as npt
import polars as pl

from geoerr.column_names import is_temperature
from geoerr.drawing import drawn
from geoerr.errors import InputFileError, ShapeError
from geoerr.files import check_written
from geoerr.summaries import facts_html, sentences_html, span_text, summary_html, table_html
from geoerr.tables import RowProblem, Schema, check, read_raw, remedy_of_names, write_table

if TYPE_CHECKING:
    import plotly.graph_objects as go

CARRIERS = ("tool", "work", "base", "relative")
MEASURED = ("mx", "my", "mz")
COVARIANCE = ("cxx", "cxy", "cxz", "cyy", "cyz", "czz")
STANDARD_UNCERTAINTY = ("sx", "sy", "sz")
PIXELS = ("u_left", "v_left", "u_right", "v_right")
DIRECTIONS = ("dir_x", "dir_y", "dir_z")
_AXES = ("x", "y", "z")
_OFFSETS = ("tx", "ty", "tz")
_UNITS = {**dict.fromkeys((*_AXES, "r", "measured"), "mm"), "feed": "mm/min"}
# A summary names as many, and counts more.
_MOST_NAMED = 8
# Positions closer than this are one place: a hundredth of a micrometre is below every command's resolution. So are
# neighbours nearer than this share of their mean distance.
SAME_PLACE_MM, ONE_PLACE = 1e-5, 0.01

Numbers = npt.NDArray[np.float64]

POINT_COLUMNS = Schema(
    required=("x", "y", "z"),
    filled=("x", "y", "z"),
    numbers=(
        *(*_AXES, *_OFFSETS),
        *MEASURED,
        *STANDARD_UNCERTAINTY,
        *COVARIANCE,
        *("t", "feed", "temp"),
        *PIXELS,
    ),
    whole_numbers=("repeat", *DIRECTIONS, "moving"),
    signs=DIRECTIONS,
    flags=("moving",),
    texts=("line", "session", "target", "group"),
    choices=(("carrier", CARRIERS),),
)
CIRCLE_COLUMNS = Schema(
    required=("x", "y", "z", "r"),
    filled=("x", "y", "z", "r"),
    numbers=("x", "y", "z", "r", "sr", "t", "feed"),
    whole_numbers=("repeat", "dir", *DIRECTIONS),
    signs=("dir", *DIRECTIONS),
    texts=("line", "session"),
)
_LENGTH_ENDS = ("x1", "y1", "z1", "x2", "y2", "z2")
LENGTH_COLUMNS = Schema(
    required=("feature", *_LENGTH_ENDS, "measured"),
    filled=(*_LENGTH_ENDS, "measured"),
    numbers=(*_LENGTH_ENDS, "measured", "s_measured"),
    whole_numbers=("repeat",),
    texts=("feature", "group"),
)
# What a file is called that names no session, and is read alone.
_FIRST_SESSION = "0"
# Three years: a time that begins later counts from no session's begin.
_SINCE_NO_SESSION_S = 1e8
# A target farther from the tool than so many times the machine's three ranges together hangs on no machine.
_MOST_LEVER = 10.0
# Filled in where a column or a cell is absent (docs/reference/formats/observations.md).
_TEXT_DEFAULTS = {"line": "", "target": "", "carrier": "tool"}
_NUMBER_DEFAULTS = dict.fromkeys(_OFFSETS, 0.0)
_WHOLE_DEFAULTS = {"repeat": 0, "moving": 0}


@dataclass(frozen=True, eq=False)
class Observations:
    """Measured target points.

    Attributes
    ----------
    frame
        The table with typed columns and defaults filled in (`line session repeat carrier target x y z tx ty tz mx
        my mz moving ...`) and every further column of the file. Rows are in order of measurement.
    sources
        Where it came from, for messages.
    set_aside
        Rows that could not be used, with file, row, column and reason.
    """

    frame: pl.DataFrame
    sources: tuple[str, ...] = ()
    set_aside: tuple[RowProblem, ...] = ()

    def __len__(self) -> int:
        return self.frame.height

    def numbers(self, *columns: str) -> Numbers:
        """Give columns as (n, k) float64; an empty cell or an absent column is NaN."""
        present = [
            self.frame[name].cast(pl.Float64).to_numpy() if name in self.frame.columns else np.full(len(self), np.nan)
            for name in columns
        ]
        return np.ascontiguousarray(np.column_stack(present), dtype=np.float64)

    def texts(self, column: str) -> list[str]:
        """Give a text column; an empty cell is ''."""
        return [value or "" for value in self.frame[column].cast(pl.String).to_list()]

    @property
    def is_of_cameras(self) -> bool:
        """Whether pixels stand beside the positions."""
        return PIXELS[0] in self.frame.columns

    @property
    def commanded_mm(self) -> Numbers:
        """Commanded axis positions, (n, 3)."""
        return self.numbers("x", "y", "z")

    @property
    def target_offset_mm(self) -> Numbers:
        """Target offsets `tx ty tz`, (n, 3)."""
        return self.numbers(*_OFFSETS)

    @property
    def measured_mm(self) -> Numbers:
        """Measured positions in the measuring frame, (n, 3); NaN where a component was not measured."""
        return self.numbers(*MEASURED)

    @property
    def covariance_mm2(self) -> Numbers | None:
        """Covariances of the measured positions, (n, 3, 3); None where there are no columns for them.

        Each row has what it states: `cxx ...` where these are all that it needs, else `sx sy sz`. A laser's file may
        state the one, and a camera's the other.
        """
        columns = self.frame.columns
        by_element = by_deviation = None
        if all(name in columns for name in COVARIANCE):
            xx, xy, xz, yy, yz, zz = self.numbers(*COVARIANCE).T
            by_element = np.stack([xx, xy, xz, xy, yy, yz, xz, yz, zz], axis=-1).reshape(-1, 3, 3)
        if any(name in columns for name in STANDARD_UNCERTAINTY):
            # A negative one is as impossible as 0, and its square would hide it.
            deviations = np.maximum(self.numbers(*STANDARD_UNCERTAINTY), 0.0)
            # What is off the diagonal is 0, also of an empty cell.
            by_deviation = np.where(np.eye(3, dtype=bool), deviations[:, None, :] ** 2, 0.0)
        if by_element is None or by_deviation is None:
            return by_deviation if by_element is None else by_element
        is_measured = np.isfinite(self.measured_mm)
        needed = is_measured[:, :, None] & is_measured[:, None, :]
        is_whole = (np.isfinite(by_element) | ~needed).all(axis=(1, 2))
        return np.where(is_whole[:, None, None], by_element, by_deviation)

    @property
    def directions(self) -> npt.NDArray[np.int8]:
        """Direction in which each axis last moved, (n, 3): −1, +1, 0 = unknown.

        Taken from `dir_x dir_y dir_z` where the file has them, else from the order of rows within each session.
        """
        derived = np.zeros((len(self), 3), dtype=np.int8)
        for rows in self._rows_of_sessions():
            derived[rows] = _directions_from_order(self.commanded_mm[rows])
        for column, name in enumerate(DIRECTIONS):
            if name in self.frame.columns:
                derived[:, column] = np.sign(np.nan_to_num(self.numbers(name)[:, 0])).astype(np.int8)
        return derived

    def select(self, mask: npt.ArrayLike) -> Observations:
        """Give the rows where `mask` (n,) is true.

        Raises
        ------
        ShapeError
            for a mask of another length.
        """
        kept = np.asarray(mask, dtype=bool)
        # A single true would otherwise stand for all rows.
        if kept.shape != (len(self),):
            raise ShapeError(f"the mask must be ({len(self)},), one for each row, not {kept.shape}")
        return Observations(self.frame.filter(pl.Series(kept)), self.sources, self.set_aside)

    def plot_uncertainty(self) -> go.Figure:
        """Draw the stated standard uncertainty of the points, by target."""
        return drawn("measurement_residuals", self)

    def _repr_html_(self) -> str:
        """Show what was measured, for a notebook."""
        facts = _counted(self.frame, ("session", "line", "target", "carrier"))
        facts |= _spans(
            self.frame, (*_AXES, "temp", *(name for name in self.frame.columns if name.startswith("temp_")))
        )
        covariance = "stated" if self.covariance_mm2 is not None else "not stated"
        return _shown("Observations", self.frame, facts | {"uncertainty": covariance}, self.set_aside)

    def _rows_of_sessions(self) -> Iterable[npt.NDArray[np.intp]]:
        sessions = np.asarray(self.texts("session"))
        for name in dict.fromkeys(sessions.tolist()):
            yield np.flatnonzero(sessions == name)


@dataclass(frozen=True, eq=False)
class CircularTest:
    """Circular tests (ball bar): columns `line x y z r`, optionally `sr dir feed t ...`, one row a point."""

    frame: pl.DataFrame
    sources: tuple[str, ...] = ()
    set_aside: tuple[RowProblem, ...] = ()

    def _repr_html_(self) -> str:
        """Show what was measured, for a notebook."""
        facts = _counted(self.frame, ("session", "line")) | _spans(self.frame, (*_AXES, "r", "feed"))
        return _shown("Circular test", self.frame, facts, self.set_aside)


@dataclass(frozen=True, eq=False)
class Lengths:
    """Measured distances between nominal end points: `feature x1 y1 z1 x2 y2 z2 measured`."""

    frame: pl.DataFrame
    sources: tuple[str, ...] = ()
    set_aside: tuple[RowProblem, ...] = ()

    def _repr_html_(self) -> str:
        """Show what was measured, for a notebook."""
        facts = _counted(self.frame, ("feature", "group")) | _spans(self.frame, ("measured",))
        return _shown("Measured lengths", self.frame, facts, self.set_aside)


# What a model can be held against, and fitted to.
MeasuredTable: TypeAlias = Observations | CircularTest | Lengths


def kind_of(columns: Iterable[str]) -> str:
    """Tell the kind of a table from its column names: `points`, `circle` or `lengths`."""
    # What is wrong with its names is for the reader of its kind to say.
    names = {name.lower() for name in columns}
    if {"x1", "x2"} <= names and ("measured" in names or not names & set(MEASURED)):
        return "lengths"
    if "r" in names and not names & set(MEASURED):
        return "circle"
    return "points"


def read_observations(*paths: str | Path, ranges_mm: Mapping[str, tuple[float, float]] | None = None) -> Observations:
    """Read one or more tables of measured points.

    Two files are two sessions unless they name their sessions. Where `t` is given in every row of a session it
    orders that session's rows.

    Parameters
    ----------
    paths
        The files.
    ranges_mm
        Axis to the machine's range (`Machine.ranges_mm`): rows that were commanded farther outside one than that is
        long are set aside, for they are mistyped.

    Raises
    ------
    InputFileError
        if a file is missing, empty, of another kind, lacks a column, or has no usable row.
    """
    if not paths:
        raise InputFileError("-", "no observations were given", remedy="name at least one table")
    frames: list[pl.DataFrame] = []
    problems: list[RowProblem] = []
    for path in paths:
        raw = read_raw(path)
        _expect(raw, "points", path)
        _refuse_unmeasured(raw, path)
        frame, found = _of_the_machine(*check(raw, POINT_COLUMNS, path), ranges_mm, path)
        frames.append(frame)
        problems.extend(found)
    names = _session_names(frames)
    whole = [_with_defaults(frame, session=name) for frame, name in zip(frames, names, strict=True)]
    merged = pl.concat(whole, how="diagonal_relaxed")
    return Observations(_in_time(merged), tuple(str(path) for path in paths), tuple(problems))


def as_read_together(tables: Sequence[Observations]) -> Observations:
    """Join tables as `read_observations` joins their files: each that names no session is one of its own."""
    frames = [
        one.frame.drop("session") if one.frame["session"].unique().to_list() == [_FIRST_SESSION] else one.frame
        for one in tables
    ]
    whole = [_with_defaults(frame, session=name) for frame, name in zip(frames, _session_names(frames), strict=True)]
    return Observations(
        _in_time(pl.concat(whole, how="diagonal_relaxed")),
        tuple(source for one in tables for source in one.sources),
        tuple(problem for one in tables for problem in one.set_aside),
    )


def _refuse_unmeasured(raw: pl.DataFrame, path: str | Path) -> None:
    if not any(name in raw.columns for name in MEASURED):
        raise InputFileError(
            path,
            f"the columns are missing; the file has {', '.join(raw.columns)}",
            row=1,
            column="mx my mz",
            remedy=remedy_of_names(raw.columns, MEASURED, POINT_COLUMNS)
            or "measured positions in mm; leave cells empty where a component was not measured",
        )


def read_circular_test(path: str | Path, ranges_mm: Mapping[str, tuple[float, float]] | None = None) -> CircularTest:
    """Read a circular test; `dir` is +1 counter-clockwise seen from + of the third axis, −1 clockwise.

    Parameters
    ----------
    path
        The file.
    ranges_mm
        As for `read_observations`.
    """
    raw = read_raw(path)
    _expect(raw, "circle", path)
    frame, problems = _of_the_machine(*check(raw, CIRCLE_COLUMNS, path), ranges_mm, path)
    return CircularTest(frame, (str(path),), problems)


def _of_the_machine(
    frame: pl.DataFrame,
    problems: tuple[RowProblem, ...],
    ranges_mm: Mapping[str, tuple[float, float]] | None,
    path: str | Path,
) -> tuple[pl.DataFrame, tuple[RowProblem, ...]]:
    """Set aside rows whose place or target is where no machine of this range can be: one stretches every function.

    Places a little outside are kept and noted by the fit: ranges are stated carelessly. None is left where a table
    counts from another zero: then it is refused, for nothing of it is of this machine.
    """
    if ranges_mm is None:
        return frame, problems
    found = [*_far_commands(frame, ranges_mm, path), *_far_targets(frame, ranges_mm, path)]
    kept = frame.filter(~pl.col("file_row").is_in([one.row for one in found]))
    if found and kept.is_empty():
        problem, _, remedy = found[0].problem.partition(": ")
        raise InputFileError(
            path,
            f"{problem}; no usable row is left",
            row=found[0].row,
            column=found[0].column,
            remedy=remedy if found[0].column in _OFFSETS else f"{remedy}, or count places from the machine's zero",
        )
    return kept, tuple(sorted((*problems, *found), key=lambda one: one.row))


def _far_commands(
    frame: pl.DataFrame, ranges_mm: Mapping[str, tuple[float, float]], path: str | Path
) -> Iterator[RowProblem]:
    for axis in _AXES:
        low, high = ranges_mm[axis]
        beyond_mm = pl.max_horizontal(low - pl.col(axis), pl.col(axis) - high)
        why = (
            f" mm is farther outside the range of {axis}, {low:g} to {high:g} mm, than that is long: "
            "correct the row, or state the machine's range as it is"
        )
        for row, value in frame.filter(beyond_mm > high - low).select("file_row", axis).iter_rows():
            yield RowProblem(str(path), row, axis, f"{value:g}{why}")


def _far_targets(
    frame: pl.DataFrame, ranges_mm: Mapping[str, tuple[float, float]], path: str | Path
) -> Iterator[RowProblem]:
    """Name targets so far off that their lever would outweigh every other row; on the base it is not read."""
    most_mm = _MOST_LEVER * sum(high - low for low, high in ranges_mm.values())
    is_read = pl.col("carrier").fill_null("") != "base" if "carrier" in frame.columns else pl.lit(value=True)
    for name in _OFFSETS:
        if name not in frame.columns:
            continue
        why = " mm from the tool is on no machine of this size: correct the row (offsets are in mm)"
        is_far = is_read & (pl.col(name).abs() > most_mm)
        for row, value in frame.filter(is_far).select("file_row", name).iter_rows():
            yield RowProblem(str(path), row, name, f"a target {value:g}{why}")


def read_lengths(path: str | Path) -> Lengths:
    """Read measured distances between nominal end points."""
    raw = read_raw(path)
    _expect(raw, "lengths", path)
    frame, problems = check(raw, LENGTH_COLUMNS, path)
    return Lengths(frame, (str(path),), problems)


def write_observations(path: str | Path, observations: Observations) -> None:
    """Write the table (`.csv`, `.parquet`, `-`), whole or not at all; the file's line numbers are not part of it."""
    check_written(path, observations, Observations, "write_observations(path, observations)")
    write_table(path, observations.frame.drop("file_row", strict=False))


def observations_from_columns(columns: Mapping[str, object] | pl.DataFrame, source: str = "memory") -> Observations:
    """Make observations from columns in memory; the same checks and defaults as for a file.

    Parameters
    ----------
    columns
        Arrays, lists, or a frame of polars or pandas, by the names of docs/reference/formats/observations.md. A
        single number or text is the same in every row; None and NaN are what an empty cell is in a file.
    source
        What messages call it.

    Raises
    ------
    InputFileError
        under the name `source`, as for a file.
    """
    raw = columns if isinstance(columns, pl.DataFrame) else _frame_of(columns, source)
    # In memory not a number is what an empty cell is in a file.
    raw = raw.fill_nan(None)
    if not any(name in raw.columns for name in PIXELS):
        _refuse_unmeasured(raw, source)
    for name, kind in raw.schema.items():
        if kind.is_temporal() and (name in POINT_COLUMNS.columns or is_temperature(name)):
            raise InputFileError(
                source,
                "holds dates or times of day, where numbers or texts are read",
                column=name,
                remedy="times (t) are seconds since the session began",
            )
    frame, problems = check(raw, POINT_COLUMNS, source)
    return Observations(_in_time(_with_defaults(frame, session=_FIRST_SESSION)), (source,), problems)


def _frame_of(columns: Mapping[str, object], source: str) -> pl.DataFrame:
    """Make a frame of arrays, lists and single values, by name."""
    if not hasattr(columns, "items"):
        raise InputFileError(
            source,
            f"{type(columns).__name__} is no set of columns",
            remedy="give a dictionary of arrays by name, or a frame; a file is for read_observations",
        )
    single = {name for name, values in columns.items() if _is_single(values)}
    series = {name: _series(name, values, source) for name, values in columns.items() if name not in single}
    lengths = {name: len(values) for name, values in series.items()}
    if len(set(lengths.values())) > 1:
        told = ", ".join(f"{name} {length}" for name, length in lengths.items())
        raise InputFileError(
            source, f"its columns differ in length: {told}", remedy="give every column one value for each row"
        )
    if not lengths:
        raise InputFileError(
            source, "no column tells how many rows there are", remedy="give x, y and z as arrays or lists"
        )
    n_rows = next(iter(lengths.values()))
    return pl.DataFrame(
        {
            name: _series(name, [np.asarray(values).item()] * n_rows, source) if name in single else series[name]
            for name, values in columns.items()
        }
    )


def _is_single(values: object) -> bool:
    return values is None or isinstance(values, str | Number | np.generic) or getattr(values, "ndim", None) == 0


def _series(name: str, values: object, source: str) -> pl.Series:
    """Make a column; what is none is refused by its name."""
    if not isinstance(values, pl.Series) and hasattr(values, "to_numpy"):
        # Of pandas.
        values = values.to_numpy()
    if isinstance(values, np.ndarray) and values.dtype == object:
        values = values.tolist()
    elif isinstance(values, np.ndarray) and values.dtype.kind in "mM":
        # Polars knows no seconds.
        values = values.astype(f"{values.dtype.kind}8[us]")
    refused = InputFileError(
        source,
        f"{type(values).__name__} is no column of numbers or texts",
        column=name,
        remedy="give an array or a list with one number or text for each row",
    )
    try:
        series = pl.Series(name, values, strict=False)  # type: ignore[arg-type]  # what it cannot take it refuses
    except (pl.exceptions.PolarsError, ArithmeticError, TypeError, ValueError) as error:
        raise refused from error
    if series.dtype.is_nested() or series.dtype == pl.Object:
        raise refused
    if series.dtype == pl.String and isinstance(values, list | tuple):
        _refuse_mixed(name, values, source)
    return series


def _refuse_mixed(name: str, values: Sequence[object], source: str) -> None:
    if not all(value is None or isinstance(value, str) for value in values):
        raise InputFileError(
            source, "holds numbers and texts", column=name, remedy="write all as numbers; None is not known"
        )


def place_numbers(position_mm: Numbers) -> npt.NDArray[np.int64]:
    """Give every commanded position (n,) along an axis the number of its place, upwards from 0, (n,).

    A program states a target in one way, an encoder with some spread: neighbours that are a hundredth as far apart as
    positions are on average are one place.
    """
    order = np.argsort(position_mm, kind="stable")
    gap_mm = np.diff(position_mm[order], prepend=position_mm[order][:1])
    n_distinct = 1 + int((gap_mm > SAME_PLACE_MM).sum())
    same_mm = max(SAME_PLACE_MM, ONE_PLACE * float(gap_mm.sum()) / n_distinct)
    number = np.empty(len(position_mm), dtype=np.int64)
    number[order] = np.cumsum(gap_mm > same_mm)
    return number


def _counted(frame: pl.DataFrame, columns: Iterable[str]) -> dict[str, str]:
    """Count what differs in a column, and name it where that is little."""
    facts = {}
    for column in columns:
        if column not in frame.columns:
            continue
        names = [str(name) for name in frame[column].unique(maintain_order=True).to_list() if name not in (None, "")]
        if names:
            told = "" if len(names) > _MOST_NAMED else f" ({', '.join(names)})"
            facts[column] = f"{len(names)}{told}"
    return facts


def _spans(frame: pl.DataFrame, columns: Iterable[str]) -> dict[str, str]:
    """Give the range of columns that hold numbers, with their units."""
    facts = {}
    for column in columns:
        values = frame[column].drop_nulls().to_numpy() if column in frame.columns else np.empty(0)
        if len(values):
            facts[f"{column}, {_UNITS.get(column, '°C')}"] = span_text(float(values.min()), float(values.max()))
    return facts


def _shown(title: str, frame: pl.DataFrame, facts: dict[str, str], set_aside: Iterable[RowProblem]) -> str:
    rows = [(str(one),) for one in set_aside]
    return summary_html(
        title, sentences_html(f"{frame.height} rows"), facts_html(facts), table_html(("rows set aside",), rows)
    )


_KIND_IN_WORDS = {
    "points": "measured points (x, y, z, mx, my, mz)",
    "circle": "a circular test (x, y, z, r)",
    "lengths": "measured lengths (feature, x1 ... z2, measured)",
}


def _expect(raw: pl.DataFrame, kind: str, path: str | Path) -> None:
    found = kind_of(raw.columns)
    if found != kind:
        raise InputFileError(path, f"holds {_KIND_IN_WORDS[found]}, {_KIND_IN_WORDS[kind]} are needed here")


def _with_defaults(frame: pl.DataFrame, session: str) -> pl.DataFrame:
    defaults: dict[str, str | float | int] = {
        **_TEXT_DEFAULTS,
        **_NUMBER_DEFAULTS,
        **_WHOLE_DEFAULTS,
        "session": session,
    }
    columns = [
        pl.col(name).fill_null(value) if name in frame.columns else pl.lit(value).alias(name)
        for name, value in defaults.items()
    ]
    measured = [pl.lit(None, dtype=pl.Float64).alias(name) for name in MEASURED if name not in frame.columns]
    return frame.with_columns(*columns, *measured)


def _session_names(frames: Sequence[pl.DataFrame]) -> list[str]:
    """Give each file the name of its session where it states none: its number, or the next that no file states."""
    stated = {name for frame in frames if "session" in frame.columns for name in frame["session"].to_list()}
    free = (name for name in map(str, itertools.count(len(frames))) if name not in stated)
    return [next(free) if str(number) in stated else str(number) for number in range(len(frames))]


def _in_time(frame: pl.DataFrame) -> pl.DataFrame:
    """Order rows by their time in each session; where it counts seconds since 1970, let it count from the begin."""
    if "t" not in frame.columns:
        return frame
    return pl.concat(map(_session_in_time, frame.partition_by("session", maintain_order=True)))


def _session_in_time(part: pl.DataFrame) -> pl.DataFrame:
    if not part["t"].null_count():
        part = part.sort("t", maintain_order=True)
    begin_s = part["t"].min()
    if isinstance(begin_s, float) and begin_s > _SINCE_NO_SESSION_S:
        return part.with_columns(t=pl.col("t") - begin_s)
    return part


def _directions_from_order(commanded_mm: Numbers) -> npt.NDArray[np.int8]:
    directions = np.zeros(commanded_mm.shape, dtype=np.int8)
    if len(commanded_mm) < 2:
        return directions
    steps = np.sign(np.diff(commanded_mm, axis=0)).astype(np.int8)
    row = np.arange(len(steps))[:, None]
    # The last step that was one; before the first there is none, and nothing is known.
    last = np.maximum.accumulate(np.where(steps != 0, row, -1), axis=0)
    directions[1:] = np.where(last >= 0, np.take_along_axis(steps, np.maximum(last, 0), axis=0), 0)
    return directions
