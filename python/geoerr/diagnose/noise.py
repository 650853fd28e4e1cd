"""Noise as it is: scatter from row to row, an offset of each pass, a slow drift within each session.

For each component c of the whitened residual the covariance is

    V_c = σ_c² (I + Z C_c Zᵀ),   C_c = a_c² [same pass] + b_c² exp(−|t − t'| / τ_c) [same session],

Z the membership of rows in blocks: runs of neighbouring rows of one pass. The drift is the device's, so that rows
of a static reference marker share it with the rows of the machine: where there are such rows, generalised least
squares takes off what the marker shows.

| symbol | code | what |
|---|---|---|
| U | `unit` | Z with columns of length 1; K = N^½ C N^½, so that V = σ²(I + U K Uᵀ) |
| T | `transforms` | inverse Cholesky factor of I + K in the order of time: σ⁻¹(I + U (T − I) Uᵀ) whitens |
| A | `basis` | orthonormal columns of what the fit is free to do |

The four numbers of each component maximise the restricted likelihood, which charges for A; all that depends on them
are sums by blocks. A test holds it to the likelihood written out with dense matrices.

Source: Harville, Maximum likelihood approaches to variance component estimation, JASA 72 (1977).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy import linalg, optimize, sparse

from geoerr.fit.sightings import Numbers, Sightings
from geoerr.fit.variables import times_s

# Rows of a block: over so few a slow drift is constant, and a pass of 40 points still has two.
_BLOCK_ROWS = 24
# Blocks of one session: what their matrices cost grows with the cube.
_MOST_BLOCKS = 160
# Variance ratios beyond these are nothing, or all there is.
_LEAST_LOG, _MOST_LOG = -16.0, 9.0
# A drift that forgets within a pass is that pass's offset; one beyond this many sessions is a straight line.
_LONGEST_SESSIONS = 2.0
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


def blocks_of(sightings: Sightings) -> Blocks:
    """Cut every pass into runs of neighbouring rows."""
    n = len(sightings)
    times = times_s(sightings)
    order = np.lexsort((np.arange(n), times, sightings.pass_number))
    per_session = np.bincount(sightings.session, minlength=len(sightings.sessions))
    size = np.maximum(_BLOCK_ROWS, np.ceil(per_session / _MOST_BLOCKS)).astype(np.int64)
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
    unit
        For each component U (n, n_blocks), sparse.
    transforms
        For each component and session T − I.
    log_likelihood
        Of the data, restricted or not as it was asked for.
    """

    blocks: Blocks
    sigma: Numbers
    offset: Numbers
    drift: Numbers
    memory: Numbers
    unit: tuple[sparse.csr_array, ...]
    transforms: tuple[tuple[Numbers, ...], ...]
    log_likelihood: float

    def whiten(self, values: Numbers) -> Numbers:
        """Apply V^(-1/2) to values (n, 3) or (n, 3, m)."""
        return self._apply(values, transposed=False)

    def whiten_transposed(self, values: Numbers) -> Numbers:
        """Apply the transpose of V^(-1/2) to values (n, 3) or (n, 3, m)."""
        return self._apply(values, transposed=True)

    def unwhiten(self, values: Numbers) -> Numbers:
        """Undo `whiten` for values (n, 3)."""
        result = np.empty_like(values)
        for c in range(3):
            sums = self.unit[c].T @ values[:, c]
            more = np.empty_like(sums)
            for own, less_one in zip(self.blocks.slices, self.transforms[c], strict=True):
                whole = less_one + np.eye(len(less_one))
                more[own] = linalg.solve_triangular(whole, sums[own], lower=True) - sums[own]
            result[:, c] = self.sigma[c] * (values[:, c] + self.unit[c] @ more)
        return result

    def _apply(self, values: Numbers, *, transposed: bool) -> Numbers:
        result = np.empty_like(values)
        for c in range(3):
            sums = self.unit[c].T @ values[:, c]
            result[:, c] = (values[:, c] + self.unit[c] @ self.less_one(c, sums, transposed=transposed)) / self.sigma[
                c
            ]
        return result

    def less_one(self, component: int, sums: Numbers, *, transposed: bool = False) -> Numbers:
        """Apply T − I to sums by block (n_blocks, ...)."""
        result = np.empty_like(sums)
        for own, less_one in zip(self.blocks.slices, self.transforms[component], strict=True):
            result[own] = (less_one.T if transposed else less_one) @ sums[own]
        return result


