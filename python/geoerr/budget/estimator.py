"""How errors of what was measured become errors of the fitted parameters.

The joint least squares minimizes `|W (y − A x)|² + |h|²`: y the measured points, W their whitening (outliers 0), x
all unknowns (parameters θ of the model, frames, places of targets, and h, the calibration's error in unit variances,
that is held at 0 ± 1), with `C x = 0` by convention. With K the covariance of x under that convention,

    x̂ = K Aᵀ Wᵀ W y,      so that an error e of the points moves the parameters by  K_θ Aᵀ Wᵀ W e.

Two kinds of errors matter, and they are independent:

- **Noise of the points**, e with covariance (Wᵀ W)⁻¹: `Var θ̂ = K_θ (Aᵀ Wᵀ W A) K_θᵀ`.
- **The calibration**, one error Δ of the rig's parameters for all points, e = S Δ with S the points' derivatives and
  Δ ~ Σ: `Var θ̂ = T Σ Tᵀ` with `T = K_θ Aᵀ Wᵀ W S`. This holds whether the fit was told of the calibration or not.

Where it was told (h fitted along), `K⁻¹ = Aᵀ Wᵀ W A + P` on the determined directions, P the unit matrix on h and 0
elsewhere. Hence `K_θ Aᵀ Wᵀ W A K_θᵀ = K_θθ − K_θh K_θhᵀ` and, since the columns A_h are S F with Σ = F Fᵀ and
`(K Aᵀ Wᵀ W A)_θh = −K_θh`, `T Σ Tᵀ = K_θh K_θhᵀ`: the two parts add up to the fit's covariance. This is the law of
total variance: what is uncertain at a given calibration, and what the calibration adds. Functions that a prior holds
smooth have rows D in P too: `K_θ Dᵀ D K_θᵀ` is a third part, what a curvature unknown but for its size leaves.

Verified in tests/budget: both identities, and both parts by Monte-Carlo with exact refits.
"""

from __future__ import annotations

import numpy as np

from geoerr.budget.columns import owners_of
from geoerr.fit import Fitted
from geoerr.model.arrays import Numbers, contiguous

# Directions of a covariance below this share of the largest are round-off of its making.
_ROUNDING = 1e-13
# Places are all lengths: directions that are this much more certain than the worst are those that are free together.
_PLACES = 1e-7
_BLOCK_ROWS = 2048


class Estimator:
    """The linear map from errors of measured points to errors of the parameters (m,) in the record's order."""

    def __init__(self, fitted: Fitted) -> None:
        self.fitted = fitted
        self.places = fitted.places_of_unknowns
        self.n_parameters = len(owners_of(fitted.terms))
        # Rows along which free directions stay smallest: what the data say is the same for both factors.
        self.covariance = fitted.root_of_all @ np.asarray(fitted.solved.solution.covariance_root).T
        self.gain = self.covariance[: len(self.places)]
        self.state = fitted.state_of_columns
        self.is_linear = len(self.places) == fitted.compiled.n_coefficients
        self.row_scale = fitted.solved.used.astype(np.float64)
        self.prior = np.zeros((0, len(self.covariance))) if fitted.prior is None else fitted.prior
        self.is_calibration = self.prior[:, fitted.problem.first_shared_column :].any(axis=1)

    def of_displacements(self, displacement_mm: Numbers) -> Numbers:
        """Give what displacements (n, 3, k) of the measured points do to the parameters, (m, k)."""
        fitted = self.fitted
        gradients = [
            fitted.problem.gradient(self.state, contiguous(one), self.row_scale, fitted.threads)
            for one in np.moveaxis(displacement_mm, 2, 0)
        ]
        return self._in_record(self.gain @ np.array(gradients).reshape(len(gradients), -1).T)

    def of_noise(self) -> tuple[Numbers, Numbers]:
        """Give two roots (m, k) of the parameters' covariance by the points' own, stated covariances.

        Returns
        -------
        apart, with_places
            The two covariances add up. The second is what goes together with the places of targets that the fit has
            to find (`C_θp C_pp⁺ C_pθ`), the first what would be left if those places were known.
        """
        fitted = self.fitted
        n_rows, n_own = len(fitted.sightings), len(self.places)
        first_place = fitted.problem.first_shared_column + int(self.is_calibration.sum())
        gain = np.concatenate([self.gain, self.covariance[first_place:]])
        triangle: Numbers = np.zeros((0, len(gain)))
        for first in range(0, n_rows, _BLOCK_ROWS):
            last = min(first + _BLOCK_ROWS, n_rows)
            design = fitted.problem.design(self.state, self.row_scale, first, last, fitted.threads)
            triangle = np.linalg.qr(np.concatenate([triangle, design @ gain.T])).R
        own, places = triangle[:, :n_own].T, triangle[:, n_own:]
        left, size, _ = np.linalg.svd(places, full_matrices=False)
        along = left[:, size > _PLACES * float(size.max(initial=0.0))]
        with_places = own @ along
        return self._in_record(own - with_places @ along.T), self._in_record(with_places)

    def of_calibration(self) -> Numbers:
        """Give a root (m, k) of the parameters' covariance by the calibration, as the fit was told of it."""
        return self._in_record(self.gain @ self.prior[self.is_calibration].T)

    def of_smoothness(self) -> Numbers:
        """Give a root (m, k) of the parameters' covariance by what is known of curvatures only, (m, 0) without."""
        return self._in_record(self.gain @ self.prior[~self.is_calibration].T)

    def _in_record(self, rows: Numbers) -> Numbers:
        result = np.zeros((self.n_parameters, rows.shape[1]))
        result[self.places] = rows
        return result


def root_of(covariance: Numbers) -> Numbers:
    """Give R (m, k) with R Rᵀ = the covariance; units may differ by any powers of ten."""
    std = np.sqrt(np.maximum(np.diagonal(covariance), 0.0))
    unit = np.where(std > 0.0, std, 1.0)
    value, vector = np.linalg.eigh(covariance / unit[:, None] / unit[None, :])
    keep = value > _ROUNDING * max(float(value.max(initial=0.0)), 1e-300)
    return np.asarray(unit[:, None] * vector[:, keep] * np.sqrt(value[keep]))
