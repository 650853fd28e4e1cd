"""How much each of a device's components scatters from row to row, told by the rows themselves.

A joint fit that holds all rows for alike is as wrong as they differ: of points known to 10 µm and radii to 0.5 µm
standard errors were 2.6 times too small, and the radii made the model worse. So where nothing is stated, scatter is
told before any model, and so that no error of the machine passes for it:

1. A row that was measured again is taken without the mean of its visits: what the machine does every time is gone.
2. What its neighbours along the pass say of a row, by the cubic through two on either side (by a line through one
   where a pass is short), is taken off: offsets, drifts and growth are gone.
3. The median of what is left tells the standard deviation, so that gross rows do not.

Where some device has no repeats the second step alone tells it of all, where passes are straight, or circles; of all
components together, for errors of unlike short waves along three axes would pass for components of unlike noise.

Source: the pseudo-residuals of Gasser, Sroka and Jennen-Steinmetz, Biometrika 73 (1986), of the next order. Verified
in tests/fit/test_scatter.py: on white noise of known size beside errors that it must not see, and by Monte-Carlo of
the standard errors of a fit that is weighed so.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from geoerr.fit.alike import numbers_of_alike, scatter_in_groups
from geoerr.fit.lengths import other_ends
from geoerr.fit.noise import groups_of
from geoerr.fit.sightings import SAME_POSITION_MM, Integers, Numbers, Sightings

# A median of fewer numbers tells nothing, and of more no more.
_LEAST, _MOST_WINDOWS = 12, 300_000
# A root mean square of so many is known to a quarter.
_LEAST_OF_LENGTHS = 8
# Standard deviations nearer to each other than this are one: weights that are so far off cost a fiftieth of what the
# data tell, and standard errors are off by a tenth.
ALIKE = 1.25
# They have to be apart by so many of their own standard errors, too; that of n pseudo-residuals' median, which share
# rows, is so many times 1/√(2n).
_SIGNIFICANT, _ERROR_OF_MEDIAN = 4.0, 2.25
# The median of |x| of Gaussian noise is its standard deviation over this.
_BY_MEDIAN = 1.4826
# Less scatter than this is rounding, or of numbers that were computed.
_LEAST_STD_MM = 1e-6
# Rows of a straight pass lie on a line to this share of its length, and those of a circle this near to their chord.
_STRAIGHT, _ON_A_CIRCLE = 1e-9, 0.1
# Steps of scales; of finer ones none is seen.
_STEPS_MM = (0.1, 0.01, 1e-3, 1e-4, 1e-5)
_ROUND_OFF_MM = 1e-9


@dataclass(frozen=True, eq=False)
class Scatter:
    """Standard deviations from row to row: one for all devices and components that do not differ.

    Attributes
    ----------
    device : (n,)
        Number of each row's device: a session of points, a whole circular test, all lengths of a table.
    names
        Of the devices.
    std_mm : (n_devices, 3)
        By component of the measuring frame, of a radius or of a length; NaN where nothing is measured.
    n_told_by : (n_devices, 3)
        How many independent numbers tell it.
    """

    device: Integers
    names: tuple[str, ...]
    std_mm: Numbers
    n_told_by: Numbers


def scatter_of(table: Sightings) -> Scatter | None:
    """Tell how much the components of one table scatter from row to row; None where nothing tells."""
    if set(table.frames) == {"lengths"}:
        return _of_lengths(table)
    device, names, devices = _devices_of(table)
    left, is_by_component = _left_by_all(table, devices)
    of_devices = [_told([one.of(rows) for one in left]) for rows in devices]
    if None in of_devices:
        return None
    whole = _told(left)
    assert whole is not None
    pooled = [whole] * 3
    if is_by_component:
        pooled = _own_where_apart([_told(_of_component(left, number)) for number in range(3)], whole)
    std_mm, n_told_by = np.full((len(names), 3), np.nan), np.zeros((len(names), 3))
    for component, of_all in enumerate(pooled):
        own = _of_component(left, component) if is_by_component else left
        told = _own_where_apart([_told([one.of(rows) for one in own]) for rows in devices], of_all)
        for number, (rows, one) in enumerate(zip(devices, told, strict=True)):
            if table.is_measured[rows, component].any():
                std_mm[number, component], n_told_by[number, component] = one.std_mm, one.n_told_by
    return Scatter(device, names, std_mm, n_told_by)


@dataclass(frozen=True, eq=False)
class BesideStated:
    """How far the rows of devices scatter, as a share of what they state.

    Attributes
    ----------
    device, names
        As of a `Scatter`.
    ratio, n_told_by : (n_devices,)
        1 and 0 where nothing tells it.
    """

    device: Integers
    names: tuple[str, ...]
    ratio: Numbers
    n_told_by: Numbers


def scatter_beside_stated(table: Sightings, stated_mm: Numbers) -> BesideStated | None:
    """Tell how far rows of points and circles scatter, as a share of what they state (n, 3); None for lengths.

    Each number is held against what its own row states: near and far points are known unlike well.
    """
    if set(table.frames) == {"lengths"}:
        return None
    device, names, devices = _devices_of(table)
    left, _ = _left_by_all(table, devices)
    ratio, n_told_by = np.ones(len(names)), np.zeros(len(names))
    for number, rows in enumerate(devices):
        own = [one.of(rows) for one in left]
        n_numbers = float(sum(one.n_independent for one in own))
        share = np.concatenate([np.zeros(0), *(one.value_mm / stated_mm[one.row, one.component] for one in own)])
        middle = _BY_MEDIAN * float(np.median(np.abs(share))) if len(share) else 0.0
        # Of a coarse scale more than half stand still.
        if n_numbers >= _LEAST and middle > 0.0:
            ratio[number], n_told_by[number] = middle, n_numbers
    return BesideStated(device, names, ratio, n_told_by)


def _devices_of(table: Sightings) -> tuple[Integers, tuple[str, ...], list[np.ndarray]]:
    """Give the number of each row's device, the names of devices, and the rows (n,) of each."""
    is_circle = set(table.frames) == {"circle"}
    device = np.zeros(len(table), dtype=np.int64) if is_circle else table.session
    names = ("circular test",) if is_circle else tuple(f"session {name}" for name in table.sessions)
    return device, names, [np.asarray(device == number) for number in range(len(names))]


