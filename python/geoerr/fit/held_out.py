"""How far a fit is off where it did not see the data: whole passes left out by turns, exactly and without refits.

With H = A (AᵀA)⁺ Aᵀ the residual of a block that the fit did not see is (I − H_bb)⁻¹ r_b. Where H_bb has the
eigenvalue 1 the rest does not determine the block. A session that lies wholly in the block keeps its own frame: its
directions are left at the best frame; anything else that the rest does not determine makes the pass not computable.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geoerr import _core
from geoerr.fit.figures import ErrorFigures, figures_of
from geoerr.fit.sightings import Numbers, Sightings
from geoerr.fit.variables import times_s

MOST_FOLDS = 20
BLOCKS_OF_ONE_PASS = 10
LEAST_FOLDS = 3
# Eigenvalues of H_bb above this leave less than a billionth of the variance to be predicted: not determined.
_NOT_DETERMINED = 1.0 - 1e-9


@dataclass(frozen=True, eq=False)
class HeldOut:
    """Residuals of rows that the fit did not see.

    Attributes
    ----------
    residual_mm : (n, 3)
        In base axes; NaN where not computable.
    figures
        Over the computable rows; None below three folds.
    n_folds
        How many were left out by turns.
    n_not_computable
        Rows whose fold the rest does not determine.
    prediction_variance_mm2
        Mean trace of the covariance of the prediction, over the computable rows.
    """

    residual_mm: Numbers
    figures: ErrorFigures | None
    n_folds: int
    n_not_computable: int
    prediction_variance_mm2: float


def folds_of(sightings: Sightings) -> np.ndarray:
    """Give every row's fold, (n,): passes dealt out by turns, or ten blocks of one pass."""
    n_passes = sightings.n_passes
    if n_passes > 1:
        return np.asarray(sightings.pass_number % MOST_FOLDS if n_passes > MOST_FOLDS else sightings.pass_number)
    if "t" in sightings.table.columns and np.isfinite(sightings.numbers("t")).all():
        order = np.argsort(times_s(sightings), kind="stable")
    else:
        # In space: along the direction in which the points spread most.
        centred = sightings.commanded_mm - sightings.commanded_mm.mean(axis=0)
        _, _, axes = np.linalg.svd(centred, full_matrices=False)
        order = np.argsort(centred @ axes[0], kind="stable")
    fold = np.empty(len(sightings), dtype=np.int64)
    fold[order] = np.arange(len(sightings)) * BLOCKS_OF_ONE_PASS // max(len(sightings), 1)
    return fold


def leave_out(
    problem: _core.FitProblem,
    state: _core.FitState,
    sightings: Sightings,
    root: Numbers,
    residual_mm: Numbers,
    used: np.ndarray,
    fold: np.ndarray,
    *,
    threads: int = 0,
) -> HeldOut:
    """Predict every fold from the others.

    Parameters
    ----------
    root : (n_columns, r)
        Root of the unscaled covariance of the fit.
    residual_mm : (n, 3)
        Of the fit, in the measuring frames.
    used : (n,)
        Rows that the fit saw; others are no part of any figure.
    fold : (n,)
        Fold of every row.
    """
    n_rows = len(sightings)
    whitened = problem.whitened(residual_mm)
    scale = used.astype(np.float64)
    held = np.full((n_rows, 3), np.nan)
    unwhitening = np.linalg.pinv(sightings.whitening)
    variance, n_counted, folds = 0.0, 0, 0
    spread = projected_rows(problem, state, root, scale, threads)
    for number in np.unique(fold[used]):
        rows = np.flatnonzero((fold == number) & used)
        z = spread[rows].reshape(3 * len(rows), -1)
        value, vector = np.linalg.eigh(z.T @ z)
        is_unit = value > _NOT_DETERMINED
        if int(is_unit.sum()) > _own_frame_unknowns(sightings, rows, used):
            continue
        folds += 1
        along = z @ vector[:, ~is_unit]
        residual = whitened[rows].ravel()
        predicted = residual + along @ ((along.T @ residual) / (1.0 - value[~is_unit]))
        held[rows] = np.einsum("nij,nj->ni", unwhitening[rows], predicted.reshape(-1, 3))
        # Covariance of the prediction from the rest, H_bb (I − H_bb)⁻¹, in whitened numbers.
        by_row = (along**2 / (1.0 - value[~is_unit])).sum(axis=1).reshape(-1, 3)
        size = (unwhitening[rows] ** 2).sum(axis=1)
        variance += float((by_row * size).sum())
        n_counted += len(rows)
    base = problem.in_base_axes(state, np.ascontiguousarray(np.nan_to_num(held)))
    base[np.isnan(held).any(axis=1)] = np.nan
    computable = used & np.isfinite(base).all(axis=1)
    figures = figures_of(sightings, np.nan_to_num(base), computable) if folds >= LEAST_FOLDS else None
    return HeldOut(base, figures, folds, int((used & ~computable).sum()), variance / max(n_counted, 1))


def projected_rows(
    problem: _core.FitProblem, state: _core.FitState, root: Numbers, scale: Numbers, threads: int
) -> Numbers:
    """Give A F (n, 3, r), A the whitened design and F the root of the covariance: H = (A F)(A F)ᵀ."""
    n_rows = len(scale)
    result = np.empty((n_rows, 3, root.shape[1]))
    step = 2048
    for first in range(0, n_rows, step):
        last = min(first + step, n_rows)
        design = problem.design(state, scale, first, last, threads)
        result[first:last] = (design @ root).reshape(last - first, 3, -1)
    return result


def _own_frame_unknowns(sightings: Sightings, rows: np.ndarray, used: np.ndarray) -> int:
    """Count the unknowns of frames of sessions that lie wholly in these rows."""
    unknowns = {"free": 6, "parallel": 3, "circle": 4}
    inside = np.bincount(sightings.session[rows], minlength=len(sightings.sessions))
    whole = np.bincount(sightings.session[used], minlength=len(sightings.sessions))
    return sum(
        unknowns[kind]
        for kind, count, total in zip(sightings.frames, inside, whole, strict=True)
        if count and count == total
    )
