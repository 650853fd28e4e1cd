"""What rows share beside the model: offsets of passes and drifts of the device, in the uncertainties of a fit.

The least squares weigh rows as if each scattered by itself. Where rows of a pass share an offset, or rows near in
time a drift, the covariance of the noise is that of `noise_model`, V = σ² (I + Z C Zᵀ) for each component, and that
of the parameters

    K Aᵀ V A Kᵀ = Σ_c σ_c² K A_cᵀ A_c Kᵀ + Σ_c σ_c² (K A_cᵀ Z) C_c (K A_cᵀ Z)ᵀ,

with K the covariance of the unknowns by white noise of unit size and A their columns, both whitened (Huber's
sandwich, with V from the model of the noise and not from its own residuals: passes are fewer than parameters). The
first sum is what rows scatter by themselves, the second what they share. It stands in the place of the fit's own
covariance, where the residual says for certain that rows share something. What a prior knew keeps its part.

Verified in tests/fit/test_shared_noise.py: the formula by dense matrices, stated uncertainties by Monte-Carlo with
offsets and with a drift, and no change where there is neither.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import fields, replace

import numpy as np

from geoerr import _core
from geoerr.distributions import chi_squared_sf
from geoerr.fit.covariance_parts import SharedNoise, root_of
from geoerr.fit.fitted import Fitted
from geoerr.fit.jumps import jump_places
from geoerr.fit.noise_model import Blocks, NoiseModel, NoiseSums, blocks_of, offset_weights
from geoerr.fit.sightings import Numbers
from geoerr.terms import Parameter, Term

# Less probable than this, what rows share is not chance (as for the fit's own scale).
_SIGNIFICANCE = 0.01
# Numbers of what rows share: offset, drift and its memory, of three components.
_N_SHARED = 9
# Numbers of columns that are made at once, or to which the noise is fitted: 50 MB.
_MOST_NUMBERS = 6_000_000
# Blocks of which each is held against each; those before reach them as one.
_BLOCKS_AT_ONCE = 256
# Blocks of a session to whose rows the noise is fitted: that costs their cube. Every so manieth pass stands for all.
_MOST_BLOCKS = 320
# Steps to the scatter of rows that share nothing: but for what the columns take of it, the first is exact.
_STEPS = 3
_LEAST_SHARE = 1e-12


def with_shared_noise(fitted: Fitted) -> Fitted:
    """Give a fit whose covariance and standard errors count what rows share; the same where they share nothing.

    Lengths share no offset: they are differences, and have no part in it.
    """
    sightings, solved = fitted.sightings, fitted.solved
    weights = offset_weights(sightings, solved.used) * ~sightings.of_kind("lengths")[:, None]
    counts = np.asarray((weights > 0.0).any(axis=1))
    columns = _UnitColumns(fitted)
    if len(np.unique(sightings.pass_number[counts])) < 2 or columns.rank == 0 or fitted.dof <= 0:
        return fitted
    blocks = blocks_of(sightings)
    some = _some(blocks, counts, 3 * columns.rank)
    basis = columns.of(some)
    if len(some) < len(sightings):
        # Of every second row the columns are half as long, and must be orthonormal.
        basis = _core.orthonormal_columns(basis.reshape(3 * len(some), -1), fitted.threads).reshape(len(some), 3, -1)
    residual = solved.whitened[some] * (weights[some] > 0.0)
    sums = NoiseSums(_of_rows(blocks, some), weights[some], residual, basis, threads=fitted.threads)
    noise = sums.fit()
    if not _is_certain(sums, noise):
        return fitted
    # Only now: half of all time, and most rows share nothing.
    grams, by_block = columns.sums(weights, blocks)
    return _counted(fitted, replace(noise, blocks=blocks), grams, by_block)


def _some(blocks: Blocks, counts: np.ndarray, n_numbers: int) -> np.ndarray:
    """Give the rows to which the noise is fitted: those that count, or evenly as many as need not too much."""
    largest = max(own.stop - own.start for own in blocks.slices)
    pass_of_row = blocks.pass_number[blocks.block]
    of_passes = np.unique(pass_of_row, return_inverse=True)[1] % math.ceil(largest / _MOST_BLOCKS) == 0
    some = np.flatnonzero(counts & of_passes)
    return some[:: max(math.ceil(len(some) * n_numbers / _MOST_NUMBERS), 1)]


def _of_rows(blocks: Blocks, some: np.ndarray) -> Blocks:
    """Give the blocks of some rows."""
    own, block = np.unique(blocks.block[some], return_inverse=True)
    numbers = {"session": blocks.session[own], "pass_number": blocks.pass_number[own], "time": blocks.time[own]}
    return replace(blocks, block=block, **numbers)


class _UnitColumns:
    """The columns A R of unit covariance, made of some rows at a time: three numbers a row, r of each."""

    def __init__(self, fitted: Fitted) -> None:
        self._fitted = fitted
        # Each is a copy: of ten million rows that would be half of the work, were it made for each chunk of them.
        self._root, self._used = fitted.solved.solution.covariance_root, fitted.solved.used.astype(np.float64)

    @property
    def rank(self) -> int:
        return int(self._root.shape[1])

    def of(self, rows: np.ndarray) -> Numbers:
        """Give those of some rows, (k, 3, r)."""
        fitted = self._fitted
        return fitted.problem.times(fitted.state_of_columns, self._root, self._used, fitted.threads, rows)

    def sums(self, weights: Numbers, blocks: Blocks) -> tuple[Numbers, Numbers]:
        """Sum them up.

        Returns
        -------
        grams : (3, r, r)
            Products of the columns with each other, each component's rows.
        by_block : (3, n_blocks, r)
            Sums over the rows of each block: what an offset of the block moves.
        """
        n_rows = len(weights)
        grams, by_block = np.zeros((3, self.rank, self.rank)), np.zeros((3, len(blocks), self.rank))
        at_once = max(_MOST_NUMBERS // (3 * self.rank), 1)
        for first in range(0, n_rows, at_once):
            rows = slice(first, min(first + at_once, n_rows))
            columns = self.of(np.arange(rows.start, rows.stop))
            order = np.argsort(blocks.block[rows], kind="stable")
            own, starts = np.unique(blocks.block[rows][order], return_index=True)
            for component in range(3):
                grams[component] += columns[:, component].T @ columns[:, component]
                weighed = weights[rows, component, None] * columns[:, component]
                by_block[component, own] += np.add.reduceat(weighed[order], starts, axis=0)
        return grams, by_block


def _is_certain(sums: NoiseSums, noise: NoiseModel) -> bool:
    """Tell whether rows share something: by the ratio of restricted likelihoods with and without."""
    if not (noise.offset.any() or noise.drift.any()):
        return False
    logs = noise.logs
    logs[:, 1:3] = -np.inf
    n_numbers = np.maximum((sums.weights > 0.0).sum(axis=0) - np.einsum("ncr,ncr->c", sums.basis, sums.basis), 1.0)
    alone = np.inf
    for _ in range(_STEPS):
        alone, gradient = sums.minus_twice_log_likelihood(logs)
        # With a share r of the scatter it is n (1 − r), and ln r is what is missing.
        logs[:, 0] += np.log(np.maximum(1.0 - gradient[:, 0] / n_numbers, _LEAST_SHARE))
    gain = alone + 2.0 * noise.log_likelihood
    return float(chi_squared_sf(gain, _N_SHARED)) < _SIGNIFICANCE


def _moved(noise: NoiseModel, by_block: Numbers) -> Numbers:
    """Give the root (r, r) of Σ_c σ_c² (A_c R)ᵀ Z C_c Zᵀ (A_c R), what the offsets of all blocks move."""
    covariance = np.zeros((by_block.shape[2],) * 2)
    for component in range(3):
        offset, drift, memory = (float(one[component]) for one in (noise.offset, noise.drift, noise.memory))
        for own in noise.blocks.slices:
            moved = by_block[component, own]
            shared = offset**2 * _by_offsets(moved, noise.blocks.pass_number[own])
            shared += drift**2 * _by_drift(moved, noise.blocks.time[own] / memory)
            covariance += noise.sigma[component] ** 2 * shared
    return root_of(covariance)


def _by_offsets(moved: Numbers, pass_number: np.ndarray) -> Numbers:
    """Give Mᵀ [same pass] M of what blocks move, M (k, r): products of each pass's sums."""
    order = np.argsort(pass_number, kind="stable")
    _, starts = np.unique(pass_number[order], return_index=True)
    of_passes = np.add.reduceat(moved[order], starts, axis=0)
    return np.asarray(of_passes.T @ of_passes)


