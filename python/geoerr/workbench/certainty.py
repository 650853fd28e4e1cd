"""How sure an own effect is: whether chance does as much, and which other periods do."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from geoerr.diagnose.words import alike_words
from geoerr.distributions import f_sf
from geoerr.fit import Fitted
from geoerr.fit.from_nothing import chance_of_nothing
from geoerr.fit.held_out import folds_of
from geoerr.fit.inner import n_trials, other_periods
from geoerr.terms import Parameter, Term

# Other periods are looked for up to so much longer than the one that was found, whatever the range, and down to so
# much shorter where the range begins at 0.
_TIMES = 8.0
# Of an effect that one pass shows.
_LEAST_DOF = 0.5


def chance_of(before: Fitted, after: Fitted, terms: Sequence[Term]) -> float:
    """Give the probability that nothing looks as large as these terms, by the fits without and with them.

    A number that was searched for finds more by chance: each value that the search tells apart had one of its own
    (Bonferroni).
    """
    nothing = chance_of_nothing(after)
    by_passes = _chance_by_passes(before, after, sum(len(term.coefficients) for term in terms))
    chances = [max(nothing[one.id], by_passes) * n_trials(after, one) for one in terms if one.id in nothing]
    return min(1.0, len(terms) * min(chances, default=1.0))


def _chance_by_passes(before: Fitted, after: Fitted, n_coefficients: int) -> float:
    """Give the same where what is left hangs together within a pass, as anything does that the model still lacks.

    With m what the effect explains and r what is left behind it, |m|² has the variance Σ (m·r)², a product a pass
    (Liang & Zeger 1986). Passes in which m is small tell nothing of it: as many count as would share it evenly.
    """
    sightings, used = after.sightings, after.solved.used
    group = sightings.pass_number if sightings.n_passes > 1 else folds_of(sightings)
    left = after.solved.whitened * used[:, None]
    explained = before.solved.whitened * used[:, None] - left
    squares = np.bincount(group, (explained**2).sum(axis=1))
    variance = float((np.bincount(group, (explained * left).sum(axis=1)) ** 2).sum())
    size = float(squares.sum())
    if not size > 0.0:
        return 1.0
    dof = max(size**2 / float((squares**2).sum()) - 1.0, _LEAST_DOF)
    ratio = size**2 / variance if variance > 0.0 else math.inf
    return float(f_sf(ratio / n_coefficients, n_coefficients, dof))


def other_period_words(fitted: Fitted, terms: Sequence[Term]) -> tuple[str, ...]:
    """Say which other periods look the same at these places, of each period that was searched for."""
    return tuple(
        f"{name} may as well be {alike_words(values, '')}"
        for term in terms
        for name, values in other_periods(fitted, replace(term, inner=tuple(map(_as_period, term.inner)))).items()
    )


def _as_period(parameter: Parameter) -> Parameter:
    """Give a number that was searched for as the periods of the catalogue are: above 0, in a range of ratios."""
    low, high, value = parameter.low, parameter.high, parameter.value
    if low is None or high is None or parameter.is_fixed or not (math.isfinite(value) and value > 0.0):
        return parameter
    return replace(parameter, low=max(low, value / _TIMES), high=max(high, value * _TIMES), spacing="log")
