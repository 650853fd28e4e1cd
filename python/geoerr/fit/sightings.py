"""Observations as the fit needs them: arrays in the order of measurement, each row with its whitening.

A row states up to three components in its session's measuring frame, or one radius about its run's centre. Its
`whitening` turns the residual of its measured components into numbers of unit variance; a component that was not
measured has a row of zeros, and so takes no part.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt
import polars as pl

from geoerr.errors import GeometryError
from geoerr.fit.commanded_circle import on_their_circle
from geoerr.observations import CARRIERS, SAME_PLACE_MM, CircularTest, Observations
from geoerr.terms import is_name

Numbers = npt.NDArray[np.float64]
Integers = npt.NDArray[np.int64]
T = TypeVar("T")

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
    }
)
# A standard uncertainty below a tenth of a nanometre is a slip, not a measurement, and would outweigh all others.
_LEAST_STD_MM = 1e-7
# Makes one number of the directions −1, 0 and 1 of three axes.
_SENSES = np.array([1, 3, 9], dtype=np.int64)
# A point that is measured so many times, and so much, farther from the others than the machine moves is a mistake.
_BEYOND_REACH, _BEYOND_REACH_MM = 10.0, 1000.0
# Positions closer than this are one position: a hundredth of a micrometre is below every command's resolution.
SAME_POSITION_MM = SAME_PLACE_MM


@dataclass(frozen=True, eq=False)
class Sightings:
    """Measured rows, sessions one after the other, each in the order of measurement.

    Attributes
    ----------
    table : polars.DataFrame
        The rows with all their columns.
    commanded_mm, offset_mm : (n, 3)
        Axis positions and target offsets.
    measured_mm : (n, 3)
        In the measuring frame; 0 where not measured. A radius stands in the first component.
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
        For each session `free` (any pose), `parallel` (a device that never measures all components at once) or
        `circle` (centre and mean radius free).
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
    _worked_out: dict[str, Any] = field(default_factory=dict, init=False, repr=False)

    def __len__(self) -> int:
        return len(self.commanded_mm)

    @cached_property
    def unwhitening(self) -> Numbers:
        """Pseudo-inverses of W, (n, 3, 3): from numbers of unit variance to mm; most rows have one and the same."""
        flat = self.whitening.reshape(len(self), 9)
        # Rows that stand together mostly have the same, so that the first of each run is enough to sort.
        begins = np.ones(len(flat), dtype=bool)
        begins[1:] = (flat[1:] != flat[:-1]).any(axis=1)
        alike, place = np.unique(flat[begins], axis=0, return_inverse=True)
        return np.asarray(np.linalg.pinv(alike.reshape(-1, 3, 3))[place.ravel()[np.cumsum(begins) - 1]])

    def once(self, name: str, work_out: Callable[[Sightings], T]) -> T:
        """Give what follows from these rows alone, worked out when it is first asked for."""
        if name not in self._worked_out:
            self._worked_out[name] = work_out(self)
        found: T = self._worked_out[name]
        return found

    def select(self, mask: npt.ArrayLike, why: str) -> Sightings:
        """Give the rows where `mask` (n,) is true; the others are counted under the reason."""
        kept = np.asarray(mask, dtype=bool)
        out = int((~kept).sum())
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
    def sequences(self) -> Integers:
        """First row of each session that has rows left, (k,): what runs along rows begins anew there."""
        return np.flatnonzero(np.diff(self.session, prepend=-1)).astype(np.int64)

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

    @property
    def covariate_columns(self) -> tuple[str, ...]:
        """Names of all columns of numbers that hold any number."""
        return tuple(
            name
            for name in _columns_of_numbers(self.table)
            if is_name(name) and bool(np.isfinite(self.numbers(name)).any())
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


def sightings_of(*tables: Observations | CircularTest) -> Sightings:
    """Join measurements of points and circular tests.

    A circular test states the uncertainty of its radii in a column `sr` (mm), if at all. One that does not is weighed
    like the other tables' components, and a note says so.

    Raises
    ------
    GeometryError
        where nothing is measured, or some tables of points state uncertainties and others do not.
    """
    parts = [_of_points(table) if isinstance(table, Observations) else _of_circle(table) for table in tables]
    parts = [part for part in parts if len(part)]
    if not parts:
        raise GeometryError("no row has a measured component\nhint: measured positions stand in mx, my and mz")
    joined = parts[0] if len(parts) == 1 else _joined(parts)
    odd = [name for name in _columns_of_numbers(joined.table) if not is_name(name)]
    if not odd:
        return joined
    told = (
        f"no effect can follow {', '.join(map(repr, odd))}: formulas name columns by letters a to z, digits and "
        "underscores; rename what one may follow"
    )
    return replace(joined, notes=(*joined.notes, told))


def _columns_of_numbers(table: pl.DataFrame) -> list[str]:
    return [name for name, kind in table.schema.items() if kind.is_numeric()]


def _of_points(observations: Observations) -> Sightings:
    is_measured = np.isfinite(observations.measured_mm)
    used = is_measured.any(axis=1)
    left_out = {"nothing measured": int((~used).sum())} if not used.all() else {}
    believable = _has_positive_covariance(observations.covariance_mm2, is_measured)
    if (used & believable).any() and not believable[used].all():
        left_out["its covariance is not positive"] = int((used & ~believable).sum())
        used &= believable
    kept = observations.select(used)
    names = kept.texts("session")
    sessions = tuple(dict.fromkeys(names))
    number_of = {name: number for number, name in enumerate(sessions)}
    session = np.array([number_of[name] for name in names], dtype=np.int64)
    order = np.argsort(session, kind="stable")
    kept = Observations(kept.frame[order], kept.sources, kept.set_aside)
    session = session[order]
    is_measured = is_measured[used][order]
    whitening, is_stated, notes = _whitening(kept.covariance_mm2, is_measured)
    directions = kept.directions
    frames = tuple(
        "free" if bool(is_measured[session == number].all(axis=1).any()) else "parallel"
        for number in range(len(sessions))
    )
    commanded = kept.commanded_mm
    sightings = Sightings(
        table=kept.frame,
        commanded_mm=commanded,
        offset_mm=kept.target_offset_mm,
        measured_mm=np.where(is_measured, np.nan_to_num(kept.measured_mm), 0.0),
        is_measured=is_measured,
        whitening=whitening,
        is_stated=is_stated,
        carrier=np.array([CARRIERS.index(name) for name in kept.texts("carrier")], dtype=np.uint8),
        session=session,
        sessions=sessions,
        frames=frames,
        pass_number=_passes(session, kept.texts("line"), kept.numbers("repeat")[:, 0], commanded, directions),
        directions=directions,
        source_row=np.flatnonzero(used)[order].astype(np.int64),
        left_out=left_out,
        notes=notes,
    )
    is_near = _near_the_others(sightings)
    if is_near.all():
        return sightings
    return sightings.select(is_near, "measured far from any place that the machine reaches")


def _near_the_others(sightings: Sightings) -> np.ndarray:
    """Tell which rows (n,) are measured where the machine can have been: a lost decimal point turns a whole frame."""
    is_near = np.ones(len(sightings), dtype=bool)
    moves = sightings.carrier != CARRIERS.index("base")
    for number in range(len(sightings.sessions)):
        rows = np.flatnonzero((sightings.session == number) & moves)
        if len(rows) < 3:
            continue
        travel, offsets = (_farthest_mm(own[rows]) for own in (sightings.commanded_mm, sightings.offset_mm))
        seen, measured = sightings.is_measured[rows], sightings.measured_mm[rows]
        columns = zip(measured.T, seen.T, strict=True)
        middle = [np.median(own[is_seen]) if is_seen.any() else 0.0 for own, is_seen in columns]
        distance = np.linalg.norm(np.where(seen, measured - middle, 0.0), axis=1)
        is_near[rows] = distance <= _BEYOND_REACH * (travel + offsets) + _BEYOND_REACH_MM
    return is_near


def _farthest_mm(points_mm: Numbers) -> float:
    return float(np.linalg.norm(points_mm - np.median(points_mm, axis=0), axis=1).max())


def _of_circle(test: CircularTest) -> Sightings:
    """Rows of a circular test: the tool seen from the work, one radius each.

    Every line of a session has one set-up of the bar; a pass is what was run once, in one sense at one feed.
    """
    frame = test.frame
    n_rows = frame.height
    session_names = frame["session"].cast(pl.String).to_list() if "session" in frame.columns else ["0"] * n_rows
    lines = frame["line"].cast(pl.String).to_list() if "line" in frame.columns else [""] * n_rows
    runs = [f"circle {line or ''}/{session or ''}" for line, session in zip(lines, session_names, strict=True)]
    names = tuple(dict.fromkeys(runs))
    number_of = {name: number for number, name in enumerate(names)}
    session = np.array([number_of[run] for run in runs], dtype=np.int64)
    order = np.argsort(session, kind="stable")
    frame, session = frame[order], session[order]
    commanded = np.column_stack([frame[name].cast(pl.Float64).to_numpy() for name in ("x", "y", "z")])
    measured = np.zeros((n_rows, 3))
    measured[:, 0] = frame["r"].cast(pl.Float64).to_numpy()
    is_measured = np.zeros((n_rows, 3), dtype=bool)
    is_measured[:, 0] = True
    repeat = frame["repeat"].cast(pl.Float64).to_numpy() if "repeat" in frame.columns else np.zeros(n_rows)
    sense = frame["dir"].cast(pl.Float64).to_numpy() if "dir" in frame.columns else np.zeros(n_rows)
    directions = Observations(frame.with_columns(pl.Series("session", session.astype(str)))).directions
    feed = frame["feed"].cast(pl.Float64).to_numpy() if "feed" in frame.columns else np.zeros(n_rows)
    _, pass_number = np.unique(
        np.column_stack([session, *(np.nan_to_num(column) for column in (repeat, feed, sense))]),
        axis=0,
        return_inverse=True,
    )
    commanded = np.ascontiguousarray(commanded, dtype=np.float64)
    for number in range(int(pass_number.max(initial=-1)) + 1):
        rows = pass_number.ravel() == number
        commanded[rows] = on_their_circle(commanded[rows])
    std_mm = frame["sr"].cast(pl.Float64).to_numpy() if "sr" in frame.columns else np.full(n_rows, np.nan)
    is_stated = bool((np.isfinite(std_mm) & (std_mm >= _LEAST_STD_MM)).all())
    whitening = np.zeros((n_rows, 3, 3))
    whitening[:, 0, 0] = 1.0 / std_mm if is_stated else 1.0
    return Sightings(
        table=frame,
        commanded_mm=commanded,
        offset_mm=np.zeros((n_rows, 3)),
        measured_mm=measured,
        is_measured=is_measured,
        whitening=whitening,
        is_stated=is_stated,
        carrier=np.full(n_rows, CARRIERS.index("relative"), dtype=np.uint8),
        session=session,
        sessions=names,
        frames=("circle",) * len(names),
        pass_number=pass_number.astype(np.int64).ravel(),
        directions=directions,
        source_row=order.astype(np.int64),
        left_out={},
        notes=(),
    )


def _joined(parts: Sequence[Sightings]) -> Sightings:
    parts = _with_weights_of_circles(parts)
    if len({part.is_stated for part in parts}) > 1:
        raise GeometryError(
            "some measurements state their uncertainty and others do not, so that they cannot be weighed together\n"
            "hint: give sx, sy, sz (mm) in every file, or in none"
        )
    session_offsets = np.cumsum([0, *(len(part.sessions) for part in parts[:-1])])
    pass_offsets = np.cumsum([0, *(part.n_passes for part in parts[:-1])])
    left_out: dict[str, int] = {}
    for part in parts:
        for why, count in part.left_out.items():
            left_out[why] = left_out.get(why, 0) + count
    return Sightings(
        table=pl.concat([part.table for part in parts], how="diagonal_relaxed"),
        commanded_mm=np.concatenate([part.commanded_mm for part in parts]),
        offset_mm=np.concatenate([part.offset_mm for part in parts]),
        measured_mm=np.concatenate([part.measured_mm for part in parts]),
        is_measured=np.concatenate([part.is_measured for part in parts]),
        whitening=np.concatenate([part.whitening for part in parts]),
        is_stated=parts[0].is_stated,
        carrier=np.concatenate([part.carrier for part in parts]),
        session=np.concatenate([p.session + start for p, start in zip(parts, session_offsets, strict=True)]),
        sessions=tuple(name for part in parts for name in part.sessions),
        frames=tuple(kind for part in parts for kind in part.frames),
        pass_number=np.concatenate([p.pass_number + start for p, start in zip(parts, pass_offsets, strict=True)]),
        directions=np.concatenate([part.directions for part in parts]),
        source_row=np.concatenate([part.source_row for part in parts]),
        left_out=left_out,
        notes=tuple(sentence for part in parts for sentence in part.notes),
    )


def _with_weights_of_circles(parts: Sequence[Sightings]) -> Sequence[Sightings]:
    """Weigh radii that state no uncertainty like the components of the tables that do."""
    stated = [part for part in parts if part.is_stated]
    if not stated:
        return parts
    variances = [(part.unwhitening**2).sum(axis=2)[part.is_measured] for part in stated]
    std_mm = float(np.sqrt(np.concatenate(variances).mean()))
    note = f"a circular test states no uncertainty (column sr, mm): its radii got that of the points, {std_mm:.2g} mm"
    return [
        replace(part, whitening=part.whitening / std_mm, is_stated=True, notes=(*part.notes, note))
        if not part.is_stated and set(part.frames) == {"circle"}
        else part
        for part in parts
    ]


def _has_positive_covariance(covariance_mm2: Numbers | None, is_measured: npt.NDArray[np.bool_]) -> np.ndarray:
    """Tell which rows have a covariance that a measurement can have, (n,); one that is not stated is no obstacle."""
    if covariance_mm2 is None:
        return np.ones(len(is_measured), dtype=bool)
    needed = is_measured[:, :, None] & is_measured[:, None, :]
    stated = (np.isfinite(covariance_mm2) | ~needed).all(axis=(1, 2))
    padded = np.where(needed & np.isfinite(covariance_mm2), covariance_mm2, 0.0)
    padded = padded + np.eye(3) * (~is_measured)[:, None, :]
    return np.asarray(~stated | (np.linalg.eigvalsh(padded)[:, 0] >= _LEAST_STD_MM**2))


def _whitening(
    covariance_mm2: Numbers | None, is_measured: npt.NDArray[np.bool_]
) -> tuple[Numbers, bool, tuple[str, ...]]:
    """Give W (n, 3, 3) with W C Wᵀ = 1 on the measured components; rows without a covariance get the mean one."""
    unit = np.asarray(np.eye(3) * is_measured[:, None, :].astype(np.float64))
    if covariance_mm2 is None:
        return unit, False, ()
    needed = is_measured[:, :, None] & is_measured[:, None, :]
    stated = (np.isfinite(covariance_mm2) | ~needed).all(axis=(1, 2))
    if not stated.any():
        return unit, False, ("no row states the uncertainty of its position: the columns are empty",)
    notes: tuple[str, ...] = ()
    filled = np.where(needed & np.isfinite(covariance_mm2), covariance_mm2, 0.0)
    if not stated.all():
        mean = filled[stated].sum(axis=0) / np.maximum(needed[stated].sum(axis=0), 1)
        filled[~stated] = np.where(needed[~stated], mean, 0.0)
        notes = (f"{int((~stated).sum())} rows state no uncertainty: they were given the mean of the others",)
    # A component that was not measured gets variance 1 of its own, and its row of W is then taken out.
    padded = filled + np.eye(3) * (~is_measured)[:, None, :]
    value, vector = np.linalg.eigh(padded)
    too_small = value < _LEAST_STD_MM**2
    if too_small.any():
        row = int(np.flatnonzero(too_small.any(axis=1))[0])
        raise GeometryError(
            f"the covariance of measured row {row + 1} is not positive: its smallest eigenvalue is "
            f"{value[row].min():.3g} mm²\nhint: state the standard uncertainties in millimetres"
        )
    # W = V diag(1/√λ) Vᵀ: symmetric, and with a component taken out it never mixes it with the others.
    whitening = np.einsum("nik,nk,njk->nij", vector, 1.0 / np.sqrt(value), vector)
    return np.ascontiguousarray(np.where(needed, whitening, 0.0)), True, notes


def _passes(
    session: Integers, lines: Sequence[str], repeat: Numbers, commanded_mm: Numbers, directions: npt.NDArray[np.int8]
) -> Integers:
    """Give every row its pass: rows of one session, line, repeat and direction of the axes that move in it."""
    keys = zip(session.tolist(), lines, np.nan_to_num(repeat).tolist(), strict=True)
    number_of: dict[tuple[int, str, float], int] = {}
    group = np.array([number_of.setdefault(key, len(number_of)) for key in keys], dtype=np.int64)
    if not len(group):
        return group
    # Groups one after another, the rows of each in their order.
    order = np.argsort(group, kind="stable")
    own = group[order]
    starts = np.flatnonzero(np.diff(own, prepend=-1))
    commanded = commanded_mm[order]
    moves = (np.maximum.reduceat(commanded, starts) - np.minimum.reduceat(commanded, starts))[own] > SAME_POSITION_MM
    sense = np.where(moves, _with_first_direction(directions[order], commanded, starts), 0)
    _, first, of_key = np.unique(3**3 * own + sense @ _SENSES, return_index=True, return_inverse=True)
    # Numbered as they come.
    numbers = np.empty(len(group), dtype=np.int64)
    numbers[order] = np.argsort(np.argsort(first))[of_key]
    return numbers


def _with_first_direction(
    directions: npt.NDArray[np.int8], commanded_mm: Numbers, starts: Integers
) -> npt.NDArray[np.int8]:
    """Give each row the direction of travel within its line: of the step towards it, at first of the next one.

    A row at rest belongs to the step before it; to the one after it where the file says that it turned.

    Parameters
    ----------
    starts
        The first row of each line.
    """
    n = len(commanded_mm)
    row = np.arange(n)
    lengths = np.diff(starts, append=n)
    first, end = np.repeat(starts, lengths), np.repeat(starts + lengths, lengths)
    step = np.zeros((n, 3), dtype=np.int8)
    step[1:] = np.sign(np.round(np.diff(commanded_mm, axis=0) / SAME_POSITION_MM))
    # No step leads from one line to another.
    step[starts] = 0
    result = np.zeros_like(directions)
    for axis in range(3):
        is_step = step[:, axis] != 0
        last = np.maximum.accumulate(np.where(is_step, row, -1))
        following = np.append(np.minimum.accumulate(np.where(is_step, row, n)[::-1])[::-1], n)
        # Rows up to the first step belong to it, and those after the last one to that.
        has_last, has_next = last >= first, following[1:] < end
        before = np.where(has_last, last, following[:-1])
        after = np.where(has_next, following[1:], last)
        moves_at_all = has_last | (following[:-1] < end)
        before, after = (step[np.clip(place, 0, n - 1), axis] for place in (before, after))
        is_at_rest = (row > first) & ~is_step
        has_turned = is_at_rest & (directions[:, axis] == after)
        result[:, axis] = np.where(moves_at_all, np.where(has_turned, after, before), directions[:, axis])
    return result
