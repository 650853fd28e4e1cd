"""Waves along a variable: periods to try, and periods that are the same wave at the places that were measured.

Places in even steps see a wave of one frequency and of another that differs from it by a cycle a step alike: 10 mm
steps cannot tell a wave of 40 mm from one of 13.3 or 8 mm. Where the sum of e^(2πi Δf x) over all places is as long
as their number, waves whose frequencies differ by Δf are one.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
import scipy

from geoerr.effects.plausible import plausible_match
from geoerr.fit.sightings import Numbers
from geoerr.terms import Parameter, Term

# Waves are apart by this share of a cycle over the range of their variable: what lies midway has 0.81 of its gain.
_CYCLES_APART = 0.5
# So many do for waves of half a millimetre over a metre; together they cost little.
_MOST_PERIODS = 4000
# How closely a formula is a sine or a cosine.
_SAME_WAVE = 1e-6
# Two waves are one where the places' sum of their difference has this share of its longest.
_ALIKE = 0.98
# Differences of frequency are tried so many times a cycle over the range, and at most so many places take part.
_TRIED_PER_CYCLE, _MOST_PLACES = 6, 400
# Of very many the rest is not told.
_MOST_TOLD = 40


def place_of_period(term: Term) -> int | None:
    """Give the place of the inner parameter that is a period, if the term is a wave; None where it cannot be one."""
    free = [place for place, one in enumerate(term.inner) if not one.is_fixed]
    if len(free) != 1 or len(term.variables) != 1 or term.inner[free[0]].spacing != "log":
        return None
    return free[0]


def is_wave(
    columns_at: Callable[[float], Numbers], values: Numbers, parameter: Parameter, *, harmonics: Sequence[int] = (1,)
) -> bool:
    """Tell whether columns (k, n) at any period are sines and cosines of values (n,): at both ends of its range.

    `harmonics` are the multiples of the frequency that they may have: places that see two waves alike see theirs so.
    """
    for period in (parameter.low, parameter.high):
        assert period is not None
        phase = 2.0 * np.pi * values / period
        for column in columns_at(period):
            waves = [wave(multiple * phase) for multiple in harmonics for wave in (np.sin, np.cos)]
            if not any(np.allclose(column, wave, rtol=0.0, atol=_SAME_WAVE) for wave in waves):
                return False
    return True


def periods_to_try(values: Numbers, low: float, high: float) -> list[float]:
    """Give periods, rising, whose frequencies are multiples of one, for waves along values (n,)."""
    step = 1.0 / high
    span = float(np.ptp(values[np.isfinite(values)]))
    if span > 0.0:
        step = min(step, _CYCLES_APART / span)
    harmonics = np.arange(math.ceil(1.0 / (high * step) - _SAME_WAVE), math.floor(1.0 / (low * step)) + 1)
    return [float(1.0 / (harmonic * step)) for harmonic in harmonics[:_MOST_PERIODS][::-1]]


def alike_periods(values: Numbers, period: float, low: float, high: float) -> list[float]:
    """Give the other periods between `low` and `high` that are the same wave at values (n,), longest first."""
    places, counts = np.unique(np.round(values[np.isfinite(values)], 6), return_counts=True)
    if len(places) > _MOST_PLACES:
        kept = np.sort(np.random.default_rng(len(places)).choice(len(places), _MOST_PLACES, replace=False))
        places, counts = places[kept], counts[kept]
    span = float(np.ptp(places))
    if span <= 0.0:
        return []
    share = counts / counts.sum()

    def length(difference: float) -> float:
        return float(abs(share @ np.exp(2j * np.pi * difference * places)))

    step = 1.0 / (_TRIED_PER_CYCLE * span)
    steps = np.arange(_TRIED_PER_CYCLE // 2, math.ceil(2.0 / (low * step)) + 2)
    tried, lengths = step * steps, _lengths(share, step * places, steps)
    peaks = 1 + np.flatnonzero((lengths[1:-1] >= lengths[:-2]) & (lengths[1:-1] > lengths[2:]))
    found = []
    for peak in peaks[lengths[peaks] > 0.5]:
        ends = (tried[peak - 1], tried[peak + 1])
        best = scipy.optimize.minimize_scalar(lambda one: -length(one), bounds=ends, options={"xatol": 1e-4 * step})
        if -best.fun >= _ALIKE:
            found += [abs(1.0 / period + best.x), abs(1.0 / period - best.x)]
    others = sorted(
        {round(float(1.0 / one), 9) for one in found if one > 0.0 and low <= 1.0 / one <= high}, reverse=True
    )
    return [one for one in others if abs(1.0 / one - 1.0 / period) * span > _CYCLES_APART][:_MOST_TOLD]


def _lengths(share: Numbers, turn: Numbers, steps: np.ndarray) -> Numbers:
    """Give | Σ share e^(2πi k turn) | for numbers k (m,) that rise by 1: as one product, of few waves with few."""
    n_fine = math.isqrt(len(steps)) + 1
    coarse, fine = (np.exp(2j * np.pi * np.outer(k, turn)) for k in (steps[::n_fine], np.arange(n_fine)))
    return np.asarray(np.abs((share * coarse) @ fine.T).ravel()[: len(steps)])


def likeliest(parameter: Parameter, periods: Sequence[float]) -> float:
    """Give the longest of some periods that a part of a machine is known to have, else the longest of all.

    All are as well known as the parameter's own value, in frequency.
    """
    return max([one for one in periods if is_known(parameter, one)] or periods)


def is_known(parameter: Parameter, period: float) -> bool:
    """Tell whether a part of a machine is known to have a period as well known as the parameter's, in frequency."""
    return plausible_match(parameter, period, parameter.std * (period / parameter.value) ** 2) is not None
