"""Rows at which nobody knows whether the axis has turned already.

The usual run of ISO 230-2 goes beyond its last point and comes back to it: two rows of one place, the first reached
the one way, the second the other way. A machine that waits there, is looked at twice and then turns makes the same
rows. So where a place is looked at again and an axis goes back from there, the direction of that look is unknown,
unless it is stated. Nor does the order of rows tell it where one was taken in motion and the axis goes back from
there: it turned somewhere between the rows before and behind.
"""

from __future__ import annotations

import numpy as np

from geoerr.fit.sightings import SEE_POSITIONS, Numbers, Sightings
from geoerr.machine import AXES


def unstated_turns(sightings: Sightings, times: Numbers) -> np.ndarray:
    """Tell at which rows an axis may have turned and no direction is stated, (n, 3): whoever stated one knew."""
    stated = np.column_stack([np.isfinite(sightings.numbers(f"dir_{axis}")) for axis in AXES])
    return np.asarray((may_have_turned(sightings, times) | _turns_on_its_way(sightings)) & ~stated)


def _turns_on_its_way(sightings: Sightings) -> np.ndarray:
    """Tell at which rows in motion an axis goes back at once from where it is, (n, 3)."""
    is_moving = np.nan_to_num(sightings.numbers("moving")) != 0.0
    result = np.zeros((len(sightings), 3), dtype=bool)
    for rows, kind in zip(sightings.rows_of_sessions, sightings.frames, strict=True):
        if kind in SEE_POSITIONS and is_moving[rows].any():
            ahead = np.sign(np.diff(sightings.commanded_mm[rows], axis=0, append=np.nan))
            before = sightings.directions[rows]
            result[rows] = is_moving[rows, None] & (before != 0) & (ahead == -before)
    return result


def may_have_turned(sightings: Sightings, times: Numbers) -> np.ndarray:
    """Tell at which rows an axis may have turned since the last look from the same place, (n, 3).

    Parameters
    ----------
    times
        Of every row, (n,): rows of one time and place are one look.
    """
    n = len(sightings)
    result = np.zeros((n, 3), dtype=bool)
    has_times = np.isfinite(sightings.numbers("t"))
    names = sightings.texts("target") if "target" in sightings.table.columns else [""] * n
    target = np.column_stack([np.unique(names, return_inverse=True)[1], sightings.carrier, sightings.offset_mm])
    for rows, kind in zip(sightings.rows_of_sessions, sightings.frames, strict=True):
        n_rows = rows.stop - rows.start
        if kind not in SEE_POSITIONS or n_rows < 3:
            continue
        step = np.diff(sightings.commanded_mm[rows], axis=0, prepend=np.nan)
        is_new_place = (step != 0.0).any(axis=1)
        # Without times, several targets at one place were seen together, and one target twice is two looks.
        is_later = np.diff(times[rows], prepend=-np.inf) > 0.0
        is_same_target = np.append(False, (target[rows][1:] == target[rows][:-1]).all(axis=1))
        is_later = np.where(has_times[rows].all(), is_later, is_same_target)
        looks = np.cumsum(~is_new_place & is_later)
        first = np.maximum.accumulate(np.where(is_new_place, np.arange(n_rows), 0))
        is_again = looks > looks[first]
        before = sightings.directions[rows]
        turns = (before != 0) & (_next_directions(step, is_new_place) == -before)
        result[rows] = is_again[:, None] & turns
    return result


def _next_directions(step: Numbers, is_new_place: np.ndarray) -> np.ndarray:
    """Give the directions (n, 3) in which axes go to the next place from each row; 0 of one that stays.

    An axis that goes back later only, while others move, has not gone beyond its place here.
    """
    places = np.flatnonzero(is_new_place)
    following = np.searchsorted(places, np.arange(len(step)), side="right")
    return np.append(np.sign(step[places]), np.zeros((1, 3)), axis=0)[following]
