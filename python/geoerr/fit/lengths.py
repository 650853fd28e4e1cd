"""Measured lengths as sightings: two rows each, one for each end.

A length tells how far two places of a part are from each other, and nothing of where the part lay. So both ends are
seen along the length, from a middle that is an unknown of its own: what is left over is one number, the length, and
exactly |p₂ − p₁| of the machine that made the part (`geoerr_core::volumetric`, `ends.rs`). Each end has half of what
it is off.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import numpy.typing as npt
import polars as pl

from geoerr import _core
from geoerr.errors import GeometryError
from geoerr.fit.sightings import SAME_POSITION_MM, Numbers, Sightings
from geoerr.fit.unbelievable import stated_std_mm
from geoerr.observations import Lengths
from geoerr.summaries import counted, place_of_row

_ENDS = (("x1", "y1", "z1"), ("x2", "y2", "z2"))
# A machine that is off by this share of a length is another machine, or the length another, or mistyped.
_STRANGE = 0.05
# Repeats of one that differ by so many times the usual; of so many that were repeated, and so many rows are named.
_UNLIKE, _FEWEST_REPEATED, _MOST_NAMED = 10.0, 4, 4
_NO_EXTENT = "a length from a place to itself"
_MISTYPED = "a length that is off by more than a twentieth"


def sightings_of_lengths(lengths: Lengths) -> Sightings:
    """Give the ends of lengths, first and second of each in turn; each length is a pass of its own.

    A column `s_measured` (mm) states the standard uncertainty of each length, if at all.

    Raises
    ------
    GeometryError
        where half of the lengths are off by more than a twentieth: of another part, or in another unit.
    """
    frame = lengths.frame
    ends_mm = _from_the_lower_end(np.stack([_columns(frame, names) for names in _ENDS], axis=1))
    measured_mm = _columns(frame, ("measured",))[:, 0]
    nominal_mm = np.linalg.norm(ends_mm[:, 1] - ends_mm[:, 0], axis=1)
    has_extent = nominal_mm > SAME_POSITION_MM
    is_strange = has_extent & ~(np.abs(measured_mm - nominal_mm) <= _STRANGE * nominal_mm)
    _refuse_strangers(lengths, nominal_mm, measured_mm, has_extent, is_strange)
    kept = np.flatnonzero(has_extent & ~is_strange)
    left_out = {_NO_EXTENT: int((~has_extent).sum()), _MISTYPED: int(is_strange.sum())}
    row = np.repeat(kept, 2)
    n_rows = len(row)
    commanded_mm = np.ascontiguousarray(ends_mm[kept].reshape(-1, 3))
    table = frame.drop(*_ENDS[0], *_ENDS[1])[row].with_columns(
        pl.Series(name, commanded_mm[:, number]) for number, name in enumerate(("x", "y", "z"))
    )
    std_mm, is_stated, notes = stated_std_mm(frame[kept], "s_measured", "lengths")
    # Of two ends that are independent; one that states nothing is as sure as a component of a point.
    of_end_mm = (std_mm if is_stated else np.ones(len(kept))) / np.sqrt(2.0)
    return Sightings.of_one_number(
        table=table.with_columns(table["feature"].alias("line")),
        commanded_mm=commanded_mm,
        measured_mm=measured_mm[row],
        std_mm=np.repeat(of_end_mm, 2),
        is_stated=is_stated,
        session=np.zeros(n_rows, dtype=np.int64),
        sessions=("lengths",),
        frames=("lengths",),
        pass_number=np.repeat(np.arange(len(kept)), 2),
        directions=np.zeros((n_rows, 3), dtype=np.int8),
        source_row=row.astype(np.int64),
        left_out={why: count for why, count in left_out.items() if count},
        notes=(
            *notes,
            *_strangers(frame, nominal_mm, measured_mm, is_strange),
            *_unlike_repeats(frame[kept], ends_mm[kept], measured_mm[kept]),
        ),
    )


def _unlike_repeats(frame: pl.DataFrame, ends_mm: Numbers, measured_mm: Numbers) -> Iterator[str]:
    """Name the length whose repeats differ by far more than those of the others do: one of them is a slip.

    Which one nobody can tell of two, and what a model lacks, all repeats of a length have in common.
    """
    places = np.round(ends_mm.reshape(-1, 6) / SAME_POSITION_MM)
    _, group = np.unique(places, axis=0, return_inverse=True)
    low, high = (np.full(int(group.max(initial=-1)) + 1, start) for start in (np.inf, -np.inf))
    np.minimum.at(low, group.ravel(), measured_mm)
    np.maximum.at(high, group.ravel(), measured_mm)
    spread = (high - low)[np.bincount(group.ravel()) > 1]
    usual = float(np.median(spread)) if len(spread) >= _FEWEST_REPEATED else 0.0
    worst = int(np.argmax(high - low)) if len(low) else 0
    if not 0.0 < _UNLIKE * usual < high[worst] - low[worst]:
        return
    rows = np.flatnonzero(group.ravel() == worst)[:_MOST_NAMED].tolist()
    where = ""
    if "file_row" in frame.columns:
        where = f" ({', '.join(place_of_row(float(frame['file_row'][row]), row) for row in rows)})"
    yield (
        f"{frame['feature'][rows[0]]} was measured from {low[worst]:g} to {high[worst]:g} mm{where}, where others "
        f"differ by {usual:.2g} mm when they are measured again: one is mistyped, or of another place; it takes "
        "part, and all is less sure by it"
    )


def middles_of_lengths(sightings: Sightings) -> Numbers | None:
    """Give the derivative (n, 3, k) of what is measured by where the middles of k lengths lie; None without any."""
    length = sightings.length
    if length is None:
        return None
    rows = np.flatnonzero(length >= 0)
    _, number = np.unique(length[rows], return_inverse=True)
    derivative = np.zeros((len(sightings), 3, int(number.max(initial=-1)) + 1))
    derivative[rows, 0, number.ravel()] = 1.0
    return derivative


def other_ends(sightings: Sightings) -> tuple[np.ndarray, np.ndarray]:
    """Give the rows of the first ends of all lengths, (k,), and those of their second ends."""
    return sightings.once("ends of lengths", _ends)


def _ends(sightings: Sightings) -> tuple[np.ndarray, np.ndarray]:
    length = sightings.length
    if length is None:
        return np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64)
    rows = np.flatnonzero(length >= 0)
    both = rows[np.argsort(length[rows], kind="stable")].reshape(-1, 2)
    return both[:, 0], both[:, 1]


def other_ends_mm(sightings: Sightings) -> Numbers:
    """Give where the other end of each end of a length was commanded, (n, 3), 0 in other rows; (n, 0) without any."""
    if "lengths" not in sightings.frames:
        return np.zeros((len(sightings), 0))
    places = np.zeros((len(sightings), 3))
    first, second = other_ends(sightings)
    places[first], places[second] = sightings.commanded_mm[second], sightings.commanded_mm[first]
    return places


def is_told(sightings: Sightings) -> npt.NDArray[np.bool_]:
    """Tell which numbers (n, 3) were measured, each length once: at its second end."""
    if "lengths" not in sightings.frames:
        return sightings.is_measured
    result = sightings.is_measured.copy()
    result[other_ends(sightings)[0]] = False
    return result


def of_the_headline(sightings: Sightings) -> npt.NDArray[np.bool_]:
    """Tell which numbers (n, 3) have the figure that comes first: lengths where nothing sees positions."""
    told = is_told(sightings)
    of_lengths = sightings.of_kind("lengths")
    return told if not of_lengths.any() or of_lengths.all() else told & ~of_lengths[:, None]


def of_whole_lengths(sightings: Sightings, residual_mm: Numbers, *, size: float = 2.0) -> Numbers:
    """Give residuals (n, 3) with those of lengths at their second ends, and 0 at the first.

    Each end has half of what its length is off; in standard deviations, of which `size` is √2, a root of half.
    """
    if "lengths" not in sightings.frames:
        return residual_mm
    first, second = other_ends(sightings)
    result = residual_mm.copy()
    result[first] = 0.0
    result[second] *= size
    return result


def told_in_base_axes(
    sightings: Sightings, problem: _core.FitProblem, state: _core.FitState, residual_mm: Numbers
) -> Numbers:
    """Give residuals (n, 3) of what was told: of points in base axes, of lengths whole at their second ends."""
    return of_whole_lengths(sightings, problem.in_base_axes(state, np.ascontiguousarray(residual_mm)))


def _from_the_lower_end(ends_mm: Numbers) -> Numbers:
    """Give ends (k, 2, 3) in the order of their places: one that was measured from its other end is the same."""
    places = np.round(ends_mm / SAME_POSITION_MM)
    is_swapped = np.array([tuple(one) > tuple(two) for one, two in places], dtype=bool)
    return np.asarray(np.where(is_swapped[:, None, None], ends_mm[:, ::-1], ends_mm))


def _columns(frame: pl.DataFrame, names: tuple[str, ...]) -> Numbers:
    return np.column_stack([frame[name].cast(pl.Float64).to_numpy() for name in names]).astype(np.float64)


def _refuse_strangers(
    lengths: Lengths, nominal_mm: Numbers, measured_mm: Numbers, has_extent: np.ndarray, is_strange: np.ndarray
) -> None:
    n_lengths, n_strange = int(has_extent.sum()), int(is_strange.sum())
    if n_strange and 2 * n_strange >= n_lengths:
        ratio = float(np.median(measured_mm[has_extent] / nominal_mm[has_extent]))
        where = f"{', '.join(lengths.sources)}: " if lengths.sources else ""
        raise GeometryError(
            f"{where}{n_strange} of {counted(n_lengths, 'length')} are off by more than a twentieth; measured is "
            f"{ratio:.4g} times what the end points say\n"
            "hint: x1 ... z2 are the nominal end points and measured their distance, all in mm, of one part"
        )


def _strangers(
    frame: pl.DataFrame, nominal_mm: Numbers, measured_mm: Numbers, is_strange: np.ndarray
) -> Iterator[str]:
    """Name the first length that is another, or mistyped."""
    if not is_strange.any():
        return
    first, n_strange = int(np.argmax(is_strange)), int(is_strange.sum())
    row = float(frame["file_row"][first]) if "file_row" in frame.columns else float("nan")
    yield (
        f"{counted(n_strange, 'length')} {'is' if n_strange == 1 else 'are'} off by more than a twentieth and "
        f"{'takes' if n_strange == 1 else 'take'} no part: the first in {place_of_row(row, first)}, "
        f"{measured_mm[first]:g} mm where the end points are {nominal_mm[first]:g} mm apart"
    )
