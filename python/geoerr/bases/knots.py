"""Where the knots of cubic splines stand, so that between positions they go where the positions say.

A spline is told by values at positions. What is wrong of these (noise, or an effect that the model lacks) is between
them larger by the swing of the basis: with w(q) the weights of the values in the spline's value at q,

    swing = max_q Σ_i |w_i(q)|

It is 1.6 to 3 of knots that are spread like the positions, and 300 of a knot for each of two positions that lie side
by side, with a gap beside them: a slope over 1 mm reaches 30 mm far.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import numpy.typing as npt

from geoerr.bases.build import basis_of
from geoerr.terms import BasisSpec

Numbers = npt.NDArray[np.float64]

_CUBIC = 3
# Between two positions there is nothing but a line.
_FEWEST = 3
# A cubic through five positions that are spread evenly has 1.9, and with one of them anywhere near its place 3.
_MOST_SWING = 5.0
# Positions that are nearer to each other than this share of their mean distance count as one place: as few shares as
# leave the basis calm.
_SHARES = (0.1, 0.2, 0.3, 0.4, 0.5)
# Between two positions the swing is looked for at so many places, and of many positions as many stand for all as four
# times the functions.
_BETWEEN, _POSITIONS_OF_A_FUNCTION = 4, 4
# Up to this share of the places functions are few: with more, and even places, the swing of quantiles is above 3.
_FEW = 0.75
# With fewer functions than places a knot may stand less well: so many fewer are looked at, too, and the most that are
# few.
_FEWER = 3


def spline_over(axis: str, place_mm: Numbers, n_functions: int) -> BasisSpec:
    """Give a cubic spline with that many functions for rising places (k,), at least as many.

    Knots are at quantiles, so that as many places are between any two. With nearly a function for each place that
    leaves the ends loose: there knots are means of three neighbours among as many places as there are functions, as
    for a spline that interpolates (de Boor, A Practical Guide to Splines (2001), XIII).
    """
    if n_functions <= _FEW * len(place_mm):
        knots = np.quantile(place_mm, np.linspace(0.0, 1.0, n_functions - _CUBIC + 1))
    else:
        some = np.quantile(place_mm, np.linspace(0.0, 1.0, n_functions))
        knots = np.concatenate([some[:1], (some[1:-3] + some[2:-2] + some[3:-1]) / 3.0, some[-1:]])
    return BasisSpec("bspline", axis, knots_mm=tuple(knots.tolist()), degree=_CUBIC)


def swing_of(spec: BasisSpec, position_mm: Numbers) -> float:
    """Give how much larger a function may be between positions (n,) than at them, told by values there."""
    basis = basis_of(spec)
    between = np.linspace(0.0, len(position_mm) - 1.0, _BETWEEN * (len(position_mm) - 1) + 1)
    asked = np.interp(between, np.arange(len(position_mm)), position_mm)
    weights = basis.evaluate(asked) @ np.linalg.pinv(basis.evaluate(position_mm))
    return float(np.abs(weights).sum(axis=1).max())


def places_for_knots(position_mm: Numbers, most: int) -> Numbers:
    """Give as many of some rising positions (n,) as a spline with `most` functions may follow one by one.

    Positions that lie side by side are one place where a function for each would swing in the gaps between them. Both
    ends stay.
    """
    if len(position_mm) < _FEWEST:
        return position_mm
    n_some = min(len(position_mm), _POSITIONS_OF_A_FUNCTION * most)
    some_mm = position_mm[np.linspace(0, len(position_mm) - 1, n_some).round().astype(np.intp)]
    found = position_mm
    for share in (0.0, *_SHARES):
        found = _apart(position_mm, share)
        if all(swing_of(spec, some_mm) <= _MOST_SWING for spec in _richest(found, most)):
            break
    return found


def _richest(place_mm: Numbers, most: int) -> Iterator[BasisSpec]:
    """Give the bases with the most functions that places (k,) support."""
    if len(place_mm) <= _CUBIC + 1:
        low, high = float(place_mm[0]), float(place_mm[-1])
        yield BasisSpec("polynomial", "x", degree=len(place_mm) - 1, low_mm=low, high_mm=high)
        return
    count = min(len(place_mm), most)
    for n_functions in (*range(count, count - _FEWER - 1, -1), int(_FEW * count)):
        if n_functions > _CUBIC + 1:
            yield spline_over("x", place_mm, n_functions)


def _apart(position_mm: Numbers, share: float) -> Numbers:
    """Leave out positions (n,) that are nearer to the one before than a share of the mean distance of what stays."""
    kept = position_mm
    while share > 0.0:
        least_mm = share * float(kept[-1] - kept[0]) / len(kept)
        found = [kept[0]]
        for place in kept[1:-1]:
            if place - found[-1] > least_mm and kept[-1] - place > least_mm:
                found.append(place)
        found.append(kept[-1])
        if len(found) == len(kept):
            break
        kept = np.array(found)
    return kept
