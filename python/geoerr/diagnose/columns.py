"""A list of columns that is one array: what the core is given at every call is not put together every time."""

from __future__ import annotations

import numpy as np

from geoerr.fit.sightings import Numbers


class Columns:
    """Columns of so many rows each, one after the other."""

    def __init__(self, n_rows: int) -> None:
        self._room = np.zeros((0, n_rows))
        self._n = 0

    def __len__(self) -> int:
        """Give the number of columns."""
        return self._n

    def __getitem__(self, number: int) -> Numbers:
        """Give a column, (n_rows,)."""
        return np.asarray(self.array[number])

    @property
    def array(self) -> Numbers:
        """All of them, (n, n_rows)."""
        return self._room[: self._n]

    def copy(self) -> Columns:
        """Give the same ones, to which others can be added; until then both are one array."""
        other = Columns(self._room.shape[1])
        # Without room for another: what is added to these does not show in those.
        other._room, other._n = self.array, self._n
        return other

    def append(self, column: Numbers) -> int:
        """Add a column, and give its number."""
        if self._n == len(self._room):
            room = np.empty((max(16, 2 * self._n), self._room.shape[1]))
            room[: self._n] = self.array
            self._room = room
        self._room[self._n] = column
        self._n += 1
        return self._n - 1
