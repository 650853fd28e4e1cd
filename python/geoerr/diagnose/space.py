"""What a fit leaves, in the metric of its noise: the space in which candidates are judged.

Whitened rows, an orthonormal basis Q of everything that the fit is free to do there, the residual r off Q, and the
residual of each pass as the rest predicts it, (I − H_pp)⁻¹ r_p with H = Q Qᵀ: the fit did not see that pass, and so
its scores do not shrink by what the fit has absorbed of them (Bell & McCaffrey 2002, CR3).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt
from scipy import linalg

from geoerr import _core
from geoerr.fit.fitted import Fitted
from geoerr.fit.noise_model import WINSOR, NoiseModel, NoiseSums, blocks_of, offset_weights
from geoerr.fit.sightings import Numbers
from geoerr.fit.start import KINDS
from geoerr.model.compile import compile_terms
from geoerr.terms import Parameter, Part, Term

NumbersOfDraws = npt.NDArray[np.float32]
_SEED = 20_210_917
# Numbers of all draws that are drawn at once: what is picked stays in the cache.
_DRAWN_TOGETHER = 1000
# A direction of a pass that the rest determines by less than this share is the pass's own, and says nothing.
_OWN = 1e-3
# Of the numbers, a share that tails may have: of Student's with three degrees of freedom 1.5 % are winsorised.
_FEW = 0.02
# A direction in which a given model is known better than to so many standard deviations of the noise is known.
_DOUBT = 0.3
# A direction that is shorter than 1 by this has a doubt of a thousand standard deviations: it is free.
_AS_FREE = 1e-6
# Columns whose part off the others has less than this share of their square are inside already. The core's.
INSIDE = 1e-9


@dataclass(frozen=True, eq=False)
class Space:
    """Whitened rows of a fit.

    Attributes
    ----------
    fitted
        The fit.
    noise
        Its noise.
    rows : (n, 3)
        1 where a number counts, else 0.
    basis : (n, 3, r)
        Q, whitened. Of a model that is given, the directions in which it may be off are columns shorter than 1: with
        U g for what it may be off by beside unit noise, (I + U g² Uᵀ)⁻¹ = I − B Bᵀ where B = U g (1 + g²)^(−1/2). So
        what is off by as much is no news, and what is off by far more is.
    residual : (n, 3)
        r, whitened, off Q, winsorised but for last estimates.
    """

    fitted: Fitted
    noise: NoiseModel
    rows: Numbers
    basis: Numbers
    residual: Numbers

    @cached_property
    def is_free(self) -> np.ndarray:
        """Which directions of the basis are free, (r,); the others are those in which a given model may be off."""
        return np.asarray(np.einsum("ncr,ncr->r", self.basis, self.basis) > 1.0 - _AS_FREE)

    @property
    def pass_number(self) -> np.ndarray:
        """Pass of each row, (n,)."""
        return self.fitted.sightings.pass_number

    @property
    def n_passes(self) -> int:
        """Number of passes."""
        return self.fitted.sightings.n_passes

    @property
    def n_numbers(self) -> int:
        """Number of measured numbers that count."""
        return int(self.rows.sum())

    def draws(self, n_draws: int, *, threads: int = 0) -> NumbersOfDraws:
        """Give noise off Q as chance might have left it, (n_draws, n, 3), whitened, in single precision.

        Numbers of the residual, each in units of its own standard deviation, drawn with replacement and a sign:
        white, with the tails that they have, and of their size: winsorised tails are less than the noise was
        estimated with. Every draw is whitened by the noise that would be fitted to it, as the residual was by its own
        (`geoerr_core::noise_likelihood::draws`). Always the same draws of the same residual.
        """
        counts = self.rows.reshape(-1) > 0.0
        own = 1.0 - np.einsum("ncr,ncr->nc", self.basis, self.basis).reshape(-1)
        residual = self.residual.reshape(-1)[counts] / np.sqrt(np.maximum(own[counts], _OWN))
        rng = np.random.default_rng(_SEED)
        numbers = np.concatenate([residual, -residual]).astype(np.float32)
        drawn = np.zeros((len(counts), n_draws), dtype=np.float32)
        places = np.flatnonzero(counts)
        for start in range(0, len(places), _DRAWN_TOGETHER):
            own = places[start : start + _DRAWN_TOGETHER]
            drawn[own] = numbers[rng.integers(0, len(numbers), size=(len(own), n_draws))]
        drawn = drawn.reshape(*self.rows.shape, n_draws)
        size = float(np.sqrt((self.residual**2).sum() / max(self.n_numbers - self.basis.shape[2], 1)))
        self.noise.take_off(drawn, basis_of_draws(self.basis), size=size, threads=threads)
        return drawn.transpose(2, 0, 1)

    @cached_property
    def basis_back(self) -> Numbers:
        """V^(-T/2) Q, (n, 3, r): its products with raw columns are those of Q with whitened ones."""
        return self.noise.whiten_transposed(self.basis)

    @cached_property
    def residual_back(self) -> Numbers:
        """V^(-T/2) r, (n, 3)."""
        return self.noise.whiten_transposed(self.residual)

    @cached_property
    def unseen(self) -> Numbers:
        """Residual of every pass as the others predict it, (n, 3), whitened."""
        return unseen_residual(self.basis, self.residual, self.pass_number, self.n_passes)

    def with_columns(self, columns: Numbers) -> Space:
        """Give the space in which these whitened columns (n, 3, k) are the model's own too."""
        flat = self.basis.reshape(-1, self.basis.shape[2])
        unit, new = beyond_in_metric(flat, columns.reshape(-1, columns.shape[2]))
        residual = self.residual.reshape(-1)
        residual = residual - new @ (unit.T @ residual)
        return replace(
            self,
            basis=np.concatenate([self.basis, new.reshape(*self.basis.shape[:2], -1)], axis=2),
            residual=residual.reshape(self.residual.shape),
        )


