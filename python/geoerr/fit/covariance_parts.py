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
        What rows scatter by themselves in each component, in units of what they state; not less than that.
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
        """Mean of the components' scatter, by squares."""
        return float(np.sqrt(np.mean(self.scatter**2)))

    def scatter_root(self, *, beyond: float = 0.0) -> Numbers:
        """Give the root (n_parameters, r) of the covariance by scatter, beyond so many stated standard deviations."""
        variance = np.maximum(self.scatter**2 - beyond**2, 0.0)
        value, vector = np.linalg.eigh(np.einsum("c,cij->ij", variance, self.grams))
        return np.asarray(self.gain @ (vector * np.sqrt(np.maximum(value, 0.0))))
