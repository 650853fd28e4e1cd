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
from geoerr.fit.lengths import is_told, of_whole_lengths, told_in_base_axes
from geoerr.fit.sightings import SAME_POSITION_MM, Numbers, Sightings
from geoerr.fit.start import N_UNKNOWNS, ON_A_LINE
from geoerr.fit.variables import times_s

MOST_FOLDS = 20
BLOCKS_OF_ONE_PASS = 10
LEAST_FOLDS = 3


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
    variance_of_fold_mm2 : (n_folds,)
        The same over the rows of each fold, in the order of their numbers; NaN where not computable.
    sums
        What folds sum up to, for a fit to the same rows; None where that is not kept.
    """

    residual_mm: Numbers
    figures: ErrorFigures | None
    n_folds: int
    n_not_computable: int
    prediction_variance_mm2: float
    variance_of_fold_mm2: Numbers
    sums: _core.FitSums | None = None


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
    design_state: _core.FitState,
    solution: _core.FitSolution,
    sightings: Sightings,
    residual_mm: Numbers,
    used: np.ndarray,
    fold: np.ndarray,
    *,
    shared: Numbers | None = None,
    known: tuple[_core.FitSums, np.ndarray] | None = None,
    threads: int = 0,
) -> HeldOut:
    """Predict every fold from the others.

    Parameters
    ----------
    state, design_state, solution
        Of the fit. What a pass alone determines is found by eigenvalues of 1, and 1 they are only with the design
        that the solution is of: another one of a circle 0.03 mm off has them 3·10⁻⁴ off, and 9 µm became 1 mm.
    residual_mm : (n, 3)
        Of the fit, in the measuring frames.
    used : (n,)
        Rows that the fit saw; others are no part of any figure.
    fold : (n,)
        Fold of every row.
    shared : (n, 3, p) or None
        Derivative of measured points by shared unknowns; one that acts in a single fold is that fold's own.
    known
        Sums of another design of these rows in its frames, and where each column (n_columns,) is in that one; -1 of
        one that is not.
    """
    held = np.full((len(sightings), 3), np.nan)
    order = np.flatnonzero(used)
    order = np.ascontiguousarray(order[np.argsort(fold[order], kind="stable")], dtype=np.int64)
    _, starts = np.unique(fold[order], return_index=True)
    acts = np.zeros((len(sightings), 0), dtype=bool)
    if shared is not None:
        acts = ((shared != 0.0) & sightings.is_measured[:, :, None]).any(axis=1) & used[:, None]
    n_acting = acts.sum(axis=0)
    in_session = np.bincount(sightings.session[used], minlength=len(sightings.sessions))
    own = [_own_unknowns(sightings, rows, in_session, acts, n_acting) for rows in np.split(order, starts)[1:]]
    whitened, spread_mm2, is_determined, sums = problem.leave_out(
        design_state,
        solution,
        residual_mm,
        order,
        starts.astype(np.int64),
        np.array(own, dtype=np.int64),
        sightings.once("weights of numbers", _weights_mm2),
        threads,
        known,
    )
    # W is symmetric with a component's row and column taken out together: its pseudo-inverse undoes the rest.
    held[order] = np.einsum("nij,nj->ni", sightings.unwhitening[order], whitened)
    base = told_in_base_axes(sightings, problem, state, np.nan_to_num(held))
    computable = used & np.isfinite(held).all(axis=1)
    base[~computable] = np.nan
    folds = int(sum(is_determined))
    figures = figures_of(sightings, np.nan_to_num(base), computable) if folds >= LEAST_FOLDS else None
    return HeldOut(
        base,
        figures,
        folds,
        int((used & ~computable).sum()),
        float(np.nansum(spread_mm2)) / max(int((computable & is_told(sightings).any(axis=1)).sum()), 1),
        np.asarray(spread_mm2) / np.maximum(np.diff([*starts, len(order)]), 1),
        sums,
    )


def _weights_mm2(sightings: Sightings) -> Numbers:
    """Give what the variance of each whitened number (n, 3) counts in mm²."""
    weights_mm2 = (sightings.unwhitening**2).sum(axis=1)
    # What was not measured has no variance, whatever its weight; one weight of all is the quickest.
    weights_mm2 = np.where(weights_mm2 > 0.0, weights_mm2, weights_mm2.max(initial=0.0))
    # Twice as far, four times the variance.
    return of_whole_lengths(sightings, weights_mm2, size=4.0)


def _own_unknowns(
    sightings: Sightings, rows: np.ndarray, in_session: np.ndarray, acts: np.ndarray, n_acting: np.ndarray
) -> int:
    """Count unknowns that act in these rows only: frames of sessions and shared unknowns that lie wholly in them.

    One that moves no measured component, as the turn of a frame about the one line of its points, is none.
    `in_session` counts the rows of each session that take part, `acts` (n, p) tells where a shared unknown acts,
    `n_acting` (p,) in how many rows.
    """
    inside = np.bincount(sightings.session[rows], minlength=len(in_session))
    count = sum(
        _frame_unknowns(sightings, rows[sightings.session[rows] == number])
        for number in np.flatnonzero((inside > 0) & (inside == in_session))
    )
    n_here = acts[rows].sum(axis=0)
    return count + int(((n_here > 0) & (n_here == n_acting)).sum())


def _frame_unknowns(sightings: Sightings, rows: np.ndarray) -> int:
    """Count the unknowns of a session's frame that its rows can see."""
    kind = sightings.frames[sightings.session[rows[0]]]
    if kind == "circle":
        # The centre leaves the plane of the circle unnoticed.
        return N_UNKNOWNS[kind] - 1
    if kind == "parallel":
        return int(sightings.is_measured[rows].any(axis=0).sum())
    complete = sightings.measured_mm[rows[sightings.is_measured[rows].all(axis=1)]]
    size = np.linalg.svd(complete - complete.mean(axis=0), compute_uv=False)
    n_dimensions = int((size > ON_A_LINE * max(float(size[0]), SAME_POSITION_MM)).sum())
    return N_UNKNOWNS[kind] - {0: 3, 1: 1}.get(n_dimensions, 0)