def space_of(fitted: Fitted, *, threads: int = 0) -> Space:
    """Fit the noise of a fit's residual, whiten by it, and project."""
    rows = (fitted.sightings.is_measured & fitted.solved.used[:, None]).astype(np.float64)
    sums = noise_sums(fitted, rows, freedom_of(fitted, fitted.solved.used, threads=threads), threads=threads)
    return whitened_space(fitted, sums.fit(), rows, sums)


def freedom_of(fitted: Fitted, used: np.ndarray, *, threads: int = 0) -> Numbers:
    """Give an orthonormal basis (n, 3, r) of what a fit is free to do in rows (n,) that count, whitened as stated.

    Of what the calibration knows of its unknowns beforehand, a direction is free where the data say more of it than
    the calibration does; others the fit leaves nearly as they are. Taken for free too, one that moves points by a
    hundredth of their noise would be a full column, and what little of the residual is in it (points are where they
    were measured) would take all of the residual away.
    """
    solved, scale = fitted.solved, used.astype(np.float64)
    root = solved.solution.covariance_root
    held = _held_beforehand(fitted)
    own = root.copy()
    own[held] = 0.0
    # The rest of the model, and each of those unknowns by itself.
    wanted = np.concatenate([own, np.eye(len(root))[:, held]], axis=1)
    raw = fitted.problem.times(solved.state, wanted, scale, threads).reshape(3 * len(scale), -1)
    basis = orthonormal(raw[:, : own.shape[1]], threads=threads)
    if len(held):
        columns = raw[:, own.shape[1] :]
        for _ in range(2):
            columns = columns - basis @ (basis.T @ columns)
        value, vector = np.linalg.eigh(columns.T @ columns)
        # Each has unit variance beforehand.
        basis = np.concatenate([basis, orthonormal(columns @ vector[:, value >= 1.0], threads=threads)], axis=1)
    return basis.reshape(len(scale), 3, -1)


def _held_beforehand(fitted: Fitted) -> np.ndarray:
    """Give the columns of the unknowns that rows share and the calibration knows beforehand."""
    if fitted.prior is None:
        return np.zeros(0, dtype=np.int64)
    columns = np.flatnonzero((fitted.prior != 0.0).any(axis=0))
    return columns[columns >= fitted.problem.first_shared_column]