def _left_by_all(table: Sightings, devices: Sequence[np.ndarray]) -> tuple[list[_Left], bool]:
    """Give what is left of rows by what all devices (n,) have, repeats or else lines, and whether it is repeats."""
    windows = [*_windows(table, 5), *_windows(table, 3)]
    left = _repeated(table, windows)
    if all(_told([one.of(rows) for one in left]) for rows in devices):
        return left, True
    return _along_lines(table, windows), False


def _of_lengths(table: Sightings) -> Scatter | None:
    """Tell how much lengths scatter: by those that were measured again alike, for they come in no order."""
    _, second = other_ends(table)
    squares_mm2, dof = scatter_in_groups(table.measured_mm[second, 0], groups_of(table)[second])
    std_mm = math.sqrt(squares_mm2 / dof) if dof else 0.0
    if dof < _LEAST_OF_LENGTHS or std_mm <= _LEAST_STD_MM:
        return None
    told = np.full((1, 3), np.nan)
    told[0, 0] = std_mm
    return Scatter(np.zeros(len(table), dtype=np.int64), ("lengths",), told, np.array([[float(dof), 0.0, 0.0]]))


def are_apart(std_mm: Numbers, n_told_by: Numbers) -> bool:
    """Tell whether the most and least of some standard deviations differ by more than matters, and than chance."""
    error = _ERROR_OF_MEDIAN / np.sqrt(2.0 * n_told_by)
    most, least = int(np.argmax(std_mm)), int(np.argmin(std_mm))
    by_chance = _SIGNIFICANT * math.hypot(error[most], error[least])
    return math.log(std_mm[most] / std_mm[least]) > max(math.log(ALIKE), by_chance)


