"""Probabilities of chi-squared, F and Student's t, and ranks.

The functions are SciPy's special ones, on which its `stats` stands too: that module alone takes half a second to
load, as long as all else that a fit needs. Verified in `tests/test_distributions.py` against `scipy.stats`, with NaN
and at the ends.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt
from scipy import special

Numbers: TypeAlias = npt.NDArray[np.float64]
#: The smallest probability that is told: below the smallest normal number a tail is none, and never exactly 0.
LEAST_PROBABILITY = float(np.finfo(np.float64).tiny)


def never_zero(probability: float) -> float:
    """Give a probability, or the smallest that is told where it is none any more: nothing that was seen has none."""
    return max(probability, LEAST_PROBABILITY)


def chi_squared_sf(value: npt.ArrayLike, dof: npt.ArrayLike) -> Numbers:
    """Give the probability of more than a value."""
    return _known(special.chdtrc(dof, np.maximum(value, 0.0)), value, dof)


def chi_squared_log_sf(value: npt.ArrayLike, dof: float) -> Numbers:
    """Give the logarithm of the probability of more than a value; −∞ where that is no number any more."""
    return _log_sf(
        value, special.chdtri(dof, 0.5), lambda one: chi_squared_sf(one, dof), lambda one: special.chdtr(dof, one)
    )


def chi_squared_isf(probability: npt.ArrayLike, dof: npt.ArrayLike) -> Numbers:
    """Give the value that is exceeded with a probability."""
    return _known(special.chdtri(dof, probability), probability, dof)


def chi_squared_ppf(probability: npt.ArrayLike, dof: npt.ArrayLike) -> Numbers:
    """Give the value that is not reached with a probability."""
    return _known(2.0 * special.gammaincinv(0.5 * np.asarray(dof), probability), probability, dof)


def f_sf(value: npt.ArrayLike, dof: npt.ArrayLike, other_dof: npt.ArrayLike) -> Numbers:
    """Give the probability of more than a value."""
    return _known(special.fdtrc(dof, other_dof, np.maximum(value, 0.0)), value, dof, other_dof)


def f_log_sf(value: npt.ArrayLike, dof: float, other_dof: float) -> Numbers:
    """Give the logarithm of the probability of more than a value; −∞ where that is no number any more."""
    return _log_sf(
        value,
        special.fdtri(dof, other_dof, 0.5),
        lambda one: f_sf(one, dof, other_dof),
        lambda one: special.fdtr(dof, other_dof, one),
    )


def f_isf(probability: npt.ArrayLike, dof: npt.ArrayLike, other_dof: npt.ArrayLike) -> Numbers:
    """Give the value that is exceeded with a probability."""
    return _known(special.fdtri(dof, other_dof, 1.0 - np.asarray(probability)), probability, dof, other_dof)


def student_isf(probability: npt.ArrayLike, dof: npt.ArrayLike) -> Numbers:
    """Give the value that is exceeded with a probability between 0 and 1."""
    return _known(-special.stdtrit(dof, probability), probability, dof)


def ranks_of(values: npt.ArrayLike) -> Numbers:
    """Give the ranks of numbers (n,), from 1 on; of equal ones their mean."""
    _, place, count = np.unique(values, return_inverse=True, return_counts=True)
    return (np.cumsum(count) - 0.5 * (count - 1))[place]


def _log_sf(
    value: npt.ArrayLike, median: float, sf: Callable[[Any], Numbers], cdf: Callable[[Any], Numbers]
) -> Numbers:
    """Give the logarithm of a tail by that of the smaller of both sides."""
    with np.errstate(divide="ignore"):
        beyond = np.log(sf(value))
    return np.where(np.asarray(value) > median, beyond, np.log1p(-cdf(np.minimum(value, median))))


def _known(values: Any, argument: npt.ArrayLike, *dofs: npt.ArrayLike) -> Numbers:
    """Leave NaN where an argument is, and where there is no degree of freedom: SciPy has numbers for some of them."""
    is_known = ~np.isnan(argument)
    for dof in dofs:
        is_known = is_known & (np.asarray(dof) > 0.0)
    return np.where(is_known, values, np.nan)