class _Sums:
    """All of the likelihood that does not depend on the parameters."""

    def __init__(self, blocks: Blocks, weights: Numbers, residual: Numbers, basis: Numbers) -> None:
        n = len(residual)
        self.blocks = blocks
        self.n_numbers = (weights > 0.0).sum(axis=0)
        self.unit, self.root_count, self.g, self.g_basis, self.inside, self.pull, self.square = (
            [],
            [],
            [],
            [],
            [],
            [],
            [],
        )
        for c in range(3):
            own, y = basis[:, c], residual[:, c]
            length = np.sqrt(np.bincount(blocks.block, weights=weights[:, c] ** 2, minlength=len(blocks)))
            data = weights[:, c] / np.maximum(length, 1e-300)[blocks.block]
            unit = sparse.csr_array((data, blocks.block, np.arange(n + 1)), shape=(n, len(blocks)))
            self.unit.append(unit)
            self.root_count.append(length)
            sums, sums_basis = unit.T @ y, unit.T @ own
            self.g.append(sums)
            self.g_basis.append(sums_basis)
            self.inside.append(own.T @ own - sums_basis.T @ sums_basis)
            self.pull.append(own.T @ y - sums_basis.T @ sums)
            self.square.append(float(y @ y - sums @ sums))
        same = blocks.pass_number[:, None] == blocks.pass_number
        self.same = [same[own, own].astype(np.float64) for own in blocks.slices]
        self.apart = [np.abs(blocks.time[own, None] - blocks.time[None, own]) for own in blocks.slices]

    def covariance(self, c: int, number: int, a2: float, b2: float, tau: float) -> tuple[Numbers, Numbers]:
        """Give K of one session, and the part of it that is drift."""
        root = self.root_count[c][self.blocks.slices[number]]
        drift = b2 * np.exp(-self.apart[number] / tau) * (root[:, None] * root)
        return a2 * self.same[number] * (root[:, None] * root) + drift, drift


def fit_noise(
    blocks: Blocks,
    weights: Numbers,
    residual: Numbers,
    basis: Numbers,
    *,
    restricted: bool = True,
    start: NoiseModel | None = None,
) -> NoiseModel:
    """Fit the noise of whitened residuals.

    Parameters
    ----------
    weights : (n, 3)
        What an offset of one unit does to each number: 0 where nothing was measured or used.
    residual : (n, 3)
        What the fit leaves, whitened by the stated uncertainties; 0 where `weights` is.
    basis : (n, 3, r)
        Columns of what the fit is free to do, orthonormal or nearly.
    restricted
        Whether the likelihood charges for `basis`; to compare models with different columns it must not.
    start
        A model to start from.
    """
    sums = _Sums(blocks, weights, residual, basis)
    used = [c for c in range(3) if sums.n_numbers[c] > 0]
    low = np.log(blocks.shortest)
    high = np.log(_LONGEST_SESSIONS)
    first, bounds = [], []
    n_all = max(int(sums.n_numbers.sum()) - basis.shape[2], 1)
    level = float((residual**2).sum()) / n_all
    for c in used:
        if start is None:
            first += [np.log(max(level, 1e-300)), -3.0, -3.0, 0.5 * (low + high)]
        else:
            least = np.exp(0.5 * _LEAST_LOG)
            first += [
                *(2.0 * np.log(max(v[c], least)) for v in (start.sigma, start.offset, start.drift)),
                float(np.log(start.memory[c])),
            ]
        bounds += [(None, None), (_LEAST_LOG, _MOST_LOG), (_LEAST_LOG, _MOST_LOG), (min(low, high - 0.1), high)]
    found = optimize.minimize(
        _minus_twice_log_likelihood,
        np.clip(
            first,
            [-np.inf if b[0] is None else b[0] for b in bounds],
            [np.inf if b[1] is None else b[1] for b in bounds],
        ),
        args=(sums, used, restricted),
        jac=True,
        method="L-BFGS-B",
        bounds=bounds,
        options={"maxiter": 60, "ftol": 1e-7 if start is None else 1e-6},
    )
    sigma, offset, drift, memory = np.ones(3), np.zeros(3), np.zeros(3), np.ones(3)
    for place, c in enumerate(used):
        own = found.x[4 * place : 4 * place + 4]
        sigma[c], offset[c], drift[c] = np.exp(0.5 * own[:3])
        memory[c] = np.exp(own[3])
    return NoiseModel(
        blocks,
        sigma,
        offset,
        drift,
        memory,
        tuple(sums.unit),
        _transforms(sums, offset, drift, memory),
        -0.5 * float(found.fun),
    )


