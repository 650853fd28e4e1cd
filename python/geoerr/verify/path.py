"""Prove a corrected program: run both programs through the model and compare their paths with the intended one."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from geoerr import _core
from geoerr.arguments import check_choice, check_threads
from geoerr.errors import GcodeError, GeoerrError
from geoerr.model import Model
from geoerr.model.arrays import Triple, triple_mm
from geoerr.model.called import check_model
from geoerr.model.conditions import Conditions
from geoerr.model.program_conditions import program_conditions, without_waves_in_time
from geoerr.verify.path_matching import END_MM, REMEDY, Run, further_pieces, paired_runs, piece_counts
from geoerr.verify.program_reader import FIRMWARES, UNITS_PER_MM, Move, ProgramReader

Numbers = npt.NDArray[np.float64]

# Moves that are compared together, and samples that are evaluated together: what bounds the memory.
_BATCH_MOVES = 50_000
_BATCH_SAMPLES = 500_000
# What a correction changes of a path's length is far less; what is more than this has another reason.
_FEED_CHANGE = 0.01
# Each leaves as much of the last change as errors change by a millimetre of travel: under a hundredth.
_PLACE_STEPS = 4
# What a piece extrudes may differ from its share of its move's by this part of the whole, and by its digits.
_EXTRUSION_SHARE, _EXTRUSION_DIGITS_MM = 0.01, 1e-3


@dataclass(frozen=True)
class PathResult:
    """How far the tool is from where the program means it to be.

    Errors are distances between the actual tool position, by the model, and the intended one at the same share of the
    move; rms figures weigh every millimetre of the path alike.

    Attributes
    ----------
    max_error_um_before, rms_um_before
        Of the program as it was written.
    max_error_um_after, rms_um_after
        Of the corrected one.
    max_error_line_after
        Line of the corrected program where its largest error is; 0 where nothing was compared.
    moves_in, moves_out
        Moves (lines that give X, Y or Z to a motion code) of both.
    moves_compared, moves_not_compared
        Moves of the first program whose path was compared, and the others: they begin or end at a place that is not
        known, or begin where homing leaves the machine, of which `compensate` corrects the end alone, or are no
        straight moves.
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
    """

    max_error_um_before: float
    max_error_um_after: float
    rms_um_before: float
    rms_um_after: float
    max_error_line_after: int
    moves_in: int
    moves_out: int
    moves_compared: int
    moves_not_compared: int
    path_mm: float
    extrusion_in_mm: float
    extrusion_out_mm: float
    moves_with_other_extrusion: int
    other_extrusion_line: int
    max_feed_change_percent: float
    max_feed_change_line: int
    moves_with_other_feed: int

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


@dataclass(frozen=True)
class _Pieces:
    """Straight pieces of the corrected program: commanded and intended ends, motion, lines; all (n, ...)."""

    command_begin_mm: Numbers
    command_end_mm: Numbers
    ideal_begin_mm: Numbers
    ideal_end_mm: Numbers
    motion_begin: Numbers
    motion_end: Numbers
    line: npt.NDArray[np.int64]


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
class _Tally:
    """What was compared, and how moves differ from their pieces other than by their path."""

    n_compared: int = 0
    n_other_extrusion: int = 0
    other_extrusion_line: int = 0
    n_other_feed: int = 0
    feed_change: float = 0.0
    feed_change_line: int = 0

    def add(self, move: Move, pieces: Sequence[Move], ends: Sequence[float], lines: Sequence[int]) -> None:
        """Count a move; `ends` are the shares of it at which its pieces are meant to end."""
        other = _other_extrusion(move, pieces, ends)
        if other is not None:
            self.n_other_extrusion += 1
            self.other_extrusion_line = self.other_extrusion_line or lines[other]
        changes = [move.feed.change_to(piece.feed) for piece in pieces]
        largest = max(changes)
        self.n_other_feed += largest > _FEED_CHANGE
        if largest > self.feed_change:
            self.feed_change, self.feed_change_line = largest, lines[changes.index(largest)]


def _other_extrusion(move: Move, pieces: Sequence[Move], ends: Sequence[float]) -> int | None:
    """Give the first piece that does not extrude its share of the path, the very first where only the sum is another.

    Digits of words and what places are off are left to it; None where all is as the move has it.
    """
    other = None if sum(piece.extrusion for piece in pieces) == move.extrusion else 0
    if move.start_mm is None:
        return other
    margin = _EXTRUSION_SHARE * abs(move.extrusion) + _EXTRUSION_DIGITS_MM * UNITS_PER_MM
    shares = np.diff([0.0, *ends[:-1], 1.0]).tolist()
    off = (abs(piece.extrusion - share * move.extrusion) for piece, share in zip(pieces, shares, strict=True))
    return next((number for number, one in enumerate(off) if one > margin), other)


class _Machine:
    """The machine that runs the programs, under their conditions."""

    def __init__(self, model: Model, at: Conditions | None, threads: int) -> None:
        model = without_waves_in_time(model)
        self._compiled = model.compiled_at(program_conditions(model, at))
        self._threads = threads
        terms = self._compiled if isinstance(self._compiled, _core.TermMachine) else None
        self.follows_motion = terms is not None and bool(terms.motion_names)
        self.windups = [] if terms is None else terms.windups

    def error_mm(self, q_mm: Numbers, motion: Numbers) -> Numbers:
        """Give actual minus nominal position of the tool point, (n, 3)."""
        origin = np.zeros((1, 3))
        if isinstance(self._compiled, _core.TermMachine):
            return self._compiled.error_mm(q_mm, origin, self._threads, motion)
        return self._compiled.error_mm(q_mm, origin, self._threads)


def compare_paths(
    model: Model,
    before: str | Path,
    after: str | Path,
    *,
    at: Conditions | None = None,
    work_offset_mm: Triple = (0.0, 0.0, 0.0),
    home_mm: Triple | None = None,
    firmware: str | None = None,
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
    work_offset_mm, home_mm, firmware
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
    machine = _Machine(model, at, threads)
    options = (work_offset_mm, home_mm, firmware, machine.windups)
    reader_in, reader_out = ProgramReader(before, *options), ProgramReader(after, *options)
    in_figures, out_figures = _Figures(), _Figures()
    tally = _Tally()
    for batch in _batches(paired_runs(reader_in, reader_out)):
        pieces = _pieces(machine, reader_in.path, reader_out.path, batch, tally)
        for part in _parts(pieces, sample_step_mm):
            samples = _sample(machine, part, sample_step_mm, in_figures, out_figures)
            if on_samples is not None:
                on_samples(samples)
        last_line = batch[-1][0].next_line
        if on_progress is not None and last_line is not None:
            on_progress(last_line.number)
    return PathResult(
        max_error_um_before=in_figures.largest_mm * 1e3,
        max_error_um_after=out_figures.largest_mm * 1e3,
        rms_um_before=in_figures.rms_mm * 1e3,
        rms_um_after=out_figures.rms_mm * 1e3,
        max_error_line_after=out_figures.largest_at,
        moves_in=reader_in.n_moves,
        moves_out=reader_out.n_moves,
        moves_compared=tally.n_compared,
        moves_not_compared=reader_in.n_moves - tally.n_compared,
        path_mm=in_figures.weight,
        extrusion_in_mm=reader_in.extrusion / UNITS_PER_MM,
        extrusion_out_mm=reader_out.extrusion / UNITS_PER_MM,
        moves_with_other_extrusion=tally.n_other_extrusion,
        other_extrusion_line=tally.other_extrusion_line,
        max_feed_change_percent=100.0 * tally.feed_change,
        max_feed_change_line=tally.feed_change_line,
        moves_with_other_feed=tally.n_other_feed,
    )


def _check_arguments(
    work_offset_mm: Triple, home_mm: Triple | None, firmware: str | None, sample_step_mm: float, threads: int
) -> None:
    triple_mm(work_offset_mm, "work_offset_mm")
    if home_mm is not None:
        triple_mm(home_mm, "home_mm")
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


def _pieces(machine: _Machine, before: Path, after: Path, batch: list[tuple[Run, Run]], tally: _Tally) -> _Pieces:
    """Match the moves of a batch; give the pieces of those that can be compared."""
    commands = _rows([move.end_mm for _, run_out in batch for move in run_out.moves])
    actual_mm = commands
    if not machine.follows_motion:
        actual_mm = commands + machine.error_mm(commands, np.zeros((1, 10)))
    rows: list[tuple[Triple, Triple, Triple, Triple, int]] = []
    motions: list[Numbers] = []
    at = 0
    for run_in, run_out in batch:
        n_out = len(run_out.moves)
        own_mm = actual_mm[at : at + n_out]
        if machine.follows_motion:
            counts, shares = _counts_and_shares(machine, run_in, run_out, own_mm)
        else:
            counts = piece_counts(run_in, run_out, own_mm)
            shares = _shares(run_in, counts, own_mm)
        _refuse_unclear_extrusion(before, run_in, counts)
        first = 0
        for move, count in zip(run_in.moves, counts, strict=True):
            own, numbers = run_out.moves[first : first + count], run_out.numbers[first : first + count]
            _refuse_other_words(after, move, own, numbers)
            tally.add(move, own, shares[first : first + count], numbers)
            if move.start_mm is not None and own[0].start_mm is not None:
                tally.n_compared += 1
                ideal, begun = move.start_mm, 0.0
                for number, piece in enumerate(own):
                    share = shares[first + number]
                    is_last = number + 1 == count
                    end = move.end_mm if is_last else _between(move.start_mm, move.end_mm, share)
                    begin = piece.start_mm or move.start_mm
                    rows.append((begin, piece.end_mm, ideal, end, numbers[number]))
                    motions.append(move.course.motion_at([begun, share]))
                    ideal, begun = end, share
            first += count
        at += n_out
    begins, ends, ideal_begins, ideal_ends, lines = ([row[column] for row in rows] for column in range(5))
    motion = np.array(motions, dtype=np.float64).reshape(-1, 2, 10 + len(machine.windups))
    return _Pieces(
        _rows(begins),
        _rows(ends),
        _rows(ideal_begins),
        _rows(ideal_ends),
        motion[:, 0],
        motion[:, 1],
        np.array(lines, dtype=np.int64),
    )


def _refuse_other_words(program: Path, move: Move, pieces: Sequence[Move], numbers: Sequence[int]) -> None:
    """Refuse a piece that says something else than its move, of a laser's power say: the first says it for all."""
    for piece, number in zip(pieces, numbers, strict=True):
        wanted = move.others if number == numbers[0] else ()
        if piece.others not in (move.others, wanted):
            said, meant = (" ".join(one) or "nothing" for one in (piece.others, wanted))
            raise GcodeError(
                program, number, f"says {said} besides where to go, and its move says {meant}", remedy=REMEDY
            )