def noise_sums(fitted: Fitted, rows: Numbers, raw_basis: Numbers, *, threads: int = 0) -> NoiseSums:
    """Sum up a fit's residual and basis (n, 3, r), both whitened by the stated uncertainties, for a noise model."""
    residual, weights = (
        fitted.solved.whitened * rows,
        offset_weights(fitted.sightings, fitted.solved.used) * (rows > 0.0),
    )
    return NoiseSums(blocks_of(fitted.sightings), weights, residual, raw_basis, threads=threads)


def whitened_space(
    fitted: Fitted,
    noise: NoiseModel,
    rows: Numbers,
    sums: NoiseSums,
    *,
    is_winsorised: bool = True,
    explained: Numbers | None = None,
    doubt: Doubt | None = None,
) -> Space:
    """Bring a fit's residual and basis into the metric of a noise model.

    Winsorised: a number of the residual beyond `WINSOR` standard deviations counts as one of so many, so that a few
    rows alone do not decide what is searched for; where more than a few lie out there, they are no tails, and the few
    that lie furthest count as the next. But what an effect does to a few rows may lie that far out, and is then no
    chance: where its values are estimated nothing is winsorised.

    Parameters
    ----------
    explained : (n, 3) or None
        What is known to be no chance of the residual, whitened by the stated uncertainties: the rest is winsorised.
    doubt
        How far a given model may be off; its columns are among those of `sums`.
    """
    whitened = sums.whitened_basis(noise)
    if whitened is None:
        whitened = noise.whiten(sums.basis)
        basis = orthonormal(whitened.reshape(-1, whitened.shape[2]), threads=sums.threads)
    else:
        basis = whitened.reshape(-1, whitened.shape[2])
    if doubt is not None:
        basis = doubt.shortened(basis, noise)
    flat = noise.whiten(fitted.solved.whitened * rows).reshape(-1)
    flat = flat - basis @ (basis.T @ flat)
    if not is_winsorised:
        return Space(fitted, noise, rows, basis.reshape(*rows.shape, -1), flat.reshape(rows.shape))
    known = np.zeros_like(flat)
    if explained is not None:
        known = noise.whiten(explained * rows).reshape(-1)
        known = known - basis @ (basis.T @ known)
    left = flat - known
    # The middle of absolute values knows no tails; 0.6745 makes it a standard deviation.
    counts = rows.reshape(-1) > 0.0
    sizes = np.abs(left[counts]) if counts.any() else np.ones(1)
    middle, nearly_all = np.quantile(sizes, [0.5, 1.0 - _FEW])
    limit = max(WINSOR * float(middle) / 0.6745, float(nearly_all), 1e-300)
    # As if so much less had been measured: what is left of a doubt is not to be taken off once more.
    less = np.clip(left, -limit, limit) - left
    clipped = flat + less - basis @ (basis.T @ less)
    return Space(fitted, noise, rows, basis.reshape(*rows.shape, -1), clipped.reshape(rows.shape))


@dataclass(frozen=True, eq=False)
class Doubt:
    """How far a given model may be off, beside what is free.

    Attributes
    ----------
    columns : (n, 3, k)
        Each one standard deviation, independent of the others, whitened by the stated uncertainties.
    free : (n, 3, r)
        Columns of what is free in any case, whitened likewise.
    """

    columns: Numbers
    free: Numbers

    def shortened(self, basis: Numbers, noise: NoiseModel) -> Numbers:
        """Give a basis (3 n, r + k) of both from an orthonormal one; the doubt is as long as this noise leaves it."""
        free, columns = (
            basis.T @ noise.whiten(one).reshape(len(basis), -1) if one.shape[2] else np.zeros((basis.shape[1], 0))
            for one in (self.free, self.columns)
        )
        own, size, _ = np.linalg.svd(free, full_matrices=False)
        own = own[:, size > INSIDE * max(float(size.max(initial=0.0)), 1e-300)]
        turn, size, _ = np.linalg.svd(columns - own @ (own.T @ columns), full_matrices=False)
        return np.asarray(basis @ np.concatenate([own, turn * (size / np.sqrt(1.0 + size**2))], axis=1))


