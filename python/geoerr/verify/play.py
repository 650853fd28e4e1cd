"""Play followed command by command: what it holds back of the axes of a corrected program.

A model has an error of direction as of the program's own moves. The machine has it as of its commands: where these
take an axis back from where it came, by r, it follows by what is more than its play b, and min(r, b) is held back;
where they come again, it is given back. So a correction that turns an axis which rests in the program shows, and
whether its play is taken up there.

Verified in tests/compensate/test_term_programs.py against carriages that follow their drives across the play.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from copy import copy
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from geoerr.verify.path_machine import ProgramMachine
from geoerr.verify.program_passages import Gone

Numbers = npt.NDArray[np.float64]

# Columns of the core's motion: of x y z each, and of the wind-ups.
_DIRECTION, _TRAVEL_MM, _WINDUPS = 0, 3, 10
# Less of it is rounding, of what has the same value on both sides.
_LEAST_PLAY_MM = 1e-9
# Play is crossed where less of it is left than printed digits may leave.
_ON_A_SIDE_MM = 1e-3


class AxisPlay:
    """How far one axis stands in its play."""

    def __init__(self) -> None:
        self._direction = 0.0
        self._at_mm = math.nan
        self.held_mm = 0.0

    def go(self, gone: Gone, axis: int, play_mm: float) -> None:
        """Take over what passed as it is: the drive goes from place to place, the axis follows across its play."""
        if gone.is_lost[axis]:
            self._direction, self._at_mm, self.held_mm = 0.0, math.nan, 0.0
        for begin_mm, end_mm in pairwise(gone.places_mm[axis]):
            if not self._direction:
                self._direction = math.copysign(1.0, end_mm - begin_mm)
            back_mm = self.held_mm - self._direction * (end_mm - begin_mm)
            self.held_mm = min(max(back_mm, 0.0), play_mm)
            self._at_mm = end_mm

    def take(self, command_mm: float, direction: float, play_mm: float) -> tuple[float, float]:
        """Take over a piece by its end, and the direction of its move; give what was held back at its begin and end.

        What is held back counts against the direction of the move: an axis that the program turns begins with what is
        left of its play. The end is that of an axis whose play has no ends: between 0 and its play are held back.
        """
        begun_mm = self.held_mm
        if direction != self._direction:
            # Of the first direction that is known nothing says that play was ever on the other side.
            begun_mm = max(play_mm - begun_mm, 0.0) if self._direction else 0.0
        ended_mm = 0.0
        if direction and not math.isnan(self._at_mm):
            ended_mm = begun_mm - direction * (command_mm - self._at_mm)
        self.held_mm = min(max(ended_mm, 0.0), play_mm)
        self._direction, self._at_mm = direction, command_mm
        return begun_mm, ended_mm


@dataclass(frozen=True)
class HeldBack:
    """What play holds back along pieces.

    Attributes
    ----------
    share : (n, 2, 3)
        Of the play of each axis, at both ends of each piece, before it is cut to 0 and 1: a drive crosses its play on
        the way, and not evenly along it.
    across_mm : (n, 3, 3)
        What the tool is elsewhere on the other side of the play, [piece][axis].
    """

    share: Numbers
    across_mm: Numbers

    def part(self, of: slice | npt.NDArray[np.bool_]) -> HeldBack:
        """Give those of some pieces."""
        return HeldBack(self.share[of], self.across_mm[of])

    def at(self, piece: npt.NDArray[np.int64], share: Numbers) -> Numbers:
        """Give displacements (m, 3) at shares (m, 1) of pieces, by their numbers (m,)."""
        held = self.share[piece, 0] * (1.0 - share) + self.share[piece, 1] * share
        return np.asarray(np.einsum("ma,mac->mc", np.clip(held, 0.0, 1.0), self.across_mm[piece]))


class Play:
    """What play holds back, as a program goes on.

    Parameters
    ----------
    machine
        Whose errors follow motion.
    """

    def __init__(self, machine: ProgramMachine) -> None:
        self._machine = machine
        self._axes = [AxisPlay() for _ in range(3)]

    def held_back(self, command_mm: Numbers, motion: Numbers, gone: Mapping[int, Gone]) -> HeldBack:
        """Give what is held back along pieces.

        Parameters
        ----------
        command_mm : (n, 3)
            Where the pieces end.
        motion : (n, m)
            That of their moves there.
        gone
            What passed before a piece, by its number.
        """
        behind = list(gone)
        here_mm, motion_here = places_behind(gone, command_mm), motion[behind]
        here_error_mm = self._machine.error_mm(here_mm, motion_here) if behind else here_mm
        held = HeldBack(np.zeros((len(command_mm), 2, 3)), np.zeros((len(command_mm), 3, 3)))
        error_mm = self._machine.error_mm(command_mm, motion)
        for axis, state in enumerate(self._axes):
            across_mm = self._machine.error_mm(command_mm, self._turned(motion, axis)) - error_mm
            direction = motion[:, _DIRECTION + axis]
            play_mm = np.maximum(direction * across_mm[:, axis], 0.0)
            play_here_mm: dict[int, float] = {}
            if behind:
                across_here_mm = self._machine.error_mm(here_mm, self._turned(motion_here, axis)) - here_error_mm
                here = np.maximum(direction[behind] * across_here_mm[:, axis], 0.0)
                play_here_mm = dict(zip(behind, here.tolist(), strict=True))
            ends = []
            told = zip(command_mm[:, axis].tolist(), direction.tolist(), play_mm.tolist(), strict=True)
            for piece, one in enumerate(told):
                if piece in play_here_mm:
                    state.go(gone[piece], axis, play_here_mm[piece])
                ends.append(state.take(*one))
            ends_mm = np.array(ends).reshape(-1, 2)
            has_play = play_mm > _LEAST_PLAY_MM
            held.share[has_play, :, axis] = ends_mm[has_play] / play_mm[has_play, None]
            held.across_mm[has_play, axis] = across_mm[has_play]
        return held

    def _turned(self, motion: Numbers, axis: int) -> Numbers:
        """Give motion, (n, m), of an axis that a way too short to wind anything up has turned."""
        turned = motion.copy()
        travel_mm = motion[:, _TRAVEL_MM + axis]
        for number, (of, length_mm) in enumerate(self._machine.windups):
            if of == axis:
                left = _WINDUPS + number
                decay = np.exp(-travel_mm / length_mm) if length_mm > 0.0 else np.zeros_like(travel_mm)
                turned[:, left] = (1.0 - motion[:, left]) * decay
        turned[:, _DIRECTION + axis] *= -1.0
        turned[:, _TRAVEL_MM + axis] = 0.0
        return turned


def places_behind(gone: Mapping[int, Gone], command_mm: Numbers) -> Numbers:
    """Give where the machine is behind what passed, (n, 3); where that is not known, where the next piece ends."""
    places = [
        [to if at is None else at for at, to in zip(one.end_mm, command_mm[piece], strict=True)]
        for piece, one in gone.items()
    ]
    return np.array(places, dtype=np.float64).reshape(-1, 3)


class Sides:
    """On which sides of their play axes are, while nobody knows yet which move a command belongs to.

    Parameters
    ----------
    machine
        Whose errors follow motion.
    """

    def __init__(self, machine: ProgramMachine) -> None:
        self._machine = machine
        self._axes = [AxisPlay() for _ in range(3)]
        self._command_mm: list[list[float]] = []
        # What the tool is elsewhere on the other side of each axis' play.
        self._across_mm: list[list[list[float]]] = []
        self._gone: Mapping[int, Gone] = {}
        # Play of each axis behind what passed before a command.
        self._play_behind_mm: dict[int, list[float]] = {}

    def begin(self, command_mm: Numbers, gone: Mapping[int, Gone]) -> None:
        """Take over the commands, (n, 3), that come next, and what passed before some of them."""
        self._command_mm, self._gone = command_mm.tolist(), gone
        self._across_mm = self._across(command_mm)
        plays_mm = [
            [max(one[axis], 0.0) for one in of]
            for axis, of in enumerate(self._across(places_behind(gone, command_mm)))
        ]
        self._play_behind_mm = dict(zip(gone, map(list, zip(*plays_mm, strict=True)), strict=True))

    def _across(self, command_mm: Numbers) -> list[list[list[float]]]:
        """Give what the tool is elsewhere on the other side of each axis' play, at commands (n, 3)."""
        found = []
        still = np.zeros((len(command_mm), _WINDUPS + len(self._machine.windups)))
        # Half unwound, a wind-up has the same value on both sides.
        still[:, _WINDUPS:] = 0.5
        for axis in range(3):
            sides_mm = []
            for direction in (-1.0, 1.0):
                still[:, _DIRECTION + axis] = direction
                sides_mm.append(self._machine.error_mm(command_mm, still))
            still[:, _DIRECTION + axis] = 0.0
            found.append((sides_mm[0] - sides_mm[1]).tolist())
        return found

    def elsewhere_mm(self, first: int, direction: Sequence[float]) -> Iterator[list[list[float]]]:
        """Give what the tool may be elsewhere than the model has it, which knows the move's direction alone.

        For each command from `first` on, if it were of that move, the possible displacements, (3,) each: what is held
        back between both sides was meant for one of them.
        """
        axes = [copy(axis) for axis in self._axes]
        for command in range(first, len(self._command_mm)):
            self._step(axes, command, direction)
            ways = [[0.0, 0.0, 0.0]]
            for axis, across in enumerate(self._across_mm):
                play_mm, held_mm = across[command][axis], axes[axis].held_mm
                if held_mm > _ON_A_SIDE_MM:
                    other_mm = [direction[axis] * one for one in across[command]]
                    others = [[a + b for a, b in zip(way, other_mm, strict=True)] for way in ways]
                    ways = others if held_mm > play_mm - _ON_A_SIDE_MM else ways + others
            yield ways

    def take(self, commands: range, direction: Sequence[float]) -> None:
        """Take over commands that are of a move in this direction."""
        for command in commands:
            self._step(self._axes, command, direction)

    def _step(self, axes: Sequence[AxisPlay], command: int, direction: Sequence[float]) -> None:
        gone = self._gone.get(command)
        for axis, across in enumerate(self._across_mm):
            if gone is not None:
                axes[axis].go(gone, axis, self._play_behind_mm[command][axis])
            play_mm = max(across[command][axis], 0.0)
            axes[axis].take(self._command_mm[command][axis], direction[axis], play_mm)
