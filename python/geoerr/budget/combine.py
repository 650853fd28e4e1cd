"""Combined and expanded uncertainty of a component or of a length (GUM 5, G)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from geoerr.distributions import f_isf, student_isf
from geoerr.model.arrays import Numbers

PROBABILITY = 0.95


def effective_dof(variances: Sequence[Numbers], dof: Sequence[float]) -> Numbers:
    """Give ν = (Σ v)² / Σ v²/ν of independent variances, element by element (Welch and Satterthwaite, GUM G.2b)."""
    total = np.sum(variances, axis=0)
    doubt = np.sum([v**2 / d for v, d in zip(variances, dof, strict=True)], axis=0)
    dof_of_sum: Numbers = np.divide(total**2, doubt, out=np.full(np.shape(total), np.inf), where=doubt > 0.0)
    return dof_of_sum


def expanded(std: Numbers, dof: npt.ArrayLike) -> Numbers:
    """Give U = k·u of components, k from Student's t at 95 % (GUM G.3)."""
    return np.asarray(std * student_isf(0.5 * (1.0 - PROBABILITY), dof))


def expanded_length(covariance: Numbers, dof: npt.ArrayLike) -> Numbers:
    """Give the length (n,) that an error with covariance (n, 3, 3) stays below with 95 %.

    |e|² is a sum of three chi-squared variables weighted by the eigenvalues λ; it is taken as tr V · F(h, ν) with
    `h = (Σλ)² / Σλ²` (Satterthwaite), which is exact for one component (t² = F(1, ν)) and for equal ones. At 95 % its
    root is within 1 % of the exact quantile for any three eigenvalues (tests/budget).
    """
    trace = np.trace(covariance, axis1=1, axis2=2)
    squares = np.einsum("nij,nij->n", covariance, covariance)
    h = np.divide(trace**2, squares, out=np.ones_like(trace), where=squares > 0.0)
    finite = np.minimum(dof, 1e9)
    return np.asarray(np.sqrt(trace * f_isf(1.0 - PROBABILITY, h, finite)))
