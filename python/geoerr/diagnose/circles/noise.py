"""Noise of circular runs: scatter from row to row, and what wanders along the circle and differs from run to run.

A bar is read at one feed along one path, so that its noise is correlated with the angle: vibration that is not
periodic, feed fluctuation, dirt under the balls, warming. Each run is a realisation of its own with the covariance

    V = σ² s² (I + U K Uᵀ),   K = Σ_j θ_j exp(−|φ − φ'| / ℓ_j) + Σ_k θ_k exp(−(φ − φ')² / (2 ℓ_k²)) + θ_0,

φ the angle travelled, ℓ_j from 3 degrees to two turns, ℓ_k from 3 to 14 degrees: noise with corners and noise
without, whose sum is close to any spectrum that falls with the frequency. θ_0 is an offset of a run, where runs share
a set-up; a few runs tell it badly, and so its upper bound counts. s is the run's own level, where levels clearly
differ (a higher feed shakes more).

What could be a cause must not count as noise, and noise not as a cause: σ and θ maximise the restricted likelihood,
which charges for the shapes of all causes, so that they are learnt from what no cause could be: the rest of the
spectrum and the difference between runs.

| symbol | code | what |
|---|---|---|
| U | `_sums` | rows of a block of about 3 degrees, columns of length 1 |
| T | `transforms` | inverse Cholesky factor of I + K; σ⁻¹(I + U (T − I) Uᵀ) whitens |
| X | `shapes` | orthonormal columns of set-up and causes |

Source: Harville, Maximum likelihood approaches to variance component estimation, JASA 72 (1977). Verified in
tests/diagnose/test_diagnose_circles.py against the likelihood written out with dense matrices.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy
from scipy import linalg

from geoerr.diagnose.circles.runs import Runs
from geoerr.distributions import chi_squared_ppf
from geoerr.fit.sightings import Numbers

MEMORIES_RAD = tuple(float(np.radians(3.0)) * 4.0**k for k in range(5))
SMOOTH_RAD = tuple(float(np.radians(angle)) for angle in (3.0, 6.5, 14.0))
_N_PARTS = len(MEMORIES_RAD) + len(SMOOTH_RAD)
_BLOCK_RAD = float(np.radians(3.0))
_MOST_BLOCKS = 160
_LEAST_LOG, _MOST_LOG = -14.0, 9.0
_START_LOG = -4.0
# Levels of runs that differ by less than this factor are one.
_OTHER_LEVEL = 1.5
# How strongly doubt about the noise counts against causes, where causes lie. A variance that ν numbers tell is raised
# by 1 + 2·2/ν: about as far out as Student's t lies beyond Gauss at one in a hundred.
CAUTION = 2.0
# The offset of a run is larger than its bound once in ten.
_OFFSET_DOUBT = 0.1
# An offset that is quite unknown: a millimetre.
_FREE_UM2 = 1e6
# No bar tells less than ten nanometres; below it there is rounding.
_LEAST_UM = 0.01
# Standard deviation of Gaussian noise over the median of absolute values.
_NORMAL = 0.6745


@dataclass(frozen=True, eq=False)
class Blocks:
    """Runs of neighbouring rows of one run: `starts` (n_blocks,) of all, `of_run` slices, `angle` (n_blocks,)."""

    starts: np.ndarray
    counts: Numbers
    of_run: tuple[slice, ...]
    angle: Numbers

    def sums(self, columns: Numbers) -> Numbers:
        """Apply Uᵀ to columns (n, k)."""
        return np.asarray(np.add.reduceat(columns, self.starts, axis=0) / np.sqrt(self.counts)[:, None])

    def spread(self, sums: Numbers) -> Numbers:
        """Apply U to sums (n_blocks, k)."""
        return np.asarray(np.repeat(sums / np.sqrt(self.counts)[:, None], self.counts.astype(np.int64), axis=0))


def blocks_of(runs: Runs) -> Blocks:
    """Cut every run into blocks."""
    starts, of_run, first = [], [], 0
    for own in runs.slices:
        n = own.stop - own.start
        turned = float(runs.travelled_rad[own][-1])
        n_blocks = int(min(n, _MOST_BLOCKS, max(round(turned / _BLOCK_RAD), 1)))
        starts.append(own.start + (np.arange(n_blocks) * n) // n_blocks)
        of_run.append(slice(first, first + n_blocks))
        first += n_blocks
    joined = np.concatenate(starts)
    counts = np.diff(np.append(joined, len(runs))).astype(np.float64)
    angle = np.add.reduceat(runs.travelled_rad, joined) / counts
    return Blocks(joined, counts, tuple(of_run), angle)


@dataclass(frozen=True, eq=False)
class Noise:
    """The noise of runs.

    Attributes
    ----------
    blocks
        Its blocks.
    sigma_um
        Scatter from row to row, of a run of level 1 and a row of weight 1.
    theta : (9,)
        Variances of the wandering parts, and of a run's offset, in units of σ².
    level : (n,)
        Of each row: its weight times its run's level.
    transforms
        T − I of each run.
    doubt
        Of a given model: U (n, k), and (1 + g²)^(−1/2) − 1; None where it is sure, or takes part (`with_doubt`).
    """

    blocks: Blocks
    sigma_um: float
    theta: Numbers
    level: Numbers
    transforms: tuple[Numbers, ...]
    doubt: tuple[Numbers, Numbers] | None = None

    def with_doubt(self, doubt_um: Numbers) -> Noise:
        """Give the same with what a given model may be off by beside it: the covariance V + D Dᵀ.

        With V^(-1/2) D = U g W' it is whitened by (I + U ((1 + g²)^(-1/2) − 1) Uᵀ) V^(-1/2): what is off by as much
        is noise, and what is off by far more is not. Verified in tests/diagnose/test_given_model_circles.py.

        Parameters
        ----------
        doubt_um : (n, k)
            Each column one standard deviation, independent of the others.
        """
        if not doubt_um.shape[1]:
            return self
        turn, size, _ = np.linalg.svd(self.whiten(doubt_um), full_matrices=False)
        return replace(self, doubt=(turn, 1.0 / np.sqrt(1.0 + size**2) - 1.0))

    def whiten(self, columns: Numbers) -> Numbers:
        """Apply V^(-1/2) to columns (n, k) or (n,)."""
        flat = columns.reshape(len(columns), -1) / (self.sigma_um * self.level)[:, None]
        sums = self.blocks.sums(flat)
        carried = np.empty_like(sums)
        for own, less_one in zip(self.blocks.of_run, self.transforms, strict=True):
            carried[own] = less_one @ sums[own]
        white = flat + self.blocks.spread(carried)
        if self.doubt is not None:
            turn, less_one = self.doubt
            white = white + turn @ (less_one[:, None] * (turn.T @ white))
        return np.asarray(white.reshape(columns.shape))

    def seen_um(self, set_up: Numbers) -> tuple[float, float]:
        """Give the standard deviations of a row's noise and of its wandering part, as seen beyond the set-up.

        A drift over many turns is a shift of centre and radius; a run's offset is no noise of its course.

        Parameters
        ----------
        set_up : (n, r)
            Orthonormal columns.
        """
        kinds = _kinds(self.blocks, with_offset=False)
        inside = set_up.shape[1] * _among(kinds, self.blocks, set_up)[:-1]
        wander = float(self.theta[:-1] @ np.maximum(1.0 - inside / len(self.level), 0.0))
        scale = self.sigma_um * float(np.sqrt(np.mean(self.level**2)))
        return scale * float(np.sqrt(1.0 + wander)), scale * float(np.sqrt(wander))


class _Geometry:
    """Covariances of one kind of run: which runs have it, and G_j (9, b, b)."""

    def __init__(self, blocks: Blocks, own: slice, *, with_offset: bool) -> None:
        apart = np.abs(blocks.angle[own, None] - blocks.angle[None, own])
        root = np.sqrt(np.outer(blocks.counts[own], blocks.counts[own]))
        parts = [np.exp(-apart / memory) * root for memory in MEMORIES_RAD]
        parts += [np.exp(-0.5 * (apart / width) ** 2) * root for width in SMOOTH_RAD]
        self.parts = np.stack([*parts, root if with_offset else np.zeros_like(root)])
        self.own: list[slice] = []


def fit_noise(runs: Runs, blocks: Blocks, signal_um: Numbers, shapes: Numbers, caution: float = CAUTION) -> Noise:
    """Fit the noise.

    Parameters
    ----------
    signal_um : (n,)
        Measured radius beyond the model.
    shapes : (n, k)
        Columns of set-up and causes; any length, may depend on each other.
    caution
        How strongly doubt about the noise counts; 0 is the restricted likelihood alone.
    """
    level = runs.weight * _levels(runs, signal_um, shapes)[runs.run]
    x = orthonormal(shapes / level[:, None])
    y = signal_um / level
    y = y - x @ (x.T @ y)
    has_offset = len(set(runs.set_up.tolist())) < runs.n_runs
    kinds = _kinds(blocks, with_offset=has_offset)
    sums_x, sums_y = blocks.sums(x), blocks.sums(y[:, None])[:, 0]
    inside = x.T @ x - sums_x.T @ sums_x
    pull = x.T @ y - sums_x.T @ sums_y
    square = float(y @ y - sums_y @ sums_y)
    dof = len(y) - x.shape[1]
    n_free = _N_PARTS + int(has_offset)
    among_causes = _among(kinds, blocks, shapes / level[:, None])

    def objective(log_theta: Numbers) -> tuple[float, Numbers]:
        theta = np.zeros(_N_PARTS + 1)
        theta[:n_free] = np.exp(log_theta)
        a, along, rest = inside.copy(), pull.copy(), square
        value, kept = 0.0, []
        for kind in kinds:
            factor = np.linalg.cholesky(np.eye(kind.parts.shape[1]) + np.tensordot(theta, kind.parts, 1))
            inverse = linalg.solve_triangular(factor, np.eye(len(factor)), lower=True, check_finite=False)
            value += 2.0 * len(kind.own) * float(np.log(np.diag(factor)).sum())
            for own in kind.own:
                tx, ty = inverse @ sums_x[own], inverse @ sums_y[own]
                a += tx.T @ tx
                along += tx.T @ ty
                rest += float(ty @ ty)
                kept.append((kind, inverse, tx, ty))
        root = np.linalg.cholesky(a + 1e-12 * np.trace(a) / max(len(a), 1) * np.eye(len(a)))
        root_inverse = linalg.solve_triangular(root, np.eye(len(a)), lower=True, check_finite=False)
        beta = root_inverse.T @ (root_inverse @ along)
        rss = max(rest - float(along @ beta), 1e-300)
        value += dof * float(np.log(rss)) + 2.0 * float(np.log(np.diag(root)).sum())
        gradient = np.zeros(len(theta))
        scale = dof / rss
        done: dict[int, Numbers] = {}
        for kind, inverse, tx, ty in kept:
            if id(kind) not in done:
                whole = inverse.T @ inverse
                done[id(kind)] = np.einsum("jab,ab->j", kind.parts, whole)
            part = inverse.T @ (tx @ root_inverse.T)
            q = inverse.T @ (ty - tx @ beta)
            gradient += done[id(kind)]
            gradient -= np.einsum("jab,ab->j", kind.parts, part @ part.T + scale * np.outer(q, q))
        level_of_causes = 1.0 + float(theta[:-1] @ among_causes[:-1])
        value -= 2.0 * caution * float(np.log(level_of_causes))
        gradient[:-1] -= 2.0 * caution / level_of_causes * among_causes[:-1]
        return value, (gradient * theta)[:n_free]

    found = scipy.optimize.minimize(
        objective,
        np.full(n_free, _START_LOG),
        jac=True,
        method="L-BFGS-B",
        bounds=[(_LEAST_LOG, _MOST_LOG)] * n_free,
        options={"maxiter": 60, "ftol": 1e-8},
    )
    theta = np.zeros(_N_PARTS + 1)
    theta[:n_free] = np.exp(found.x)
    if has_offset:
        sigma2 = _sigma2(kinds, theta, inside, pull, square, sums_x, sums_y, dof)
        theta[-1] = max(theta[-1], _offset_bound_um2(runs, signal_um, shapes) / max(sigma2, 1e-300))
    transforms: dict[int, Numbers] = {}
    for kind in kinds:
        inverse = _inverse_root(kind, theta)
        for own in kind.own:
            transforms[own.start] = inverse - np.eye(len(inverse))
    sigma = max(_LEAST_UM, float(np.sqrt(_sigma2(kinds, theta, inside, pull, square, sums_x, sums_y, dof))))
    return Noise(blocks, sigma, theta, level, tuple(transforms[own.start] for own in blocks.of_run))


def _inverse_root(kind: _Geometry, theta: Numbers) -> Numbers:
    factor = np.linalg.cholesky(np.eye(kind.parts.shape[1]) + np.tensordot(theta, kind.parts, 1))
    return np.asarray(linalg.solve_triangular(factor, np.eye(len(factor)), lower=True, check_finite=False))


def _sigma2(
    kinds: list[_Geometry],
    theta: Numbers,
    inside: Numbers,
    pull: Numbers,
    square: float,
    sums_x: Numbers,
    sums_y: Numbers,
    dof: int,
) -> float:
    """Give σ² for these ratios."""
    a, along, rest = inside.copy(), pull.copy(), square
    for kind in kinds:
        inverse = _inverse_root(kind, theta)
        for own in kind.own:
            tx, ty = inverse @ sums_x[own], inverse @ sums_y[own]
            a += tx.T @ tx
            along += tx.T @ ty
            rest += float(ty @ ty)
    rss = max(rest - float(along @ np.linalg.lstsq(a, along, rcond=None)[0]), 1e-300)
    return rss / max(dof, 1)


def _offset_bound_um2(runs: Runs, signal_um: Numbers, shapes: Numbers) -> float:
    """Give the upper bound of the variance of runs' offsets, µm².

    Means of runs beyond what shapes explain by their course along the circle; a radius for each set-up and the square
    of the feed may be in them. Where nothing is left to tell the variance by, every radius counts as free.
    """
    mean = np.zeros((runs.n_runs, len(runs)))
    for number, own in enumerate(runs.slices):
        mean[number, own] = 1.0 / (own.stop - own.start)

    def centred(columns: Numbers) -> Numbers:
        return np.asarray(columns - (mean @ columns)[runs.run])

    size = np.linalg.norm(shapes, axis=0)
    scaled = shapes[:, size > 0.0] / size[size > 0.0]
    course = np.linalg.lstsq(centred(scaled), centred(signal_um[:, None])[:, 0], rcond=1e-6)[0]
    offsets = mean @ (signal_um - scaled @ course)
    design = [(runs.set_up == one).astype(np.float64) for one in np.unique(runs.set_up)]
    if len(runs.feeds()) > 1:
        design.append(np.nan_to_num(runs.feed_mm_min) ** 2 / float(np.nanmax(runs.feed_mm_min)) ** 2)
    basis = orthonormal(np.column_stack(design))
    left = offsets - basis @ (basis.T @ offsets)
    dof = runs.n_runs - basis.shape[1]
    if dof < 1:
        return _FREE_UM2
    return float(left @ left) / float(chi_squared_ppf(_OFFSET_DOUBT, dof))


def _among(kinds: list[_Geometry], blocks: Blocks, shapes: Numbers) -> Numbers:
    """Give the mean variance that each part of the noise puts into a shape of length 1, (9,), in units of σ² θ."""
    size = np.linalg.norm(shapes, axis=0)
    sums = blocks.sums(shapes[:, size > 0.0] / size[size > 0.0])
    total = np.zeros(_N_PARTS + 1)
    for kind in kinds:
        for own in kind.own:
            total += np.einsum("ak,jab,bk->j", sums[own], kind.parts, sums[own], optimize=True)
    return np.asarray(total / max(sums.shape[1], 1))


def _kinds(blocks: Blocks, *, with_offset: bool) -> list[_Geometry]:
    known: dict[tuple[bytes, bytes], _Geometry] = {}
    for own in blocks.of_run:
        angle = np.round(blocks.angle[own] - blocks.angle[own.start], 6)
        key = (angle.tobytes(), blocks.counts[own].tobytes())
        if key not in known:
            known[key] = _Geometry(blocks, own, with_offset=with_offset)
        known[key].own.append(own)
    return list(known.values())


def _levels(runs: Runs, signal_um: Numbers, shapes: Numbers) -> Numbers:
    """Give the level of each run, from second differences of what no shape explains; 1 where they hardly differ."""
    x = orthonormal(shapes)
    left = (signal_um - x @ (x.T @ signal_um)) / runs.weight
    found = []
    for own in runs.slices:
        bend = np.abs(np.diff(left[own], 2))
        found.append(float(np.median(bend)) / _NORMAL if len(bend) else 0.0)
    level = np.array(found)
    if not (level > 0.0).all() or float(level.max()) < _OTHER_LEVEL * float(level.min()):
        return np.ones(len(level))
    return np.asarray(level / np.sqrt(np.mean(level**2)))


def scatter_um(runs: Runs) -> float:
    """Give how far the radius scatters from row to row, as a standard deviation: what is smooth takes no part."""
    steps = np.concatenate([np.diff(runs.signal_um[own]) for own in runs.slices])
    # The middle of absolute values knows no jumps.
    return float(np.median(np.abs(steps))) / _NORMAL / float(np.sqrt(2.0))


def orthonormal(columns: Numbers) -> Numbers:
    """Give an orthonormal basis of columns (n, k); columns inside the others, and 0, are left out."""
    size = np.sqrt(np.einsum("nk,nk->k", columns, columns))
    columns = columns[:, size > 1e-12 * max(float(size.max(initial=0.0)), 1e-300)]
    size = size[size > 1e-12 * max(float(size.max(initial=0.0)), 1e-300)]
    if not columns.shape[1]:
        return columns
    left, singular, _ = np.linalg.svd(columns / size, full_matrices=False)
    return np.asarray(left[:, singular > 1e-7 * singular[0]])