def _by_drift(moved: Numbers, time: Numbers) -> Numbers:
    """Give Mᵀ exp(−|t − t'|) M of what blocks move, M (k, r), at times (k,) that rise, in units of the memory.

    What is before a stretch of blocks reaches all of it through its first time: each pair once, at a cost that grows
    with k and not with its square.
    """
    covariance = np.zeros((moved.shape[1],) * 2)
    # What all blocks before have left, as the last of them has it.
    left, last = np.zeros(moved.shape[1]), -np.inf
    for first in range(0, len(moved), _BLOCKS_AT_ONCE):
        own, at = moved[first : first + _BLOCKS_AT_ONCE], time[first : first + _BLOCKS_AT_ONCE]
        covariance += own.T @ (np.exp(-np.abs(at[:, None] - at[None, :])) @ own)
        across = np.outer(np.exp(last - at) @ own, left)
        covariance += across + across.T
        left, last = np.exp(last - at[-1]) * left + np.exp(at - at[-1]) @ own, float(at[-1])
    return covariance


def _counted(fitted: Fitted, noise: NoiseModel, grams: Numbers, by_block: Numbers) -> Fitted:
    """Give the fit with the covariance by this noise, of whose columns these are the sums."""
    n_coefficients = fitted.compiled.n_coefficients
    # How sure the moment of a jump is follows from no derivative.
    jumps = [n_coefficients + place for place, is_jump in enumerate(_are_jumps(fitted.terms)) if is_jump]
    gain = np.zeros((len(fitted.covariance), grams.shape[1]))
    places = fitted.places_of_unknowns
    gain[places] = fitted.root[: len(places)]
    gain[jumps] = 0.0
    least = 1.0 if fitted.sightings.is_stated else 0.0
    # Of a component that nobody measured nothing is moved.
    is_used = np.einsum("cii->c", grams) > 0.0
    scatter = np.where(is_used, np.maximum(noise.sigma, least), 0.0)
    shared = SharedNoise(scatter, grams, gain, gain @ _moved(noise, by_block))
    parts = [shared.scatter_root(), shared.root]
    if fitted.prior is not None:
        parts.append(fitted.unit * gain @ (fitted.prior @ fitted.solved.solution.covariance_root).T)
    # Of a root: no variance becomes negative by rounding.
    root = np.concatenate(parts, axis=1)
    covariance = root @ root.T
    covariance[jumps, jumps] = fitted.covariance[jumps, jumps]
    errors = np.sqrt(np.maximum(np.diagonal(covariance), 0.0)).tolist()
    terms = _with_errors(fitted.terms, errors[:n_coefficients], errors[n_coefficients:])
    return _beside_what_is_known(fitted, replace(fitted, covariance=covariance, shared_noise=shared, terms=terms))


def _beside_what_is_known(fitted: Fitted, counted: Fitted) -> Fitted:
    """Give the second with what was worked out of the first: held-out errors follow from no covariance."""
    own = {field.name for field in fields(fitted)}
    counted.__dict__.update({name: value for name, value in fitted.__dict__.items() if name not in own})
    return counted


def _are_jumps(terms: Sequence[Term]) -> list[bool]:
    return [place in jump_places(term) for term in terms for place in range(len(term.inner))]


def _with_errors(
    terms: tuple[Term, ...], of_coefficients: Sequence[float], of_inner: Sequence[float]
) -> tuple[Term, ...]:
    """Give terms with other standard errors; what has none keeps none."""
    coefficients, inner = iter(of_coefficients), iter(of_inner)

    def errors(parameters: Sequence[Parameter], found: Iterator[float]) -> list[float]:
        return [error if math.isfinite(one.std) else one.std for one, error in zip(parameters, found, strict=False)]

    return tuple(
        term.with_values(
            coefficients_std=errors(term.coefficients, coefficients), inner_std=errors(term.inner, inner)
        )
        for term in terms
    )
