"""Direction, travel and speed of a program's moves, for checking it; shares nothing with the code that corrects."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

Numbers = npt.NDArray[np.float64]
Place = tuple[float | None, float | None, float | None]

# Motion that is none: rounding of sums of increments.
_STILL_MM = 1e-9


class Course(NamedTuple):
    """How a move comes to its places.

    Attributes
    ----------
    direction
        Of each axis, −1 or 1; 0 where it is not known. An axis that rests keeps its last direction.
    travel_mm
        Of each axis since its reversal, at the begin of the move.
    step_mm
        What each axis moves.
    feed_mm_min
        Speed along the path; 0 where the program does not tell it.
    left_unwound
        Of each wind-up of the machine, what the stroke before the last reversal left, as a share of the lost motion.
    """

    direction: tuple[float, ...]
    travel_mm: tuple[float, ...]
    step_mm: tuple[float, ...]
    feed_mm_min: float
    left_unwound: tuple[float, ...]


class Courses:
    """How many moves come to their places, as the core has it.

    Parameters
    ----------
    courses
        Of the moves.
    """

    def __init__(self, courses: Sequence[Course]) -> None:
        self._direction, self._travel_mm, step_mm = (
            np.array([course[column] for course in courses], dtype=np.float64).reshape(-1, 3) for column in range(3)
        )
        self._feed_mm_min = np.array([course.feed_mm_min for course in courses])
        self._left_unwound = np.array([course.left_unwound for course in courses], dtype=np.float64)
        self._gone_mm = np.abs(step_mm)
        length_mm = np.linalg.norm(step_mm, axis=1)
        speed_mm_s = self._feed_mm_min / 60.0 / np.where(length_mm > 0.0, length_mm, 1.0)
        self._velocity_mm_s = step_mm * speed_mm_s[:, None]

    def direction_of(self, move: int) -> tuple[float, ...]:
        """Give the direction of each axis in a move."""
        return tuple(self._direction[move].tolist())

    def motion_at(self, move: npt.NDArray[np.int64], share: Numbers) -> Numbers:
        """Give the core's motion, (n, 10 + wind-ups), at shares (n,) of moves, by their numbers (n,).

        Direction, travel and velocity of x y z, the feed, and what is left unwound.
        """
        return np.column_stack(
            (
                self._direction[move],
                self._travel_mm[move] + share[:, None] * self._gone_mm[move],
                self._velocity_mm_s[move],
                self._feed_mm_min[move],
                self._left_unwound[move],
            )
        )


class Past:
    """Directions and travels as a program goes on.

    Parameters
    ----------
    windups
        Index of the axis and length (mm) of each wind-up of the machine. Its value, of a lost motion of 1, is
        w = −d/2 + (w_rev + d/2)·exp(−s/length), `w_rev` the value at the reversal; −d/2 until the first one.
    """

    def __init__(self, windups: Sequence[tuple[int, float]] = ()) -> None:
        self._windups = windups
        self._wound_at_reversal = [0.0] * len(windups)
        self._direction = [0.0, 0.0, 0.0]
        self._travel_mm = [0.0, 0.0, 0.0]

    def straight(self, begin: Place, end: Place, feed_mm_min: float) -> Course:
        """Take over a straight move."""
        steps = [0.0, 0.0, 0.0]
        for axis, (from_mm, to_mm) in enumerate(zip(begin, end, strict=True)):
            if from_mm is None or to_mm is None or abs(to_mm - from_mm) <= _STILL_MM:
                continue
            steps[axis] = to_mm - from_mm
            self._turn(axis, math.copysign(1.0, steps[axis]))
        left = tuple(
            0.5 - wound * self._direction[axis]
            for (axis, _), wound in zip(self._windups, self._wound_at_reversal, strict=True)
        )
        course = Course(tuple(self._direction), tuple(self._travel_mm), tuple(steps), feed_mm_min, left)
        self._travel_mm = [gone + abs(step) for gone, step in zip(self._travel_mm, steps, strict=True)]
        return course

    def pass_by(self, begin: Place, strokes: Sequence[list[float] | None], miss_mm: float) -> None:
        """Take over what passes as it is; strokes of each axis from its begin, None where nobody knows them."""
        still_mm = max(_STILL_MM, miss_mm)
        for axis, (at_mm, places) in enumerate(zip(begin, strokes, strict=True)):
            if at_mm is None or places is None:
                self.forget(axis)
                continue
            for end_mm in places:
                if abs(end_mm - at_mm) > still_mm:
                    self._turn(axis, math.copysign(1.0, end_mm - at_mm))
                    self._travel_mm[axis] += abs(end_mm - at_mm)
                    at_mm = end_mm

    def _turn(self, axis: int, direction: float) -> None:
        """Take over that an axis moves in a direction."""
        if direction != self._direction[axis]:
            self._wind(axis, direction)
            self._direction[axis], self._travel_mm[axis] = direction, 0.0

    def _wind(self, axis: int, direction: float) -> None:
        """Take over that an axis turns, or moves for the first time that is known."""
        before, travel_mm = self._direction[axis], self._travel_mm[axis]
        for number, (of, length_mm) in enumerate(self._windups):
            if of == axis:
                decay = math.exp(-travel_mm / length_mm) if length_mm > 0.0 else 0.0
                wound = self._wound_at_reversal[number]
                at_end = -0.5 * before + (wound + 0.5 * before) * decay
                self._wound_at_reversal[number] = at_end if before else -0.5 * direction

    def forget(self, axis: int) -> None:
        """Take over that an axis has moved in a way that is not known."""
        self._direction[axis] = self._travel_mm[axis] = 0.0