@dataclass(frozen=True)
class _Told:
    """A standard deviation, and how many independent numbers tell it."""

    std_mm: float
    n_told_by: float


def _own_where_apart(own: Sequence[_Told | None], pooled: _Told) -> list[_Told]:
    """Give each its own, or all the pooled one where they do not differ; what is not told has the pooled one."""
    told = [pooled if one is None else one for one in own]
    is_apart = are_apart(np.array([one.std_mm for one in told]), np.array([one.n_told_by for one in told]))
    return told if is_apart else [pooled] * len(told)


@dataclass(frozen=True, eq=False)
class _Window:
    """Neighbouring rows (k, size) of passes and how far those beside it tell the one in the middle, (k, size)."""

    rows: Integers
    shares: Numbers
    is_straight: np.ndarray


@dataclass(frozen=True, eq=False)
class _Left:
    """What neighbours leave of rows (k,) in one component, as large as the scatter of one row.

    `share` (k,) counts them: two visits of a place are off their mean by the same, and are one number.
    `apart_mm` (k,) is how far its reading is from another one of the same place; 0 where there is none.
    """

    component: int
    row: Integers
    value_mm: Numbers
    share: Numbers
    apart_mm: Numbers

    @property
    def n_independent(self) -> float:
        """Give how many of them do not follow from the others."""
        return float(self.share.sum())

    def of(self, chosen: np.ndarray) -> _Left:
        """Give those of some rows (n,)."""
        own = chosen[self.row]
        return _Left(self.component, self.row[own], self.value_mm[own], self.share[own], self.apart_mm[own])


def _windows(table: Sightings, size: int) -> list[_Window]:
    """Give all runs of so many neighbours; of three only in passes that have no five."""
    place = np.round(table.offset_mm / SAME_POSITION_MM)
    series = numbers_of_alike([table.pass_number, table.carrier, place])
    # In a pass rows stand as they were measured.
    order = np.argsort(series, kind="stable")
    count = np.bincount(series)[series[order]]
    first = np.arange(max(len(order) - size + 1, 0))
    inside = series[order[first]] == series[order[first + size - 1]]
    first = first[inside & ((count[first] >= 5) == (size == 5))]
    if not len(first):
        return []
    # Of very many rows some tell a median as well, and do not take gigabytes.
    first = first[:: math.ceil(len(first) / _MOST_WINDOWS)]
    rows = order[first[:, None] + np.arange(size)]
    steps = np.diff(table.commanded_mm[rows], axis=1)
    lengths = np.linalg.norm(steps, axis=2)
    path, chord = lengths.sum(axis=1), np.linalg.norm(steps.sum(axis=1), axis=1)
    is_circle = table.of_kind("circle", rows=rows[:, 0])
    bend = np.where(is_circle, _ON_A_CIRCLE, _STRAIGHT)
    is_straight = (lengths > SAME_POSITION_MM).all(axis=1) & (chord >= (1.0 - bend) * path)
    along = np.cumsum(np.maximum(lengths, SAME_POSITION_MM), axis=1)
    along = np.concatenate([np.zeros((len(rows), 1)), along], axis=1)
    return [_Window(rows, _shares(along), is_straight)]


def _shares(along: Numbers) -> Numbers:
    """Give how far each place (k, size) counts in the polynomial through all but the middle one; that is −1."""
    middle = along.shape[1] // 2
    beside = [number for number in range(along.shape[1]) if number != middle]
    shares = np.full(along.shape, -1.0)
    for number in beside:
        others = [other for other in beside if other != number]
        above = along[:, [middle]] - along[:, others]
        shares[:, number] = np.prod(above / (along[:, [number]] - along[:, others]), axis=1)
    return shares


