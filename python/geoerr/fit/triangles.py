"""Triangles of a fit's design, at one state or another: whole, or from one of which most columns are the same."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from geoerr import _core
from geoerr.fit.sightings import Numbers

# A column of the products is this many times its share of a triangle.
_COST_OF_A_COLUMN = 16


def holding(columns: Sequence[int] | np.ndarray, n_columns: int) -> Numbers:
    """Give rows C (k, n_columns), C x = 0, that hold one unknown each."""
    rows = np.zeros((len(columns), n_columns))
    rows[np.arange(len(columns)), columns] = 1.0
    return rows


@dataclass(frozen=True, eq=False)
class Known:
    """A triangle of which another one has some columns.

    Attributes
    ----------
    triangle
        Of a design of the same rows.
    row_scale : (n,)
        What each row counts in it.
    places : (n_columns,)
        Where each column of the other design is among its own; -1 of one that is not.
    """

    triangle: _core.FitTriangle
    row_scale: Numbers
    places: np.ndarray

    @property
    def is_most(self) -> bool:
        """Whether so few columns are others that all of them would take longer."""
        return int((self.places < 0).sum()) * _COST_OF_A_COLUMN < len(self.places)


@dataclass(frozen=True, eq=False)
class Triangles:
    """Triangles of one problem and weighing; each is given with the state that it is made at."""

    problem: _core.FitProblem
    row_scale: Numbers
    gauge: Numbers
    prior: Numbers | None
    threads: int

    def at(self, state: _core.FitState, known: Known | None = None) -> tuple[_core.FitTriangle, _core.FitState]:
        """Give the triangle of the design at a state; from a known one, where rows count in it as they do here."""
        begin = None
        if known is not None and np.array_equal(known.row_scale, self.row_scale):
            begin = known.triangle, known.places
        return self.problem.triangle(state, self.row_scale, self.gauge, self.prior, self.threads, begin), state

    def near(
        self, known: tuple[_core.FitTriangle, _core.FitState], state: _core.FitState, is_followed: np.ndarray | None
    ) -> tuple[_core.FitTriangle, _core.FitState]:
        """Give the same from one of this problem at another state.

        Of a design only columns that follow inner parameters change along the way (`is_followed`, None where any
        may), and those of frames by no more than a linear model's, which stay. So where few follow, frames stay, and
        the rest of the triangle with them.
        """
        triangle, made_at = known
        changed = np.ones(self.problem.n_columns, dtype=bool) if is_followed is None else is_followed
        same = Known(triangle, self.row_scale, np.where(changed, -1, np.arange(self.problem.n_columns)))
        return self.at(state.in_frames_of(made_at), same) if same.is_most else self.at(state)
