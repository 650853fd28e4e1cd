"""Observations as the fit needs them: arrays in the order of measurement, each row with its whitening.

A row states up to three components in its session's measuring frame, or one radius about its run's centre. Its
`whitening` turns the residual of its measured components into numbers of unit variance; a component that was not
measured has a row of zeros, and so takes no part.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt
import polars as pl

from geoerr.fit.worked_out import KeepsWorkedOut
from geoerr.observations import CARRIERS, SAME_PLACE_MM
from geoerr.summaries import counted
from geoerr.terms import is_column, session_numbers

Numbers = npt.NDArray[np.float64]
Integers = npt.NDArray[np.int64]

_BY_ROW = (
    *("commanded_mm", "offset_mm", "measured_mm", "is_measured", "whitening"),
    *("carrier", "session", "pass_number", "directions", "source_row"),
)
# Columns of numbers that say where a row stands, what was measured and how surely: nothing that an error follows.
_PLACING = frozenset(
    {
        *(
            "file_row",
            "moving",
            "repeat",
            "session",
            "x",
            "y",
            "z",
            "tx",
            "ty",
            "tz",
            "dir",
            "dir_x",
            "dir_y",
            "dir_z",
        ),
        *("mx", "my", "mz", "sx", "sy", "sz", "cxx", "cxy", "cxz", "cyy", "cyz", "czz", "r", "sr"),
        *("measured", "s_measured"),
    }
)
# Devices that see where points are; others tell one number of them, a radius or a length.
SEE_POSITIONS = ("free", "parallel")
# Positions closer than this are one position: a hundredth of a micrometre is below every command's resolution.
SAME_POSITION_MM = SAME_PLACE_MM


@dataclass(frozen=True, eq=False)
class Sightings(KeepsWorkedOut):
    """Measured rows, sessions one after the other, each in the order of measurement.

    Attributes
    ----------
    table : polars.DataFrame
        The rows with all their columns.
    commanded_mm, offset_mm : (n, 3)
        Axis positions and target offsets.
    measured_mm : (n, 3)
        In the measuring frame; 0 where not measured. A radius stands in the first component, and a length in that of
        both its ends.
    is_measured : (n, 3)
        Which components were.
    whitening : (n, 3, 3)
        W with W C Wᵀ = 1 on the measured components; per mm.
    is_stated
        Whether the covariances come from the data; otherwise every component has 1 mm, and the scale is not known.
    carrier : (n,) uint8
        Place in `CARRIERS`.
    session : (n,)
        Number of the row's session or circular run.
    sessions
        Their names.
    frames
        For each session `free` (any pose), `parallel` (a device that never measures all components at once), `circle`
        (centre and mean radius free) or `lengths` (two rows each, and no frame).
    pass_number : (n,)
        Number of the row's pass: one session, line, repeat and direction.
    directions : (n, 3) int8
        Direction in which each axis last moved; 0 unknown.
    source_row : (n,)
        Place of the row in its table.
    left_out
        Reason to number of rows that took no part.
    notes
        What had to be filled in.
    derived
        What followed from the order of rows, by name, where some of them were left out since.
    """

    table: pl.DataFrame
    commanded_mm: Numbers
    offset_mm: Numbers
    measured_mm: Numbers
    is_measured: npt.NDArray[np.bool_]
    whitening: Numbers
    is_stated: bool
    carrier: npt.NDArray[np.uint8]
    session: Integers
    sessions: tuple[str, ...]
    frames: tuple[str, ...]
    pass_number: Integers
    directions: npt.NDArray[np.int8]
    source_row: Integers
    left_out: dict[str, int]
    notes: tuple[str, ...]
    derived: Mapping[str, Numbers] = field(default_factory=dict)

    @classmethod
    def of_one_number(
        cls, *, commanded_mm: Numbers, measured_mm: Numbers, std_mm: Numbers, **others: Any
    ) -> Sightings:
        """Of a device that tells one number (n,) of each row, of the tool seen from the work, with its uncertainty.

        `others` are the attributes that no device tells in its own way.
        """
        n_rows = len(commanded_mm)
        measured, is_measured = np.zeros((n_rows, 3)), np.zeros((n_rows, 3), dtype=bool)
        measured[:, 0], is_measured[:, 0] = measured_mm, True
        whitening = np.zeros((n_rows, 3, 3))
        whitening[:, 0, 0] = 1.0 / std_mm
        return cls(
            commanded_mm=commanded_mm,
            offset_mm=np.zeros((n_rows, 3)),
            measured_mm=measured,
            is_measured=is_measured,
            whitening=whitening,
            carrier=np.full(n_rows, CARRIERS.index("relative"), dtype=np.uint8),
            **others,
        )

    def __len__(self) -> int:
        return len(self.commanded_mm)

    @property
    def unwhitening(self) -> Numbers:
        """Pseudo-inverses of W, (n, 3, 3): from numbers of unit variance to mm; made anew each time."""
        different, number = self._unwhitenings
        return np.asarray(different[number])

    @cached_property
    def _unwhitenings(self) -> tuple[Numbers, npt.NDArray[np.int32]]:
        """The different ones, (k, 3, 3), and the number of each row's: most rows have one and the same."""
        flat = self.whitening.reshape(len(self), 9)
        # Rows that stand together mostly have the same, so that the first of each run is enough to sort.
        begins = np.ones(len(flat), dtype=bool)
        begins[1:] = (flat[1:] != flat[:-1]).any(axis=1)
        alike, place = np.unique(flat[begins], axis=0, return_inverse=True)
        number = place.ravel().astype(np.int32)[np.cumsum(begins, dtype=np.int32) - 1]
        return np.asarray(np.linalg.pinv(alike.reshape(-1, 3, 3)), dtype=np.float64), number

    def of_kind(self, *kinds: str, rows: np.ndarray | slice = slice(None)) -> npt.NDArray[np.bool_]:
        """Tell which rows (n,), or which of some of them, are of sessions of these kinds."""
        return np.array([kind in kinds for kind in self.frames], dtype=bool)[self.session[rows]]

    def in_words(self, *, grouped: bool = False) -> str:
        """Say how much was measured, `240 rows in 12 passes, 18 lengths`; with digits in groups if asked."""
        of_lengths = self.of_kind("lengths")
        n_lengths, others = int(of_lengths.sum()) // 2, self.pass_number[~of_lengths]
        texts = []
        if len(others) or not n_lengths:
            n_passes = len(np.unique(others))
            texts.append(
                f"{counted(len(others), 'row', grouped=grouped)} in {counted(n_passes, 'pass', grouped=grouped)}"
            )
        if n_lengths:
            texts.append(counted(n_lengths, "length", grouped=grouped))
        return ", ".join(texts)

    @property
    def n_set_ups(self) -> int:
        """Number of sessions that something may have changed between; of lengths nobody knows when they were made."""
        return max(len(self.set_ups), 1)

    @property
    def set_ups(self) -> tuple[str, ...]:
        """Names of these sessions, in order."""
        return tuple(name for name, kind in zip(self.sessions, self.frames, strict=True) if kind != "lengths")

    @property
    def numbers_of_set_ups(self) -> dict[str, int]:
        """Number of each of these sessions by its name, in order."""
        found: dict[str, int] = {}
        for name, number in zip(self.set_ups, session_numbers(self.set_ups), strict=True):
            # Two tables may have a session of one name.
            found[name if name not in found else f"{name} ({number})"] = number
        return found

    @cached_property
    def session_numbers(self) -> Integers:
        """By what number formulas know each session, (n_sessions,); -1 of lengths."""
        is_set_up = np.array([kind != "lengths" for kind in self.frames], dtype=bool)
        numbers = np.full(len(self.sessions), -1, dtype=np.int64)
        numbers[is_set_up] = session_numbers(self.set_ups)
        return numbers

    @property
    def has_lengths_only(self) -> bool:
        """Whether no device saw a position or a radius."""
        return set(self.frames) == {"lengths"}

    @cached_property
    def length(self) -> Integers | None:
        """Number of the length that each row (n,) is an end of, -1 of others; None where none is."""
        if "lengths" not in self.frames:
            return None
        keys = np.column_stack([self.session, self.source_row])
        _, number = np.unique(keys, axis=0, return_inverse=True)
        return np.where(self.of_kind("lengths"), number.ravel(), -1).astype(np.int64)

    def select(self, mask: npt.ArrayLike, why: str) -> Sightings:
        """Give the rows where `mask` (n,) is true; the others are counted under the reason."""
        kept = np.asarray(mask, dtype=bool)
        # A length is two rows, and counts once.
        out = int((~kept).sum()) - int((self.of_kind("lengths") & ~kept).sum()) // 2
        return replace(
            self,
            table=self.table.filter(pl.Series(kept)),
            **{name: getattr(self, name)[kept] for name in _BY_ROW},
            derived={name: values[kept] for name, values in self.derived.items()},
            left_out={**self.left_out, why: self.left_out.get(why, 0) + out} if out else self.left_out,
        )

    @property
    def starts(self) -> Integers:
        """First row of each session, (n_sessions,)."""
        return np.searchsorted(self.session, np.arange(len(self.sessions))).astype(np.int64)

    @property
    def rows_of_sessions(self) -> list[slice]:
        """Rows of each session; none of one that has none left."""
        ends = [*self.starts[1:].tolist(), len(self)]
        return [slice(start, end) for start, end in zip(self.starts.tolist(), ends, strict=True)]

    def rows_of_session(self, number: int, among: np.ndarray) -> np.ndarray:
        """Give the rows of a session, (k,), of those that are `among` (n,): at the cost of its own."""
        own = slice(*np.searchsorted(self.session, [number, number + 1]).tolist())
        return np.asarray(np.flatnonzero(among[own]) + own.start)

    @property
    def sequences(self) -> Integers:
        """First row of each session that has rows left, (k,): what runs along rows begins anew there."""
        return np.flatnonzero(np.diff(self.session, prepend=-1)).astype(np.int64)

    def axes_moved(self, rows: np.ndarray) -> np.ndarray:
        """Tell along which axes (3,) the machine went in some rows (n,)."""
        if not rows.any():
            return np.zeros(3, dtype=bool)
        return np.asarray(np.ptp(self.commanded_mm[rows], axis=0) > SAME_POSITION_MM)

    @property
    def n_passes(self) -> int:
        """Number of passes."""
        return int(self.pass_number.max()) + 1 if len(self) else 0

    def numbers(self, column: str) -> Numbers:
        """Give a column (n,) as float64; NaN where it is empty or absent."""
        if column not in self.table.columns:
            return np.full(len(self), np.nan)
        return np.asarray(self.table[column].cast(pl.Float64, strict=False).to_numpy(), dtype=np.float64)

    def texts(self, column: str) -> list[str]:
        """Give a text column; an empty cell is ''."""
        return [value or "" for value in self.table[column].cast(pl.String).to_list()]

    def place_of_target(self, row: int) -> str:
        """Say where a row's target sits by its stated offset, and on what."""
        x, y, z = self.offset_mm[row]
        return f"({x:g}, {y:g}, {z:g}) mm on the {CARRIERS[self.carrier[row]]}"

    @property
    def covariate_columns(self) -> tuple[str, ...]:
        """Names of all columns of numbers that hold any number."""
        return tuple(
            name
            for name in columns_of_numbers(self.table)
            if is_column(name) and bool(np.isfinite(self.numbers(name)).any())
        )

    @property
    def effect_columns(self) -> tuple[str, ...]:
        """Names of the columns that an effect can follow; a circle is in motion, whether or not its file says so."""
        columns = self.covariate_columns
        return columns if "moving" in columns or "circle" not in self.frames else (*columns, "moving")

    @property
    def free_columns(self) -> tuple[str, ...]:
        """Names of the columns of numbers that an effect may follow: covariates, not what places a row."""
        return tuple(name for name in self.covariate_columns if name not in _PLACING)


def columns_of_numbers(table: pl.DataFrame) -> list[str]:
    """Give the names of a table's columns of numbers."""
    return [name for name, kind in table.schema.items() if kind.is_numeric()]
