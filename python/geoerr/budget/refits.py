"""The check of the linear model: rig and points drawn, triangulated and fitted again, exactly."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from geoerr import _core
from geoerr.budget.budget import Budget
from geoerr.budget.estimator import Estimator, root_of
from geoerr.budget.monte_carlo import Propagated, compared, summary, tolerance_of
from geoerr.budget.sources import covariances_mm2
from geoerr.errors import GeometryError, NotDeterminedError
from geoerr.model.arrays import Numbers
from geoerr.vision.rig import Rig
from geoerr.vision.sensitivity import points_from_pixels, project_to_both

_UM_PER_MM = 1e3
_MAX_STEPS = 40
# A correction smaller than this share of its standard error ends the iteration.
_SETTLED = 1e-4


def refit_with_noise(
    budget: Budget, *, n_trials: int = 200, seed: int = 0, with_noise: bool = True, with_calibration: bool = True
) -> Propagated:
    """Draw rig and points, refit exactly and predict exactly: the check of the data's part of the budget.

    Parameters
    ----------
    budget
        Of a fit. Its standard uncertainties by noise and calibration are what the trials are compared with.
    n_trials
        Refits; the ratio of standard uncertainties is then known to ± 1.4/√n.
    with_noise, with_calibration
        Which of the two to draw.

    Raises
    ------
    NotDeterminedError
        where the budget is that of a model file.
    GeometryError
        where the calibration is to be drawn and no rig is given.

    Notes
    -----
    The truth is the fitted machine. A trial sees its points through a rig that is off by a draw of its covariance:
    the pixels of the true points, triangulated by the wrong rig; adds noise by the points' covariances (times the
    fit's scale); and iterates from the truth until the correction is settled.
    """
    estimator = budget.estimator
    if estimator is None:
        raise NotDeterminedError("a model file does not hold the data, so that nothing can be fitted again")
    if with_calibration and (budget.rig is None or budget.rig.covariance is None):
        raise GeometryError("no rig with a covariance is given, so that the calibration cannot be drawn")
    rng = np.random.default_rng([seed, 1])
    fitted = estimator.fitted
    if fitted.shared_noise is None:
        roots = fitted.scale * np.array([root_with_zeros(one) for one in covariances_mm2(fitted)])
    else:
        # What rows scatter by themselves; what they share is a source that is not drawn here.
        roots = fitted.sightings.unwhitening * fitted.shared_noise.scatter
    places = budget.q_mm
    expected = budget.predictor.error_mm(places, _parameters(fitted.solved.state))
    trials = np.empty((n_trials, len(places), 3))
    for number in range(n_trials):
        moved = np.zeros((len(roots), 3))
        if with_calibration:
            assert budget.rig is not None
            moved += _seen_by_wrong_rig(budget.rig, fitted.sightings.measured_mm - fitted.solved.residual_mm, rng)
        if with_noise:
            moved += np.einsum("nij,nj->ni", roots, rng.standard_normal((len(roots), 3)))
        parameters = _refitted(estimator, moved)
        trials[number] = budget.predictor.error_mm(places, parameters) - expected
    trials *= _UM_PER_MM
    names = {"pixels", "scatter", "data"} if with_noise else set()
    names |= {"calibration"} if with_calibration else set()
    return compared(_only(budget, names), "prediction", trials, tolerance_of(summary(trials)[1], 1))


def root_with_zeros(covariance: Numbers) -> Numbers:
    """Give a root (3, 3) of a covariance that may have directions without any."""
    root = root_of(covariance)
    return np.pad(root, ((0, 0), (0, 3 - root.shape[1])))


def _only(budget: Budget, names: set[str]) -> Budget:
    pairs = [pair for pair in budget.chosen("prediction") if pair[0].name in names]
    return replace(budget, sources=tuple(source for source, _ in pairs), roots_mm=tuple(root for _, root in pairs))


def _seen_by_wrong_rig(rig: Rig, points_mm: Numbers, rng: np.random.Generator) -> Numbers:
    """Give how far points (n, 3) move when their pixels are triangulated by a rig with another calibration."""
    assert rig.covariance is not None
    root = root_of(rig.covariance)
    wrong = rig.changed_by(root @ rng.standard_normal(root.shape[1]))
    pixels = project_to_both(rig, points_mm).pixel
    return points_from_pixels(wrong, pixels) - points_from_pixels(rig, pixels)


def _refitted(estimator: Estimator, moved_mm: Numbers) -> Numbers:
    """Give the parameters (m,) that the fit finds where the points are the fitted machine's, moved (n, 3)."""
    fitted, problem = estimator.fitted, estimator.fitted.problem
    start = fitted.solved.state
    state, centre = start, _unknowns(estimator, start)
    spread = np.sqrt(np.diagonal(estimator.covariance))
    for _ in range(_MAX_STEPS):
        residual = problem.residuals(state, fitted.threads) - fitted.solved.residual_mm + moved_mm
        gradient = problem.gradient(estimator.state, residual, estimator.row_scale, fitted.threads)
        gradient -= estimator.prior.T @ (estimator.prior @ (_unknowns(estimator, state) - centre))
        step = estimator.covariance @ gradient
        state = problem.corrected(state, step)
        if float(np.max(np.abs(step) / np.where(spread > 0.0, spread, np.inf), initial=0.0)) < _SETTLED:
            break
    return _parameters(state)


def _parameters(state: _core.FitState) -> Numbers:
    return np.concatenate([state.coefficients, state.inner])


def _unknowns(estimator: Estimator, state: _core.FitState) -> Numbers:
    """Give the unknowns that a prior can hold; 0 for inner parameters and frames."""
    problem = estimator.fitted.problem
    unknowns = np.zeros(problem.n_columns)
    unknowns[: len(state.coefficients)] = state.coefficients
    unknowns[problem.first_shared_column :] = state.shared
    return unknowns
