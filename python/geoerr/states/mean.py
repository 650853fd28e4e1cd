r"""The mean of what states say of common parameters, where each state may leave other directions open.

State s tells parameters θ but for moves along its free directions N_s, and nothing of what the gauge C θ = 0 holds.
With L_s an orthonormal basis of the rest, y_s = L_sᵀ θ_s is what it does tell, of covariance L_sᵀ V_s L_s, and

    A = Σ_s L_s (L_sᵀ V_s L_s)⁻¹ L_sᵀ,      A θ = Σ_s L_s (L_sᵀ V_s L_s)⁻¹ y_s

gives the mean along all that some state determines. What no state determines is open in the mean: an error that one
state knows nothing of keeps what the others say of it.

Source: weighted least squares. Verified: tests/states/test_mean.py.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from geoerr.fit import Fitted
from geoerr.fit.aliases import Determined
from geoerr.fit.classic import gauge_rows
from geoerr.fit.sightings import Numbers
from geoerr.states.functions import Estimate
from geoerr.terms import Term

# Singular values and variances below this share of the largest are round-off.
_RANK = 1e-12
# A direction that is open in all states is orthogonal to all that they tell, but for rounding.
_OPEN = 1e-8
# Parameters are compared in units of their uncertainty; what the gauge holds has next to none, and no unit smaller
# than this share of the largest of its kind.
_SMALLEST_UNIT = 1e-3
# What a coefficient of 1 moves at a machine's usual lever, mm: directions of mm and rad are of one size so.
_MM_PER = {"mm": 1.0, "rad": 200.0}


def mean_of(fits: Sequence[Fitted], estimates: Sequence[Estimate]) -> Determined:
    """Give the mean of the states' estimates, weighed by their covariances, and what none of them determines.

    Parameters
    ----------
    fits
        Of the states, all with the same terms.
    estimates
        Of the same.
    """
    terms = fits[0].terms
    held = gauge_rows(terms).T
    open_in_all = _open_in_all(terms, held, [fitted.null_space for fitted in fits])
    scale = _units(terms, estimates)
    known = _beside(_orthonormal(np.hstack([held * scale[:, None], open_in_all / scale[:, None]])))
    weight, pull = np.zeros((known.shape[1],) * 2), np.zeros(known.shape[1])
    for fitted, estimate in zip(fits, estimates, strict=True):
        seen = known @ _beside(_within(known, fitted.null_space / scale[:, None]))
        inward = seen.T / scale
        value, vector = np.linalg.eigh(inward @ estimate.covariance @ inward.T)
        kept = value > _RANK * value.max(initial=0.0)
        along = known.T @ (seen @ vector[:, kept])
        weight += (along / value[kept]) @ along.T
        pull += (along / value[kept]) @ (vector[:, kept].T @ (inward @ estimate.parameters))
    covariance = np.linalg.inv(weight)
    out = scale[:, None] * known
    return Determined(out @ (covariance @ pull), out @ covariance @ out.T, open_in_all)


def _open_in_all(terms: Sequence[Term], held: Numbers, null_spaces: Sequence[Numbers]) -> Numbers:
    """Give the directions (m, k) that every state leaves open, each with largest entry 1."""
    size = np.array([_MM_PER[one.unit] for term in terms for one in term.coefficients])
    free = _beside(_orthonormal(held / size[:, None]))
    told = np.zeros((free.shape[1],) * 2)
    for null_space in null_spaces:
        seen = _beside(_within(free, null_space * size[:, None]))
        told += seen @ seen.T
    value, vector = np.linalg.eigh(told)
    directions = (free @ vector[:, value <= _OPEN]) / size[:, None]
    return np.asarray(directions / np.abs(directions).max(axis=0, initial=1e-300))


def _units(terms: Sequence[Term], estimates: Sequence[Estimate]) -> Numbers:
    """Give a unit for each parameter (m,): the largest uncertainty that it has in some state."""
    std = np.sqrt(np.max([np.maximum(np.diag(one.covariance), 0.0) for one in estimates], axis=0))
    kinds = np.array([one.unit for term in terms for one in term.coefficients])
    for kind in set(kinds):
        largest = std[kinds == kind].max()
        std[kinds == kind] = np.maximum(std[kinds == kind], _SMALLEST_UNIT * largest if largest > 0.0 else 1.0)
    return np.asarray(std)


def _orthonormal(columns: Numbers) -> Numbers:
    """Give an orthonormal basis (n, r) of what columns (n, k) span, each of them compared by its own length."""
    length = np.linalg.norm(columns, axis=0)
    columns = columns[:, length > 0.0] / length[length > 0.0]
    left, size, _ = np.linalg.svd(columns, full_matrices=False)
    return np.asarray(left[:, size > _RANK * size.max(initial=0.0)])


def _within(basis: Numbers, columns: Numbers) -> Numbers:
    """Give an orthonormal basis (r, k) of what columns (n, d) span in an orthonormal basis (n, r).

    Of columns orthogonal to the basis rounding is left, which has a direction, too.
    """
    left, size, _ = np.linalg.svd(basis.T @ _orthonormal(columns), full_matrices=False)
    return np.asarray(left[:, size > _OPEN])


def _beside(directions: Numbers) -> Numbers:
    """Give an orthonormal basis (n, n - r) of all that is orthogonal to orthonormal columns (n, r)."""
    n, r = directions.shape
    return np.asarray(np.linalg.svd(directions, full_matrices=True)[0][:, r:]) if r else np.eye(n)