def _refuse_unclear_extrusion(program: Path, run_in: Run, counts: list[int]) -> None:
    """Ask what `compensate` asks, in its words: what a split move extrudes, its firmware decides."""
    for move, number, count in zip(run_in.moves, run_in.numbers, counts, strict=True):
        if count > 1 and not move.is_extrusion_clear:
            problem, remedy = _core.unclear_extrusion()
            raise GcodeError(program, number, problem, remedy=remedy)


def _shares(run_in: Run, counts: list[int], actual_mm: Numbers) -> list[float]:
    """Give the share of its move at which the program means each piece to end."""
    shares = []
    at = 0
    for move, count in zip(run_in.moves, counts, strict=True):
        begin = move.start_mm or move.end_mm
        shares += [_foot(begin, move.end_mm, point) for point in actual_mm[at : at + count - 1]]
        shares.append(1.0)
        at += count
    return shares


def _counts_and_shares(
    machine: _Machine, run_in: Run, run_out: Run, commands_mm: Numbers
) -> tuple[list[int], list[float]]:
    """Do the same as `piece_counts` and `_shares` where the tool's place depends on the motion of the move."""
    counts: list[int] = []
    shares: list[float] = []
    slack, at = len(run_out.moves) - len(run_in.moves), 0
    for number, move in enumerate(run_in.moves):
        begin = move.start_mm or move.end_mm
        count = 1
        if number + 1 == len(run_in.moves):
            count += slack
        elif slack and move.start_mm is not None:
            some = commands_mm[at : at + slack + 1]
            count += further_pieces(some + machine.error_mm(some, move.course.motion_at(1.0)), move.end_mm)
        own = np.full(count, 1.0)
        inner = commands_mm[at : at + count - 1]
        # Where errors follow the travel, the place says the travel and the travel the place.
        for _ in range(_PLACE_STEPS if count > 1 else 0):
            actual_mm = inner + machine.error_mm(inner, move.course.motion_at(own[:-1]))
            own[:-1] = [_foot(begin, move.end_mm, point) for point in actual_mm]
        if count > 1 and math.dist(begin, move.end_mm) * own[0] < END_MM:
            # The piece takes up play at the begin of the move.
            own[0] = 0.0
        shares += own.tolist()
        counts.append(count)
        slack -= count - 1
        at += count
    return counts, shares


