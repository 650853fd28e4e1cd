r"""What chance does over a whole map: one test of all of it, and the largest of many correlated deviations.

A difference d = J e, e normal with covariance F Fᵀ, has the covariance (J F)(J F)ᵀ of some rank k, however many
places it is asked at. All of it is judged by χ² = dᵀ (J F Fᵀ Jᵀ)⁺ d with k degrees of freedom, or, where the noise's
scale is known from ν degrees of freedom only, by χ²/k against F(k, ν). Bands that hold everywhere at once are c
standard deviations wide, c the quantile of the largest deviation, from draws of e: neighbours are alike, so that c
lies far below what independent places would need.

Source: Working and Hotelling 1929 (bands); Hothorn, Bretz and Westfall, Biometrical Journal 50 (2008) (maximum of
correlated statistics). Verified: tests/states/test_chance.py.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy import stats

from geoerr.fit.sightings import Numbers

# Singular values below this share of the largest are the gauge's, or round-off.
_RANK = 1e-7
# 10,000 draws tell a probability of 5 % to 0.2 %.
_DRAWS = 10_000
_DRAWS_AT_ONCE = 500
_SEED = 20_230


@dataclass(frozen=True)
class Test:
    """One test of many numbers at once.

    Attributes
    ----------
    chi_squared
        Square of the deviation in units of its covariance.
    rank
        Degrees of freedom of the deviation.
    dof
        Of the noise's scale; infinite where that is stated.
    p_value
        That noise alone does as much; 1 where there is nothing to test.
    """

    chi_squared: float
    rank: int
    dof: float
    p_value: float


def whole_test(value: Numbers, root: Numbers, dof: float) -> Test:
    """Test numbers (n,) with covariance root · rootᵀ, root (n, m), against 0."""
    std = np.linalg.norm(root, axis=1)
    known = std > 0.0
    if not known.any():
        return Test(0.0, 0, dof, 1.0)
    # Compared without units: every number over its own standard uncertainty.
    left, size, _ = np.linalg.svd(root[known] / std[known, None], full_matrices=False)
    kept = size > _RANK * size[0]
    along = (left[:, kept].T @ (value[known] / std[known])) / size[kept]
    return tail(float(along @ along), int(kept.sum()), dof)


def tail(chi_squared: float, rank: int, dof: float) -> Test:
    """Give the test of a sum of squares whose `rank` numbers have unit variance, or an estimated one."""
    if rank <= 0:
        return Test(chi_squared, 0, dof, 1.0)
    if math.isinf(dof):
        return Test(chi_squared, rank, dof, float(stats.chi2.sf(chi_squared, rank)))
    return Test(chi_squared, rank, dof, float(stats.f.sf(chi_squared / rank, rank, dof)))


def whitened_rows(root: Numbers) -> Numbers:
    """Give W (n, k, m) with W Wᵀ of each row the identity over what is known of it, from roots (n, k, m).

    For k = 1 a row over its standard deviation; a row of zeros stays one.
    """
    left, size, right = np.linalg.svd(root, full_matrices=False)
    known = size > _RANK * size.max(axis=1, keepdims=True, initial=1e-300)
    return np.asarray((left * known[:, None, :]) @ right)


def deviations(value: Numbers, root: Numbers) -> Numbers:
    """Give how many standard deviations (n,) vectors (n, k) are from 0, covariance of each root · rootᵀ."""
    left, size, _ = np.linalg.svd(root, full_matrices=False)
    known = size > _RANK * size.max(axis=1, keepdims=True, initial=1e-300)
    along = np.einsum("nik,ni->nk", left, value) / np.where(known, size, np.inf)
    return np.asarray(np.linalg.norm(along, axis=1))


@dataclass(frozen=True, eq=False)
class Largest:
    """What the largest deviation of a map is by chance: sorted draws of it."""

    draws: Numbers

    def quantile(self, level: float = 0.95) -> float:
        """Give the deviation that chance exceeds nowhere in the map with this probability."""
        return float(np.quantile(self.draws, level))

    def p_value(self, deviation: Numbers) -> Numbers:
        """Give the probability that chance does as much anywhere in the map; never below one over the draws."""
        beyond = len(self.draws) - np.searchsorted(self.draws, deviation, side="left")
        return np.asarray((beyond + 1.0) / (len(self.draws) + 1.0))


def largest_by_chance(root: Numbers, dof: float) -> Largest:
    """Draw the largest of the deviations of vectors (n, k) whose root (n, k, m) says how they hang together."""
    rows = whitened_rows(root)
    n, k, m = rows.shape
    # Draws in the space that the rows span: as many numbers as the rank.
    _, size, right = np.linalg.svd(rows.reshape(n * k, m), full_matrices=False)
    flat = rows.reshape(n * k, m) @ right[size > _RANK * size[0]].T
    rng = np.random.default_rng(_SEED)
    found = []
    for _ in range(_DRAWS // _DRAWS_AT_ONCE):
        drawn = flat @ rng.standard_normal((flat.shape[1], _DRAWS_AT_ONCE))
        length = np.sqrt((drawn.reshape(n, k, -1) ** 2).sum(axis=1)).max(axis=0)
        if not math.isinf(dof):
            length = length / np.sqrt(rng.chisquare(dof, _DRAWS_AT_ONCE) / dof)
        found.append(length)
    return Largest(np.sort(np.concatenate(found)))
