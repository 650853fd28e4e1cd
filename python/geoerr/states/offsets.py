r"""What rows of one pass, and of passes one after the other, have in common and is no error of the machine.

A camera that was touched, a carriage that settles, air that warms: residuals have an offset by pass and wander within
a session, and a test that takes them for independent alarms on every pair of states. With A the whitened columns of
the fit, r its whitened residual, Z the membership of rows in blocks (a pass, or a third of one, of one body), the
offsets of blocks along each axis of the measuring frame are normal with covariance d_axis K,

    K = (w [same pass] + (1 − w) exp(−|t − t'| / τ) [same session]) (1 − c + c [same body]) = R Rᵀ,

in units of the scatter s²: c is 0 where a camera was touched and 1 where every carriage settles by itself. s², d, the
numbers w, τ and c, and whether a second look where the machine turns belongs to the way back, maximise the restricted
likelihood

    −2 log L = ν log s² + log det(1 + Dᵀ G D) + (r·r − b·D (1 + Dᵀ G D)⁻¹ Dᵀ b) / s²,
    D = R ⊗ diag(√d),   G = Zᵀ(1 − A A⁺)Z,   b = Zᵀ r

How well their size is known follows from the eigenvalues λ of Dᵀ G D: Σ (λ/(1 + λ))² degrees of freedom.

Source: Harville, JASA 72 (1977). Verified: tests/states/test_offsets.py, validation/hot_and_cold.py.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
import scipy
from scipy import linalg

from geoerr.fit import Fitted
from geoerr.fit.sightings import Numbers
from geoerr.states.blocks import Blocks, blocks_of, has_bodies_apart, passes_from_turns
from geoerr.states.functions import Estimate

Integers = npt.NDArray[np.int64]

# Offsets with less than this share of the noise's variance change no uncertainty that is written down.
_LEAST, _MOST = 1e-4, 1e4
_STARTS = 13
# A found variance within this factor of the least is none.
_NEAR = 1.2
# Memories that are tried, as shares of a session, how much of the offsets is each pass's own, and each body's own.
_MEMORIES = (0.05, 0.15, 0.5)
_SHARES = (0.0, 0.5)
_CARRIER_SHARES = (0.0, 0.5, 1.0)
# Eigenvalues below this share of the largest are rounding.
_RANK = 1e-9
# Directions of a correlation with less than this share of the largest variance need no unknowns of their own.
_NEGLIGIBLE = 1e-4


@dataclass(frozen=True, eq=False)
class PassOffsets:
    """Offsets that rows share.

    Attributes
    ----------
    std_mm : (3,)
        Along x, y, z of the measuring frame, in units of the fit's `scale`, as stated uncertainties are; 0 where
        there is nothing to be seen.
    block : (n,)
        Number of each row's block.
    root : (b, k)
        Root of the correlation of blocks.
    dof
        Degrees of freedom that told the size.
    """

    std_mm: Numbers
    block: Integers
    root: Numbers
    dof: float

    def sensitivity(self, fitted: Fitted, n_rows: int) -> Numbers:
        """Give how unknowns that are known to be 0 ± 1 move the rows of the table, (n, 3, k)."""
        kept = np.flatnonzero(self.std_mm > 0.0)
        derivative = np.zeros((n_rows, 3, len(kept), self.root.shape[1]))
        for number, axis in enumerate(kept):
            derivative[fitted.sightings.source_row, axis, number] = self.std_mm[axis] * self.root[self.block]
        return derivative.reshape(n_rows, 3, -1)


def pass_offsets(fitted: Fitted) -> PassOffsets:
    """Find what rows share in what a fit leaves."""
    sightings = fitted.sightings
    turned = passes_from_turns(sightings)
    is_told = (turned == sightings.pass_number).all()
    numberings = [sightings.pass_number] if is_told else [sightings.pass_number, turned]
    shares = _CARRIER_SHARES if has_bodies_apart(sightings) else (0.0,)
    tried = _sums_of(fitted, numberings, by_carrier=True) if len(shares) > 1 else []
    if not tried:
        shares, tried = (0.0,), _sums_of(fitted, numberings, by_carrier=False)
    if not tried:
        blocks = blocks_of(sightings, sightings.pass_number, by_carrier=False)
        return PassOffsets(np.zeros(3), blocks.of_row, np.eye(len(blocks)), math.inf)
    firsts = [sums.best(1.0, 1.0, share) for sums in tried for share in shares]
    of_pass = min(firsts, key=lambda found: found.value)
    wandering = [of_pass.sums.best(w, tau, share) for w in _SHARES for tau in _MEMORIES for share in shares]
    best = min([of_pass, *wandering], key=lambda found: found.value)
    low, high = math.log(_LEAST), math.log(_MOST)
    start = np.full(3, best.log_ratio)
    found = scipy.optimize.minimize(best.likelihood, start, method="Powell", bounds=[(low, high)] * 3).x
    sums = best.sums
    is_there = sums.is_seen & (found > low + math.log(_NEAR))
    if not is_there.any():
        return PassOffsets(np.zeros(3), sums.blocks.of_row, best.root, math.inf)
    std_mm = np.where(is_there, np.sqrt(sums.noise * np.exp(found)), 0.0)
    dof = best.likelihood.degrees_of_freedom(np.where(is_there, found, low))
    return PassOffsets(std_mm, sums.blocks.of_row, best.root, dof)


def with_offsets(estimate: Estimate, fitted: Fitted, offsets: PassOffsets) -> Estimate:
    """Say which part of a fit's covariance stems from the offsets, and how well their size is known.

    Rows that hold the offsets at 0 ± 1 are data with an error of their own, and the solution's response to them is
    its covariance with the offsets.
    """
    first = fitted.problem.first_shared_column
    count = int((offsets.std_mm > 0.0).sum()) * offsets.root.shape[1]
    root = fitted.solved.solution.covariance_root
    part = fitted.scale * root[: len(estimate.parameters)] @ root[first : first + count].T
    return replace(estimate, part=part, part_dof=offsets.dof)


def root_of_correlation(correlation: Numbers) -> Numbers:
    """Give R (b, k) with R Rᵀ a correlation, but for little: blocks of one pass with one offset need one column."""
    value, vector = np.linalg.eigh(correlation)
    kept = value > _NEGLIGIBLE * value[-1]
    return np.asarray(vector[:, kept] * np.sqrt(value[kept]))


@dataclass(frozen=True, eq=False)
class _Likelihood:
    """−2 log L as a function of log d (3,), less what is constant."""

    gram: Numbers
    pull: Numbers
    noise: Numbers
    square: float
    dof: float

    @classmethod
    def of(cls, sums: _Sums, root: Numbers) -> _Likelihood:
        """Turn sums into those of unknowns of unit variance, of which a root (b, k) makes the blocks' offsets."""
        size = 3 * root.shape[1]
        turned = np.einsum("ba,bcde,df->acfe", root, sums.gram, root, optimize=True)
        return cls(turned.reshape(size, size), (root.T @ sums.pull).ravel(), sums.noise, sums.square, sums.dof)

    def _scaled(self, log_ratio: Numbers) -> tuple[Numbers, Numbers]:
        root = np.tile(np.sqrt(self.noise * np.exp(log_ratio)), len(self.pull) // 3)
        return root[:, None] * self.gram * root, root * self.pull

    def __call__(self, log_ratio: Numbers) -> float:
        gram, pull = self._scaled(log_ratio)
        factor = linalg.cholesky(np.eye(len(pull)) + gram, lower=True)
        explained = linalg.solve_triangular(factor, pull, lower=True)
        left = max(self.square - float(explained @ explained), 1e-300)
        return float(self.dof * np.log(left) + 2.0 * np.log(np.diag(factor)).sum())

    def degrees_of_freedom(self, log_ratio: Numbers) -> float:
        value = np.maximum(np.linalg.eigvalsh(self._scaled(log_ratio)[0]), 0.0)
        return float(((value / (1.0 + value)) ** 2).sum())


def _sums_of(fitted: Fitted, numberings: Sequence[Integers], *, by_carrier: bool) -> list[_Sums]:
    """Sum up for passes that are numbered in several ways, where enough is left for that."""
    blocks = [blocks_of(fitted.sightings, numbers, by_carrier=by_carrier) for numbers in numberings]
    return [sums for one in blocks if (sums := _Sums.of(fitted, one)) is not None]


@dataclass(frozen=True, eq=False)
class _Found:
    """One correlation, and the best that it does with one size for all axes."""

    sums: _Sums
    root: Numbers
    likelihood: _Likelihood
    log_ratio: float
    value: float


@dataclass(frozen=True, eq=False)
class _Sums:
    """G (b, 3, b, 3) and b (b, 3), and what they are of.

    Attributes
    ----------
    noise : (3,)
        Variance of one number along each axis, mm²; 0 where nothing is seen.
    square, dof
        χ² of the fit, and its degrees of freedom.
    """

    blocks: Blocks
    gram: Numbers
    pull: Numbers
    noise: Numbers
    square: float
    dof: float

    @classmethod
    def of(cls, fitted: Fitted, blocks: Blocks) -> _Sums | None:
        """Sum up; None where the fit leaves no more than the blocks could take, or nothing was seen."""
        if fitted.dof <= 3 * len(blocks):
            return None
        sightings, used = fitted.sightings, fitted.solved.used
        gram, pull = _sums(fitted, blocks.of_row, len(blocks))
        information = (sightings.whitening[used] ** 2).sum(axis=(0, 1))
        n_numbers = sightings.is_measured[used].sum(axis=0)
        is_seen = (n_numbers > 0) & (np.einsum("bcbc->c", gram) > 0.0)
        if not is_seen.any():
            return None
        noise = np.where(is_seen, n_numbers / np.maximum(information, 1e-300), 0.0)
        return cls(blocks, gram, pull, noise, fitted.solved.chi_squared, fitted.dof)

    @property
    def is_seen(self) -> npt.NDArray[np.bool_]:
        """Along which axes (3,) offsets show."""
        return self.noise > 0.0

    def best(self, pass_share: float, memory: float, carrier_share: float) -> _Found:
        """Try sizes of offsets with one correlation."""
        root = root_of_correlation(self.blocks.correlation(pass_share, memory, carrier_share))
        likelihood = _Likelihood.of(self, root)
        trials = np.linspace(math.log(_LEAST), math.log(_MOST), _STARTS)
        values = [likelihood(np.full(3, one)) for one in trials]
        place = int(np.argmin(values))
        return _Found(self, root, likelihood, float(trials[place]), values[place])


def _sums(fitted: Fitted, block: Integers, n_blocks: int) -> tuple[Numbers, Numbers]:
    """Give G (b, 3, b, 3) and b (b, 3)."""
    sightings, solved = fitted.sightings, fitted.solved
    used = solved.used
    whitening, own_block = sightings.whitening[used], block[used]
    columns = fitted.problem.times(
        solved.state, solved.solution.covariance_root, used.astype(np.float64), fitted.threads
    )[used]
    own = np.zeros((n_blocks, 3, 3))
    np.add.at(own, own_block, whitening.transpose(0, 2, 1) @ whitening)
    shared = np.zeros((n_blocks, 3, columns.shape[2]))
    np.add.at(shared, own_block, whitening.transpose(0, 2, 1) @ columns)
    pull = np.zeros((n_blocks, 3))
    np.add.at(pull, own_block, np.einsum("nij,ni->nj", whitening, solved.whitened[used]))
    flat = shared.reshape(3 * n_blocks, -1)
    value, vector = linalg.eigh(linalg.block_diag(*own) - flat @ flat.T)
    # What the fit takes up wholly is 0 but for rounding, of either sign; along it a residual says nothing.
    seen = vector[:, value > _RANK * value[-1]]
    gram = (seen * value[value > _RANK * value[-1]]) @ seen.T
    return gram.reshape(n_blocks, 3, n_blocks, 3), (seen @ (seen.T @ pull.ravel())).reshape(pull.shape)
