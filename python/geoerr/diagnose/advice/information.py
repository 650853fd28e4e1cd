"""Sums of squares and products of a model's and its candidates' columns: of the data once, of a plan added.

| symbol | code | what |
|---|---|---|
| Z | `model` | columns of what the model is free to do: coefficients, then frames and other unknowns of these rows |
| W | `candidates` | columns of all trials of all candidates |
| Q, V^(-T/2) Q | `Space` | orthonormal whitened columns that span the model's, and their products with raw columns |

The products of Z are those of C = Qᵀ V^(-1/2) Z, because Q spans V^(-1/2) Z: CᵀC and Cᵀ(Qᵀ V^(-1/2) W). Unknowns of
the data's own rows (their frames, places of their targets) no plan's row knows: they are eliminated once.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import linalg

from geoerr.diagnose.advice.columns import Poses, Terms
from geoerr.diagnose.advice.planned import Planned, PlannedNoise
from geoerr.diagnose.space import Space
from geoerr.fit.sightings import Numbers

# Directions of unit columns below this share are held by nothing: the ridge keeps them from mattering.
_RIDGE, _ROUND_OFF = 1e-10, 1e-6


@dataclass(frozen=True, eq=False)
class Information:
    """Products of the model's coefficients and the candidates' columns, everything else eliminated.

    Attributes
    ----------
    model : (m, m), across : (m, k), candidates : (k, k)
        ZᵀV⁻¹Z, ZᵀV⁻¹W, WᵀV⁻¹W.
    size : (m,)
        Diagonal of ZᵀV⁻¹Z before anything was eliminated: what round-off is measured by.
    n_numbers
        How many measured numbers they are sums over.
    """

    model: Numbers
    across: Numbers
    candidates: Numbers
    size: Numbers
    n_numbers: float

    def plus(self, other: Information, times: float = 1.0) -> Information:
        """Add another measurement's, carried out so many times."""
        return Information(
            self.model + times * other.model,
            self.across + times * other.across,
            self.candidates + times * other.candidates,
            self.size + times * other.size,
            self.n_numbers + times * other.n_numbers,
        )

    def beyond_model(self) -> Numbers:
        """Give what the candidates' columns are with the model fitted anew, (k, k)."""
        return eliminated(self.model, self.across, self.candidates, self.size)


def eliminated(inside: Numbers, across: Numbers, outside: Numbers, size: Numbers) -> Numbers:
    """Give C − Bᵀ A⁺ B; of A what is left of columns of squared length `size`."""
    if not len(inside):
        return outside
    scale = np.where(size > 0.0, 1.0 / np.sqrt(np.where(size > 0.0, size, 1.0)), 0.0)
    unit = inside * scale[:, None] * scale
    unit[np.diag_indices_from(unit)] += _RIDGE + (size <= 0.0)
    factor, failed = linalg.lapack.dpotrf(unit, lower=1)
    if failed:
        # Round-off of what was eliminated before exceeds the ridge: directions of that size say nothing either.
        unit[np.diag_indices_from(unit)] += _ROUND_OFF
        factor = linalg.cholesky(unit, lower=True, check_finite=False)
    half = linalg.solve_triangular(factor, across * scale[:, None], lower=True, check_finite=False)
    return np.asarray(outside - half.T @ half)


@dataclass(frozen=True, eq=False)
class Measured:
    """The data's own information, and the scores of the candidates' columns beyond the model, (k,)."""

    information: Information
    score: Numbers


def measured(
    space: Space, model: Terms, candidates: Terms, poses: Poses, prior: Numbers | None, *, threads: int = 1
) -> Measured:
    """Sum over the data once.

    The space's columns may span more than the model's: the candidates themselves, where the noise was estimated with
    one of them in it.
    """
    fitted = space.fitted
    used = space.rows.max(axis=1)
    z = model.columns(fitted.sightings, poses, scale=used, shared=fitted.shared, threads=threads)
    w = candidates.columns(fitted.sightings, poses, scale=used, threads=threads)[:, :, : candidates.n_columns]
    w = np.ascontiguousarray(w * space.rows[:, :, None])
    back = space.basis_back.reshape(-1, space.basis.shape[2])
    basis = space.basis.reshape(len(back), -1)
    c = back.T @ z.reshape(len(back), -1)
    whitened = space.noise.whiten(w).reshape(len(back), -1)
    d = basis.T @ whitened
    m = model.n_columns
    products = c.T @ c
    if prior is not None:
        products += prior.T @ prior
    cross = c.T @ d
    # What is left of the data off Q is winsorised; what lies in Q is as it was measured.
    inside = back.T @ (fitted.solved.whitened * space.rows).reshape(-1)
    pull = c.T @ inside
    score = whitened.T @ space.residual.reshape(-1) + d.T @ inside
    k = candidates.n_columns
    outside = np.zeros((m + k + 1, m + k + 1))
    outside[:m, :m], outside[:m, m : m + k] = products[:m, :m], cross[:m]
    outside[m : m + k, m : m + k] = whitened.T @ whitened
    outside[:m, -1], outside[m : m + k, -1] = pull[:m], score
    outside = np.triu(outside) + np.triu(outside, 1).T
    across = np.hstack([products[m:, :m], cross[m:], pull[m:, None]])
    size = np.diag(products)
    reduced = eliminated(products[m:, m:], across, outside, size[m:])
    left = eliminated(reduced[:m, :m], reduced[:m, m:], reduced[m:, m:], size[:m])
    return Measured(_split(reduced[:-1, :-1], size[:m], space.n_numbers), left[:-1, -1])


def _columns_of(terms: Terms, rows: Planned) -> Numbers:
    return terms.columns(rows.sightings, rows.poses, clock_from_s=rows.clock_from_s, as_in_session=rows.as_in_session)


def expected(model: Terms, candidates: Terms, rows: Planned, noise: PlannedNoise) -> Information:
    """Sum over the rows of a plan; its frames and its targets' places eliminated."""
    m = model.n_columns
    z = _columns_of(model, rows)
    w = _columns_of(candidates, rows)[:, :, : candidates.n_columns]
    own = rows.sightings.whitening @ rows.own
    joined = np.concatenate([z[:, :, :m], w, z[:, :, m:], own], axis=2)
    products = noise.product(joined, joined)
    n = m + candidates.n_columns
    size = np.diag(products)
    reduced = eliminated(products[n:, n:], products[n:, :n], products[:n, :n], size[n:])
    return _split(reduced, size[:m], float(rows.sightings.is_measured.sum()))


def _split(products: Numbers, size: Numbers, n_numbers: float) -> Information:
    m = len(size)
    return Information(products[:m, :m], products[:m, m:], products[m:, m:], size, n_numbers)
