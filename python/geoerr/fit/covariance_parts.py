"""The covariance of a fit in parts, where rows share something."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geoerr.fit.sightings import Numbers


@dataclass(frozen=True, eq=False)
class SharedNoise:
    """The parts of a fit's covariance, where rows share something.

    Attributes
    ----------
    scatter : (3,)
        What rows scatter by themselves in each component, in units of what they state and not less than that; 0 of
        one that nobody measured.
    grams : (3, r, r)
        Products of the columns of unit covariance with each other, each component's rows.
    gain : (n_parameters, r)
        What these columns are of the parameters.
    root : (n_parameters, k)
        Root of the covariance by what rows share.
    """

    scatter: Numbers
    grams: Numbers
    gain: Numbers
    root: Numbers

    @property
    def mean_scatter(self) -> float:
        """Mean of the scatter of components that were measured, by squares."""
        return float(np.sqrt(np.mean(self.scatter[self.scatter > 0.0] ** 2)))

    def scatter_root(self, *, beyond: float = 0.0) -> Numbers:
        """Give the root (n_parameters, r) of the covariance by scatter, beyond so many stated standard deviations."""
        variance = np.maximum(self.scatter**2 - beyond**2, 0.0)
        return np.asarray(self.gain @ root_of(np.einsum("c,cij->ij", variance, self.grams)))


def root_of(covariance: Numbers) -> Numbers:
    """Give R (r, r) with R Rᵀ = a covariance of numbers of one unit."""
    value, vector = np.linalg.eigh(covariance)
    return np.asarray(vector * np.sqrt(np.maximum(value, 0.0)))
