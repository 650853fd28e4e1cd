"""Whether a wave along an axis is one wave from end to end.

A screw turns alike along all of its length. A step, a bump or a table of an axis's error that is finer than the
model's functions holds waves of every period, and the largest of them explains a part of it; but somewhere along the
axis it has another size and another phase, or is not there. So the wave is made free, once more, in a few parts of
the axis: of a true one the sum of squares falls by what chance gives to so many numbers, and of one that wears by a
little more.
"""

from __future__ import annotations

import numpy as np

from geoerr.diagnose.candidates import n_waves
from geoerr.diagnose.functions import Functions
from geoerr.diagnose.scan import estimate
from geoerr.diagnose.search.settle import Settled
from geoerr.distributions import chi_squared_sf
from geoerr.machine import AXES

# Parts of an axis, at most, and waves in each, at least: of less than one the model's own functions do much.
_MOST_PARTS, _LEAST_WAVES = 4, 1.5
# Share of what a wave explains free in each part that it explains as a whole. Of one whose size differs by a half
# from its mean it is 0.8.
_LEAST_SHARE = 0.8
# What parts explain beyond the whole is no chance.
_NO_CHANCE = 1e-3


def is_one_wave(functions: Functions, settled: Settled) -> bool:
    """Tell whether an effect is no wave along an axis, or one wave along all of it."""
    columns = _in_parts(functions, settled)
    if columns is None:
        return True
    _, root, whole = estimate(settled.space, settled.of_coefficients)
    _, root_of_parts, parts = estimate(settled.space, columns)
    more, rank = float(parts - whole), root_of_parts.shape[1] - root.shape[1]
    if rank <= 0 or float(chi_squared_sf(more, rank)) > _NO_CHANCE:
        return True
    return bool(whole - root.shape[1] >= _LEAST_SHARE * (parts - root_of_parts.shape[1]))


def _in_parts(functions: Functions, settled: Settled) -> np.ndarray | None:
    """Give a wave's columns (n, 3, k) for each part of its axis; None of what is no wave, or has too few turns."""
    term = settled.term
    if term is None or len(term.variables) != 1 or term.variables[0] not in AXES:
        return None
    turns = n_waves(functions, term, settled.shapes.trials[0])
    n_parts = min(_MOST_PARTS, int(turns / _LEAST_WAVES))
    if n_parts < 2:
        return None
    along_mm = settled.space.fitted.sightings.commanded_mm[:, AXES.index(term.variables[0])]
    ends_mm = np.linspace(along_mm.min(), along_mm.max(), n_parts + 1)
    part = np.clip(np.searchsorted(ends_mm, along_mm, side="right") - 1, 0, n_parts - 1)
    waves = settled.of_coefficients
    return np.concatenate([waves * (part == number)[:, None, None] for number in range(n_parts)], axis=2)