def doubt_that_counts(columns: Numbers, free: Numbers, scatter: float) -> Numbers:
    """Give the directions (n, 3, m) of a doubt (n, 3, k) that are seen beside what is free (n, 3, r) and scatter."""
    flat, basis = columns.reshape(-1, columns.shape[2]), free.reshape(-1, free.shape[2])
    left = flat - basis @ (basis.T @ flat)
    value, vector = np.linalg.eigh(left.T @ left)
    seen = vector[:, value > (_DOUBT * scatter) ** 2]
    return np.asarray((flat @ seen).reshape(*columns.shape[:2], seen.shape[1]))


def scatter_of(fitted: Fitted, rows: Numbers) -> float:
    """Give how far numbers scatter from row to row, as a standard deviation: what is smooth takes no part."""
    counts = (rows[1:] > 0.0) & (rows[:-1] > 0.0)
    steps = np.abs(np.diff(fitted.solved.whitened, axis=0)[counts])
    # The middle of absolute values knows no jumps; 0.6745 makes it a standard deviation.
    return float(np.median(steps)) / 0.6745 / math.sqrt(2.0) if len(steps) else 0.0


def orthonormal(columns: Numbers, *, threads: int = 0) -> Numbers:
    """Give an orthonormal basis of columns (n, k); columns inside the others, and 0, are left out."""
    return _core.orthonormal_columns(np.ascontiguousarray(columns), threads)


def beyond(basis: Numbers, columns: Numbers) -> Numbers:
    """Give orthonormal columns of what columns (n, k) add to an orthonormal basis (n, r)."""
    size = np.sqrt(np.einsum("nk,nk->k", columns, columns))
    own = columns / np.where(size > 0.0, size, 1.0)
    own = own - basis @ (basis.T @ own)
    value, vector = np.linalg.eigh(own.T @ own)
    keep = value > INSIDE
    own = own @ (vector[:, keep] / np.sqrt(value[keep]))
    return orthonormal(own - basis @ (basis.T @ own))


def beyond_in_metric(basis: Numbers, columns: Numbers) -> tuple[Numbers, Numbers]:
    """Give what columns X (n, k) add to a basis B (n, r) some of whose columns are shorter than 1.

    With M = I − B Bᵀ that are Y = X (Xᵀ M X)^(−1/2) and N = M Y: where X is free too, M becomes M − N Nᵀ.
    """
    size = np.sqrt(np.einsum("nk,nk->k", columns, columns))
    unit = columns / np.where(size > 0.0, size, 1.0)
    left = unit - basis @ (basis.T @ unit)
    value, vector = np.linalg.eigh(unit.T @ left)
    keep = value > INSIDE
    turn = vector[:, keep] / np.sqrt(value[keep])
    return unit @ turn, left @ turn


def basis_of_draws(basis: Numbers) -> Numbers:
    """Give the basis (n, 3, r) off which white noise has a residual's covariance M = I − B Bᵀ: of I − M^(1/2).

    Off Q they are the same; of a direction of a doubt, its column b long, white noise less that column would have the
    square of the residual's variance 1 − b².
    """
    square = np.einsum("ncr,ncr->r", basis, basis)
    is_short = square < 1.0 - INSIDE
    if not is_short.any():
        return basis
    wanted = 1.0 - np.sqrt(np.maximum(1.0 - square, 0.0))
    return basis * np.where(is_short, np.sqrt(wanted / np.maximum(square, 1e-300)), 1.0)


def independent(gram: Numbers, least: float) -> Numbers:
    """Give the combinations (k, m) of columns that are orthonormal, from products of the columns with each other.

    Directions that hold less than a share of the columns' squares are left out.
    """
    size = lengths(gram)
    value, vector = np.linalg.eigh(gram / np.outer(size, size))
    kept = value > least
    return np.asarray(vector[:, kept] / size[:, None] / np.sqrt(value[kept]))


