"""Directions that the data leave free: which point of them is taken, and whom they concern.

Along a free direction the sum of squares does not change, or not so that anybody could tell (`PRACTICAL_RANK` in the
core). The solution of least length in scaled unknowns puts as much as it can into unknowns that hardly show: a wave
whose period all but divides the step of the data is a straight line there, of a thousandth of its amplitude, and half
of a scale of 10 µm would become a wave of 5 mm. So the point is taken where the unknowns are smallest beside what is
absurd for a machine; then the wave is none and the scale is the scale. And a function whose own part in a direction
stays within a third of its standard uncertainty, however far that direction is followed until some unknown becomes
absurd, is as good as determined.

| symbol | code | what |
|---|---|---|
| N | `null_space` | (n, d) the directions |
| W | `1 / limits` | one over what is absurd; 0 for unknowns of which nothing is (frames, places of targets) |
| x − N (W N)⁺ W x | `held_smallest` | the same for the data, and smallest |

Verified in tests/fit/test_free_directions.py.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from geoerr.fit.sightings import Numbers
from geoerr.terms import Term

# Beyond these nothing is an error of a machine.
_CLASSIC_LIMITS = {"mm": 3.0, "rad": 0.02}
_EFFECT_LIMITS = {"mm": 1.0, "rad": 0.01}
# A contribution below a third of an uncertainty adds a twentieth to it.
_NEGLIGIBLE = 1.0 / 3.0
# Directions that move no unknown whose size matters are known to this.
_RANK = 1e-12


def limits_of(terms: Sequence[Term], mm_per_unit: Numbers, n_columns: int) -> Numbers:
    """Give what is absurd for each unknown, (n_columns,); infinite where nothing is.

    Parameters
    ----------
    terms
        All terms, in the order of their coefficients.
    mm_per_unit : (n_coefficients,)
        Largest displacement at the data by one unit of each coefficient, for those that are neither mm nor rad;
        infinite where it is not known.
    n_columns
        Of all unknowns: inner parameters, frames and places after the coefficients.
    """
    limits = np.full(n_columns, np.inf)
    place = 0
    for term in terms:
        known = _CLASSIC_LIMITS if term.kind == "classic" else _EFFECT_LIMITS
        for parameter in term.coefficients:
            if parameter.unit in known:
                limits[place] = known[parameter.unit]
            elif 0.0 < mm_per_unit[place] < np.inf:
                limits[place] = known["mm"] / mm_per_unit[place]
            place += 1
    return limits


def held_smallest(values: Numbers, null_space: Numbers, limits: Numbers) -> Numbers:
    """Give unknowns (n,) or (n, k) moved along the free directions to where they are smallest.

    They may be the first ones alone, where the size of no other matters.
    """
    if not null_space.shape[1]:
        return values
    first = limits[: len(values)]
    weighted = null_space[: len(values)] / first[:, None]
    of_values = values / (first if values.ndim == 1 else first[:, None])
    size = np.linalg.norm(weighted, axis=0)
    matters = size > _RANK * np.linalg.norm(null_space, axis=0)
    directions = null_space[: len(values), matters] / size[matters]
    moves, *_ = np.linalg.lstsq(weighted[:, matters] / size[matters], of_values, rcond=_RANK)
    return np.asarray(values - directions @ moves)


def concerned(
    null_space: Numbers, is_determined: np.ndarray, terms: Sequence[Term], limits: Numbers, std: Numbers
) -> tuple[Numbers, np.ndarray]:
    """Take out of the directions the functions that they do not concern.

    Parameters
    ----------
    null_space : (n, d)
        Directions.
    is_determined : (n,)
        Whether no direction moves an unknown.
    terms, limits
        As for `limits_of`.
    std : (n_coefficients,)
        Standard uncertainties of the coefficients.

    Returns
    -------
    null_space, is_determined
        The same, but 0 and true for such functions.
    """
    result, known = null_space.copy(), np.asarray(is_determined, dtype=bool).copy()
    size = np.abs(null_space)
    with np.errstate(divide="ignore"):
        reach = np.min(np.where(size > 0.0, limits[:, None] / size, np.inf), axis=0, initial=np.inf)
    first = 0
    for term in terms:
        own = slice(first, first + len(term.coefficients))
        first = own.stop
        for number in np.flatnonzero(np.isfinite(reach) & (size[own].max(axis=0, initial=0.0) > 0.0)):
            if (reach[number] * size[own, number] <= _NEGLIGIBLE * std[own]).all():
                result[own, number] = 0.0
        was_moved = size[own].max(axis=1, initial=0.0) > 0.0
        known[own] |= was_moved & ~result[own].any(axis=1)
    return result, known
