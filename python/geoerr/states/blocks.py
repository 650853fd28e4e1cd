"""Which rows may share an offset: blocks of a pass, of a stretch of it, of what sits on one body in it."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from geoerr.fit.sightings import SAME_POSITION_MM, Numbers, Sightings
from geoerr.fit.variables import times_s

Integers = npt.NDArray[np.int64]

# At most three stretches a pass, of four moments or more, and so many blocks that a determinant takes milliseconds.
_STRETCHES, _FEWEST_MOMENTS, _MOST_BLOCKS = 3, 4, 120


@dataclass(frozen=True, eq=False)
class Blocks:
    """Rows in blocks.

    Attributes
    ----------
    of_row : (n,)
        Number of each row's block.
    pass_of, carrier_of, session_of : (b,)
        What each block is of.
    time_of : (b,)
        Its time, the session's span being 1.
    """

    of_row: Integers
    pass_of: Integers
    carrier_of: Integers
    session_of: Integers
    time_of: Numbers

    def __len__(self) -> int:
        return len(self.pass_of)

    def correlation(self, pass_share: float, memory: float, carrier_share: float) -> Numbers:
        """Give K (b, b) of `geoerr.states.offsets`: w is `pass_share`, τ `memory`, c `carrier_share`."""
        wander = np.exp(-np.abs(self.time_of[:, None] - self.time_of) / memory)
        wander *= self.session_of[:, None] == self.session_of
        of_pass = pass_share * (self.pass_of[:, None] == self.pass_of) + (1.0 - pass_share) * wander
        own = self.carrier_of[:, None] == self.carrier_of
        return np.asarray(of_pass * (1.0 - carrier_share + carrier_share * own))


def blocks_of(sightings: Sightings, pass_number: Integers, *, by_carrier: bool) -> Blocks:
    """Put rows into blocks.

    Parameters
    ----------
    pass_number : (n,)
        Of each row.
    by_carrier
        Whether what sits on different bodies gets blocks of its own.
    """
    times = times_s(sightings)
    carrier = sightings.carrier.astype(np.int64) if by_carrier else np.zeros(len(sightings), dtype=np.int64)
    n_blocks = len(np.unique(np.column_stack([pass_number, carrier]), axis=0))
    most = max(1, min(_STRETCHES, _MOST_BLOCKS // max(n_blocks, 1)))
    stretch = np.zeros(len(sightings), dtype=np.int64)
    for number in np.unique(pass_number):
        rows = np.flatnonzero(pass_number == number)
        moments, place = np.unique(times[rows], return_inverse=True)
        count = max(1, min(most, len(moments) // _FEWEST_MOMENTS))
        stretch[rows] = place * count // len(moments)
    _, first, of_row = np.unique(
        np.column_stack([pass_number, stretch, carrier]), axis=0, return_index=True, return_inverse=True
    )
    of_row = of_row.ravel()
    session = sightings.session[first]
    time = np.bincount(of_row, weights=times) / np.bincount(of_row)
    for number in np.unique(session):
        own = times[sightings.session == number]
        time[session == number] -= own.min()
        time[session == number] /= max(float(np.ptp(own)), 1e-300)
    return Blocks(of_row, pass_number[first], carrier[first], session, time)


def has_bodies_apart(sightings: Sightings) -> bool:
    """Tell whether what sits on different bodies was seen in one and the same pass."""
    pairs = np.unique(np.column_stack([sightings.pass_number, sightings.carrier]), axis=0)
    return len(pairs) > len(np.unique(pairs[:, 0]))


def passes_from_turns(sightings: Sightings) -> Integers:
    """Give each row's pass (n,) where a second look at the place of a turn belongs to the way back.

    Which way a machine came says nothing of when the next pass began: a program that goes there and back and writes
    down both ends stands twice where it turns, and what was set up anew in between is seen from the second on.
    """
    numbers = sightings.pass_number.copy()
    target = np.array(sightings.texts("target") if "target" in sightings.table.columns else [""] * len(sightings))
    is_new = np.diff(sightings.pass_number, prepend=-1) != 0
    for start in (np.flatnonzero(is_new[1:]) + 1).tolist():
        before, after = start - 1, start
        if not _is_one_line(sightings, before, after):
            continue
        low = before
        while (
            low >= 0
            and sightings.pass_number[low] == sightings.pass_number[before]
            and _stands(sightings, low, before)
        ):
            low -= 1
        looks: Counter[tuple[object, ...]] = Counter()
        rows = range(low + 1, start)
        keys = [(sightings.carrier[row], target[row], tuple(sightings.offset_mm[row])) for row in rows]
        total = Counter(keys)
        for row, key in zip(rows, keys, strict=True):
            looks[key] += 1
            # Of an odd number of looks the one in the middle ends the way there.
            if looks[key] > (total[key] + 1) // 2:
                numbers[row] = sightings.pass_number[after]
    return numbers


def _is_one_line(sightings: Sightings, one: int, other: int) -> bool:
    """Tell whether two rows are of one line, as far as the table names lines."""
    if sightings.session[one] != sightings.session[other]:
        return False
    named = [name for name in ("line", "repeat") if name in sightings.table.columns]
    return all(sightings.table[name][one] == sightings.table[name][other] for name in named)


def _stands(sightings: Sightings, one: int, other: int) -> bool:
    return bool((np.abs(sightings.commanded_mm[one] - sightings.commanded_mm[other]) <= SAME_POSITION_MM).all())
