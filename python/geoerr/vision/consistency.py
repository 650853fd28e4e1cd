"""Whether what the pictures say about themselves agrees with what is claimed of them.

Sixteen pixel numbers of a plate have seven more than a parallelogram needs. Pooled over a session these tell whether
the corners scatter as their covariances say, and whether the cameras still stand as they did at calibration.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from geoerr.distributions import chi_squared_isf
from geoerr.vision.rig import Rig
from geoerr.vision.sensitivity import sensitivity_of_points

Array = npt.NDArray[np.float64]

_ROUNDS = 20
# So improbable that a plate of a whole session scatters so much, it does not by chance.
_NO_CHANCE = 1e-6
# By how much a marker's fit places a corner wrong in all pictures alike: the bound in the notes of `fit_marker`.
_SHARED_CORNER_STD_PX = 0.005


@dataclass(frozen=True)
class Agreement:
    """What the redundant pixel numbers of a session say.

    Attributes
    ----------
    birge_ratio
        Root mean square residual over what the covariances promise, after the part that an error of
        calibration explains: 1 where the covariances are right, above where something is not modelled.
    rig_shift_sigmas
        Root mean square of the change of the rig that the residuals ask for, in its own standard
        uncertainties; above 2 or 3 the cameras have moved since calibration. None without a covariance.
    n_residuals
        How many went in.
    """

    birge_ratio: float
    rig_shift_sigmas: float | None
    n_residuals: int


def stand_out(chi: Array, n_residuals: int) -> npt.NDArray[np.bool_]:
    """Tell which plates contradict themselves far more than the others do, (n,).

    Their own scatter is theirs: a shadow's edge, a finger, a reflection. In the scatter of all it would be small.

    Parameters
    ----------
    chi : (n,)
        Root mean square of the residuals of each plate, whitened.
    n_residuals
        Of how many.
    """
    usual = max(float(np.median(chi)), 1.0) if len(chi) else 1.0
    limit = float(chi_squared_isf(_NO_CHANCE / max(len(chi), 1), n_residuals))
    return np.asarray(n_residuals * (chi / usual) ** 2 > limit)


def agreement(whitened: Array, by_rig: Array, rig: Rig) -> Agreement:
    """Pool the residuals of many plates.

    Parameters
    ----------
    whitened
        (n, 7) residuals with unit variance if the covariances are right.
    by_rig
        (n, 7, p) their derivatives by the rig's parameters.
    rig
        With its covariance, the prior of its error.

    Notes
    -----
    `r = −G L z + s ε` with `Σ_rig = L Lᵀ`, z and ε standard normal: z by least squares with its prior, s² from what
    is left over the degrees of freedom that z has not used, by turns until both stay.
    """
    residual = whitened.ravel()
    n = len(residual)
    if n == 0:
        return Agreement(1.0, None, 0)
    if rig.covariance is None:
        return Agreement(math.sqrt(float(residual @ residual) / n), None, n)
    values, vectors = np.linalg.eigh(_scaled(rig.covariance))
    root = np.sqrt(np.diag(rig.covariance))[:, None] * vectors * np.sqrt(np.clip(values, 0.0, None))
    design = by_rig.reshape(n, -1) @ root
    gram, right = design.T @ design, design.T @ residual
    variance, z = 1.0, np.zeros(len(right))
    for _ in range(_ROUNDS):
        information = np.eye(len(right)) + gram / variance
        z = np.linalg.solve(information, right / variance)
        used = float(np.trace(np.linalg.solve(information, gram / variance)))
        left_over = residual - design @ z
        variance = max(float(left_over @ left_over) / max(n - used, 1.0), 1e-12)
    # Directions that the residuals do not see stay at 0 by the prior: only those seen are judged.
    seen = max(float(np.trace(np.linalg.solve(information, gram / variance))), 1e-9)
    return Agreement(math.sqrt(variance), math.sqrt(float(z @ z) / seen), n)


def _scaled(covariance: Array) -> Array:
    """Correlation matrix; a parameter that is known exactly stays apart."""
    deviations = np.sqrt(np.diag(covariance))
    safe = np.where(deviations > 0.0, deviations, 1.0)
    result: Array = covariance / np.outer(safe, safe)
    return result


@dataclass(frozen=True)
class MeasuredSize:
    """A target's side as measured, against the size that the session gives.

    Attributes
    ----------
    target
        Name.
    given_mm, measured_mm
        Side of the marker.
    std_mm
        Standard uncertainty of the measured mean: scatter, at least what the pictures' noise makes of it; what the
        fit of a marker is wrong by in all pictures alike; and, where it is known, calibration.
    n
        Observations.
    """

    target: str
    given_mm: float
    measured_mm: float
    std_mm: float
    n: int

    @property
    def relative_error(self) -> float:
        """Measured over given, minus 1."""
        return self.measured_mm / self.given_mm - 1.0

    @property
    def sigmas(self) -> float:
        """Deviation in standard uncertainties."""
        return (self.measured_mm - self.given_mm) / self.std_mm


def measured_size(
    target: str,
    given_mm: float,
    sides_mm: Array,
    side_std_mm: Array,
    sides_px: Array,
    centres_mm: Array,
    directions: Array,
    rig: Rig,
) -> MeasuredSize:
    """Pool the measured sides of one target.

    Parameters
    ----------
    target, given_mm
        Name and stated side.
    sides_mm
        (n, 2)
    side_std_mm
        (n,) of the mean of both sides, from the pictures' noise.
    sides_px
        (n,) the side in the pictures.
    centres_mm, directions
        (m, 3) places of a few of its plates and unit vectors along one of their sides, where the rig's part is taken.
    rig
        With its covariance, or without: then that part is not in `std_mm`.

    Notes
    -----
    Scatter and noise are divided by n. What the fit is wrong by is not, for frames share it: each end of a side by
    0.005 px (`fit_marker`), which is `side_mm · 0.005 px · √2 / side_px` of a side, whichever picture shows it.
    """
    means = sides_mm.mean(axis=1)
    # The median: one plate at which something was taken for a corner must not shift the size.
    measured = float(np.median(means))
    # A few plates scatter by chance less than their noise, and a single one not at all.
    spread = max(1.4826 * float(np.median(np.abs(means - measured))), float(np.median(side_std_mm)))
    # The median of one or two is their mean.
    variance = (math.pi / 2.0 if len(means) > 2 else 1.0) * spread**2 / len(means)
    variance += 2.0 * (measured * _SHARED_CORNER_STD_PX / float(np.median(sides_px))) ** 2
    if rig.covariance is not None and len(centres_mm):
        half = 0.5 * measured * directions
        ends = sensitivity_of_points(rig, centres_mm + half) - sensitivity_of_points(rig, centres_mm - half)
        by_rig = np.einsum("nc,ncp->p", directions, ends) / len(centres_mm)
        variance += float(by_rig @ rig.covariance @ by_rig)
    return MeasuredSize(target, given_mm, measured, math.sqrt(variance), len(means))
