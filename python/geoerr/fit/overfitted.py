"""Functions that follow what is missing: where passes that were left out are missed by far, fewer are tried.

Evidence knows noise, and not what a model lacks: of few rows for many functions it chooses such as follow a jump or a
drift, and miss by a decimetre what they did not see. What they did not see decides.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from geoerr.bases import spline_over
from geoerr.fit.classic import BENT
from geoerr.fit.fitted import Fitted
from geoerr.fit.knots import KnotChoice
from geoerr.fit.sightings import Numbers
from geoerr.terms import BasisSpec

# A model with fewer numbers than this share of what was measured cannot follow single passes: what it misses need not
# be asked.
_MANY = 0.05
# It has followed them where it misses what it did not see by so many times what a right model would.
_MISSES = 1.5
# Functions of an error that are tried.
_FEWER = (12, 8, BENT)


def with_fewer(
    fitted: Fitted,
    choices: Sequence[KnotChoice],
    places_mm: Mapping[str, Numbers],
    fit: Callable[[Mapping[str, BasisSpec]], Fitted],
) -> tuple[Fitted, tuple[KnotChoice, ...]]:
    """Give the fit, and its choices, with as few functions as predict best; what was given where it does well.

    Parameters
    ----------
    fit
        Fits the model with these bases, by ISO name.
    """
    best, chosen = fitted, tuple(choices)
    n_numbers = int(fitted.sightings.is_measured[fitted.solved.used].sum())
    if fitted.solved.solution.rank < _MANY * n_numbers:
        return best, chosen
    least_um, left_um = _missed_um(fitted), fitted.figures.headline_um
    # With p numbers for n a right model leaves 1 − p/n of what it misses.
    share_left = 1.0 - fitted.solved.solution.rank / n_numbers
    if left_um is None or not _MISSES * left_um < share_left * least_um < math.inf:
        return best, chosen
    tried = chosen
    for most in _FEWER:
        fewer = tuple(_at_most(one, most, places_mm) for one in choices)
        if fewer == tried:
            continue
        tried = fewer
        found = fit({one.name: one.basis for one in fewer})
        missed_um = _missed_um(found)
        if missed_um < least_um:
            best, chosen, least_um = found, fewer, missed_um
    return best, chosen


def _missed_um(fitted: Fitted) -> float:
    figures = fitted.held_out.figures
    held = None if figures is None else figures.headline_um
    return math.inf if held is None or np.isnan(held) else held


def _at_most(choice: KnotChoice, most: int, places_mm: Mapping[str, Numbers]) -> KnotChoice:
    n_functions = choice.basis.n_functions
    if choice.basis.kind != "bspline" or n_functions <= most:
        return choice
    basis = spline_over(choice.basis.axis, places_mm[choice.basis.axis], most)
    return replace(choice, basis=basis, n_free=min(choice.n_free, most))
