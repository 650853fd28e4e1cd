"""Lags that a measurement began in the middle of: what had not followed yet at its first row is not in them.

A lag counts as settled at the first row of a session. Of a machine that had been warming for ten minutes it is not,
and its growth, coefficient and time constant come out wrong by several of their standard errors.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from geoerr.column_names import is_temperature
from geoerr.fit.fitted import Fitted
from geoerr.fit.sightings import Numbers
from geoerr.fit.variables import times_s
from geoerr.summaries import listed
from geoerr.terms import Term

_LAG = "tau"
# What is missing at first, and how far a session begins from the reference, as shares of what the temperature varies.
_MISSING, _WARM = 0.1, 0.1
# The first slope is that of so many rows at least, and of this share of the lag.
_FEWEST_ROWS, _FIRST = 6, 0.25


def begun_warm(fitted: Fitted, terms: Sequence[Term]) -> Iterator[str]:
    """Say so of each term that follows a temperature late, where some session began while that was changing."""
    sightings = fitted.sightings
    for term in terms:
        lag_s = next((one.value for one in term.inner if one.name == _LAG), np.nan)
        names = [name for name in term.variables if is_temperature(name)]
        if not np.isfinite(lag_s) or not names or "t" not in sightings.table.columns:
            continue
        times, values = times_s(sightings), [sightings.numbers(name) for name in names]
        # Of a difference the reference is none.
        followed = values[0] - (values[1] if len(values) > 1 else fitted.machine.reference_temperature_degc)
        span_k = float(np.nanmax(followed) - np.nanmin(followed)) if np.isfinite(followed).any() else 0.0
        starts = [_start(times[rows], followed[rows], lag_s) for rows in sightings.rows_of_sessions]
        missing_k = max((abs(slope) * lag_s for at_k, slope in starts if abs(at_k) > _WARM * span_k), default=0.0)
        missing_k = min(missing_k, span_k)
        if missing_k > _MISSING * span_k:
            yield (
                f"{term.id}: a lag of {lag_s:.0f} s counts as settled at the first row of a session, where "
                f"{listed(names)} was on its way, by {missing_k:.2g} K in such a time: what had not followed yet is "
                "missing, and the values come out wrong by more than they state; begin cold, or when all has settled"
            )


def _start(times: Numbers, followed: Numbers, lag_s: float) -> tuple[float, float]:
    """Give where a session begins, and how fast it changes there per second; 0 and 0 where nothing tells."""
    known = np.isfinite(followed) & np.isfinite(times)
    if known.sum() < _FEWEST_ROWS:
        return 0.0, 0.0
    times, followed = times[known], followed[known]
    first = np.arange(len(times)) < _FEWEST_ROWS
    first |= times - times[0] <= _FIRST * lag_s
    if np.ptp(times[first]) == 0.0:
        return 0.0, 0.0
    slope, at = np.polyfit(times[first] - times[0], followed[first], 1)
    return float(at), float(slope)
