r"""What chance does over a whole map: one test of all of it, and the largest of many correlated deviations.

A difference d = J e, e normal with covariance F Fᵀ, has the covariance (J F)(J F)ᵀ of some rank k, however many
places it is asked at. All of it is judged by χ² = dᵀ (J F Fᵀ Jᵀ)⁺ d with k degrees of freedom. Bands that hold
everywhere at once are c standard deviations wide, c the quantile of the largest deviation, from draws of e:
neighbours are alike, so that c lies far below what independent places would need.

Covariances are themselves estimates. Where the noise's scale is known from ν degrees of freedom only, χ²/k is held
against F(k, ν). The part of the covariance that stems from offsets of passes has a size s² that a few passes have
told: with f_i the share of that part in the variance along direction i, and κ ~ χ²_ν/ν what an estimate of 1 comes
out as,

    P(χ² ≥ x) = E_κ P(Σ z_i² / (1 − f_i + κ f_i) ≥ x),      z_i standard normal,

the inner one by a scaled χ² of the same mean and variance (Satterthwaite). Without that, tests alarm in a quarter of
the cases where they should in a twentieth, with 18 passes in each state.

Source: Working and Hotelling 1929 (bands); Hothorn, Bretz and Westfall, Biometrical Journal 50 (2008) (maximum of
correlated statistics). Verified: tests/states/test_chance.py, validation/hot_and_cold.py.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from geoerr.distributions import chi_squared_ppf, chi_squared_sf, f_sf, never_zero
from geoerr.fit.sightings import Numbers

# Singular values below this share of the largest are the gauge's, or round-off.
_RANK = 1e-7
# 10,000 draws tell a probability of 5 % to 0.2 %.
_DRAWS = 10_000
_DRAWS_AT_ONCE = 500
_SEED = 20_230
# What κ may be, at the middle of so many equally probable classes.
_CLASSES = 400


@dataclass(frozen=True, eq=False)
class Spread:
    """Covariance of numbers, and how well it is known.

    Attributes
    ----------
    root : (..., m)
        The covariance is root · rootᵀ.
    part : (..., k)
        Root of the part of it whose size was estimated from few degrees of freedom.
    part_dof
        These; infinite where there is no such part.
    dof
        Of the scale of all of it; infinite where that is stated.
    """

    root: Numbers
    part: Numbers
    part_dof: float
    dof: float

    def through(self, rows: Numbers) -> Spread:
        """Give the spread of linear functions, rows (n, m) of what this is of."""
        return Spread(rows @ self.root, rows @ self.part, self.part_dof, self.dof)

    @property
    def std(self) -> Numbers:
        """Standard deviations."""
        return np.asarray(np.linalg.norm(self.root, axis=-1))


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


def whole_test(value: Numbers, spread: Spread) -> Test:
    """Test numbers (n,) against 0."""
    std = spread.std
    known = std > 0.0
    if not known.any():
        return Test(0.0, 0, spread.dof, 1.0)
    # Compared without units: every number over its own standard uncertainty.
    left, size, _ = np.linalg.svd(spread.root[known] / std[known, None], full_matrices=False)
    kept = size > _RANK * size[0]
    inward = left[:, kept].T / size[kept, None] / std[known]
    along, part = inward @ value[known], inward @ spread.part[known]
    share = np.clip(np.linalg.eigvalsh(part @ part.T), 0.0, 1.0)
    return tail(float(along @ along), int(kept.sum()), spread.dof, share, spread.part_dof)


def tail(chi_squared: float, rank: int, dof: float, share: Numbers | None = None, part_dof: float = math.inf) -> Test:
    """Give the test of a sum of squares whose `rank` numbers have unit variance; see the module's text."""
    if rank <= 0:
        return Test(chi_squared, 0, dof, 1.0)
    mean, per_mean = np.array([float(rank)]), np.ones(1)
    if share is not None and not math.isinf(part_dof) and share.any():
        inverse = 1.0 / (1.0 - share + _sizes(part_dof)[:, None] * share)
        mean = inverse.sum(axis=1)
        per_mean = (inverse**2).sum(axis=1) / mean
    freedom, scaled = mean / per_mean, chi_squared / per_mean
    if math.isinf(dof):
        return Test(chi_squared, rank, dof, never_zero(float(chi_squared_sf(scaled, freedom).mean())))
    return Test(chi_squared, rank, dof, never_zero(float(f_sf(scaled / freedom, freedom, dof).mean())))


def holm(p_values: list[float]) -> list[float]:
    """Correct probabilities for their number, by Holm's step-down rule."""
    order = np.argsort(p_values, kind="stable")
    corrected, running = np.empty(len(p_values)), 0.0
    for rank, place in enumerate(order):
        running = max(running, min(1.0, (len(p_values) - rank) * p_values[place]))
        corrected[place] = running
    return [float(value) for value in corrected]


def _sizes(dof: float) -> Numbers:
    """Give equally probable values of χ²_ν/ν, never quite 0."""
    middle = (np.arange(_CLASSES) + 0.5) / _CLASSES
    return np.asarray(np.maximum(chi_squared_ppf(middle, dof) / dof, 1e-6))


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


def largest_by_chance(spread: Spread) -> Largest:
    """Draw the largest of the deviations of vectors (n, k), whose spread says how they hang together."""
    left, size, right = np.linalg.svd(spread.root, full_matrices=False)
    known = size > _RANK * size.max(axis=1, keepdims=True, initial=1e-300)
    rows = (left * known[:, None, :]) @ right
    # Share of the estimated part in each vector's variance, on average over its directions.
    inward = left.transpose(0, 2, 1) * np.where(known, 1.0 / np.where(known, size, 1.0), 0.0)[:, :, None]
    share = ((inward @ spread.part) ** 2).sum(axis=(1, 2)) / np.maximum(known.sum(axis=1), 1)
    n, k, m = rows.shape
    # Draws in the space that the rows span: as many numbers as the rank.
    _, size, right = np.linalg.svd(rows.reshape(n * k, m), full_matrices=False)
    flat = rows.reshape(n * k, m) @ right[size > _RANK * size[0]].T
    rng = np.random.default_rng(_SEED)
    found = []
    for _ in range(_DRAWS // _DRAWS_AT_ONCE):
        drawn = flat @ rng.standard_normal((flat.shape[1], _DRAWS_AT_ONCE))
        square = (drawn.reshape(n, k, -1) ** 2).sum(axis=1)
        if not math.isinf(spread.part_dof):
            found_size = rng.chisquare(spread.part_dof, _DRAWS_AT_ONCE) / spread.part_dof
            square = square / (1.0 - share[:, None] + share[:, None] * found_size)
        if not math.isinf(spread.dof):
            square = square / (rng.chisquare(spread.dof, _DRAWS_AT_ONCE) / spread.dof)
        found.append(np.sqrt(square.max(axis=0)))
    return Largest(np.sort(np.concatenate(found)))
