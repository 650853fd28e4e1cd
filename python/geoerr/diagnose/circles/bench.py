"""All causes at all trial values against what a model leaves: gains, and what chance finds in the whole search.

With whitened columns B of a cause, an orthonormal basis Q of the model and the residual r off Q, adding the cause
lowers the sum of squares by g = sᵀ I⁻¹ s, s = Bᵀ r, I = BᵀB − (QᵀB)ᵀ(QᵀB). Chance is played out: white noise in
place of the whitened signal, the largest surprise of the whole search of each play. A cause whose phase is free in
every run (vibration) has its scores run by run.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import special

from geoerr.diagnose.circles.causes import Suspect, Way, tells_vibration
from geoerr.diagnose.circles.columns import Radii
from geoerr.diagnose.circles.noise import Noise
from geoerr.diagnose.circles.probes import Probe
from geoerr.distributions import chi_squared_log_sf, never_zero
from geoerr.fit.owned import OWNED
from geoerr.fit.sightings import Numbers

# Coefficients that move the radius by less than this share of the term's largest do not move it.
_UNSEEN = 1e-6
# A direction of several columns below this share of the largest is none of its own.
_DEPENDENT = 1e-6
N_PLAYS = 199
_SEED = 20_251_121
# With fewer plays above it the share of plays is too coarse, and the tail speaks.
_FEW = 10
_GUMBEL_STD = float(np.pi / np.sqrt(6.0))
_EULER = 0.5772156649015329


@dataclass(frozen=True, eq=False)
class Group:
    """One way of a suspect or a probe: columns (n, n_trials, k) in µm for a unit of each coefficient that is seen.

    Attributes
    ----------
    what
        Number of its suspect or probe.
    way
        Number of the way.
    columns : (n, n_trials·k)
        Trial by trial.
    k
        Columns of one trial.
    seen
        Places of the coefficients that move the radius.
    by_run
        Whether every run has coefficients of its own.
    """

    what: int
    way: int
    columns: Numbers
    k: int
    seen: tuple[int, ...]
    by_run: bool

    @property
    def n_trials(self) -> int:
        """Number of trials."""
        return int(self.columns.shape[1] // self.k)


def groups_of(radii: Radii, what: Sequence[Suspect | Probe]) -> list[Group]:
    """Evaluate everything that is looked for, once."""
    groups = []
    for number, one in enumerate(what):
        if isinstance(one, Probe):
            groups += [
                Group(number, way, columns, columns.shape[1], tuple(range(columns.shape[1])), False)
                for way, columns in enumerate(one.ways)
            ]
            continue
        for way, own in enumerate(one.ways):
            group = _group(radii, number, way, own)
            if group is not None:
                groups.append(group)
    return groups


def _group(radii: Radii, number: int, place: int, way: Way) -> Group | None:
    values = np.stack([radii.columns_um(way.term, trial) for trial in way.trials], axis=1)
    if way.is_by_run:
        values *= tells_vibration(radii.runs, way)[:, :, None]
    size = np.abs(values).max(axis=(0, 1), initial=0.0)
    # Columns of one unit are compared: mm with mm.
    seen = tuple(int(k) for k in np.flatnonzero(size > _UNSEEN * max(float(size.max(initial=0.0)), 1e-300)))
    if not seen or not np.isfinite(size).all() or float(size.max()) == 0.0:
        return None
    columns = np.ascontiguousarray(values[:, :, seen].reshape(len(values), -1))
    return Group(number, place, columns, len(seen), seen, way.is_by_run)


@dataclass(frozen=True, eq=False)
class Judged:
    """A suspect or probe at its best trial.

    Attributes
    ----------
    what
        Its number.
    group, trial
        Its best way and trial.
    gain, rank
        Fall of the sum of squares, and its degrees of freedom.
    surprise
        −ln of the chance of such a gain, less that of the number of trials.
    evidence
        Logarithm of the Bayes factor (Schwarz), trials counted.
    share
        What the model leaves of its information.
    """

    what: int
    group: Group
    trial: int
    gain: float
    rank: int
    surprise: float
    evidence: float
    share: float


class Bench:
    """Everything that is looked for, in the metric of one noise model."""

    def __init__(self, groups: Sequence[Group], n_trials: dict[int, int], noise: Noise, slices: Sequence[slice]):
        self.groups, self.n_trials, self.noise, self.slices = list(groups), n_trials, noise, list(slices)
        self.white = [noise.whiten(group.columns) for group in groups]
        self.inner = [self._inner(group, white) for group, white in zip(groups, self.white, strict=True)]

    def _inner(self, group: Group, white: Numbers) -> Numbers:
        """Give BᵀB of every trial, (n_trials, k, k); of a cause by run for each run, (m, n_trials, k, k)."""
        if group.by_run:
            return np.stack([_gram(white[own], group.k) for own in self.slices])
        return _gram(white, group.k)

    def judge(
        self,
        basis: Numbers,
        residual: Numbers,
        n_rows: int,
        *,
        most_trials: int | None = None,
        only: int | None = None,
    ) -> list[Judged]:
        """Judge everything against a model with the basis Q (n, r) that leaves r (n,): best way of each.

        With `most_trials` only ways of at most so many trials; with `only` one suspect, and each way of it.
        """
        best: dict[tuple[int, int], Judged] = {}
        for group, white, inner in zip(self.groups, self.white, self.inner, strict=True):
            if most_trials is not None and (group.n_trials > most_trials or group.by_run):
                continue
            if only is not None and group.what != only:
                continue
            gain, rank, share = self._gains(group, white, inner, basis, residual[:, None])
            evidence = 0.5 * gain[:, 0] - 0.5 * rank * np.log(n_rows) - np.log(self.n_trials[group.what])
            evidence = np.where(rank > 0, evidence, -np.inf)
            trial = int(np.argmax(evidence))
            if rank[trial] == 0:
                continue
            key = (group.what, 0 if only is None else group.way)
            known = best.get(key)
            if known is not None and evidence[trial] <= known.evidence:
                continue
            surprise = float(_surprise(gain[trial, :1], int(rank[trial]), self.n_trials[group.what])[0])
            best[key] = Judged(
                group.what,
                group,
                trial,
                float(gain[trial, 0]),
                int(rank[trial]),
                surprise,
                float(evidence[trial]),
                float(share[trial]),
            )
        return list(best.values())

    def chance(self, basis: Numbers, n_rows: int) -> Null:
        """Play the whole search on white noise."""
        plays = np.random.default_rng(_SEED).standard_normal((n_rows, N_PLAYS))
        plays -= basis @ (basis.T @ plays)
        largest = np.full(N_PLAYS, -np.inf)
        for group, white, inner in zip(self.groups, self.white, self.inner, strict=True):
            gain, rank, _ = self._gains(group, white, inner, basis, plays)
            for value in np.unique(rank[rank > 0]):
                top = gain[rank == value].max(axis=0)
                largest = np.maximum(largest, _surprise(top, int(value), self.n_trials[group.what]))
        return Null(largest)

    def _gains(
        self, group: Group, white: Numbers, inner: Numbers, basis: Numbers, residual: Numbers
    ) -> tuple[Numbers, np.ndarray, Numbers]:
        """Give gains (n_trials, n_residuals), ranks and shares (n_trials,)."""
        if not group.by_run:
            return _solved(inner, white, basis, residual, group.k)
        gain, rank = np.zeros((group.n_trials, residual.shape[1])), np.zeros(group.n_trials, dtype=np.int64)
        share = np.zeros(group.n_trials)
        for number, own in enumerate(self.slices):
            # What the set-up carries from run to run of a fast wave is next to nothing.
            more, ranks, shares = _solved(inner[number], white[own], basis[own], residual[own], group.k)
            gain, rank, share = gain + more, rank + ranks, np.maximum(share, shares)
        return gain, rank, share


def _gram(white: Numbers, k: int) -> Numbers:
    cube = white.reshape(len(white), -1, k)
    result = np.empty((cube.shape[1], k, k))
    for i in range(k):
        for j in range(i, k):
            result[:, i, j] = result[:, j, i] = np.einsum("nt,nt->t", cube[:, :, i], cube[:, :, j])
    return result


def _solved(
    inner: Numbers, white: Numbers, basis: Numbers, residual: Numbers, k: int
) -> tuple[Numbers, np.ndarray, Numbers]:
    n_trials = len(inner)
    inside = (basis.T @ white).reshape(-1, n_trials, k).transpose(1, 2, 0)
    beyond = inner - inside @ inside.transpose(0, 2, 1)
    score = (white.T @ residual).reshape(n_trials, k, -1)
    if k == 1:
        size = inner[:, 0, 0]
        share = beyond[:, 0, 0] / np.maximum(size, 1e-300)
        seen = (share > OWNED) & (size > 0.0)
        gain = np.where(seen[:, None], score[:, 0] ** 2 / np.maximum(beyond[:, 0, 0], 1e-300)[:, None], 0.0)
        return gain, seen.astype(np.int64), np.where(seen, share, 0.0)
    if k == 2:
        return _solved_pairs(inner, beyond, score)
    return _solved_any(inner, beyond, score)


def _solved_pairs(inner: Numbers, beyond: Numbers, score: Numbers) -> tuple[Numbers, np.ndarray, Numbers]:
    """Solve two by two in closed form; what is nearly the model's own, or one direction, the long way."""
    (a, b, c), (p, q, r) = ((one[:, 0, 0], one[:, 0, 1], one[:, 1, 1]) for one in (inner, beyond))
    whole, left = a * c - b * b, p * r - q * q
    # Two columns that are one in the rows of a run, as a wave's are at half a wave a row, go the long way.
    is_plane = whole > 4.0 * _DEPENDENT * a * c
    divisor = np.where(is_plane, whole, 1.0)
    # Shares are the eigenvalues of I⁻¹ B.
    half = 0.5 * (c * p - 2.0 * b * q + a * r) / divisor
    spread = np.sqrt(np.maximum(half**2 - left / divisor, 0.0))
    safe = is_plane & (half - spread > OWNED)
    first, second = score[:, 0], score[:, 1]
    with np.errstate(over="ignore"):
        square = r[:, None] * first**2 - 2.0 * q[:, None] * first * second + p[:, None] * second**2
        gain = square / np.where(safe, left, 1.0)[:, None]
    rank, share = np.full(len(a), 2), half + spread
    if not safe.all():
        rest = ~safe
        gain[rest], rank[rest], share[rest] = _solved_any(inner[rest], beyond[rest], score[rest])
    return gain, rank, share


