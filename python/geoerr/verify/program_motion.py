"""Direction, travel and speed of a program's moves, for checking it; shares nothing with the code that corrects."""

from __future__ import annotations

import math
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
    """

    direction: tuple[float, ...]
    travel_mm: tuple[float, ...]
    step_mm: tuple[float, ...]
    feed_mm_min: float

    def motion_at(self, share: npt.ArrayLike) -> Numbers:
        """Give direction, travel and velocity of x y z and the feed, (n, 10), at shares of the move (n,)."""
        shares = np.atleast_1d(np.asarray(share, dtype=np.float64))
        step = np.array(self.step_mm)
        length_mm = math.hypot(*self.step_mm)
        velocity = step / length_mm * (self.feed_mm_min / 60.0) if length_mm > 0.0 else np.zeros(3)
        motion = np.empty((len(shares), 10))
        motion[:, :3] = self.direction
        motion[:, 3:6] = np.array(self.travel_mm) + shares[:, None] * np.abs(step)
        motion[:, 6:9] = velocity
        motion[:, 9] = self.feed_mm_min
        return motion


class Past:
    """Directions and travels as a program goes on."""

    def __init__(self) -> None:
        self._direction = [0.0, 0.0, 0.0]
        self._travel_mm = [0.0, 0.0, 0.0]

    def straight(self, begin: Place, end: Place, feed_mm_min: float) -> Course:
        """Take over a straight move."""
        steps = [0.0, 0.0, 0.0]
        for axis, (from_mm, to_mm) in enumerate(zip(begin, end, strict=True)):
            if from_mm is None or to_mm is None or abs(to_mm - from_mm) <= _STILL_MM:
                continue
            steps[axis] = to_mm - from_mm
            direction = math.copysign(1.0, steps[axis])
            if direction != self._direction[axis]:
                self._direction[axis], self._travel_mm[axis] = direction, 0.0
        course = Course(tuple(self._direction), tuple(self._travel_mm), tuple(steps), feed_mm_min)
        self._travel_mm = [gone + abs(step) for gone, step in zip(self._travel_mm, steps, strict=True)]
        return course

    def forget(self, axis: int) -> None:
        """Take over that an axis has moved in a way that is not known."""
        self._direction[axis] = self._travel_mm[axis] = 0.0
