"""Formulas at trial values of their inner parameters, each named once, as the core is given them."""

from __future__ import annotations

from array import array
from typing import TypeAlias

import numpy as np

from geoerr.fit.sightings import Numbers

# The number of an expression, values of its inner parameters, and the number of the series that it follows, if any.
Trial: TypeAlias = tuple[int, tuple[float, ...], int | None]


class Trials:
    """A list of them, in which nothing is twice.

    Of thousands a list of tuples would be read by the core for longer than it sums some of them.
    """

    def __init__(self) -> None:
        self._number: dict[Trial, int] = {}
        self._trials: list[Trial] = []
        self._expressions, self._series, self._inner = array("q"), array("q"), array("d")
        # Where the inner values of each begin, and where the last ones end.
        self._starts = array("q", [0])

    def __getitem__(self, number: int) -> Trial:
        """Give one by its number."""
        return self._trials[number]

    def copy(self) -> Trials:
        """Give the same list, to which others can be added."""
        other = Trials()
        other._number, other._trials = dict(self._number), list(self._trials)
        other._expressions, other._series = self._expressions[:], self._series[:]
        other._inner, other._starts = self._inner[:], self._starts[:]
        return other

    def number(self, trial: Trial) -> int:
        """Give the number of a trial, a new one if need be."""
        known = self._number.get(trial)
        if known is not None:
            return known
        expression, inner, series = trial
        self._expressions.append(expression)
        self._series.append(-1 if series is None else series)
        self._inner.extend(inner)
        self._starts.append(len(self._inner))
        self._trials.append(trial)
        self._number[trial] = len(self._trials) - 1
        return self._number[trial]

    def expressions(self, numbers: np.ndarray) -> np.ndarray:
        """Give the expressions of some, (n,)."""
        return np.asarray(np.array(self._expressions, dtype=np.int64)[numbers])

    def chosen(self, numbers: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, Numbers]:
        """Give some of them, (n,).

        Returns
        -------
        expressions : (n,)
        series : (n,)
            −1 for none.
        starts : (n + 1,)
            Where inner values of each begin, and where the last ones end.
        inner : (starts[-1],)
        """
        starts = np.array(self._starts, dtype=np.int64)
        counts = np.diff(starts)[numbers]
        own = np.concatenate([[0], np.cumsum(counts, dtype=np.int64)])
        at = np.arange(own[-1]) + np.repeat(starts[numbers] - own[:-1], counts)
        series = np.array(self._series, dtype=np.int64)[numbers]
        return self.expressions(numbers), series, own, np.array(self._inner, dtype=np.float64)[at]
