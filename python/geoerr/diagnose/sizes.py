"""Whether sizes of deviations depend on a variable, between runs and within them: rows of a run are not independent.

| symbol | code | what |
|---|---|---|
| u | `size` (n,) | size of a deviation, in units of what noise would make of it |
| z | `place` (n, k) | place in the variable, and its square |
| U, Z | | their means in each run |

Sizes, not squares, as in Levene's test: tails are heavy. Between runs √U is fitted by Z and a constant, each run of
as much weight as it has rows: F. Within runs each has the score g = Σ (z − Z) (u − U), which is 0 in the mean where
nothing depends on the variable; runs are independent: Hotelling's T² of g, with Q = (Σ g)' (Σ g g')⁻¹ (Σ g) of r runs
F = Q (r − k) / ((r − Q) k).

Sources: Levene, Robust tests for equality of variances (1960); Hotelling, Ann. Math. Statist. 2, 360 (1931); sums of
what rows of one run have in common: Liang & Zeger, Biometrika 73, 13 (1986).
"""

from __future__ import annotations

import math

import numpy as np

from geoerr.distributions import f_sf
from geoerr.fit.sightings import Numbers

# Of less than this share of a column's variance nothing can be told.
_LEAST_SHARE = 0.01
# So many runs that are next to each other in a variable have a mean in common.
_RUNS_A_CLASS, _MOST_CLASSES = 4, 10
# Fewer degrees of freedom tell no spread.
_LEAST_DOF = 3


def chance_between_runs(size: Numbers, place: Numbers, run: np.ndarray, level: np.ndarray) -> float | None:
    """Give how rarely runs differ as much in their sizes along a variable by chance; None where they tell nothing.

    Parameters
    ----------
    size : (n,)
    place : (n, k)
    run : (n,)
        Number of each row's run.
    level : (n,)
        Runs are held against those of the same number.
    """
    if not len(run):
        return None
    _, first, run = np.unique(run, return_index=True, return_inverse=True)
    weight = np.sqrt(np.bincount(run).astype(np.float64))
    levels = np.unique(level[first], return_inverse=True)[1]
    constants = np.linalg.qr(weight[:, None] * np.eye(int(levels.max(initial=-1)) + 1)[levels])[0]

    def beyond_constants(means: Numbers) -> Numbers:
        weighted = weight[:, None] * means
        return np.asarray(weighted - constants @ (constants.T @ weighted))

    columns = beyond_constants(means_of_runs(place, run))
    # The root of a mean of sizes is nearly normal, whether it is of many rows or of one offset.
    sizes = beyond_constants(np.sqrt(means_of_runs(size[:, None], run)))[:, 0]
    whole = len(size) * np.maximum(place.var(axis=0), 1e-300)
    value, vector = np.linalg.eigh(columns.T @ columns / np.sqrt(whole[:, None] * whole))
    own = value > _LEAST_SHARE
    unit = columns / np.sqrt(whole) @ vector[:, own] / np.sqrt(value[own])
    k, dof = int(own.sum()), len(sizes) - constants.shape[1] - int(own.sum())
    if k == 0 or dof < _LEAST_DOF:
        return None
    explained = float(((unit.T @ sizes) ** 2).sum())
    left = float(sizes @ sizes) - explained
    return float(f_sf(explained / k / (left / dof), k, dof)) if left > 0.0 else None


def chance_within_runs(size: Numbers, place: Numbers, run: np.ndarray) -> float | None:
    """Give how rarely sizes differ as much along a variable within runs by chance; None where these tell nothing.

    Parameters
    ----------
    size : (n,)
    place : (n, k)
    run : (n,)
        Number of each row's run.
    """
    run = np.unique(run, return_inverse=True)[1]
    within = place - means_of_runs(place, run)[run]
    within = within[:, within.var(axis=0) > _LEAST_SHARE * place.var(axis=0)]
    products = within * (size - means_of_runs(size[:, None], run)[run, 0])[:, None]
    scores = np.stack([np.bincount(run, weights=one) for one in products.T], axis=1) if within.size else products
    # Runs in which the variable is the same tell nothing.
    scores = scores[np.abs(scores).max(axis=1, initial=0.0) > 0.0]
    r, k = scores.shape
    if k == 0 or r - k < _LEAST_DOF:
        return None
    total = scores.sum(axis=0)
    quadratic = float(total @ np.linalg.pinv(scores.T @ scores, hermitian=True) @ total)
    return float(f_sf(quadratic * (r - k) / (max(r - quadratic, math.ulp(r)) * k), k, r - k))


def off_neighbours(values: Numbers, place: Numbers, run: np.ndarray) -> Numbers:
    """Give how far values (n,) are off the mean of a few runs, their own and those next to it in a variable.

    What follows the variable, or drifts with it, is no width; what a run is off by is.
    """
    run = np.unique(run, return_inverse=True)[1]
    along = means_of_runs(place, run)[:, 0]
    n_classes = min(max(len(along) // _RUNS_A_CLASS, 1), _MOST_CLASSES)
    few = np.empty(len(along), dtype=np.int64)
    few[np.argsort(along, kind="stable")] = np.arange(len(along)) * n_classes // max(len(along), 1)
    return np.asarray(values - means_of_runs(values[:, None], few[run])[few[run], 0])


def means_of_runs(values: Numbers, run: np.ndarray) -> Numbers:
    """Give the mean of each run, (r, k)."""
    return np.stack([np.bincount(run, weights=one) for one in values.T], axis=1) / np.bincount(run)[:, None]