def lengths(gram: Numbers) -> Numbers:
    """Give the lengths of columns (k,) by their products with each other; 1 for a column that is 0."""
    size = np.sqrt(np.maximum(np.diag(gram), 0.0))
    return np.where(size > 0.0, size, 1.0)


def unseen_residual(basis: Numbers, residual: Numbers, pass_number: np.ndarray, n_passes: int) -> Numbers:
    """Give (I − H_pp)⁻¹ r_p of each pass, (n, 3); what only the pass itself determines is left out of it."""
    result = np.zeros_like(residual)
    order = np.argsort(pass_number, kind="stable")
    starts = np.searchsorted(pass_number[order], np.arange(n_passes + 1))
    r = basis.shape[2]
    for number in range(n_passes):
        rows = order[starts[number] : starts[number + 1]]
        own, left = basis[rows].reshape(-1, r), residual[rows].reshape(-1)
        result[rows] = unseen_of_pass(own, left).reshape(-1, 3)
    return result


def unseen_of_pass(own: Numbers, left: Numbers) -> Numbers:
    """Give (I − Q Qᵀ)⁻¹ r for a pass's rows of Q (m, r) and of r (m,)."""
    if len(own) > own.shape[1]:
        # (I − Q Qᵀ)⁻¹ r = r + Q (I − QᵀQ)⁻¹ Qᵀ r: the smaller of the two systems.
        inside = own.T @ left
        return np.asarray(left + own @ _inverse_times(np.eye(own.shape[1]) - own.T @ own, inside))
    return _inverse_times(np.eye(len(own)) - own @ own.T, left)


def _inverse_times(matrix: Numbers, right: Numbers) -> Numbers:
    factor, info = linalg.lapack.dpotrf(matrix, lower=1)
    if info == 0 and float(np.diag(factor).min()) ** 2 > 4.0 * _OWN:
        return np.asarray(linalg.cho_solve((factor, True), right, check_finite=False))
    value, vector = np.linalg.eigh(matrix)
    inverse = np.where(value > _OWN, 1.0 / np.maximum(value, _OWN), 0.0)
    return np.asarray(vector @ (inverse * (vector.T @ right)))


class Channels:
    """Whitened displacement of each row by one unit on a channel, made once for each channel."""

    def __init__(self, fitted: Fitted, rows: Numbers, *, threads: int = 0) -> None:
        self.fitted, self.rows, self.threads = fitted, rows, threads
        self.known: dict[str, Numbers] = {}

    def need(self, names: Sequence[str]) -> None:
        """Make what is not known yet."""
        new = [name for name in dict.fromkeys(names) if name not in self.known]
        if not new:
            return
        terms = [
            Term(
                id=f"unit-{number}",
                title="",
                kind="effect",
                effect="unit",
                axis=None,
                covariate=None,
                parts=(Part(name, "u"),),
                coefficients=(Parameter("u", ""),),
                inner=(),
                source="user",
            )
            for number, name in enumerate(new)
        ]
        compiled = compile_terms(self.fitted.machine, terms)
        sightings, state = self.fitted.sightings, self.fitted.solved.state
        kinds = np.array([KINDS[kind] for kind in sightings.frames], dtype=np.uint8)
        problem = _core.FitProblem(
            compiled.core,
            sightings.carrier,
            np.ascontiguousarray(sightings.commanded_mm),
            np.ascontiguousarray(sightings.offset_mm),
            np.zeros((0, len(sightings))),
            sightings.sequences,
            None,
            np.ascontiguousarray(sightings.measured_mm),
            np.ascontiguousarray(sightings.whitening),
            sightings.session,
            (kinds, state.rotations, state.translations_mm, state.excess_mm, np.zeros((len(kinds), 3))),
            np.zeros(len(new)),
            np.zeros(0),
            [],
            None,
            length=sightings.length,
        )
        design = problem.design(problem.start, self.rows.max(axis=1), 0, len(sightings), self.threads)
        unit = design[:, : len(new)].reshape(len(sightings), 3, len(new))
        for number, name in enumerate(new):
            self.known[name] = np.ascontiguousarray(unit[:, :, number])

    def __getitem__(self, name: str) -> Numbers:
        self.need([name])
        return self.known[name]
