"""Periods that the places that were measured do not tell apart: the likeliest is told, and the others with it.

In even steps waves of several periods are the same at all places. Of few uneven places none are; but beside what the
model may do as well, a wave of another period may explain what was measured at sixteen of them as this one does.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from geoerr.diagnose.candidates import Formulas, wave_along
from geoerr.diagnose.functions import Functions
from geoerr.diagnose.scan import Scanner
from geoerr.diagnose.search.settle import Settled, settle_as, settle_at, shapes_at
from geoerr.diagnose.space import Space
from geoerr.fit.periods import alike_periods, is_known, likeliest
from geoerr.terms import Term

# Of more places along its axis one wave is told from all others.
_FEW_PLACES = 60
# Periods are tried so many times a cycle over the range: midway between two a wave has more than this of its gain.
_TRIED_PER_CYCLE, _MIDWAY = 8, 0.97
# Another period says as much where it explains less by no more than this, in the sum of squares: three standard
# errors.
_AS_MUCH = 9.0
# Waves nearer than this, in cycles over the range, are one.
_ONE_WAVE = 0.5
_MOST_TRIED, _MOST_REFINED = 20_000, 60
# Of periods that explain as much those count whose waves are no larger than so many times the smallest.
_LARGER = 1.5


def at_likeliest_period(space: Space, scanner: Scanner, settled: Settled) -> tuple[Settled, tuple[float, ...]]:
    """Estimate a wave at the likeliest of the periods that the places do not tell apart; leave any other effect.

    Gives with it the periods that explain as much without being the same at these places, longest first.
    """
    assert settled.term is not None
    sizes = _as_good_periods(space, scanner, settled)
    as_good = tuple(sorted(sizes, reverse=True))
    found = other_periods(scanner.functions, settled.term, space.rows.max(axis=1) > 0.0)
    wave = wave_along(Formulas(scanner.functions, settled.term), settled.term, settled.shapes.trials[0])
    if wave is None or (found is None and not as_good):
        return settled, ()
    parameter = settled.term.inner[wave[0]]
    same = dict.fromkeys([parameter.value, *([] if found is None else found[1])], _size(settled.term))
    sizes |= same
    # Beside a model that does most of it a wave may be several times what it need be.
    known = {period: size for period, size in sizes.items() if is_known(parameter, period)} or same
    best = likeliest(parameter, [period for period, size in known.items() if size <= _LARGER * min(known.values())])
    if best == parameter.value:
        return settled, as_good
    others = {parameter.value, *as_good} - {best} if best in as_good else set(as_good)
    return settle_at(space, scanner, settled, wave[0], best), tuple(sorted(others, reverse=True))


def _as_good_periods(space: Space, scanner: Scanner, settled: Settled) -> dict[float, float]:
    """Give other periods of a wave at few places that explain as much, with its size at each."""
    term, functions = settled.term, scanner.functions
    assert term is not None
    inner = list(settled.shapes.trials[0])
    formulas = Formulas(functions, term)
    wave = wave_along(formulas, term, inner)
    if wave is None:
        return {}
    place, values = wave
    places = np.unique(np.round(values[(space.rows.max(axis=1) > 0.0) & np.isfinite(values)], 6))
    low, high = term.inner[place].low, term.inner[place].high
    assert low is not None
    assert high is not None
    span = float(np.ptp(places)) if places.size else 0.0
    if len(places) > _FEW_PLACES or span <= 0.0:
        return {}
    step = 1.0 / (_TRIED_PER_CYCLE * span)
    n = math.floor((1.0 / low - 1.0 / high) / step)
    if not 2 < n <= _MOST_TRIED:
        return {}
    tried = 1.0 / high + step * np.arange(n + 1)
    trials = [(*inner[:place], float(1.0 / wave), *inner[place + 1 :]) for wave in tried]
    codes = np.array([formulas.codes(trial) for trial in trials], dtype=np.int64)
    shapes = replace(shapes_at(functions, term, inner), trials=tuple(trials), codes=codes)
    gain = scanner.exact(shapes).gain
    peaks = 1 + np.flatnonzero((gain[1:-1] >= gain[:-2]) & (gain[1:-1] > gain[2:]))
    peaks = peaks[gain[peaks] > _MIDWAY * settled.gain - _AS_MUCH]
    peaks = peaks[np.abs(tried[peaks] - 1.0 / inner[place]) * span > _ONE_WAVE]
    found: dict[float, float] = {}
    for peak in peaks[np.argsort(-gain[peaks])][:_MOST_REFINED]:
        start = [*inner[:place], float(1.0 / tried[peak]), *inner[place + 1 :]]
        bounds = {place: (float(1.0 / (tried[peak] + step)), float(1.0 / (tried[peak] - step)))}
        other = settle_as(space, scanner, term, start, bounds)
        assert other.term is not None
        if other.gain > settled.gain - _AS_MUCH:
            found[other.term.inner[place].value] = _size(other.term)
    return found


def _size(term: Term) -> float:
    return math.hypot(*(one.value for one in term.coefficients if math.isfinite(one.value)))


def other_periods(functions: Functions, term: Term, is_used: np.ndarray) -> tuple[int, list[float]] | None:
    """Give the place of a wave's period, and other values that are the same at the rows that are used, if any."""
    formulas = Formulas(functions, term)
    inner = [one.value for one in term.inner]
    wave = wave_along(formulas, term, inner)
    if wave is None:
        return None
    place, values = wave
    parameter = term.inner[place]
    others = alike_periods(values[is_used], parameter.value, *parameter.ends)
    return (place, others) if others else None
