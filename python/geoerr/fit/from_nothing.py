"""Whether data tell an effect from nothing: all its coefficients at once, held against their covariance."""

from __future__ import annotations

import numpy as np

from geoerr.distributions import f_sf, never_zero
from geoerr.fit.fitted import Fitted
from geoerr.fit.sightings import Numbers
from geoerr.terms import Term

# More probable than this by chance, an effect is told from nothing by no 95 % region.
SIGNIFICANCE = 0.05


def chance_of_nothing(fitted: Fitted) -> dict[str, float]:
    """Give for each effect that is determined the probability that nothing looks as large, by its id.

    Wald's test: with coefficients c (k,) and their covariance C, cᵀ C⁻¹ c / k is F(k, dof) where there is nothing. A
    period or a place that was searched finds more than that by chance: what is not told from nothing here is not told
    at all, and what is may need `geoerr diagnose` to be believed. Its level is held by a Monte-Carlo test.
    """
    unknown = set(fitted.undetermined.names)
    return {
        term.id: _chance(term, fitted.covariance[own, own], fitted.dof)
        for term, own in zip(fitted.terms, fitted.compiled.coefficient_slices, strict=True)
        if term.kind != "classic" and term.id not in unknown and fitted.dof > 0
    }


def _chance(term: Term, covariance: Numbers, dof: float) -> float:
    # In units of the standard errors: those of one effect may differ by many powers of ten.
    std = np.sqrt(np.diagonal(covariance))
    values = np.array([parameter.value for parameter in term.coefficients]) / std
    square = float(values @ np.linalg.pinv(covariance / np.outer(std, std), hermitian=True) @ values)
    return never_zero(float(f_sf(square / len(values), len(values), dof)))