def _visits(table: Sightings) -> Integers:
    """Give every row (n,) the number of what it looks at: one target at one place, reached from one side.

    Under whatever conditions: what they do along a pass is as smooth as they are.
    """
    names = table.texts("target") if "target" in table.table.columns else [""] * len(table)
    place = np.round(np.hstack([table.commanded_mm, table.offset_mm]) / SAME_POSITION_MM)
    sense = np.nan_to_num(table.numbers("dir"))
    target = np.unique(names, return_inverse=True)[1]
    return numbers_of_alike([place, table.directions, table.carrier, table.session, sense, target])


def _repeated(table: Sightings, windows: Sequence[_Window]) -> list[_Left]:
    """Give what neighbours leave of rows without the mean of their visits, by component."""
    visit = _visits(table)
    found = []
    for component in range(3):
        seen = table.is_measured[:, component]
        count = np.bincount(visit[seen], minlength=len(table))[visit]
        total = np.bincount(visit[seen], weights=table.measured_mm[seen, component], minlength=len(table))[visit]
        is_repeat = seen & (count > 1)
        # Of each visit the last row that is written stays: any of them serves.
        another = np.zeros(len(table))
        another[visit[seen]] = table.measured_mm[seen, component]
        mean = total / np.maximum(count, 1)
        value = np.where(is_repeat, table.measured_mm[:, component] - mean, np.nan)
        # A mean has its share of every row: what is left of one scatters less.
        variance = 1.0 - 1.0 / np.maximum(count, 2)
        apart = np.where(is_repeat, table.measured_mm[:, component] - another[visit], 0.0)
        found += [_left(component, value, variance, apart, one) for one in windows]
    return found


def _along_lines(table: Sightings, windows: Sequence[_Window]) -> list[_Left]:
    """Give what neighbours on a straight line, or a circle, leave of rows, by component."""
    straight = [_Window(one.rows[own], one.shares[own], own[own]) for one in windows for own in [one.is_straight]]
    value = np.where(table.is_measured, table.measured_mm, np.nan)
    whole, nothing = np.ones(len(table)), np.zeros(len(table))
    return [_left(number, value[:, number], whole, nothing, own) for number in range(3) for own in straight]


def _of_component(left: Sequence[_Left], component: int) -> list[_Left]:
    return [one for one in left if one.component == component]


def _left(component: int, value_mm: Numbers, variance: Numbers, apart_mm: Numbers, window: _Window) -> _Left:
    left = (window.shares * value_mm[window.rows]).sum(axis=1)
    size = np.sqrt((window.shares**2 * variance[window.rows]).sum(axis=1))
    known = np.isfinite(left)
    row = window.rows[known, window.rows.shape[1] // 2]
    return _Left(component, row, (left / size)[known], variance[row], apart_mm[row])


def _told(left: Sequence[_Left]) -> _Told | None:
    """Give the standard deviation of a row; None where too few numbers tell it, or nothing scatters."""
    size_mm = np.abs(np.concatenate([np.zeros(0), *(one.value_mm for one in left)]))
    n_told_by = float(sum(one.n_independent for one in left))
    if n_told_by < _LEAST:
        return None
    std_mm = _BY_MEDIAN * float(np.median(size_mm))
    if std_mm < _LEAST_STD_MM:
        # More than half stand still: of a coarse scale, those that do not tell it.
        std_mm = float(np.sqrt((size_mm**2).mean()))
    # None is known better than to its place within one step.
    std_mm = max(std_mm, _step_mm(np.concatenate([one.apart_mm for one in left])) / math.sqrt(12.0))
    return _Told(std_mm, n_told_by) if std_mm >= _LEAST_STD_MM else None


def _step_mm(apart_mm: Numbers) -> float:
    """Give the decimal step of which all that is apart is a multiple, mm; 0 where nothing is, or there is none."""
    if not apart_mm.any():
        return 0.0
    is_of = [np.abs(apart_mm - step * np.rint(apart_mm / step)).max() < _ROUND_OFF_MM for step in _STEPS_MM]
    return next((step for step, fits in zip(_STEPS_MM, is_of, strict=True) if fits), 0.0)
