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
from dataclasses import replace

import numpy as np

from geoerr.distributions import chi_squared_sf
from geoerr.fit.covariance_parts import SharedNoise
from geoerr.fit.fitted import Fitted
from geoerr.fit.jumps import jump_places
from geoerr.fit.noise_model import NoiseModel, NoiseSums, blocks_of, offset_weights
from geoerr.fit.sightings import Numbers
from geoerr.terms import Parameter, Term

# Less probable than this, what rows share is not chance (as for the fit's own scale).
_SIGNIFICANCE = 0.01
# Numbers of what rows share: offset, drift and its memory, of three components.
_N_SHARED = 9
# Steps to the scatter of rows that share nothing; each leaves a hundredth of what was missing.
_STEPS = 4


def with_shared_noise(fitted: Fitted) -> Fitted:
    """Give a fit whose covariance and standard errors count what rows share; the same where they share nothing.

    A fit to lengths stays as it is: they are differences, of passes that share no offset.
    """
    sightings, solved = fitted.sightings, fitted.solved
    root = solved.solution.covariance_root
    if sightings.has_lengths_only or sightings.n_passes < 2 or not root.shape[1] or fitted.dof <= 0:
        return fitted
    used = solved.used.astype(np.float64)
    columns = fitted.problem.times(solved.design_state, root, used, fitted.threads)
    columns = columns.reshape(len(sightings), 3, -1)
    weights = offset_weights(sightings, solved.used)
    residual = solved.whitened * (weights > 0.0)
    sums = NoiseSums(blocks_of(sightings), weights, residual, columns, threads=fitted.threads)
    noise = sums.fit()
    return _counted(fitted, noise, columns) if _is_certain(sums, noise) else fitted


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
        logs[:, 0] -= gradient[:, 0] / n_numbers
    gain = alone + 2.0 * noise.log_likelihood
    return float(chi_squared_sf(gain, _N_SHARED)) < _SIGNIFICANCE


def _moved(noise: NoiseModel, columns: Numbers) -> Numbers:
    """Give σ (A R)ᵀ Z C^(1/2), (rank, k): what the offsets of all blocks move, one component beside another."""
    blocks = noise.blocks
    roots = []
    for component in range(3):
        moved = np.zeros((len(blocks), columns.shape[2]))
        np.add.at(moved, blocks.block, noise.weights[:, component, None] * columns[:, component])
        for own in blocks.slices:
            root = _root_of_session(noise, component, own)
            roots.append(noise.sigma[component] * moved[own].T @ root)
    return np.concatenate(roots, axis=1)


def _root_of_session(noise: NoiseModel, component: int, own: slice) -> Numbers:
    """Give C^(1/2) of the blocks of one session."""
    blocks = noise.blocks
    same_pass = blocks.pass_number[own, None] == blocks.pass_number[None, own]
    apart = np.abs(blocks.time[own, None] - blocks.time[None, own])
    offset, drift, memory = (float(one[component]) for one in (noise.offset, noise.drift, noise.memory))
    value, vector = np.linalg.eigh(offset**2 * same_pass + drift**2 * np.exp(-apart / memory))
    return np.asarray(vector * np.sqrt(np.maximum(value, 0.0)))


def _counted(fitted: Fitted, noise: NoiseModel, columns: Numbers) -> Fitted:
    """Give the fit with the covariance by this noise."""
    n_coefficients = fitted.compiled.n_coefficients
    inner = [one for term in fitted.terms for one in term.inner]
    free = [n_coefficients + place for place, one in enumerate(inner) if not one.is_fixed]
    places = [*range(n_coefficients), *free]
    # How sure the moment of a jump is follows from no derivative.
    jumps = [n_coefficients + place for place, is_jump in enumerate(_are_jumps(fitted.terms)) if is_jump]
    gain = np.zeros((len(fitted.covariance), columns.shape[2]))
    gain[places] = fitted.root[: len(places)]
    gain[jumps] = 0.0
    least = 1.0 if fitted.sightings.is_stated else 0.0
    scatter = np.clip(noise.sigma, least, max(fitted.unit, least))
    grams = np.stack([columns[:, component].T @ columns[:, component] for component in range(3)])
    shared = SharedNoise(scatter, grams, gain, gain @ _moved(noise, columns))
    by_prior = fitted.unit**2 * (np.eye(columns.shape[2]) - grams.sum(axis=0))
    by_scatter = np.einsum("c,cij->ij", scatter**2, grams)
    covariance = gain @ (by_scatter + by_prior) @ gain.T + shared.root @ shared.root.T
    covariance[jumps, jumps] = fitted.covariance[jumps, jumps]
    errors = np.sqrt(np.maximum(np.diagonal(covariance), 0.0)).tolist()
    terms = _with_errors(fitted.terms, errors[:n_coefficients], errors[n_coefficients:])
    return replace(fitted, covariance=covariance, shared_noise=shared, terms=terms)


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
