"""How uncertain a given model is where it is held against other data.

Its coefficients have a covariance C = F Fᵀ from the data that they were fitted to. With G = (I − H) W J F, J the
derivative of the measured points by the parameters, W the whitening and H the projection on the unknowns that are
fitted here (frames, places of targets), the residual of a right model has the covariance σ²(I − H) + G Gᵀ. So

    r' (σ² + G G')⁻¹ r · σ² = r'r − r'G (σ² + G'G)⁻¹ G'r     (Woodbury)

is what lies beyond both the noise and the model's own doubt.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from geoerr.fit import Fitted
from geoerr.fit.given import with_terms
from geoerr.fit.lengths import of_the_headline, of_whole_lengths
from geoerr.fit.sightings import Numbers
from geoerr.model import Model
from geoerr.model.sessions import since_last_session

_BLOCK_ROWS = 2048
_UM_PER_MM = 1e3


@dataclass(frozen=True, eq=False)
class OwnUncertainty:
    """What the model's covariance does to the residuals of these data.

    Attributes
    ----------
    gram : (k, k)
        GᵀG.
    moment : (k,)
        Gᵀr.
    variance_um2
        Mean trace of the covariance of the prediction, after the frames were fitted.
    """

    gram: Numbers
    moment: Numbers
    variance_um2: float

    def explained(self, sigma2: float) -> float:
        """Give how much of the residual's sum of squares (whitened) the model's uncertainty accounts for."""
        if not len(self.moment):
            return 0.0
        system = self.gram + sigma2 * np.eye(len(self.gram))
        return float(self.moment @ np.linalg.solve(system, self.moment))


def own_uncertainty(model: Model, fitted: Fitted) -> OwnUncertainty | None:
    """Bring the model's covariance to the rows that a fit of the frames alone used; None where it has none."""
    root = _covariance_root(model)
    if root is None:
        return None
    problem = with_terms(model.machine, fitted, since_last_session(model).terms)
    state = problem.start
    row_scale = fitted.solved.used.astype(np.float64)
    whitened = fitted.solved.whitened * row_scale[:, None]
    n_columns = problem.n_columns
    n_model, k = root.shape
    total = np.zeros((k + n_columns - n_model + 1,) * 2)
    for block in _blocks(len(row_scale)):
        design = problem.design(state, row_scale, block.start, block.stop, fitted.threads)
        rows = np.column_stack([design[:, :n_model] @ root, design[:, n_model:], whitened[block].ravel()])
        total += rows.T @ rows
    own, frames = slice(0, k), slice(k, len(total) - 1)
    taken = np.linalg.pinv(total[frames, frames], rcond=1e-12, hermitian=True) @ total[frames, own]
    gram = total[own, own] - total[own, frames] @ taken
    moment = total[own, -1] - taken.T @ total[frames, -1]
    unwhitening, counts = fitted.sightings.unwhitening, of_the_headline(fitted.sightings)
    # A length is off by twice what its end is.
    shares = of_whole_lengths(fitted.sightings, counts.astype(np.float64), size=4.0)
    squares = np.zeros(3)
    for block in _blocks(len(row_scale)):
        design = problem.design(state, row_scale, block.start, block.stop, fitted.threads)
        left = (design[:, :n_model] @ root - design[:, n_model:] @ taken).reshape(-1, 3, k)
        variances = (np.einsum("nij,njk->nik", unwhitening[block], left) ** 2).sum(axis=2)
        squares += (shares[block] * variances).sum(axis=0)
    count = np.maximum(counts[fitted.solved.used].sum(axis=0), 1)
    return OwnUncertainty(gram, moment, float((squares / count).sum()) * _UM_PER_MM**2)


def own_doubt(model: Model, fitted: Fitted, *, counts_choice: bool) -> Numbers | None:
    """Give how far a given model may be off at the rows of a fit of frames alone, (n, 3, k); None where it is sure.

    Whitened by the stated uncertainties; each column one standard deviation, independent of the others: W J F. Also
    at rows that the fit leaves out: a search over circles judges anew which are gross.

    Parameters
    ----------
    counts_choice
        Whether it is as much larger as what the choice of the model may hide. A circle sees few of a model's
        functions, and is told right without (`validation/given_circles.md`).
    """
    root = _covariance_root(model)
    if root is None or model.record is None:
        return None
    if counts_choice:
        root = math.sqrt(_hidden_by_choice(model.record.n_rows)) * root
    problem = with_terms(model.machine, fitted, since_last_session(model).terms)
    row_scale = np.ones(len(fitted.sightings))
    blocks = [
        problem.design(problem.start, row_scale, block.start, block.stop, fitted.threads)[:, : len(root)] @ root
        for block in _blocks(len(row_scale))
    ]
    return np.concatenate(blocks).reshape(len(row_scale), 3, -1)


def _hidden_by_choice(n_rows: int) -> float:
    """Give how much larger the variances of a model's numbers may be than their covariance tells.

    What a model consists of is chosen by evidence: functions and effects that would gain less than their price, the
    logarithm of the number of numbers (Schwarz), are left out. What they did is in the numbers of the others, up to
    so many variances, and in no covariance. Verified by `validation/given_models.py`.
    """
    return max(math.log(max(3 * n_rows, 1)), 1.0)


def _covariance_root(model: Model) -> Numbers | None:
    """Give F (p, k) with the covariance F Fᵀ of a model's coefficients; None where it has none."""
    record = model.record
    if record is None or not record.covariance.any():
        return None
    value, vector = np.linalg.eigh(_unitless(record.covariance))
    scale = np.sqrt(np.diagonal(record.covariance))
    keep = value > 1e-12 * max(float(value.max()), 0.0)
    return np.asarray(scale[:, None] * vector[:, keep] * np.sqrt(value[keep]))


def _unitless(covariance: Numbers) -> Numbers:
    std = np.sqrt(np.diagonal(covariance))
    inverse = np.divide(1.0, std, out=np.zeros_like(std), where=std > 0.0)
    return np.asarray(covariance * inverse[:, None] * inverse[None, :])


def _blocks(n_rows: int) -> list[slice]:
    return [slice(first, min(first + _BLOCK_ROWS, n_rows)) for first in range(0, n_rows, _BLOCK_ROWS)]
