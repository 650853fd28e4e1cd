"""Prove a corrected program: run both programs through the model and compare their paths with the intended one."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from geoerr.arguments import check_choice, check_still, check_threads
from geoerr.errors import GeoerrError
from geoerr.machine import AXES
from geoerr.model import Model
from geoerr.model.arrays import Triple, triple_mm
from geoerr.model.called import check_model
from geoerr.model.conditions import Conditions
from geoerr.verify.path_machine import ProgramMachine
from geoerr.verify.path_matching import Run, paired_runs
from geoerr.verify.path_pieces import Follower, Pieces, pieces_of
from geoerr.verify.path_tally import Tally
from geoerr.verify.program_reader import FIRMWARES, UNITS_PER_MM, ProgramReader

Numbers = npt.NDArray[np.float64]

# Moves that are compared together, and samples that are evaluated together: what bounds the memory.
_BATCH_MOVES = 50_000
_BATCH_SAMPLES = 500_000


@dataclass(frozen=True)
class PathResult:
    """How far the tool is from where the program means it to be.

    Errors are distances between the actual tool position, by the model, and the intended one at the same share of the
    move; rms figures weigh every millimetre of the path alike. Of the corrected program they count what play holds
    back of axes that corrections turn.

    Attributes
    ----------
    max_error_um_before, rms_um_before
        Of the program as it was written.
    max_error_um_after, rms_um_after
        Of the corrected one.
    max_error_line_after
        Line of the corrected program where its largest error is; 0 where nothing was compared.
    held_back_um, held_back_line
        What play adds to these at most, of axes that corrections turn, and the line of the corrected program where
        that is; 0 where there is none.
    moves_in, moves_out
        Moves (lines that give X, Y or Z to a motion code) of both.
    moves_compared, moves_not_compared
        Moves of the first program whose path was compared, and the others: they begin or end at a place that is not
        known, or begin where homing leaves the machine, of which `compensate` corrects the end alone, or are no
        straight moves. Behind an arc the end counts where play may hold it back.
    moves_not_followed, not_followed_line
        Lines of the first program that move and of which nothing could be compared, not even where they end, and the
        first of them (0: none): `compensate` passes them through as they are. Moves to places that are not known,
        arcs, cycles, calls of other programs, and what stands behind them.
    path_mm
        Length of the path that was compared.
    extrusion_in_mm, extrusion_out_mm
        Net extruded length of both.
    moves_with_other_extrusion
        Moves whose pieces together do not extrude what the move did, or share it otherwise than by their lengths.
    other_extrusion_line
        Line of the corrected program where the first of them does; 0 where none does.
    max_feed_change_percent, max_feed_change_line
        Largest difference of a piece's feed from that of its move, and the line of the corrected program where it is;
        100 % where a rapid move is none any more, or there was no feed. `compensate` keeps the feed.
    moves_with_other_feed
        Moves of which a piece's feed differs by more than 1 %.
    lacks_zero
        Whether the first program has machine coordinates, and where its zero is in them nobody has told.
    """

    max_error_um_before: float
    max_error_um_after: float
    rms_um_before: float
    rms_um_after: float
    max_error_line_after: int
    held_back_um: float
    held_back_line: int
    moves_in: int
    moves_out: int
    moves_compared: int
    moves_not_compared: int
    moves_not_followed: int
    not_followed_line: int
    path_mm: float
    extrusion_in_mm: float
    extrusion_out_mm: float
    moves_with_other_extrusion: int
    other_extrusion_line: int
    max_feed_change_percent: float
    max_feed_change_line: int
    moves_with_other_feed: int
    lacks_zero: bool

    def to_document(self) -> dict[str, Any]:
        """Give it as plain values, for `--json`."""
        return dict(vars(self))


@dataclass(frozen=True, eq=False)
class PathSamples:
    """Samples of a stretch of path.

    Attributes
    ----------
    intended_mm : (n, 3)
        Where the program means the tool to be.
    before_mm, after_mm : (n,)
        Distance of the tool from it, without and with compensation.
    weight_mm : (n,)
        Length of path that a sample stands for.
    """

    intended_mm: Numbers
    before_mm: Numbers
    after_mm: Numbers
    weight_mm: Numbers


@dataclass
class _Figures:
    largest_mm: float = 0.0
    largest_at: int = 0
    weighted_square: float = 0.0
    weight: float = 0.0

    def add(self, distance_mm: Numbers, weight: Numbers, line: npt.NDArray[np.int64]) -> None:
        worst = int(np.argmax(distance_mm))
        if distance_mm[worst] > self.largest_mm or not self.largest_at:
            self.largest_mm, self.largest_at = float(distance_mm[worst]), int(line[worst])
        self.weighted_square += float(np.sum(weight * distance_mm**2))
        self.weight += float(np.sum(weight))

    @property
    def rms_mm(self) -> float:
        return float(np.sqrt(self.weighted_square / self.weight)) if self.weight > 0.0 else 0.0


@dataclass
class _AllFigures:
    """Of the program, of the corrected one, and how much larger play that is held back makes its errors."""

    before: _Figures = field(default_factory=_Figures)
    after: _Figures = field(default_factory=_Figures)
    held_back: _Figures = field(default_factory=_Figures)


def compare_paths(
    model: Model,
    before: str | Path,
    after: str | Path,
    *,
    at: Conditions | None = None,
    work_offset_mm: Triple | None = None,
    home_mm: Triple | None = None,
    firmware: str | None = None,
    still: Sequence[str] = (),
    sample_step_mm: float = 0.5,
    threads: int = 0,
    on_progress: Callable[[int], None] | None = None,
    on_samples: Callable[[PathSamples], None] | None = None,
) -> PathResult:
    """Compare the paths of a program and of its corrected form with the intended path.

    Parameters
    ----------
    model
        The machine that runs them.
    before, after
        The program as it was written and as it was corrected.
    at
        Conditions by name, as they were given when the program was corrected. Direction, travel and speed are those
        of the moves of `before`.
    work_offset_mm, home_mm, firmware, still
        As they were given when the program was corrected.
    sample_step_mm
        Largest distance of neighbouring samples; every piece has five at least.
    threads
        0 = all cores. Never changes a figure.
    on_progress
        Called with the number of lines of `before` read so far.
    on_samples
        Called with the samples of each stretch of path, in order: to draw them.

    Returns
    -------
    PathResult

    Raises
    ------
    GcodeError
        naming the line of `after` that does not belong to `before`: it is no move and differs, moves are missing, or
        a move says something else besides where to go (`S600`, `M8`);
        or that of a split move in `before` of which firmwares differ on what it extrudes, where none is named.
    InputFileError
        where a file cannot be read.
    GeoerrError
        for another argument that is not as it should be, by name.
    """
    check_model(model, (before, after), "compare_paths(model, before, after)")
    _check_arguments(work_offset_mm, home_mm, firmware, sample_step_mm, threads)
    check_still(still)
    machine = ProgramMachine(model, at, threads)
    options = work_offset_mm, home_mm, firmware
    ranges_mm = [model.machine.axes[axis].range_mm for axis in AXES]
    # How a place is come to is the program's, not the correction's.
    windups = machine.windups if machine.follows_motion else None
    reader_in = ProgramReader(before, *options, windups=windups, ranges_mm=ranges_mm, still=still)
    reader_out = ProgramReader(after, *options, windups=None, ranges_mm=ranges_mm, still=still)
    figures, tally = _AllFigures(), Tally()
    follower = Follower(machine) if machine.follows_motion else None
    for batch in _batches(paired_runs(reader_in, reader_out)):
        pieces = pieces_of(machine, reader_in.path, reader_out.path, batch, tally, follower)
        for part in _parts(pieces, sample_step_mm):
            samples = _sample(machine, part, sample_step_mm, figures)
            if on_samples is not None:
                on_samples(samples)
        last_line = batch[-1][0].next_line
        if on_progress is not None and last_line is not None:
            on_progress(last_line.number)
    return PathResult(
        max_error_um_before=figures.before.largest_mm * 1e3,
        max_error_um_after=figures.after.largest_mm * 1e3,
        rms_um_before=figures.before.rms_mm * 1e3,
        rms_um_after=figures.after.rms_mm * 1e3,
        max_error_line_after=figures.after.largest_at,
        held_back_um=figures.held_back.largest_mm * 1e3,
        held_back_line=figures.held_back.largest_at if figures.held_back.largest_mm > 0.0 else 0,
        moves_in=reader_in.n_moves,
        moves_out=reader_out.n_moves,
        moves_compared=tally.n_compared,
        moves_not_compared=reader_in.n_moves - tally.n_compared,
        moves_not_followed=reader_in.n_not_followed,
        not_followed_line=reader_in.first_not_followed,
        path_mm=figures.before.weight,
        extrusion_in_mm=reader_in.extrusion / UNITS_PER_MM,
        extrusion_out_mm=reader_out.extrusion / UNITS_PER_MM,
        moves_with_other_extrusion=tally.n_other_extrusion,
        other_extrusion_line=tally.other_extrusion_line,
        max_feed_change_percent=100.0 * tally.feed_change,
        max_feed_change_line=tally.feed_change_line,
        moves_with_other_feed=tally.n_other_feed,
        lacks_zero=reader_in.lacks_zero,
    )


def _check_arguments(
    work_offset_mm: Triple | None,
    home_mm: Triple | None,
    firmware: str | None,
    sample_step_mm: float,
    threads: int,
) -> None:
    for name, place_mm in (("work_offset_mm", work_offset_mm), ("home_mm", home_mm)):
        if place_mm is not None:
            triple_mm(place_mm, name)
    if firmware is not None:
        check_choice("firmware", firmware, FIRMWARES)
    if not 0.0 < sample_step_mm < math.inf:
        raise GeoerrError(f"sample_step_mm is {sample_step_mm!r}\nhint: give a length above 0, in mm")
    check_threads(threads)


def _batches(runs: Iterator[tuple[Run, Run]]) -> Iterator[list[tuple[Run, Run]]]:
    """Give runs in lists of some ten thousand moves, so that arrays are worth their while."""
    batch: list[tuple[Run, Run]] = []
    n_moves = 0
    for pair in runs:
        batch.append(pair)
        n_moves += len(pair[1].moves)
        if n_moves >= _BATCH_MOVES:
            yield batch
            batch, n_moves = [], 0
    if batch:
        yield batch


def _parts(pieces: Pieces, step_mm: float) -> Iterator[Pieces]:
    """Give the pieces in groups that have a bounded number of samples."""
    n_samples = np.cumsum(_intervals(pieces, step_mm) + 1)
    begin = 0
    while begin < len(n_samples):
        before = n_samples[begin - 1] if begin else 0
        end = max(begin + 1, int(np.searchsorted(n_samples, before + _BATCH_SAMPLES)))
        yield pieces.part(slice(begin, end))
        begin = end


def _intervals(pieces: Pieces, step_mm: float) -> npt.NDArray[np.int64]:
    length_mm = np.linalg.norm(pieces.ideal_end_mm - pieces.ideal_begin_mm, axis=1)
    return np.asarray(np.maximum(4, np.ceil(length_mm / step_mm)), dtype=np.int64)


def _sample(machine: ProgramMachine, pieces: Pieces, step_mm: float, figures: _AllFigures) -> PathSamples:
    """Sample every piece from end to end, evenly; a sample stands for the path half-way to its neighbours.

    A piece that the program means to have no length takes up play: its end counts.
    """
    n_intervals = _intervals(pieces, step_mm)
    n_samples = n_intervals + 1
    piece = np.repeat(np.arange(len(n_samples)), n_samples)
    number = np.arange(len(piece)) - np.repeat(np.cumsum(n_samples) - n_samples, n_samples)
    length_mm = np.linalg.norm(pieces.ideal_end_mm - pieces.ideal_begin_mm, axis=1)
    share = np.where(length_mm[piece] > 0.0, number / n_intervals[piece], 1.0)[:, None]
    command = pieces.command_begin_mm[piece] * (1.0 - share) + pieces.command_end_mm[piece] * share
    ideal = pieces.ideal_begin_mm[piece] * (1.0 - share) + pieces.ideal_end_mm[piece] * share
    motion = None
    if pieces.motion is not None:
        motion = pieces.motion[piece, 0] * (1.0 - share) + pieces.motion[piece, 1] * share
    is_end = (number == 0) | (number == n_intervals[piece])
    weight = (length_mm / n_intervals)[piece] * np.where(is_end, 0.5, 1.0)
    line = pieces.line[piece]
    before = np.linalg.norm(machine.error_mm(ideal, motion), axis=1)
    off = (command - ideal) + machine.error_mm(command, motion)
    after = np.linalg.norm(off, axis=1)
    if pieces.held_back is not None:
        as_programmed = after
        after = np.linalg.norm(off + pieces.held_back.at(piece, share), axis=1)
        figures.held_back.add(after - as_programmed, weight, line)
    figures.before.add(before, weight, line)
    figures.after.add(after, weight, line)
    return PathSamples(ideal, before, after, weight)