def without_drift(noise: NoiseModel, weights: Numbers) -> NoiseModel:
    """Give a noise model with no drift: to see what drift would hide.

    Parameters
    ----------
    weights : (n, 3)
        As for `fit_noise`.
    """
    sums = _Sums(noise.blocks, weights, np.zeros_like(weights), np.zeros((*weights.shape, 0)))
    none = np.zeros(3)
    transforms = _transforms(sums, noise.offset, none, noise.memory)
    return replace(noise, drift=none, transforms=transforms)


def _transforms(sums: _Sums, offset: Numbers, drift: Numbers, memory: Numbers) -> tuple[tuple[Numbers, ...], ...]:
    """Give T − I of each component and session."""
    transforms = []
    for c in range(3):
        rows = []
        for number, own in enumerate(sums.blocks.slices):
            size = own.stop - own.start
            k, _ = sums.covariance(c, number, offset[c] ** 2, drift[c] ** 2, memory[c])
            factor = np.linalg.cholesky(np.eye(size) + k)
            rows.append(linalg.solve_triangular(factor, np.eye(size), lower=True) - np.eye(size))
        transforms.append(tuple(rows))
    return tuple(transforms)


def _minus_twice_log_likelihood(
    parameters: Numbers, sums: _Sums, used: list[int], restricted: bool
) -> tuple[float, Numbers]:
    """Give −2 ln L, but for a constant, and its gradient by (ln σ², ln a², ln b², ln τ) of each component."""
    r = sums.inside[0].shape[0]
    h, pull = np.zeros((r, r)), np.zeros(r)
    value = 0.0
    kept = []
    for place, c in enumerate(used):
        s2, a2, b2, tau = np.exp(parameters[4 * place : 4 * place + 4])
        inside, along, square = sums.inside[c].copy(), sums.pull[c].copy(), sums.square[c]
        value += sums.n_numbers[c] * np.log(s2)
        sessions = []
        for number, own in enumerate(sums.blocks.slices):
            k, drift = sums.covariance(c, number, a2, b2, tau)
            factor = np.linalg.cholesky(np.eye(len(k)) + k)
            inverse_root = linalg.solve_triangular(factor, np.eye(len(k)), lower=True, check_finite=False)
            x, y = inverse_root @ sums.g_basis[c][own], inverse_root @ sums.g[c][own]
            inside += x.T @ x
            along += x.T @ y
            square += float(y @ y)
            value += 2.0 * float(np.log(np.diag(factor)).sum())
            sessions.append((k, drift, inverse_root, x, y))
        h += inside / s2
        pull += along / s2
        value += square / s2
        kept.append((s2, inside, along, square, sessions))
    root = np.linalg.cholesky(h + 1e-12 * np.trace(h) / max(r, 1) * np.eye(r))
    root_inverse = linalg.solve_triangular(root, np.eye(r), lower=True, check_finite=False)
    shift = root_inverse.T @ (root_inverse @ pull)
    value -= float(pull @ shift)
    if restricted:
        value += 2.0 * float(np.log(np.diag(root)).sum())
    gradient = np.zeros(len(parameters))
    for place, c in enumerate(used):
        s2, inside, along, square, sessions = kept[place]
        quadratic = square - 2.0 * float(along @ shift) + float(shift @ inside @ shift)
        gradient[4 * place] = sums.n_numbers[c] - quadratic / s2
        if restricted:
            gradient[4 * place] -= float(((root_inverse @ inside) * root_inverse).sum()) / s2
        for number, (k, drift, inverse_root, x, y) in enumerate(sessions):
            p = inverse_root.T @ inverse_root
            if restricted:
                part = inverse_root.T @ (x @ root_inverse.T)
                p = p - part @ part.T / s2
            q = inverse_root.T @ (y - x @ shift)
            weight = p - np.outer(q, q) / s2
            tau = float(np.exp(parameters[4 * place + 3]))
            gradient[4 * place + 1] += float((weight * (k - drift)).sum())
            gradient[4 * place + 2] += float((weight * drift).sum())
            gradient[4 * place + 3] += float((weight * drift * (sums.apart[number] / tau)).sum())
    return value, gradient