def _solved_any(inner: Numbers, beyond: Numbers, score: Numbers) -> tuple[Numbers, np.ndarray, Numbers]:
    k = inner.shape[1]
    size = np.sqrt(np.maximum(np.einsum("tkk->tk", inner), 1e-300))
    value, vector = np.linalg.eigh(inner / (size[:, :, None] * size[:, None, :]))
    own = np.where(value > _DEPENDENT * k, 1.0 / np.sqrt(np.maximum(value, 1e-300)), 0.0)
    unit = vector / size[:, :, None] * own[:, None, :]
    share, turn = np.linalg.eigh(unit.transpose(0, 2, 1) @ beyond @ unit)
    seen = share > OWNED
    root = unit @ turn * np.where(seen, 1.0 / np.sqrt(np.maximum(share, 1e-300)), 0.0)[:, None, :]
    gain = ((root.transpose(0, 2, 1) @ score) ** 2).sum(axis=1)
    return gain, seen.sum(axis=1), np.where(seen.any(axis=1), share[:, -1], 0.0)


def _surprise(gain: Numbers, rank: int, n_trials: int) -> Numbers:
    """Give −ln of the tail of χ² beyond the gain, less ln of the number of trials."""
    k = 0.5 * max(rank, 1)
    half = 0.5 * np.maximum(gain, 0.0)
    tail = chi_squared_log_sf(2.0 * half, 2.0 * k)
    # Beyond what a double holds, the first term of the tail's own series.
    far = (k - 1.0) * np.log(np.maximum(half, 1.0)) - half - special.gammaln(k)
    return np.asarray(-np.where(np.isfinite(tail), tail, far) - np.log(max(n_trials, 1)))


@dataclass(frozen=True, eq=False)
class Null:
    """The largest surprise of each play, (n_plays,)."""

    largest: Numbers

    def p_value(self, found: float) -> float:
        """Give the probability that chance finds as much anywhere in the search.

        Beyond what the plays can show, the tail is Gumbel's with the plays' mean and standard deviation, never
        lighter than that of χ².
        """
        above = int((self.largest >= found).sum())
        if above >= _FEW:
            return (1 + above) / (len(self.largest) + 1)
        scale = max(float(np.std(self.largest, ddof=1)) / _GUMBEL_STD, 1.0)
        where = float(np.mean(self.largest)) - _EULER * scale
        return never_zero(float(-np.expm1(-np.exp(-(found - where) / scale))))
