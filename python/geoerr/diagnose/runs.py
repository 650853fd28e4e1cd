"""Runs: rows that follow one another and may share an error, by which what depends on a variable is counted.

A pass goes one way. Of points that are scattered over a volume nearly every step turns some axis round: their passes
are rows from here and there of one run, and share whatever the run does.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geoerr.fit import Sightings
from geoerr.fit.passes import named_runs

# Rows in a row that go one way: fewer on average, and points are scattered.
_ROWS_ONE_WAY = 3.0
# Fewer runs than this tell nothing by themselves: those of scattered points are cut into so many pieces, of so many
# rows at least.
_FEW_RUNS, _PIECES, _LEAST_ROWS = 8, 24, 4


@dataclass(frozen=True, eq=False)
class Runs:
    """The run of each row.

    Attributes
    ----------
    number : (n,)
        Of its run, or of the piece of it.
    level : (n,)
        Which runs may be held against each other: those of one number. Pieces of a run against each other only, for
        they share what the run does.
    is_scattered : (n,)
        Whether its rows go any way, so that where they are does not tell when they were measured.
    """

    number: np.ndarray
    level: np.ndarray
    is_scattered: np.ndarray

    def of_rows(self, rows: np.ndarray) -> Runs:
        """Give those of some rows."""
        return Runs(self.number[rows], self.level[rows], self.is_scattered[rows])


def runs_of(sightings: Sightings) -> Runs:
    """Part rows into runs: what goes one way without a break; of scattered points all of a run by its name."""
    n = len(sightings)
    named = named_runs(sightings.session, sightings.texts("line"), sightings.numbers("repeat"))
    # Rows of each named run one after another, in their order.
    order = np.argsort(named, kind="stable")
    is_other = np.diff(named[order], prepend=-1) != 0
    turns = is_other | (np.diff(sightings.pass_number[order], prepend=-1) != 0)
    n_ways = np.bincount(named[order], weights=turns)
    is_scattered = (np.bincount(named) < _ROWS_ONE_WAY * n_ways)[named]
    number = np.empty(n, dtype=np.int64)
    number[order] = np.cumsum(np.where(is_scattered[order], is_other, turns))
    level = np.zeros(n, dtype=np.int64)
    if len(np.unique(number)) < _FEW_RUNS and is_scattered.any():
        level[is_scattered] = number[is_scattered]
        number = _cut(number, is_scattered)
    return Runs(np.unique(number, return_inverse=True)[1], level, is_scattered)


def _cut(number: np.ndarray, is_scattered: np.ndarray) -> np.ndarray:
    """Cut the runs of scattered points into pieces of rows that follow one another."""
    most = -(-_PIECES // len(np.unique(number)))
    pieces = number * most
    for run in np.unique(number[is_scattered]):
        rows = np.flatnonzero(number == run)
        pieces[rows] += np.arange(len(rows)) * min(most, max(len(rows) // _LEAST_ROWS, 1)) // len(rows)
    return pieces
