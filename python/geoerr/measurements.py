"""Files of measurements as a person gives them: points, circular tests, lengths, told apart by their columns."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from geoerr.errors import InputFileError
from geoerr.observations import (
    CircularTest,
    Lengths,
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
        Each table of measured lengths; none where a model is to be fitted.
    point_files
        Where the points came from.
    """

    points: Observations | None
    circles: tuple[CircularTest, ...] = ()
    lengths: tuple[Lengths, ...] = ()
    point_files: tuple[Path, ...] = field(default=())

    @property
    def tables(self) -> tuple[Observations | CircularTest, ...]:
        """All tables, as a fit takes them: points first."""
        return (*(() if self.points is None else (self.points,)), *self.circles)

    @property
    def set_aside(self) -> tuple[RowProblem, ...]:
        """Rows that could not be used."""
        return tuple(problem for table in (*self.tables, *self.lengths) for problem in table.set_aside)

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
    paths: Sequence[Path], *, with_lengths: bool = False, ranges_mm: Mapping[str, tuple[float, float]] | None = None
) -> Measurements:
    """Read OBS; `-` is a table of points on standard input.

    Parameters
    ----------
    paths
        The files.
    with_lengths
        Whether measured lengths can be used.
    ranges_mm
        Of the machine, by axis: rows that cannot be of it are set aside.

    Raises
    ------
    InputFileError
        for a file of measured lengths where they cannot be used, and as the readers of each kind.
    """
    points: list[Path] = []
    circles: list[CircularTest] = []
    lengths: list[Lengths] = []
    for path in paths:
        kind = "points" if str(path) == "-" else kind_of(read_raw(path).columns)
        if kind == "lengths" and not with_lengths:
            raise InputFileError(
                path,
                "holds measured lengths, which no model is fitted to",
                remedy="give measured points (x, y, z, mx, my, mz); `geoerr verify workpiece` takes lengths",
            )
        if kind == "lengths":
            lengths.append(read_lengths(path))
        elif kind == "circle":
            circles.append(read_circular_test(path, ranges_mm))
        else:
            points.append(path)
    table = read_observations(*points, ranges_mm=ranges_mm) if points else None
    return Measurements(table, tuple(circles), tuple(lengths), tuple(points))
