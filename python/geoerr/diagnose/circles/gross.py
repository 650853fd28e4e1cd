"""Rows that stand alone: mistakes, told from spikes where an axis reverses.

A spike is there at every reversal of its axis, in every run; a mistake is not.
"""

from __future__ import annotations

import numpy as np

from geoerr.diagnose.circles.causes import DECAYS
from geoerr.diagnose.circles.found import Searched
from geoerr.diagnose.circles.runs import Runs
from geoerr.distributions import chi_squared_isf
from geoerr.fit.sightings import Numbers

# Rows farther off than this many standard deviations, alone or two together, are mistakes: of noise that is known.
_GROSS, _LONGEST_MISTAKE = 6.0, 2
# Of what the rows themselves say of their noise it is a limit that Gaussian noise passes in so many tests, however
# many rows they have; in few rows, which do not know their noise well, no less than this.
_CHANCE_OF_A_TEST, _LEAST_BY_ROWS = 0.01, 4.4
# How far a row is off the nearest of what its neighbours expect has longer tails than the noise: so many times, where
# one of a thousand to one of ten million rows is farther off.
_TAIL = 1.045
# In a longer stretch one tells a mistake by its height over the rest of it.
_TOWERS = 4.0
# So many rows beside a reversal may be a spike.
_ROWS_OF_A_SPIKE = 4
# A row beside a reversal is no spike where it is off by so much more than rows as near to other reversals.
_UNLIKE = 3.0
# Shapes of spikes are off by so much of their height.
_SHAPE = 0.15
# Median of how far a row is off its neighbours, over the standard deviation of Gaussian noise.
_NORMAL = 0.412


def misfit_um(searched: Searched) -> Numbers:
    """Give what the shape of spikes may be off by at every row, (n,): a real one is no exponential."""
    decays = [place for place, one in enumerate(searched.found) if one.suspect.reference.effect in DECAYS]
    size = np.abs(searched.traces[:, decays]).sum(axis=1)
    wide = size.copy()
    for shift in range(1, _ROWS_OF_A_SPIKE + 1):
        wide[shift:] = np.maximum(wide[shift:], size[:-shift])
        wide[:-shift] = np.maximum(wide[:-shift], size[shift:])
    return np.asarray(_SHAPE * wide)


def stand_alone(runs: Runs, values_um: Numbers, least_um: Numbers) -> np.ndarray:
    """Tell which rows stand alone far off their neighbours, (n,): no mistake goes on.

    Parameters
    ----------
    values_um : (n,)
        What is left of the radius.
    least_um : (n,)
        Least standard deviation of a row's noise, where it is known; 0 where it is not.
    """
    off, spread = np.zeros(len(runs)), np.zeros(len(runs))
    reach = np.array([-3, -2, -1, 1, 2, 3])
    for own in runs.slices:
        n = own.stop - own.start
        # At the ends the nearest rows on the one side that there is.
        middle = np.clip(np.arange(n), 3, n - 4)
        beside = values_um[own][middle[:, None] + reach]
        # Beside a step a row agrees with the rows on one side, on a slope with what lies midway between both.
        before, behind = np.median(beside[:, :3], axis=1), np.median(beside[:, 3:], axis=1)
        expected = np.stack([before, behind, 0.5 * (before + behind)], axis=1)
        off[own] = np.abs(values_um[own][:, None] - expected).min(axis=1)
        spread[own] = float(np.median(off[own])) / _NORMAL
    limit = np.maximum(_limit_by_rows(len(runs)) * spread, _GROSS * least_um)
    far = off > limit
    result = np.zeros(len(runs), dtype=bool)
    for own in runs.slices:
        edges = np.flatnonzero(np.diff(np.concatenate([[0], far[own].astype(np.int8), [0]])))
        for start, stop in zip(edges[::2], edges[1::2], strict=True):
            result[own.start + start : own.start + stop] = _sticks_out(off[own][start:stop])
    return np.asarray(result & ~_are_spikes(runs, off, limit, result))


def _limit_by_rows(n_rows: int) -> float:
    """Give how many standard deviations of its run's noise a row of a test of so many is off, if it is a mistake."""
    return max(_LEAST_BY_ROWS, _TAIL * float(np.sqrt(chi_squared_isf(_CHANCE_OF_A_TEST / n_rows, 1))))


def _sticks_out(off: Numbers) -> np.ndarray:
    """Tell which rows of a stretch far off, (k,), are mistakes: all of a short one, else one or two that tower."""
    if len(off) <= _LONGEST_MISTAKE:
        return np.ones(len(off), dtype=bool)
    high = off > 0.5 * off.max()
    places = np.flatnonzero(high)
    is_short = len(places) <= _LONGEST_MISTAKE and int(np.ptp(places)) < _LONGEST_MISTAKE
    towers = is_short and float(off.max()) > _TOWERS * float(off[~high].max())
    return high if towers else np.zeros(len(off), dtype=bool)


def _are_spikes(runs: Runs, off: Numbers, limit: Numbers, flagged: np.ndarray) -> np.ndarray:
    """Tell which flagged rows lie beside a reversal, and are like the rows beside the other reversals of the axis."""
    step = np.array([float(np.median(np.diff(runs.travelled_rad[own]))) for own in runs.slices])[runs.run]
    crossing = np.rint(runs.angle_rad / (0.5 * np.pi))
    rows_after = (runs.angle_rad - 0.5 * np.pi * crossing) * runs.sense[runs.run] / step
    axis = np.array([plane[int(c) % 2] for plane, c in zip(np.array(runs.plane)[runs.run], crossing, strict=True)])
    reversal = runs.run * 4 + np.mod(crossing, 4)
    near = np.abs(rows_after) <= _ROWS_OF_A_SPIKE
    result = np.zeros(len(runs), dtype=bool)
    for row in np.flatnonzero(flagged & near):
        others = near & (axis == axis[row]) & (reversal != reversal[row])
        others &= np.abs(rows_after - rows_after[row]) <= 1.5
        heights = [float(off[others & (reversal == one)].max()) for one in np.unique(reversal[others])]
        usual = float(np.median(heights)) if heights else 0.0
        result[row] = off[row] < _UNLIKE * usual + limit[row]
    return result
