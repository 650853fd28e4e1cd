"""The straight pieces of a corrected program beside the moves that they are pieces of."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from geoerr import _core
from geoerr.errors import GcodeError
from geoerr.model.arrays import Triple
from geoerr.verify.path_machine import ProgramMachine
from geoerr.verify.path_matching import END_MM, REMEDY, Run, further_pieces
from geoerr.verify.path_tally import Tally
from geoerr.verify.play import HeldBack, Play, Sides
from geoerr.verify.program_motion import Courses
from geoerr.verify.program_passages import Gone, gone_before
from geoerr.verify.program_reader import Move

Numbers: TypeAlias = npt.NDArray[np.float64]
_Places: TypeAlias = npt.NDArray[np.int64]

# Each leaves as much of the last change as errors change by a millimetre of travel: under a hundredth.
_PLACE_STEPS = 4
# Spindle and coolant on, and how E is read: these hold from the begin of a move, other M codes may wait for its end.
_FROM_THE_BEGIN = frozenset(("M3", "M4", "M7", "M8", "M13", "M14", "M82", "M83"))
# Commands whose places are worked out at first, where a move may have further pieces: most have none.
_FIRST_LOOK = 2


@dataclass(frozen=True)
class Pieces:
    """Straight pieces of the corrected program: commanded and intended ends, lines, motion; all (n, ...).

    Motion (n, 2, m) is that at both ends; it and what play holds back are None where errors do not depend on it.
    """

    command_begin_mm: Numbers
    command_end_mm: Numbers
    ideal_begin_mm: Numbers
    ideal_end_mm: Numbers
    line: _Places
    motion: Numbers | None
    held_back: HeldBack | None

    def part(self, of: slice | npt.NDArray[np.bool_]) -> Pieces:
        """Give some of them."""
        return Pieces(
            self.command_begin_mm[of],
            self.command_end_mm[of],
            self.ideal_begin_mm[of],
            self.ideal_end_mm[of],
            self.line[of],
            None if self.motion is None else self.motion[of],
            None if self.held_back is None else self.held_back.part(of),
        )


class Follower:
    """The play of a machine whose errors follow motion, while pieces are matched with their moves and behind that."""

    def __init__(self, machine: ProgramMachine) -> None:
        self.sides = Sides(machine)
        self.play = Play(machine)


def pieces_of(
    machine: ProgramMachine,
    before: Path,
    after: Path,
    batch: Sequence[tuple[Run, Run]],
    tally: Tally,
    follower: Follower | None,
) -> Pieces:
    """Match the moves of a batch; give the pieces of those that can be compared.

    Raises
    ------
    GcodeError
        where a piece says something else than its move, or a split move extrudes what firmwares differ on.
    """
    moves = [move for run_in, _ in batch for move in run_in.moves]
    own = [move for _, run_out in batch for move in run_out.moves]
    lines = [number for _, run_out in batch for number in run_out.numbers]
    command_mm, end_mm = _rows([one.end_mm for one in own]), _rows([one.end_mm for one in moves])
    start_mm = _rows([one.start_mm or one.end_mm for one in moves])
    courses = Courses([one.course for one in moves if one.course is not None]) if machine.follows_motion else None
    sides = None if follower is None else follower.sides
    gone = {} if follower is None else _gone(moves, own)
    counts = np.array(list(_counts(machine, batch, command_mm, courses, sides, gone)), dtype=np.int64)
    _refuse_unclear_extrusion(before, [number for run_in, _ in batch for number in run_in.numbers], moves, counts)
    of, first = np.repeat(np.arange(len(moves)), counts), np.cumsum(counts) - counts
    shares = _shares(machine, courses, of, first, command_mm, start_mm, end_mm)
    is_compared = np.zeros(len(moves), dtype=bool)
    told = shares.tolist()
    for number, (move, at, count) in enumerate(zip(moves, first.tolist(), counts.tolist(), strict=True)):
        mine = slice(at, at + count)
        _refuse_other_words(after, move, own[mine], lines[mine])
        tally.add(move, own[mine], told[mine], lines[mine])
        is_compared[number] = move.start_mm is not None and own[at].start_mm is not None
    tally.n_compared += int(is_compared.sum())
    begun = np.zeros_like(shares)
    begun[1:] = shares[:-1]
    begun[first] = 0.0
    begin_mm = _rows([one.start_mm or (np.nan, np.nan, np.nan) for one in own])
    begin_mm = np.where(np.isnan(begin_mm), start_mm[of], begin_mm)
    motion = held_back = None
    if courses is not None:
        motion = np.stack([courses.motion_at(of, begun), courses.motion_at(of, shares)], axis=1)
        if follower is not None:
            held_back = follower.play.held_back(command_mm, motion[:, 1].copy(), gone)
    is_counted = is_compared[of]
    if motion is not None and held_back is not None:
        # Of a move behind what passed the end alone is corrected, and may be held back.
        ends = [at + counts[of[at]] - 1 for at, one in gone.items() if any(one.places_mm) and not is_counted[at]]
        begin_mm[ends], begun[ends], is_counted[ends] = command_mm[ends], 1.0, True
        motion[ends, 0], held_back.share[ends, 0] = motion[ends, 1], held_back.share[ends, 1]
    pieces = Pieces(
        begin_mm,
        command_mm,
        _between(start_mm[of], end_mm[of], begun),
        _between(start_mm[of], end_mm[of], shares),
        np.array(lines, dtype=np.int64),
        motion,
        held_back,
    )
    return pieces.part(is_counted)


def _gone(moves: Sequence[Move], own: Sequence[Move]) -> dict[int, Gone]:
    """Give what passed before pieces, by their numbers: what the corrected program does, whole circles as meant."""
    meant = [one.is_whole for move in moves for one in move.passed]
    told = [one.is_whole for move in own for one in move.passed]
    are_whole = iter(meant if len(meant) == len(told) else told)
    return {
        piece: gone_before(move.passed, itertools.islice(are_whole, len(move.passed)))
        for piece, move in enumerate(own)
        if move.passed
    }


def _counts(
    machine: ProgramMachine,
    batch: Sequence[tuple[Run, Run]],
    command_mm: Numbers,
    courses: Courses | None,
    sides: Sides | None,
    gone: Mapping[int, Gone],
) -> Iterator[int]:
    """Give the number of pieces of each move of a batch."""
    actual_mm = command_mm
    if courses is None:
        actual_mm = command_mm + machine.error_mm(command_mm, None)
    if sides is not None:
        sides.begin(command_mm, gone)
    at = number = 0
    for run_in, run_out in batch:
        slack, last = len(run_out.moves) - len(run_in.moves), number + len(run_in.moves) - 1
        for move in run_in.moves:
            count = 1
            if number == last:
                count += slack
            elif slack and move.start_mm is not None:
                some = actual_mm[at : at + slack + 1]
                places: Iterable[Sequence[float]] = some
                if courses is not None:
                    places = _places_in_turn(machine, some, courses, number)
                    if sides is not None:
                        elsewhere_mm = sides.elsewhere_mm(at, courses.direction_of(number))
                        places = (
                            _nearest(place, ways, move.end_mm)
                            for place, ways in zip(places, elsewhere_mm, strict=False)
                        )
                count += further_pieces(places, move.end_mm)
            yield count
            if sides is not None and courses is not None:
                sides.take(range(at, at + count), courses.direction_of(number))
            slack -= count - 1
            at += count
            number += 1


def _places_in_turn(
    machine: ProgramMachine, commands_mm: Numbers, courses: Courses, move: int
) -> Iterator[list[float]]:
    """Give where the tool is at commands that may end a move, a few worked out at a time: many are seldom wanted."""
    motion = courses.motion_at(np.array([move]), np.ones(1))
    begin, n = 0, _FIRST_LOOK
    while begin < len(commands_mm):
        some = commands_mm[begin : begin + n]
        yield from (some + machine.error_mm(some, motion)).tolist()
        begin, n = begin + n, 4 * n


def _nearest(place_mm: Sequence[float], ways_mm: Sequence[Sequence[float]], end_mm: Triple) -> list[float]:
    """Give a place displaced in the way that has it nearest to the end."""
    ways = ([at + off for at, off in zip(place_mm, way, strict=True)] for way in ways_mm)
    return min(ways, key=lambda way: math.dist(way, end_mm))


def _shares(
    machine: ProgramMachine,
    courses: Courses | None,
    of: _Places,
    first: _Places,
    command_mm: Numbers,
    start_mm: Numbers,
    end_mm: Numbers,
) -> Numbers:
    """Give the share of its move at which the program means each piece to end, (n,)."""
    shares = np.ones(len(of))
    is_inner = np.concatenate([of[1:] == of[:-1], [False]]) if len(of) else np.zeros(0, dtype=bool)
    if not is_inner.any():
        return shares
    own, inner_mm = of[is_inner], command_mm[is_inner]
    begin_mm, along_mm = start_mm[own], end_mm[own] - start_mm[own]
    length2 = np.einsum("nc,nc->n", along_mm, along_mm)
    per_mm2 = np.divide(1.0, length2, out=np.zeros_like(length2), where=length2 > 0.0)
    inner = np.ones(len(own))
    # Where errors follow the travel, the place says the travel and the travel the place.
    for _ in range(1 if courses is None else _PLACE_STEPS):
        motion = None if courses is None else courses.motion_at(own, inner)
        actual_mm = inner_mm + machine.error_mm(inner_mm, motion)
        inner = np.clip(np.einsum("nc,nc->n", actual_mm - begin_mm, along_mm) * per_mm2, 0.0, 1.0)
    shares[is_inner] = inner
    if courses is not None:
        # A piece that goes nowhere takes up play.
        length_mm = np.zeros(len(of))
        length_mm[is_inner] = np.sqrt(length2)
        told, firsts = shares.tolist(), frozenset(first.tolist())
        for piece in np.flatnonzero(is_inner).tolist():
            begun = 0.0 if piece in firsts else told[piece - 1]
            if (told[piece] - begun) * length_mm[piece] < END_MM:
                told[piece] = begun
        shares = np.array(told)
    return shares


def _refuse_other_words(program: Path, move: Move, pieces: Sequence[Move], numbers: Sequence[int]) -> None:
    """Refuse a piece that says something else than its move, of a laser's power say: the first says it for all.

    What may be meant for the end of a move, as a spindle that is switched off, no piece can say.
    """
    at_end = [said for said in move.others if said.startswith("M") and said not in _FROM_THE_BEGIN]
    if at_end and len(pieces) > 1:
        problem = (
            f"says {at_end[0]} at the end of the first of {len(pieces)} pieces, and may mean the end of the move"
        )
        raise GcodeError(program, numbers[0], problem, remedy=REMEDY)
    for piece, number in zip(pieces, numbers, strict=True):
        wanted = move.others if number == numbers[0] else ()
        if piece.others not in (move.others, wanted):
            said, meant = (" ".join(one) or "nothing" for one in (piece.others, wanted))
            raise GcodeError(
                program, number, f"says {said} besides where to go, and its move says {meant}", remedy=REMEDY
            )


def _refuse_unclear_extrusion(program: Path, numbers: Sequence[int], moves: Sequence[Move], counts: _Places) -> None:
    """Ask what `compensate` asks, in its words: what a split move extrudes a firmware decides, or nobody said."""
    for place in np.flatnonzero(counts > 1).tolist():
        if moves[place].extrusion_reading != "clear":
            problem, remedy = _core.unclear_extrusion(is_lost=moves[place].extrusion_reading == "lost")
            raise GcodeError(program, numbers[place], problem, remedy=remedy)


def _between(begin_mm: Numbers, end_mm: Numbers, share: Numbers) -> Numbers:
    """Give places at shares of segments, (n, 3); ends are the very ends."""
    inner = begin_mm + share[:, None] * (end_mm - begin_mm)
    return np.where(share[:, None] == 1.0, end_mm, inner)


def _rows(triples: Sequence[Triple]) -> Numbers:
    return np.array(triples, dtype=np.float64).reshape(-1, 3)
