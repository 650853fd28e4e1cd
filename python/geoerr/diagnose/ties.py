"""When measurements do not tell two candidates apart: one rule, for points and for circles.

Two candidates are **tied** where the one could do at least half of what the other explains, and the odds between
them, the price of their freedom paid, in the noise that is left beside each, are less than twenty to one; or less
than e^10 to one while their difference is no more than its own scatter.

Alike alone is not enough: columns may hold half of what another explains, or nine tenths, and leave the rest to be
seen. Only what does nearly all of it with no more freedom is tied however the odds are: there the error of a formula
would decide.
"""

from __future__ import annotations

import math

import numpy as np

from geoerr.fit.sightings import Numbers

# A cosine: alike so far, an error of a formula of a seventh would decide between the two.
TOO_ALIKE = 0.99
# One that could not do half of what the other does is something else.
LEAST_CORRELATION = 0.5
# In twice the logarithm: odds of twenty to one are something (Kass & Raftery 1995), e^10 to one are decided.
LEAST_DIFFERENCE, MOST_DIFFERENCE = 2.0 * math.log(20.0), 20.0
# Standard deviations of the difference that are more than scatter: one in twenty, one-sided.
_SCATTER = 1.64


def is_undecided(difference: float, z: float) -> bool:
    """Tell whether odds leave it open which of two it is.

    Parameters
    ----------
    difference
        Of both in twice the logarithm of the evidence.
    z
        The same difference, no price paid, in units of its own standard deviation.
    """
    return difference < LEAST_DIFFERENCE or (difference < MOST_DIFFERENCE and z < _SCATTER)


def is_as_good(alike: float, difference: float, z: float) -> bool:
    """Tell whether one that is so much alike explains it as well as the other; arguments as for `is_undecided`."""
    return alike > LEAST_CORRELATION and is_undecided(difference, z)


def z_by_pieces(first: Numbers, second: Numbers, piece: np.ndarray, n_pieces: int) -> float:
    """Give Vuong's statistic: the difference of two squared misfits (n,) over its scatter from piece to piece."""
    sums = np.bincount(piece, weights=second - first, minlength=n_pieces)
    scatter = float(np.sqrt(((sums - sums.mean()) ** 2).sum()))
    return float(sums.sum()) / scatter if scatter > 0.0 else 0.0


def z_by_noise(first: Numbers, second: Numbers, residual: Numbers) -> float:
    """Give the same where there are no pieces to compare: white noise of unit variance lets it scatter.

    The fall of the sum of squares by one displacement less that by another is r'(d₁ − d₂) twice but for constants,
    and its standard deviation 2 ‖d₁ − d₂‖.
    """
    scatter = 2.0 * float(np.linalg.norm(first - second))
    difference = float(((residual - second) ** 2).sum() - ((residual - first) ** 2).sum())
    return difference / scatter if scatter > 0.0 else 0.0
