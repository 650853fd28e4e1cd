"""Periods that are the same at the places that were measured: the likeliest is told, and the others with it."""

from __future__ import annotations

import numpy as np

from geoerr.diagnose.candidates import Formulas, wave_along
from geoerr.diagnose.functions import Functions
from geoerr.diagnose.scan import Scanner
from geoerr.diagnose.search.settle import Settled, settle_at
from geoerr.diagnose.space import Space
from geoerr.fit.periods import alike_periods, likeliest
from geoerr.terms import Term


def at_likeliest_period(space: Space, scanner: Scanner, settled: Settled) -> Settled:
    """Estimate a wave at the likeliest of the periods that the places do not tell apart; leave any other effect."""
    assert settled.term is not None
    found = other_periods(scanner.functions, settled.term, space.rows.max(axis=1) > 0.0)
    if found is None:
        return settled
    place, others = found
    parameter = settled.term.inner[place]
    best = likeliest(parameter, [parameter.value, *others])
    return settled if best == parameter.value else settle_at(space, scanner, settled, place, best)


def other_periods(functions: Functions, term: Term, is_used: np.ndarray) -> tuple[int, list[float]] | None:
    """Give the place of a wave's period, and other values that are the same at the rows that are used, if any."""
    formulas = Formulas(functions, term)
    inner = [one.value for one in term.inner]
    wave = wave_along(formulas, term, inner)
    if wave is None:
        return None
    place, values = wave
    parameter = term.inner[place]
    assert parameter.low is not None
    assert parameter.high is not None
    others = alike_periods(values[is_used], parameter.value, parameter.low, parameter.high)
    return (place, others) if others else None
