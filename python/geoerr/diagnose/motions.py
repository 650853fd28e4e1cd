"""Along which straight line the machine moved to a reading, by the order in which readings were taken.

Lines that share a name, or cross in a place, are told apart by what moved, not by where their readings lie: a place
where X and Y cross is a target of both, and each of its readings is of one of them.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

Numbers = npt.NDArray[np.float64]
Rows = npt.NDArray[np.int64]

# A step shorter than this share of the mean one, and than this, is none: encoders tell one target with some spread.
_STILL, _STILL_MM = 0.01, 0.01
# Steps whose ends lie no farther beside a line than this share of their length, or than this, are along it.
_BESIDE, _BESIDE_MM = 1e-3, 0.005


@dataclass
class _Stretch:
    """Steps that follow each other on one line, either way; `rows` are those that were read on the way."""

    start_mm: Numbers
    unit: Numbers
    reach_mm: float
    n_steps: int = 1
    rows: list[int] = field(default_factory=list)

    @classmethod
    def between(cls, start_mm: Numbers, end_mm: Numbers) -> _Stretch:
        """Begin with one step."""
        length = float(np.linalg.norm(end_mm - start_mm))
        return cls(start_mm, (end_mm - start_mm) / length, length)

    def goes_on_to(self, end_mm: Numbers) -> None:
        """Add a step; the farther it leads the better it tells the direction."""
        self.n_steps += 1
        away = end_mm - self.start_mm
        reach = float(np.linalg.norm(away))
        if reach > self.reach_mm:
            self.unit, self.reach_mm = away / reach, reach


def rows_by_motion(commanded_mm: Numbers, marks: npt.NDArray[np.generic]) -> Iterator[Rows]:
    """Give the rows (k,) of each straight line that was moved along, in the order of their first ones.

    A reading where one motion ended and another began belongs to the one that led to it; to the one that leads away
    where it was reached by a single step, as from line to line. Of several at such a place those belong to the motion
    away that are marked as its next reading is, and as the reading before was not.

    Parameters
    ----------
    commanded_mm : (n, 3)
        Places in the order of measurement.
    marks : (n, k)
        What tells runs apart: their number, the directions of travel.
    """
    lines: list[_Stretch] = []
    for stretch in _stretches(commanded_mm, marks):
        for line in lines:
            if _is_along(line, commanded_mm[stretch.rows]) and abs(float(line.unit @ stretch.unit)) > 1.0 - _BESIDE:
                line.rows += stretch.rows
                break
        else:
            lines.append(stretch)
    yield from (np.array(sorted(line.rows), dtype=np.int64) for line in lines)


def _stretches(commanded_mm: Numbers, marks: npt.NDArray[np.generic]) -> list[_Stretch]:
    """Divide the way into stretches, each with its readings; those without any are left out."""
    stops = _stops(commanded_mm)
    if len(stops) < 2:
        return []
    stretches: list[_Stretch] = []
    leading: list[_Stretch] = []
    for before, after in itertools.pairwise(stops):
        start, end = commanded_mm[before[-1]], commanded_mm[after[0]]
        if stretches and _is_along(stretches[-1], np.array([start, end])):
            stretches[-1].goes_on_to(end)
        else:
            stretches.append(_Stretch.between(start, end))
        leading.append(stretches[-1])
    # Nothing led to the first stop, and nothing leads away from the last one.
    for stop, to, away in zip(stops, [leading[0], *leading], [*leading, leading[-1]], strict=True):
        n_led = _led_rows(stop, to, away, marks)
        to.rows += stop[:n_led]
        away.rows += stop[n_led:]
    return [one for one in stretches if one.rows]


def _led_rows(stop: list[int], to: _Stretch, away: _Stretch, marks: npt.NDArray[np.generic]) -> int:
    """Give how many of the readings at a stop belong to the motion that led to it."""
    if to is away:
        return len(stop)
    if to.n_steps == 1 < away.n_steps:
        return 0
    # The stop's last readings that are marked like the next one, and not like the first: a run begins with them.
    following = stop[-1] + 1
    n_led = len(stop)
    while n_led > 1 and following < len(marks) and _is_of(marks, stop[n_led - 1], following, stop[0]):
        n_led -= 1
    return n_led


def _is_of(marks: npt.NDArray[np.generic], row: int, following: int, first: int) -> bool:
    """Tell whether a row is marked like the following one in something in which the first one is not."""
    return bool(((marks[row] == marks[following]) & (marks[row] != marks[first])).any())


def _stops(commanded_mm: Numbers) -> list[list[int]]:
    """Give the rows that were read at each stop, one after the other."""
    length = np.linalg.norm(np.diff(commanded_mm, axis=0), axis=1)
    still_mm = min(_STILL * float(length.mean()), _STILL_MM) if len(length) else 0.0
    begins = np.flatnonzero(length > still_mm) + 1
    return [part.tolist() for part in np.split(np.arange(len(commanded_mm)), begins)]


def _is_along(line: _Stretch, points_mm: Numbers) -> bool:
    """Tell whether points (k, 3) lie on a line."""
    away = points_mm - line.start_mm
    along = away @ line.unit
    beside = np.linalg.norm(away - along[:, None] * line.unit, axis=1)
    return bool(beside.max() <= max(_BESIDE_MM, _BESIDE * float(np.ptp(along))))
