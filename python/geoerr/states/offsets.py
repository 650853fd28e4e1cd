r"""An offset of each pass: what moved between one pass and the next, the device or the machine, and is no error.

Residuals of one pass have something in common, and a test that takes them for independent alarms on every pair of
states. With A the whitened columns of the fit, r its whitened residual and Z the membership of rows in passes, the
offsets of pass p are normal with covariance D = diag(d_x, d_y, d_z), in units of the scatter s², along the axes of
the measuring frame, and s² and D maximise the restricted likelihood

    −2 log L = ν log s² + log det(1 + D½ G D½) + (r·r − b·D½ (1 + D½ G D½)⁻¹ D½ b) / s²,
    G = Zᵀ(1 − A A⁺)Z,   b = Zᵀ r

Source: Harville, JASA 72 (1977). Verified: tests/states/test_offsets.py, against dense matrices.
"""

from __future__ import annotations

import numpy as np
from scipy import linalg, optimize

from geoerr.fit import Fitted
from geoerr.fit.held_out import projected_rows
from geoerr.fit.sightings import Numbers

# Offsets with less than this share of the noise's variance change no uncertainty that is written down.
_LEAST = 1e-4
_MOST = 1e4


def pass_offset_mm(fitted: Fitted) -> Numbers:
    """Give the standard deviation (3,) of a pass's own offset along x, y, z of the measuring frame, mm.

    In units of the fit's `scale`, as stated uncertainties are; 0 where there is nothing to be seen.
    """
    gram, pull = _sums(fitted)
    whitened = fitted.solved.whitened[fitted.solved.used]
    square, dof = float((whitened**2).sum()), fitted.dof
    information = (fitted.sightings.whitening[fitted.solved.used] ** 2).sum(axis=(0, 1))
    n_numbers = fitted.sightings.is_measured[fitted.solved.used].sum(axis=0)
    is_seen = (n_numbers > 0) & (np.diag(gram).reshape(-1, 3).sum(axis=0) > 0.0)
    if dof <= len(pull) or not is_seen.any():
        return np.zeros(3)
    noise = np.where(is_seen, n_numbers / np.maximum(information, 1e-300), 1.0)
    n_passes = len(pull) // 3

    def unlikelihood(log_ratio: Numbers) -> float:
        root = np.tile(np.sqrt(np.where(is_seen, noise * np.exp(log_ratio), 0.0)), n_passes)
        factor = linalg.cholesky(np.eye(len(root)) + root[:, None] * gram * root, lower=True)
        explained = linalg.solve_triangular(factor, root * pull, lower=True)
        left = max(square - float(explained @ explained), 1e-300)
        return float(dof * np.log(left) + 2.0 * np.log(np.diag(factor)).sum())

    low, high = np.log(_LEAST), np.log(_MOST)
    found = optimize.minimize(unlikelihood, np.full(3, np.log(0.05)), method="L-BFGS-B", bounds=[(low, high)] * 3)
    is_there = is_seen & (found.x > low + 1e-6)
    return np.asarray(np.where(is_there, np.sqrt(noise * np.exp(found.x)), 0.0))


def offset_sensitivity(fitted: Fitted, n_rows: int) -> Numbers:
    """Give how unknowns, one for each pass and axis and known to be 0 ± 1, move the rows of the table: (n, 3, 3p)."""
    sightings = fitted.sightings
    offset_mm = pass_offset_mm(fitted)
    kept = np.flatnonzero(offset_mm > 0.0)
    derivative = np.zeros((n_rows, 3, len(kept), sightings.n_passes))
    for number, axis in enumerate(kept):
        derivative[sightings.source_row, axis, number, sightings.pass_number] = offset_mm[axis]
    return derivative.reshape(n_rows, 3, -1)


def _sums(fitted: Fitted) -> tuple[Numbers, Numbers]:
    """Give G (3p, 3p) and b (3p,), pass by pass."""
    sightings, solved = fitted.sightings, fitted.solved
    used = solved.used
    passes, whitening = sightings.pass_number[used], sightings.whitening[used]
    n_passes = sightings.n_passes
    columns = projected_rows(
        fitted.problem, solved.state, solved.solution.covariance_root, used.astype(np.float64), fitted.threads
    )[used]
    own = np.zeros((n_passes, 3, 3))
    np.add.at(own, passes, whitening.transpose(0, 2, 1) @ whitening)
    shared = np.zeros((n_passes, 3, columns.shape[2]))
    np.add.at(shared, passes, whitening.transpose(0, 2, 1) @ columns)
    pull = np.zeros((n_passes, 3))
    np.add.at(pull, passes, np.einsum("nij,ni->nj", whitening, solved.whitened[used]))
    flat = shared.reshape(3 * n_passes, -1)
    value, vector = linalg.eigh(linalg.block_diag(*own) - flat @ flat.T)
    # What the fit takes up wholly is 0 but for rounding, of either sign.
    return (vector * np.maximum(value, 0.0)) @ vector.T, pull.ravel()
