"""Held-out error with more columns in the model: exact for the linear part, and without a refit.

Whole passes are left out by turns as for any fit (`geoerr.fit.held_out`); inner parameters take part by their
derivatives. Rows that the fit as it was could not predict stay out of the figure, so that before and after are of the
same rows.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from geoerr.diagnose.space import orthonormal, unseen_residual
from geoerr.fit.figures import figures_of
from geoerr.fit.fitted import Fitted
from geoerr.fit.held_out import LEAST_FOLDS, folds_of
from geoerr.fit.sightings import Numbers


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
        before = self.fitted.held_out
        if before.figures is None:
            return None
        fitted, sightings = self.fitted, self.fitted.sightings
        basis = self.base.reshape(-1, self.base.shape[2])
        if added:
            more = np.concatenate(added, axis=2).reshape(len(basis), -1)
            more = more - basis @ (basis.T @ more)
            basis = np.concatenate([basis, orthonormal(more - basis @ (basis.T @ more))], axis=1)
        flat = (fitted.solved.whitened * self.rows).reshape(-1)
        flat = flat - basis @ (basis.T @ flat)
        fold = folds_of(sightings)
        if len(np.unique(fold)) < LEAST_FOLDS:
            return None
        unseen = unseen_residual(
            basis.reshape(*self.rows.shape, -1), flat.reshape(self.rows.shape), fold, int(fold.max()) + 1
        )
        mm = np.einsum("nij,nj->ni", np.linalg.pinv(sightings.whitening), unseen)
        base = fitted.problem.in_base_axes(fitted.solved.state, np.ascontiguousarray(mm))
        computable = np.isfinite(before.residual_mm).all(axis=1) & fitted.solved.used
        return figures_of(sightings, base, computable).headline_um
