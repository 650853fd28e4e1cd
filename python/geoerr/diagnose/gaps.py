"""Temperatures between two readings: what a search takes them for where a row has none.

A sensor that is read every few seconds leaves rows empty, and a candidate that is 0 at them is judged too low: the
neighbouring sensor, or something without a name, comes first. Bodies of metal do not jump: over a gap that is short
beside the session, and over which the sensor hardly changed, the temperature runs straight. Elsewhere it stays
unknown, and a search goes on without these rows: what a temperature did there nobody can say. A fit never takes a
temperature for known: there a row without a reading is left out, and counted.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from geoerr.column_names import is_temperature
from geoerr.fit.sightings import Numbers, Sightings
from geoerr.fit.variables import times_s, variable_columns

# Of a session's time: a longer gap may hide a rise and fall; beyond first and last reading there is one side only.
_LONGEST_GAP, _LONGEST_HOLD = 0.1, 0.02
# Of the whole range of a sensor, and kelvins that no effect of a machine shows.
_LARGEST_CHANGE, _NO_CHANGE_K = 0.1, 0.5
# A sensor that is known in fewer rows than this share of them costs no rows, nor do more rows go than are left.
_LEAST_READ = 0.5


@dataclass(frozen=True)
class Gaps:
    """Rows in which a temperature was not read.

    Attributes
    ----------
    name
        Its column.
    n_empty
        Rows without a reading.
    n_between
        Those of them that lie between readings, or beside one, near enough.
    """

    name: str
    n_empty: int
    n_between: int


def read_columns(sightings: Sightings, names: Sequence[str]) -> Numbers:
    """Give variables as `variable_columns` does, (k, n), with temperatures between readings.

    Raises
    ------
    GeoerrError
        for a covariate that is no column of the data.
    """
    columns = variable_columns(sightings, names)
    for place, name in enumerate(names):
        if is_temperature(name):
            columns[place] = between_readings(sightings, columns[place])
    return columns


def gaps_of(sightings: Sightings) -> tuple[Gaps, ...]:
    """Give the temperatures that were not read in every row, in the order of columns."""
    found = []
    for name in filter(is_temperature, sightings.covariate_columns):
        values = sightings.numbers(name)
        n_empty = int(np.isnan(values).sum())
        if 0 < n_empty < len(values):
            n_left = int(np.isnan(between_readings(sightings, values)).sum())
            found.append(Gaps(name, n_empty, n_empty - n_left))
    return tuple(found)


def unread_temperatures(sightings: Sightings) -> tuple[str, ...]:
    """Give the temperatures for the sake of which a search goes on without rows."""
    unread = unread_rows(sightings)
    return tuple(
        name
        for name in filter(is_temperature, sightings.covariate_columns)
        if np.isnan(between_readings(sightings, sightings.numbers(name)))[unread].any()
    )


def unread_rows(sightings: Sightings) -> npt.NDArray[np.bool_]:
    """Tell in which rows some temperature stays unknown that others know, (n,): a search goes on without them."""
    unread = np.zeros(len(sightings), dtype=bool)
    for name in filter(is_temperature, sightings.covariate_columns):
        own = np.isnan(between_readings(sightings, sightings.numbers(name)))
        if own.mean() <= 1.0 - _LEAST_READ:
            unread |= own
    return unread if unread.mean() <= 1.0 - _LEAST_READ else np.zeros(len(sightings), dtype=bool)


def between_readings(sightings: Sightings, values: Numbers) -> Numbers:
    """Give readings (n,) with what lies between them near enough; NaN elsewhere."""
    known = np.isfinite(values)
    if known.all() or not known.any():
        return values
    result, times = values.copy(), times_s(sightings)
    change_k = max(_LARGEST_CHANGE * float(np.ptp(values[known])), _NO_CHANGE_K)
    for session in np.unique(sightings.session[~known]):
        rows = np.flatnonzero(sightings.session == session)
        read = rows[known[rows]]
        if read.size:
            read = read[np.argsort(times[read], kind="stable")]
            empty = rows[~known[rows]]
            span = float(np.ptp(times[rows]))
            result[empty] = _between(times[read], values[read], times[empty], span, change_k)
    return result


def _between(t_read: Numbers, read: Numbers, t: Numbers, span: float, change_k: float) -> Numbers:
    """Give what a session's readings tell of the times between; NaN where they tell nothing."""
    after = np.searchsorted(t_read, t)
    has_both = (after > 0) & (after < len(t_read))
    left, right = np.maximum(after - 1, 0), np.minimum(after, len(t_read) - 1)
    is_short = t_read[right] - t_read[left] <= _LONGEST_GAP * span
    is_level = np.abs(read[right] - read[left]) <= change_k
    nearest = np.minimum(np.abs(t - t_read[left]), np.abs(t - t_read[right]))
    is_known = np.where(has_both, is_short & is_level, nearest <= _LONGEST_HOLD * span)
    return np.where(is_known, np.interp(t, t_read, read), np.nan)
