"""Axes that rest in the program while corrections move them: what their play holds back.

A model has an error of direction as of the program's own moves. Where an axis rests and its correction takes it back
from where it came, by r, the model moves it by r, and the machine by what is more than its play b: it is off by
min(r, b) in the direction that it came from, until the program moves that axis again.

Verified in tests/compensate/test_term_programs.py against a play that is followed command by command.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from geoerr.verify.path_machine import ProgramMachine

Numbers = npt.NDArray[np.float64]

# Of the core's motion.
_DIRECTION = slice(0, 3)
# What is turned back by less is rounding.
_LEAST_MM = 1e-9


class Resting:
    """What play holds back, as a program goes on."""

    def __init__(self) -> None:
        self._farthest_mm = np.full(3, -np.inf)
        self._held_mm = np.zeros(3)

    def held_mm(
        self, machine: ProgramMachine, command_mm: Numbers, motion: Numbers, moves: npt.NDArray[np.bool_]
    ) -> Numbers:
        """Give what is held back at both ends of pieces, (n, 2, 3), added to where the model has the tool.

        Parameters
        ----------
        command_mm : (n, 3)
            Where the pieces end.
        motion : (n, m)
            That of their moves there.
        moves : (n, 3)
            Which axes their moves move.
        """
        back_mm = self._turned_back_mm(command_mm, motion[:, _DIRECTION], moves)
        held_mm = np.zeros_like(command_mm)
        for axis in range(3):
            some = np.flatnonzero(back_mm[:, axis] > _LEAST_MM)
            if some.size:
                direction = motion[some, axis]
                play_mm = np.maximum(-direction * _change_mm(machine, command_mm[some], motion[some], axis), 0.0)
                held_mm[some, axis] = direction * np.minimum(back_mm[some, axis], play_mm)
        ends_mm = np.concatenate([self._held_mm[None], held_mm])
        self._held_mm = ends_mm[-1]
        return np.stack([ends_mm[:-1], ends_mm[1:]], axis=1)

    def _turned_back_mm(self, command_mm: Numbers, direction: Numbers, moves: npt.NDArray[np.bool_]) -> Numbers:
        """Give how far each axis (n, 3) that rests is behind its farthest command since the program last moved it."""
        along_mm = direction * command_mm
        back_mm = np.zeros_like(command_mm)
        for axis in range(3):
            ends = np.flatnonzero(moves[:, axis])
            begins = np.concatenate([[-1], ends])
            for begin, end in zip(begins.tolist(), [*ends.tolist(), len(moves)], strict=True):
                farthest_mm = self._farthest_mm[axis] if begin < 0 else along_mm[begin, axis]
                if end > begin + 1:
                    rests_mm = along_mm[begin + 1 : end, axis]
                    reached_mm = np.maximum(np.maximum.accumulate(rests_mm), farthest_mm)
                    back_mm[begin + 1 : end, axis] = reached_mm - rests_mm
                    farthest_mm = float(reached_mm[-1])
                self._farthest_mm[axis] = farthest_mm
        # An axis that has not moved yet has come from nowhere.
        return np.where(direction == 0.0, 0.0, back_mm)


def _change_mm(machine: ProgramMachine, command_mm: Numbers, motion: Numbers, axis: int) -> Numbers:
    """Give what an axis' error along itself, (n,), is more than if the axis had come from the other side."""
    other = motion.copy()
    other[:, axis] *= -1.0
    return np.asarray((machine.error_mm(command_mm, motion) - machine.error_mm(command_mm, other))[:, axis])
