"""Lay two programs side by side: which moves of the corrected program are the pieces of which move."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from geoerr.errors import GcodeError
from geoerr.model.arrays import Triple
from geoerr.verify.program_reader import Line, Move, ProgramReader

Numbers = npt.NDArray[np.float64]

REMEDY = "give the program as it was written, then the one that `geoerr compensate` made of it"

# The comment that marks a corrected program.
MARK = b"corrected by geoerr: model "

# A piece ends a move where the tool, by the model, is this close to the move's end. Pieces of a corrected move are
# far longer: where errors change by less than 0.01 mm a millimetre, a piece shorter than this times ten cannot leave
# a tolerance of a tenth of a micrometre.
END_MM = 1e-3

# No move has more pieces: what bounds the search where the tool never comes close.
_MOST_PIECES = 1000


@dataclass
class Run:
    """Consecutive moves between two lines that stand in both programs, with the numbers of their lines."""

    moves: list[Move] = field(default_factory=list)
    numbers: list[int] = field(default_factory=list)
    next_line: Line | None = None


def runs_of(reader: ProgramReader) -> Iterator[Run]:
    """Give the runs of a program; the comment that marks it as corrected is left out."""
    run = Run()
    for line in reader:
        if line.move is not None:
            run.moves.append(line.move)
            run.numbers.append(line.number)
        elif MARK not in line.body:
            run.next_line = line
            yield run
            run = Run()
    yield run


def paired_runs(reader_in: ProgramReader, reader_out: ProgramReader) -> Iterator[tuple[Run, Run]]:
    """Give the runs of both programs side by side.

    Raises
    ------
    GcodeError
        where a line that is no move differs, or the corrected program has fewer moves or lines, or moves where the
        program has none.
    """
    # Where one program ends the other has a line: that is refused before either has no more runs.
    for run_in, run_out in zip(runs_of(reader_in), runs_of(reader_out), strict=True):
        line_in, line_out = run_in.next_line, run_out.next_line
        place_in = f"{reader_in.path}:{_number(reader_in, line_in)}"
        problem = None
        if (None if line_in is None else line_in.body) != (None if line_out is None else line_out.body):
            problem = f"{_shown(line_out)} stands where {place_in} has {_shown(line_in)}"
        elif len(run_out.moves) < len(run_in.moves):
            missing = len(run_in.moves) - len(run_out.moves)
            problem = f"{missing} moves are missing before this line, which is {place_in}"
        elif run_out.moves and not run_in.moves:
            problem = f"moves stand before this line, and none before {place_in}"
        if problem is not None:
            raise GcodeError(reader_out.path, _number(reader_out, line_out), problem, remedy=_remedy(reader_in))
        yield run_in, run_out


def _number(reader: ProgramReader, line: Line | None) -> int:
    """Give the number of a line; of the end, that of the last one."""
    return max(reader.n_lines, 1) if line is None else line.number


def _remedy(reader_in: ProgramReader) -> str:
    """Say what to give; behind homing nothing is known of the moves of a program that `--home` was corrected with."""
    lacking = [("--home", reader_in.lacks_home), ("--work-offset", reader_in.lacks_zero)]
    options = " and ".join(option for option, lacks in lacking if lacks)
    return f"{REMEDY}, and {options} where it was given one" if options else REMEDY


def further_pieces(actual_mm: Iterable[Sequence[float]] | Numbers, end_mm: Triple) -> int:
    """Give the number of pieces behind the first until the tool reaches the end of the move.

    `actual_mm` are the places of the tool, by the model, at the end of that piece and of those behind it, (3,) each.
    """
    x, y, z = end_mm
    nearest, nearest_mm = 0, math.inf
    # Place by place: the first is nearly always the one.
    for number, (actual_x, actual_y, actual_z) in enumerate(itertools.islice(actual_mm, _MOST_PIECES + 1)):
        off_mm = math.hypot(actual_x - x, actual_y - y, actual_z - z)
        if off_mm <= END_MM:
            return number
        if off_mm < nearest_mm:
            nearest, nearest_mm = number, off_mm
    # A path that is corrected for another machine never comes close: its nearest piece stands for the end.
    return nearest


def _shown(line: Line | None) -> str:
    return "the end" if line is None else f"`{line.body.decode('ascii', 'backslashreplace').strip()[:60]}`"