def _foot(begin: Triple, end: Triple, point: Numbers) -> float:
    """Give the share of a segment at which it is nearest to `point`: where the program means a piece to end."""
    along = np.subtract(end, begin)
    length2 = float(along @ along)
    return 0.0 if length2 == 0.0 else float(np.clip((point - np.asarray(begin)) @ along / length2, 0.0, 1.0))


def _between(begin: Triple, end: Triple, share: float) -> Triple:
    x, y, z = (np.asarray(begin) + share * np.subtract(end, begin)).tolist()
    return x, y, z


def _parts(pieces: _Pieces, step_mm: float) -> Iterator[_Pieces]:
    """Give the pieces in groups that have a bounded number of samples."""
    n_samples = np.cumsum(_intervals(pieces, step_mm) + 1)
    begin = 0
    while begin < len(n_samples):
        before = n_samples[begin - 1] if begin else 0
        end = max(begin + 1, int(np.searchsorted(n_samples, before + _BATCH_SAMPLES)))
        part = slice(begin, end)
        yield _Pieces(
            pieces.command_begin_mm[part],
            pieces.command_end_mm[part],
            pieces.ideal_begin_mm[part],
            pieces.ideal_end_mm[part],
            pieces.motion_begin[part],
            pieces.motion_end[part],
            pieces.line[part],
        )
        begin = end


def _intervals(pieces: _Pieces, step_mm: float) -> npt.NDArray[np.int64]:
    length_mm = np.linalg.norm(pieces.ideal_end_mm - pieces.ideal_begin_mm, axis=1)
    return np.asarray(np.maximum(4, np.ceil(length_mm / step_mm)), dtype=np.int64)


def _sample(
    machine: _Machine, pieces: _Pieces, step_mm: float, in_figures: _Figures, out_figures: _Figures
) -> PathSamples:
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
    motion = pieces.motion_begin[piece] * (1.0 - share) + pieces.motion_end[piece] * share
    is_end = (number == 0) | (number == n_intervals[piece])
    weight = (length_mm / n_intervals)[piece] * np.where(is_end, 0.5, 1.0)
    line = pieces.line[piece]
    before = np.linalg.norm(machine.error_mm(ideal, motion), axis=1)
    after = np.linalg.norm((command - ideal) + machine.error_mm(command, motion), axis=1)
    in_figures.add(before, weight, line)
    out_figures.add(after, weight, line)
    return PathSamples(ideal, before, after, weight)


def _rows(triples: list[Any]) -> Numbers:
    return np.array(triples, dtype=np.float64).reshape(-1, 3)
