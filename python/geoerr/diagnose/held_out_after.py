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

from geoerr.diagnose.space import INSIDE, independent, unseen_of_pass
from geoerr.fit.figures import figures_of
from geoerr.fit.fitted import Fitted
from geoerr.fit.held_out import LEAST_FOLDS, folds_of
from geoerr.fit.lengths import told_in_base_axes
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
            self._known[key] = self._um(added)
        return self._known[key]

    def prepare(self, columns: Sequence[Numbers]) -> None:
        """Work out at once what many columns (n, 3, k) leave; `um` then only puts them together."""
        new = [one for one in {id(one): one for one in columns}.values() if id(one) not in self._left]
        if not new or self.fitted.held_out.figures is None:
            return
        basis = self.base.reshape(-1, self.base.shape[2])
        off = np.concatenate(new, axis=2).reshape(len(basis), -1)
        off = off - basis @ (basis.T @ off)
        solved = self._solved_in_passes(off)
        ends = np.cumsum([one.shape[2] for one in new])[:-1]
        parts = zip(new, np.split(off, ends, axis=1), np.split(solved, ends, axis=1), strict=True)
        for one, own, own_solved in parts:
            self._left[id(one)] = (one, own, own_solved)

    @cached_property
    def _known(self) -> dict[tuple[int, ...], float | None]:
        """By what was added: the search asks again for what it has added already."""
        return {}

    @cached_property
    def _left(self) -> dict[int, tuple[Numbers, Numbers, Numbers]]:
        """By columns, which are kept: what the fit leaves of them, (3 n, k), and that solved in each pass."""
        return {}

    def _um(self, added: Sequence[Numbers]) -> float | None:
        before = self.fitted.held_out
        if before.figures is None or len(self._passes) < LEAST_FOLDS:
            return None
        fitted = self.fitted
        self.prepare(added)
        parts = [self._left[id(one)] for one in added]
        nothing = np.zeros((len(self._residual), 0))
        off = np.concatenate([nothing, *(own for _, own, _ in parts)], axis=1)
        turn = independent(off.T @ off, INSIDE)
        more = off @ turn
        solved = np.concatenate([nothing, *(own for _, _, own in parts)], axis=1) @ turn
        along = more.T @ self._residual
        columns = np.concatenate([(self._residual - more @ along)[:, None], more], axis=1)
        solved = np.concatenate([(self._solved_residual - solved @ along)[:, None], solved], axis=1)
        shape = (*self.rows.shape, -1)
        columns, solved = columns.reshape(shape), solved.reshape(shape)
        unseen = np.zeros_like(self.rows)
        for one in self._passes:
            own, own_solved = (all_[one.rows].reshape(3 * len(one.rows), -1) for all_ in (columns, solved))
            unseen[one.rows] = one.unseen(own, own_solved).reshape(-1, 3)
        mm = np.einsum("nij,nj->ni", fitted.sightings.unwhitening, unseen)
        base = told_in_base_axes(fitted.sightings, fitted.problem, fitted.solved.state, mm)
        computable = np.isfinite(before.residual_mm).all(axis=1) & fitted.solved.used
        return figures_of(fitted.sightings, base, computable).headline_um

    def _solved_in_passes(self, columns: Numbers) -> Numbers:
        """Give (I − Q Qᵀ)⁻¹ times the rows of each pass, of columns (3 n, k); 0 in a pass that owns a direction."""
        shaped = columns.reshape(*self.rows.shape, -1)
        result = np.zeros_like(shaped)
        for one in self._passes:
            result[one.rows] = one.solved(shaped[one.rows].reshape(3 * len(one.rows), -1)).reshape(
                -1, *shaped.shape[1:]
            )
        return result.reshape(columns.shape)

    @cached_property
    def _solved_residual(self) -> Numbers:
        return self._solved_in_passes(self._residual[:, None])[:, 0]

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
            _Pass(rows, _of_rows(self.base, rows).reshape(3 * len(rows), -1))
            for rows in np.split(order, starts[1:])
            if len(rows)
        ]


def _of_rows(values: Numbers, rows: np.ndarray) -> Numbers:
    """Give rows, which ascend: where they stand together no copy, for all passes together it would be the whole."""
    first, last = int(rows[0]), int(rows[-1])
    return values[first : last + 1] if last - first + 1 == len(rows) else values[rows]


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

    def unseen(self, columns: Numbers, solved: Numbers) -> Numbers:
        """Give (I − Q Qᵀ − q qᵀ)⁻¹ r for columns (3 m, 1 + k), r and then q, and those solved (Woodbury)."""
        if self._factor is not None:
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

    def solved(self, columns: Numbers) -> Numbers:
        """Give (I − Q Qᵀ)⁻¹ times columns (3 m, k); 0 where the pass owns a direction."""
        if self._factor is None:
            return np.zeros_like(columns)
        if len(self.own) <= self.own.shape[1]:
            return np.asarray(linalg.cho_solve(self._factor, columns, check_finite=False))
        inside = linalg.cho_solve(self._factor, self.own.T @ columns, check_finite=False)
        return np.asarray(columns + self.own @ inside)
