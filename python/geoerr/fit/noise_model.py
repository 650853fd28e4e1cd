"""Noise as it is: scatter from row to row, an offset of each pass, a slow drift within each session.

For each component c of the whitened residual the covariance is

    V_c = σ_c² (I + Z C_c Zᵀ),   C_c = a_c² [same pass] + b_c² exp(−|t − t'| / τ_c) [same session]

Z the membership of rows in blocks: runs of neighbouring rows of one pass. The drift is the device's, so that rows
of a static reference marker share it with the rows of the machine: where there are such rows, generalised least
squares takes off what the marker shows.

| symbol | code | what |
|---|---|---|
| U | `weights` | Z with columns of length 1; K = N^½ C N^½, so that V = σ²(I + U K Uᵀ) |
| T | `whitening` | inverse Cholesky factor of I + K in the order of time: σ⁻¹(I + U (T − I) Uᵀ) whitens |
| A | `basis` | orthonormal columns of what the fit is free to do |

The four numbers of each component maximise the restricted likelihood, which charges for A. The arithmetic is the
core's (`geoerr_core::noise_likelihood`); a test holds it to the likelihood written out with dense matrices.

Source: Harville, Maximum likelihood approaches to variance component estimation, JASA 72 (1977).
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from geoerr import _core
from geoerr.fit.sightings import Numbers, Sightings
from geoerr.fit.variables import times_s

# Rows of a block: over so few a slow drift is constant, and a pass of 40 points still has two. In a short session a
# drift is faster, by rows: it has so many blocks, of so many rows at least. With fewer, a random walk was named in
# half of all runs (validation/short_runs.py).
_BLOCK_ROWS, _LEAST_ROWS = 24, 4
_ENOUGH_BLOCKS = 80
# Blocks of one session: what their matrices cost grows with the cube.
_MOST_BLOCKS = 160
# Beyond so many standard deviations a residual counts as one of so many: once in 150,000 by chance.
WINSOR = 4.5


@dataclass(frozen=True, eq=False)
class Blocks:
    """Which block each row belongs to.

    Attributes
    ----------
    block : (n,)
        Number of each row's block; blocks are sorted by session, then time.
    session, pass_number : (n_blocks,)
    time : (n_blocks,)
        Mean time, in units of its session's span.
    shortest
        Drifts that forget faster (same unit) are no drifts.
    """

    block: np.ndarray
    session: np.ndarray
    pass_number: np.ndarray
    time: Numbers
    shortest: float

    def __len__(self) -> int:
        return len(self.session)

    @cached_property
    def slices(self) -> tuple[slice, ...]:
        """Blocks of each session."""
        starts = np.searchsorted(self.session, np.unique(self.session))
        return tuple(slice(int(a), int(b)) for a, b in zip(starts, [*starts[1:], len(self)], strict=True))

    @property
    def core(self) -> _core.NoiseBlocks:
        """The same, as the core has it."""
        starts = np.array([own.start for own in self.slices], dtype=np.int64)
        numbers = self.block.astype(np.int64), starts, self.pass_number.astype(np.int64)
        return _core.NoiseBlocks(*numbers, np.ascontiguousarray(self.time))


def blocks_of(sightings: Sightings) -> Blocks:
    """Cut every pass into runs of neighbouring rows."""
    n = len(sightings)
    times = times_s(sightings)
    order = np.lexsort((np.arange(n), times, sightings.pass_number))
    per_session = np.bincount(sightings.session, minlength=len(sightings.sessions))
    size = np.clip(np.ceil(per_session / _ENOUGH_BLOCKS), _LEAST_ROWS, _BLOCK_ROWS)
    size = np.maximum(size, np.ceil(per_session / _MOST_BLOCKS)).astype(np.int64)
    passes = sightings.pass_number[order]
    first = np.searchsorted(passes, passes)
    count = np.bincount(passes)[passes]
    n_runs = np.maximum(np.rint(count / size[sightings.session[order]]), 1).astype(np.int64)
    run = (np.arange(n) - first) * n_runs // count
    _, label = np.unique(passes * (n + 1) + run, return_inverse=True)
    raw = np.empty(n, dtype=np.int64)
    raw[order] = label.ravel()
    n_blocks = int(raw.max()) + 1
    rows = np.bincount(raw, minlength=n_blocks)
    time = np.zeros(n_blocks)
    shortest = []
    for number in range(len(sightings.sessions)):
        own = np.flatnonzero(sightings.session == number)
        if not own.size:
            continue
        span = max(float(np.ptp(times[own])), 1e-300)
        at = (times[own] - times[own].min()) / span
        time += np.bincount(raw[own], weights=at, minlength=n_blocks) / rows
        shortest.append(1.5 / max(len(np.unique(raw[own])), 1))
    session = np.zeros(n_blocks, dtype=np.int64)
    session[raw] = sightings.session
    pass_number = np.zeros(n_blocks, dtype=np.int64)
    pass_number[raw] = sightings.pass_number
    sort = np.lexsort((time, session))
    place = np.empty(n_blocks, dtype=np.int64)
    place[sort] = np.arange(n_blocks)
    return Blocks(place[raw], session[sort], pass_number[sort], time[sort], float(np.median(shortest)))


@dataclass(frozen=True, eq=False)
class NoiseModel:
    """The noise of whitened residuals.

    Attributes
    ----------
    blocks
        Which rows belong together.
    sigma : (3,)
        Scatter from row to row, in units of the stated standard uncertainty.
    offset, drift : (3,)
        Standard deviations of a pass's offset and of the drift, in units of `sigma`.
    memory : (3,)
        τ, in units of a session's span.
    weights : (n, 3)
        What an offset of one unit does to each number.
    log_likelihood
        Of the data, restricted or not as it was asked for.
    threads
        That work with it; 0 for all cores.
    """

    blocks: Blocks
    sigma: Numbers
    offset: Numbers
    drift: Numbers
    memory: Numbers
    weights: Numbers
    log_likelihood: float
    threads: int = 0

    @cached_property
    def whitening(self) -> _core.NoiseWhitening:
        """What whitens it, as the core has it."""
        return self.blocks.core.whitening(self.weights, self.logs)

    def whiten(self, values: Numbers) -> Numbers:
        """Apply V^(-1/2) to values (n, 3) or (n, 3, m)."""
        return self.whitening.whiten(_wide(values), self.threads).reshape(values.shape)

    def whiten_transposed(self, values: Numbers) -> Numbers:
        """Apply the transpose of V^(-1/2) to values (n, 3) or (n, 3, m)."""
        return self.whitening.whiten_transposed(_wide(values), self.threads).reshape(values.shape)

    def unwhiten(self, values: Numbers) -> Numbers:
        """Undo `whiten` for values (n, 3) or (n, 3, m)."""
        return self.whitening.unwhiten(_wide(values), self.threads).reshape(values.shape)

    def take_off(self, drawn: np.ndarray, basis: Numbers, *, size: float = 1.0, threads: int = 0) -> None:
        """Take off whitened draws (n, 3, n_draws), in place, what a fit is free to do, and whiten each by its noise.

        That is the noise that would be fitted to it: what looks like a drift is taken for one.

        Parameters
        ----------
        drawn
            In single precision, C-contiguous.
        basis
            Orthonormal columns (n, 3, r) of what a fit is free to do.
        size
            Standard deviation of the draws, where tails were cut off.
        """
        columns, shortest = np.ascontiguousarray(basis), self.blocks.shortest
        self.blocks.core.take_off(drawn, columns, self.weights, self.logs, shortest, size, threads)

    @property
    def logs(self) -> Numbers:
        """Logarithms of σ², a², b² and τ of each component, (3, 4)."""
        with np.errstate(divide="ignore"):
            variances = 2.0 * np.log([self.sigma, self.offset, self.drift])
        return np.ascontiguousarray(np.vstack([variances, np.log(self.memory)]).T)


class NoiseSums:
    """What the likelihood of noise depends on besides its parameters, summed up once for any number of fits.

    Parameters
    ----------
    weights : (n, 3)
        What an offset of one unit does to each number: 0 where nothing was measured or used.
    residual : (n, 3)
        What the fit leaves, whitened by the stated uncertainties; 0 where `weights` is.
    basis : (n, 3, r)
        Columns of what the fit is free to do, orthonormal or nearly.
    """

    def __init__(
        self, blocks: Blocks, weights: Numbers, residual: Numbers, basis: Numbers, *, threads: int = 0
    ) -> None:
        self.blocks, self.threads = blocks, threads
        self.weights, self.residual = np.ascontiguousarray(weights), np.ascontiguousarray(residual)
        self._columns: tuple[Numbers, ...] = (np.ascontiguousarray(basis),)
        self._core = blocks.core.likelihood(self.weights, self.residual, self.basis, threads)

    @cached_property
    def basis(self) -> Numbers:
        """All columns, (n, 3, r)."""
        return self._columns[0] if len(self._columns) == 1 else np.concatenate(self._columns, axis=2)

    def with_columns(self, columns: Numbers) -> NoiseSums:
        """Give the sums with more columns (n, 3, k) in the basis; those that are known are not made again."""
        more = copy(self)
        more.__dict__.pop("basis", None)
        more._columns = (*self._columns, np.ascontiguousarray(columns))
        more._core = self._core.with_columns(self.weights, self.residual, self.basis, more._columns[-1], self.threads)
        return more

    def fit(self, *, restricted: bool = True, start: NoiseModel | None = None) -> NoiseModel:
        """Fit the noise; as `fit_noise`."""
        logs, minus_twice, _ = self._core.fit(
            None if start is None else start.logs, self.blocks.shortest, restricted, self.threads
        )
        used = np.array(self._core.is_used)
        sigma, offset, drift = np.where(used, np.exp(0.5 * logs[:, :3].T), np.array([[1.0], [0.0], [0.0]]))
        memory = np.where(used, np.exp(logs[:, 3]), 1.0)
        log_likelihood = -0.5 * minus_twice
        return NoiseModel(self.blocks, sigma, offset, drift, memory, self.weights, log_likelihood, self.threads)

    def minus_twice_log_likelihood(self, logs: Numbers, *, restricted: bool = True) -> tuple[float, Numbers]:
        """Give −2 ln L, but for a constant, and its gradient.

        Parameters
        ----------
        logs : (3, 4)
            ln σ², ln a², ln b², ln τ of each component.
        """
        return self._core.minus_twice_ln(np.ascontiguousarray(logs), restricted, self.threads)

    def whitened_basis(self, noise: NoiseModel) -> Numbers | None:
        """Give an orthonormal basis of the whitened columns, (n, 3, r); None where they are too much alike."""
        return self._core.whitened_basis(self.weights, self.basis, noise.logs, self.threads)


def fit_noise(
    blocks: Blocks,
    weights: Numbers,
    residual: Numbers,
    basis: Numbers,
    *,
    restricted: bool = True,
    start: NoiseModel | None = None,
    threads: int = 0,
) -> NoiseModel:
    """Fit the noise of whitened residuals.

    Parameters
    ----------
    weights, residual, basis
        As for `NoiseSums`.
    restricted
        Whether the likelihood charges for `basis`; to compare models with different columns it must not.
    start
        A model to start from.
    """
    return NoiseSums(blocks, weights, residual, basis, threads=threads).fit(restricted=restricted, start=start)


def offset_weights(sightings: Sightings, used: np.ndarray) -> Numbers:
    """Give what an offset of the device does to each whitened number, (n, 3): 1 on average, 0 where none counts."""
    weights = np.einsum("nii->ni", sightings.whitening) * sightings.is_measured * used[:, None]
    mean = weights.sum(axis=0) / np.maximum((weights > 0.0).sum(axis=0), 1)
    return np.asarray(weights / np.where(mean > 0.0, mean, 1.0))


def without_drift(noise: NoiseModel, *, without_offsets: bool = False) -> NoiseModel:
    """Give a noise model with no drift, or with neither drift nor offsets: to see what they would hide."""
    return replace(noise, drift=np.zeros(3), offset=np.zeros(3) if without_offsets else noise.offset)


def _wide(values: Numbers) -> Numbers:
    return np.ascontiguousarray(values.reshape(len(values), 3, -1))
