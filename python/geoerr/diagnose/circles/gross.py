"""Rows that stand alone: mistakes, told from spikes where an axis reverses."""

from __future__ import annotations

import numpy as np

from geoerr.diagnose.circles.found import Searched
from geoerr.diagnose.circles.runs import Runs
from geoerr.diagnose.circles.structure import DECAYS
from geoerr.fit.sightings import Numbers

# Rows farther off than this many standard deviations, alone or two together, are mistakes.
_GROSS, _LONGEST_MISTAKE = 6.0, 2
# So many rows beside a reversal may be a spike.
_ROWS_OF_A_SPIKE = 4
# Shapes of spikes are off by so much of their height.
_SHAPE = 0.15
# Standard deviation of Gaussian noise over the median of absolute values.
_NORMAL = 0.6745


def misfit_um(searched: Searched) -> Numbers:
    """Give what the shape of spikes may be off by at every row, (n,): a real one is no exponential."""
    decays = [place for place, one in enumerate(searched.found) if one.suspect.reference.effect in DECAYS]
    size = np.abs(searched.traces[:, decays]).sum(axis=1)
    wide = size.copy()
    for shift in range(1, _ROWS_OF_A_SPIKE + 1):
        wide[shift:] = np.maximum(wide[shift:], size[:-shift])
        wide[:-shift] = np.maximum(wide[:-shift], size[shift:])
    return np.asarray(_SHAPE * wide)


def stand_alone(runs: Runs, values_um: Numbers, level_um: Numbers, *, near_reversals: bool) -> np.ndarray:
    """Tell which rows stand alone far off their neighbours, (n,): no mistake goes on.

    Parameters
    ----------
    level_um : (n,)
        Least standard deviation of a row's noise, where it is known; ones where it is not.
    near_reversals
        Whether also where an axis reverses: before causes are known, a row there may be a spike.
    """
    scaled = values_um / level_um
    result = np.zeros(len(runs), dtype=bool)
    reach = np.array([-3, -2, -1, 1, 2, 3])
    for own in runs.slices:
        n = own.stop - own.start
        # At the ends the nearest rows on the one side that there is.
        middle = np.clip(np.arange(n), 3, n - 4)
        beside = scaled[own][middle[:, None] + reach]
        # Beside a step a row agrees with the rows on one side.
        off = np.abs(scaled[own][:, None] - np.stack([np.median(beside[:, :3], 1), np.median(beside[:, 3:], 1)], 1))
        off = off.min(axis=1)
        spread = float(np.median(off)) / _NORMAL
        far = off > _GROSS * (max(spread, 1.0) if near_reversals else spread)
        edges = np.flatnonzero(np.diff(np.concatenate([[0], far.astype(np.int8), [0]])))
        for start, stop in zip(edges[::2], edges[1::2], strict=True):
            if stop - start <= _LONGEST_MISTAKE:
                result[own.start + start : own.start + stop] = True
        if not near_reversals:
            step = float(np.median(np.diff(runs.travelled_rad[own])))
            quarter = np.mod(runs.angle_rad[own] + np.pi / 4.0, np.pi / 2.0) - np.pi / 4.0
            result[own] &= np.abs(quarter) > _ROWS_OF_A_SPIKE * step
    return result
