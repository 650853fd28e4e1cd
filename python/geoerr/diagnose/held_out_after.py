"""Held-out error with more columns in the model: exact for the linear part, and without a refit.

Whole passes are left out by turns as for any fit (`geoerr.fit.held_out`); inner parameters take part by their
derivatives. Rows that the fit as it was could not predict stay out of the figure, so that before and after are of the
same rows.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import linalg

from geoerr.diagnose.space import orthonormal, unseen_of_pass
from geoerr.fit.figures import figures_of
from geoerr.fit.fitted import Fitted
from geoerr.fit.held_out import LEAST_FOLDS, folds_of
from geoerr.fit.sightings import Numbers

# What is added may take this share of a direction of a pass before the pass is solved anew.
_LEAST_LEFT = 0.01


@dataclass(frozen=True, eq=False)
class HeldOutAfter:
    """What a fit would be off where it did not see the data, with more in the model.

    Attributes
    ----------
    fitted
        The fit.
    base : (n, 3, r)
        Orthonormal columns of what it is free to do, whitened by the stated uncertainties.
    rows : (n, 3)
        1 where a number counts.
    """

    fitted: Fitted
    base: Numbers
    rows: Numbers

    def um(self, added: Sequence[Numbers]) -> float | None:
        """Give the held-out error with columns (n, 3, k) added, whitened likewise; None where there is none."""
        key = tuple(map(id, added))
        if key not in self._known:
            self._known[key] = (tuple(added), self._um(added))
        return self._known[key][1]

    @cached_property
    def _known(self) -> dict[tuple[int, ...], tuple[tuple[Numbers, ...], float | None]]:
        """By what was added, which is kept: the search asks again for what it has added already."""
        return {}

    def _um(self, added: Sequence[Numbers]) -> float | None:
        before = self.fitted.held_out
        if before.figures is None or len(self._passes) < LEAST_FOLDS:
            return None
        fitted = self.fitted
        basis = self.base.reshape(-1, self.base.shape[2])
        more = np.zeros((len(basis), 0))
        if added:
            more = np.concatenate(added, axis=2).reshape(len(basis), -1)
            more = more - basis @ (basis.T @ more)
            more = orthonormal(more - basis @ (basis.T @ more))
        flat = self._residual - more @ (more.T @ self._residual)
        columns = np.concatenate([flat[:, None], more], axis=1).reshape(*self.rows.shape, -1)
        unseen = np.zeros_like(self.rows)
        for one in self._passes:
            unseen[one.rows] = one.unseen(columns[one.rows].reshape(3 * len(one.rows), -1)).reshape(-1, 3)
        mm = np.einsum("nij,nj->ni", fitted.sightings.unwhitening, unseen)
        base = fitted.problem.in_base_axes(fitted.solved.state, np.ascontiguousarray(mm))
        computable = np.isfinite(before.residual_mm).all(axis=1) & fitted.solved.used
        return figures_of(fitted.sightings, base, computable).headline_um

    @cached_property
    def _residual(self) -> Numbers:
        """What the fit leaves, off its own columns, (3 n,)."""
        basis = self.base.reshape(-1, self.base.shape[2])
        flat = (self.fitted.solved.whitened * self.rows).reshape(-1)
        return np.asarray(flat - basis @ (basis.T @ flat))

    @cached_property
    def _passes(self) -> list[_Pass]:
        fold = folds_of(self.fitted.sightings)
        order = np.argsort(fold, kind="stable")
        starts = np.flatnonzero(np.diff(fold[order], prepend=-1))
        return [
            _Pass(rows, self.base[rows].reshape(3 * len(rows), -1))
            for rows in np.split(order, starts[1:])
            if len(rows)
        ]


@dataclass(frozen=True, eq=False)
class _Pass:
    """A pass that is left out: its rows, and its part Q of the fit's orthonormal columns, (3 m, r)."""

    rows: np.ndarray
    own: Numbers

    @cached_property
    def _factor(self) -> tuple[Numbers, bool] | None:
        """Cholesky factor of I − Q Qᵀ or of I − QᵀQ, whichever is smaller; None where the pass owns a direction."""
        small = self.own @ self.own.T if len(self.own) <= self.own.shape[1] else self.own.T @ self.own
        factor, info = linalg.lapack.dpotrf(np.eye(len(small)) - small, lower=1)
        return (factor, True) if info == 0 and float(np.diag(factor).min()) ** 2 > _LEAST_LEFT else None

    def unseen(self, columns: Numbers) -> Numbers:
        """Give (I − Q Qᵀ − q qᵀ)⁻¹ r for columns (3 m, 1 + k): r, then q, by Woodbury's identity."""
        if self._factor is not None:
            solved = self._solved(self._factor, columns)
            if columns.shape[1] == 1:
                return np.asarray(solved[:, 0])
            inside = np.eye(columns.shape[1] - 1) - columns[:, 1:].T @ solved[:, 1:]
            root, info = linalg.lapack.dpotrf(inside, lower=1)
            if info == 0 and float(np.diag(root).min()) ** 2 > _LEAST_LEFT:
                right = columns[:, 1:].T @ solved[:, 0]
                return np.asarray(
                    solved[:, 0] + solved[:, 1:] @ linalg.cho_solve((root, True), right, check_finite=False)
                )
        return unseen_of_pass(np.concatenate([self.own, columns[:, 1:]], axis=1), columns[:, 0])

    def _solved(self, factor: tuple[Numbers, bool], columns: Numbers) -> Numbers:
        if len(self.own) <= self.own.shape[1]:
            return np.asarray(linalg.cho_solve(factor, columns, check_finite=False))
        return np.asarray(columns + self.own @ linalg.cho_solve(factor, self.own.T @ columns, check_finite=False))
