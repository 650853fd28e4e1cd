"""Files of measurements as a person gives them: points, circular tests, lengths, told apart by their columns."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from geoerr.errors import GeoerrError
from geoerr.observations import (
    CircularTest,
    Lengths,
    MeasuredTable,
    Observations,
    kind_of,
    read_circular_test,
    read_lengths,
    read_observations,
)
from geoerr.tables import RowProblem, read_raw

# What tells two rows of several files apart that stand in the same line of theirs.
_ROW = ("file_row", "x", "y", "z", "mx", "my", "mz")


@dataclass(frozen=True)
class Measurements:
    """What was measured.

    Attributes
    ----------
    points
        All files of measured points as one table; None where there is none.
    circles
        Each circular test.
    lengths
        Each table of measured lengths.
    point_files
        Where the points came from.
    """

    points: Observations | None
    circles: tuple[CircularTest, ...] = ()
    lengths: tuple[Lengths, ...] = ()
    point_files: tuple[Path, ...] = field(default=())

    @property
    def tables(self) -> tuple[MeasuredTable, ...]:
        """All tables, as a fit takes them: points first."""
        return (*(() if self.points is None else (self.points,)), *self.circles, *self.lengths)

    def points_alone(self, what: str, remedy: str) -> Observations:
        """Give the points, where there is nothing else.

        Parameters
        ----------
        what, remedy
            What takes points alone, as `the arithmetic of nine lines takes`, and what to do otherwise.

        Raises
        ------
        GeoerrError
            where there are circular tests or lengths, or no points.
        """
        if self.points is None or self.circles or self.lengths:
            raise GeoerrError(f"{what} measured points alone\nhint: {remedy}")
        return self.points

    @property
    def has_lengths_only(self) -> bool:
        """Whether there are measured lengths and nothing else: of these nothing has a place."""
        return self.points is None and not self.circles and bool(self.lengths)

    @property
    def has_circles_only(self) -> bool:
        """Whether there are circular tests and nothing else: they are diagnosed in their own way."""
        return self.points is None and not self.lengths and bool(self.circles)

    @property
    def set_aside(self) -> tuple[RowProblem, ...]:
        """Rows that could not be used."""
        return tuple(problem for table in self.tables for problem in table.set_aside)

    def place(self, file_row: int, numbers: Sequence[float]) -> str:
        """Say where a row of points stands: `file:row`, or the row alone where no one file has it.

        Parameters
        ----------
        file_row
            Line of its file.
        numbers
            Its x, y, z, mx, my, mz; an empty one is NaN.
        """
        for path in self.point_files:
            if len(self.point_files) == 1:
                return f"{path}:{file_row}"
            rows = read_observations(path).numbers(*_ROW)
            if any(np.array_equal(row, [file_row, *numbers], equal_nan=True) for row in rows[rows[:, 0] == file_row]):
                return f"{path}:{file_row}"
        return f"row {file_row}"


def read_measurements(
    paths: Sequence[Path], *, ranges_mm: Mapping[str, tuple[float, float]] | None = None
) -> Measurements:
    """Read OBS; `-` is a table of points on standard input.

    Parameters
    ----------
    paths
        The files.
    ranges_mm
        Of the machine, by axis: rows that cannot be of it are set aside.

    Raises
    ------
    InputFileError
        as the readers of each kind.
    """
    points: list[Path] = []
    circles: list[CircularTest] = []
    lengths: list[Lengths] = []
    for path in paths:
        kind = "points" if str(path) == "-" else kind_of(read_raw(path).columns)
        if kind == "lengths":
            lengths.append(read_lengths(path))
        elif kind == "circle":
            circles.append(read_circular_test(path, ranges_mm))
        else:
            points.append(path)
    table = read_observations(*points, ranges_mm=ranges_mm) if points else None
    return Measurements(table, tuple(circles), tuple(lengths), tuple(points))
