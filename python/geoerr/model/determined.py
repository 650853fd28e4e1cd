"""What of a prediction the data determine: directions of parameters that are open, and axes that never moved."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from geoerr import _core
from geoerr.geometry import rigid_columns
from geoerr.machine import AXES, Machine
from geoerr.model.arrays import Numbers, contiguous
from geoerr.model.conditions import Conditions
from geoerr.model.record import FitRecord
from geoerr.terms import JOINT_CHANNELS

Carrier = Literal["tool", "work", "base", "relative"]
Box = Sequence[tuple[float, float]]
# d displacement / d parameters (n, 3, m) of places and offsets, seen so, under conditions, in blocks of rows.
Columns = Callable[[Numbers, Numbers, Carrier, Conditions | None, int], Iterator[Numbers]]

# Products of parameters and columns cancel to about this part of their sizes where a direction has no effect: the
# null space is known to the square root of the rounding, times the condition that still counts as determined.
_NO_EFFECT = 1e-6
# An axis this near to where it stood stands there: no error function differs over a micrometre.
_SAME_POSITION_MM = 1e-3
# A lever below this, or a part of a shift, is rounding.
_NO_LEVER_MM = 1e-9


@dataclass(frozen=True, eq=False)
class Determination:
    """What tells whether the data determine a displacement.

    Attributes
    ----------
    machine
        The machine.
    record
        Of the parameters that move it.
    columns
        Their derivatives.
    measured_box_mm
        Low and high end of each axis in the data; twice the same where it stood.
    stood_mm
        Where axes stood that never moved.
    """

    machine: Machine
    record: FitRecord
    columns: Columns
    measured_box_mm: Box
    stood_mm: Mapping[str, float]

    def of_rows(
        self,
        blocks: Sequence[npt.NDArray[np.bool_]],
        finite_blocks: Sequence[npt.NDArray[np.bool_]],
        rows: Numbers,
        offset: Numbers,
        carrier: Carrier,
        at: Conditions | None,
        threads: int,
    ) -> npt.NDArray[np.bool_]:
        """Tell which components (n, 3) no direction moves, from what stands still by rows in blocks (n, 3, k).

        Nothing is determined in rows that are not finite, by the same blocks (n,): these have no say in the others.
        """
        null_space = self.record.null_space
        is_finite = np.concatenate([np.empty(0, dtype=np.bool_), *finite_blocks])
        whole = np.zeros((len(rows), 3), dtype=np.bool_)
        if not is_finite.any():
            return whole
        at = {
            name: np.asarray(value)[is_finite] if np.shape(value) == is_finite.shape else value
            for name, value in (at or {}).items()
        }
        rows, offset = rows[is_finite], offset[is_finite]
        still = np.concatenate([np.empty((0, 3, null_space.shape[1]), dtype=np.bool_), *blocks])[is_finite]
        open_rows = ~still.all(axis=(1, 2))
        # Rigid motions are told on a grid, under the least and the most of every condition: what moves all points one
        # way here and another way there, as play does, is no set-up.
        ends = [_end_of(at, end) for end in (np.min, np.max)]
        is_away = np.any([np.zeros(len(rows), dtype=np.bool_), *self._away(rows).values()], axis=0)
        # A squareness with an axis that stood shifts the plane that was measured as a whole, and shears the volume.
        for away, box_mm in ((False, self.measured_box_mm), (True, self._box_beyond_mm)):
            asked = open_rows & (is_away == away)
            for own in np.unique(offset[asked], axis=0):
                rows_of_offset = asked & (offset == own).all(axis=1)
                still[rows_of_offset] |= ~self._bends(box_mm, own, carrier, ends, null_space, threads)
        result = np.asarray(still.all(axis=2))
        result[is_away] &= ~self._moved_by_unknown(rows[is_away], offset[is_away], carrier, threads)
        whole[is_finite] = result
        return whole

    @property
    def _box_beyond_mm(self) -> tuple[tuple[float, float], ...]:
        """The measured box, as wide as the machine along axes that stood."""
        box_mm = zip(AXES, self.measured_box_mm, strict=True)
        return tuple(self.machine.axes[axis].range_mm if axis in self.stood_mm else span for axis, span in box_mm)

    def _away(self, rows: Numbers) -> dict[str, npt.NDArray[np.bool_]]:
        """Tell of each axis that stood in all the data which places (n,) have it elsewhere."""
        return {
            axis: np.abs(rows[:, AXES.index(axis)] - stood) > _SAME_POSITION_MM
            for axis, stood in self.stood_mm.items()
        }

    def _moved_by_unknown(
        self, rows: Numbers, offset: Numbers, carrier: Carrier, threads: int
    ) -> npt.NDArray[np.bool_]:
        """Tell which components (n, 3) are moved by error functions of an axis that never moved, away from there.

        The record names them: mostly they are no terms, and no direction of the null space has a part in them.
        """
        moved = np.zeros((len(rows), 3), dtype=np.bool_)
        unknown = {item.name for item in self.record.not_determined}
        carriers = np.full(len(rows), _core.CARRIERS.index(carrier), dtype=np.uint8)
        columns = _core.channel_columns(
            self.machine.chain, carriers, contiguous(rows), contiguous(offset), self.machine.tool_offset_mm, threads
        )
        for axis, is_away in self._away(rows).items():
            own = [n for n, name in enumerate(JOINT_CHANNELS) if name in unknown and name[2].lower() == axis]
            moved |= is_away[:, None] & (np.abs(columns[:, own]) > _NO_LEVER_MM).any(axis=1)
        return moved

    def _bends(
        self,
        box_mm: Sequence[tuple[float, float]],
        offset: Numbers,
        carrier: Carrier,
        ends: Sequence[Conditions],
        directions: Numbers,
        threads: int,
    ) -> npt.NDArray[np.bool_]:
        """Tell which directions (m, k) of the parameters move a box, at all ends, other than rigidly."""
        # Uneven, so that no wave hides between the places.
        shares = (0.0, 0.31, 0.74, 1.0)
        places = [[low + share * (high - low) for share in shares] for low, high in box_mm]
        grids = np.meshgrid(*places, indexing="ij")
        grid = np.ascontiguousarray(np.stack([values.ravel() for values in grids], axis=1))
        blocks = [block for at in ends for block in self.columns(grid, offset, carrier, at, threads)]
        columns = np.concatenate(blocks)
        moved = (columns @ directions).reshape(3 * len(columns), -1)
        rigid = np.tile(rigid_columns(grid + offset), (len(ends), 1))
        left = moved - rigid @ np.linalg.lstsq(rigid, moved, rcond=None)[0]
        reach = (np.abs(columns) @ np.abs(directions)).max(axis=(0, 1))
        return np.asarray(np.abs(left).max(axis=0) > _NO_EFFECT * reach)


def leaves_still(columns: Numbers, directions: Numbers) -> npt.NDArray[np.bool_]:
    """Tell which directions (m, k) of the parameters leave which components still, (n, 3, k)."""
    reach = np.abs(columns) @ np.abs(directions)
    return np.asarray(np.abs(columns @ directions) <= _NO_EFFECT * reach)


def _end_of(at: Conditions, end: Callable[[Numbers], float]) -> Conditions:
    """Give one value of every condition of rows, by the function `end` of what they have."""
    return {
        name: value if isinstance(value, str) else float(end(np.asarray(value, dtype=np.float64)))
        for name, value in at.items()
    }
