"""Where the knots of cubic splines stand, so that between positions they go where the positions say.

A spline is told by values at positions. What is wrong of these (noise, or an effect that the model lacks) is between
them larger by the swing of the basis: with w(q) the weights of the values in the spline's value at q,

    swing = max_q Σ_i |w_i(q)|

It is 2 to 4 of knots that are spread like even positions, and 300 of a knot for each of two positions that lie side
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
# What is allowed: a little more than the 4 of even positions. Where a plan leaves a gap that is wider than so many
# usual ones nobody expects as much of it, and it is more in proportion, up to twice as much: a quarter of the way is
# in gaps no wider than a usual one.
_MOST_SWING, _WIDE, _USUAL, _AT_MOST = 5.0, 4.0, 0.25, 2.0
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
    return float(_swings(spec, position_mm).max())


def places_for_knots(position_mm: Numbers, most: int) -> Numbers:
    """Give as many of some rising positions (n,) as a spline with `most` functions may follow one by one.

    Where a function for each would swing in the gaps between them, every so manieth stands for its neighbours, both
    ends among them: dense parts of an axis keep their share.
    """
    if len(position_mm) < _FEWEST:
        return position_mm
    looked_at_mm = _some(position_mm, _POSITIONS_OF_A_FUNCTION * most)
    if _is_calm(position_mm, looked_at_mm, most):
        return position_mm
    fewer = (_some(position_mm, count) for count in range(min(len(position_mm) - 1, most), _FEWEST - 1, -1))
    return next((found for found in fewer if _is_calm(found, looked_at_mm, most)), _some(position_mm, 2))


def _swings(spec: BasisSpec, position_mm: Numbers) -> Numbers:
    """Give the sum of the weights' sizes at places between positions, (n − 1, m): of each gap its own."""
    basis = basis_of(spec)
    asked = np.linspace(position_mm[:-1], position_mm[1:], _BETWEEN + 1, axis=1)
    weights = basis.evaluate(np.ascontiguousarray(asked.reshape(-1))) @ np.linalg.pinv(basis.evaluate(position_mm))
    return np.asarray(np.abs(weights).sum(axis=1).reshape(asked.shape))


def _is_calm(place_mm: Numbers, position_mm: Numbers, most: int) -> bool:
    """Tell whether bases with the most functions that places (k,) support swing little between positions (n,)."""
    gap_mm = np.diff(position_mm)
    by_width = np.sort(gap_mm)
    usual_mm = by_width[np.searchsorted(np.cumsum(by_width), _USUAL * by_width.sum())]
    allowed = _MOST_SWING * np.clip(gap_mm / (_WIDE * usual_mm), 1.0, _AT_MOST)
    return all((_swings(spec, position_mm).max(axis=1) <= allowed).all() for spec in _richest(place_mm, most))


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


def _some(position_mm: Numbers, count: int) -> Numbers:
    """Give so many of the positions, evenly by their number; all where they are no more."""
    if len(position_mm) <= count:
        return position_mm
    return position_mm[np.linspace(0, len(position_mm) - 1, count).round().astype(np.intp)]
