"""The exceptions of geoerr: one small family, so that a caller can catch what it means to catch.

A message says what was found, where, and what to do; the attributes say the same to a program.
"""

from __future__ import annotations

from pathlib import Path


class GeoerrError(Exception):
    """Anything that geoerr refuses. The command line turns it into exit status 1."""


class ShapeError(GeoerrError, ValueError):
    """An array whose shape, type or length does not fit the call."""


class GeometryError(GeoerrError, ArithmeticError):
    """Geometry that has no answer: parallel rays, a line through coincident points, a lost rank."""


class NotConvergedError(GeometryError):
    """An iteration that had to succeed (a compensation) and did not."""


class DetectionError(GeoerrError):
    """Pictures in which what was looked for cannot be used."""


class MarkerFitError(DetectionError):
    """The photometric fit has no trustworthy answer here; the message says why."""


class NotThisMarkerError(MarkerFitError):
    """The picture here is not that of this marker: something else, or most of it is covered."""


class NotDeterminedError(GeoerrError):
    """A quantity that the given data do not determine."""


class InputFileError(GeoerrError, ValueError):
    """A file that cannot be used as it is: says file, row, column and remedy.

    Parameters
    ----------
    path
        The file (`-` is standard input).
    problem
        What was found, in lower case, without a full stop.
    row
        1-based line of the file that a text editor shows; None where the file as a whole is meant.
    column
        Name of the column, or key such as `axes.x.range`.
    remedy
        What the user can do; printed as a `hint:` line.
    """

    def __init__(
        self,
        path: str | Path,
        problem: str,
        *,
        row: int | None = None,
        column: str | None = None,
        remedy: str | None = None,
    ) -> None:
        self.path = str(path)
        self.problem = problem
        self.row = row
        self.column = column
        self.remedy = remedy
        place = self.path
        if row is not None:
            place += f":{row}"
        if column is not None:
            place += f": {column}"
        message = f"{place}: {problem}"
        if remedy:
            message += f"\nhint: {remedy}"
        super().__init__(message)

    def __reduce__(self) -> tuple[object, ...]:
        """Pickle by parts, so that the error survives the way back from a worker process."""
        return (_rebuild_input_file_error, (self.path, self.problem, self.row, self.column, self.remedy))


def _rebuild_input_file_error(
    path: str, problem: str, row: int | None, column: str | None, remedy: str | None
) -> InputFileError:
    return InputFileError(path, problem, row=row, column=column, remedy=remedy)


class ExpressionError(GeoerrError, ValueError):
    """A formula that is refused: the message shows the place.

    Parameters
    ----------
    message
        What is wrong, the line of the formula, and carets under the place.
    text
        The formula, or the text of the definition that holds the problem.
    start, end
        The place: `text[start:end]`, empty where something is missing.
    """

    def __init__(self, message: str, text: str, start: int, end: int) -> None:
        self.text = text
        self.start = start
        self.end = end
        super().__init__(message)

    def __reduce__(self) -> tuple[object, ...]:
        """Pickle by parts, so that the error survives the way back from a worker process."""
        return (ExpressionError, (str(self), self.text, self.start, self.end))


class GcodeError(GeoerrError, ValueError):
    """A program that cannot be compensated safely: says line, text and remedy."""

    def __init__(self, path: str | Path, line: int, problem: str, *, remedy: str | None = None) -> None:
        self.path = str(path)
        self.line = line
        self.problem = problem
        self.remedy = remedy
        message = f"{self.path}:{line}: {problem}"
        if remedy:
            message += f"\nhint: {remedy}"
        super().__init__(message)


class GeoerrWarning(UserWarning):
    """Something the user should know; the work went on."""
