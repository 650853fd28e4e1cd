"""Waves in time: what hums or breathes, at any of thousands of frequencies.

As columns there are too many. Here each is one value of sums over moments,

    s(f) = Σ y_i exp(2πi f t_i),    G(f) from Σ w_i exp(4πi f t_i) and Σ w_i,

and its gain is sᵀG⁻¹s: y what one unit along a channel sees of the residual in the metric of the noise, w its weight
there. What a model takes off G is left out: a gain is then rather too small than large.

Each session has its amplitude and phase: what hums does not wait for a session to begin.

| symbol | code | what |
|---|---|---|
| y, w | `y`, `w` | Dᵀ V⁻¹ r and |D|²/σ² by row |
| f | `frequencies` | in halves of a wave over the longest session: between two of them a wave has 0.8 of its gain |

Source: Lomb (1976), Scargle (1982), with weights. Verified in tests/diagnose against least squares written out.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from geoerr.fit.sightings import Numbers, Sightings
from geoerr.fit.variables import times_s

Complex = npt.NDArray[np.complex64]
Sums = npt.NDArray[np.complexfloating[Any, Any]]
# Between two trials: so much of a wave over the longest session.
_STEP = 0.5
# Slower than so many waves in a session is drift; faster than half a wave between two moments is another frequency's
# twin where moments are evenly spaced.
_LEAST_IN_SESSION = 8.0
# So many frequencies in a band at most.
_MOST = 6000
# Mains, and how far they stray from their frequency (50 mHz are allowed in Europe's grid).
_MAINS_HZ, _STRAY_HZ = (50.0, 60.0), 0.05
# Sessions of fewer moments show no wave.
_LEAST_MOMENTS = 16
# Places of a finer search around the best trial.
_FINER = 9


@dataclass(frozen=True, eq=False)
class Wave:
    """The wave that gains most.

    Attributes
    ----------
    frequency
        Waves in a second; in a row where there are no times.
    gain
        Of the best trial.
    rank
        Of its columns: two of each session that shows any.
    columns : (2 n_sessions, n)
        Cosine and sine of each session.
    """

    frequency: float
    gain: float
    rank: int
    columns: Numbers


class WavesInTime:
    """The frequencies of a fit's sessions, made ready once for all looks."""

    def __init__(self, sightings: Sightings) -> None:
        times = times_s(sightings)
        self.unit = "s" if "t" in sightings.covariate_columns else "rows"
        own = [(rows, np.unique(times[rows])) for rows in _sessions(sightings)]
        own = [(rows, at) for rows, at in own if len(at) >= _LEAST_MOMENTS]
        self.bands = _bands([at for _, at in own], has_seconds=self.unit == "s")
        self.sessions = [_Session.of(rows, times[rows], self.bands) for rows, _ in own] if self.bands else []

    @property
    def frequencies(self) -> Numbers:
        """All that are looked at."""
        return np.concatenate([band.frequencies for band in self.bands]) if self.bands else np.zeros(0)

    @property
    def step(self) -> float:
        """How far one is from the next."""
        return self.bands[0].step

    def best(self, y: Numbers, w: Numbers) -> Wave | None:
        """Give the wave of the largest gain by y and w (n,); None where no session shows any."""
        frequencies = self.frequencies
        gain, rank = np.zeros(len(frequencies)), 0
        for session in self.sessions:
            if w[session.rows].any():
                gain += session.gain(session.by_moment(y), session.by_moment(w))
                rank += 2
        if not rank:
            return None
        best = int(np.argmax(gain))
        f = self._finer(float(frequencies[best]), y, w)
        columns = np.zeros((2 * len(self.sessions), len(y)))
        for place, session in enumerate(self.sessions):
            phase = 2.0 * np.pi * np.modf(f * session.at)[0]
            columns[2 * place : 2 * place + 2, session.rows] = np.stack([np.cos(phase), np.sin(phase)])
        return Wave(f, float(gain[best]), rank, columns)

    def _finer(self, f: float, y: Numbers, w: Numbers) -> float:
        near = f + self.step * np.linspace(-1.0, 1.0, _FINER)
        gain = np.zeros(len(near))
        for session in self.sessions:
            single, own_w = _exponentials(near, session.at), w[session.rows]
            if own_w.any():
                gain += _gain(single @ y[session.rows], (single * single) @ own_w, float(own_w.sum()))
        return float(near[int(np.argmax(gain))])


def _sessions(sightings: Sightings) -> list[slice]:
    starts = sightings.starts.tolist()
    return [slice(a, b) for a, b in zip(starts, [*starts[1:], len(sightings)], strict=True)]


def _bands(moments: Sequence[Numbers], *, has_seconds: bool) -> list[_Band]:
    """Give the bands that sessions at these moments can show; none where there is none."""
    if not moments:
        return []
    longest = max(float(np.ptp(at)) for at in moments)
    step, slowest = _STEP / longest, _LEAST_IN_SESSION / longest
    fastest = 0.5 / float(np.median(np.concatenate([np.diff(at) for at in moments])))
    bands = [_Band(slowest, step, min(int((fastest - slowest) / step), _MOST))]
    if has_seconds:
        n_mains = math.ceil(2.0 * _STRAY_HZ / step)
        bands += [_Band(mains - _STRAY_HZ, step, n_mains) for mains in _MAINS_HZ if mains > fastest]
    return [band for band in bands if 0 < band.n <= _MOST]


@dataclass(frozen=True)
class _Band:
    """Evenly spaced frequencies."""

    first: float
    step: float
    n: int

    @property
    def frequencies(self) -> Numbers:
        return np.asarray(self.first + self.step * np.arange(self.n))

    def factors(self, at: Numbers) -> tuple[Complex, Complex]:
        """Give few frequencies and few more, the sums of which are all: exp(i(a + b)t) is a product."""
        n_fine = math.ceil(math.sqrt(self.n))
        coarse = np.asarray(self.first + self.step * n_fine * np.arange(math.ceil(self.n / n_fine)))
        return _exponentials(coarse, at), _exponentials(np.asarray(self.step * np.arange(n_fine)), at)


@dataclass(frozen=True, eq=False)
class _Session:
    """Rows of a session and their times; targets that are seen at one moment share its phase."""

    rows: slice
    at: Numbers
    moment: np.ndarray
    n_moments: int
    factors: tuple[tuple[Complex, Complex, int], ...]

    @classmethod
    def of(cls, rows: slice, at: Numbers, bands: Sequence[_Band]) -> _Session:
        moments, moment = np.unique(at, return_inverse=True)
        factors = tuple((*band.factors(moments), band.n) for band in bands)
        return cls(rows, at, moment.ravel(), len(moments), factors)

    def by_moment(self, of_rows: Numbers) -> npt.NDArray[np.float32]:
        """Add up numbers (n,) of each moment."""
        own = np.bincount(self.moment, weights=of_rows[self.rows], minlength=self.n_moments)
        return own.astype(np.float32)

    def gain(self, y: npt.NDArray[np.float32], w: npt.NDArray[np.float32]) -> Numbers:
        """Give the gain at every frequency."""
        gains = []
        for coarse, fine, n in self.factors:
            score, doubled = (coarse * y) @ fine.T, (coarse * coarse * w) @ (fine * fine).T
            gains.append(_gain(score, doubled, float(w.sum())).ravel()[:n])
        return np.concatenate(gains)


def _exponentials(f: Numbers, at: Numbers) -> Complex:
    """Give exp(2πi f t), (n_f, n); the phase in double precision, for a hum has turned many thousand times."""
    phase = 2.0 * np.pi * np.modf(np.multiply.outer(f, at))[0]
    return np.asarray(np.exp(1j * phase.astype(np.float32)), dtype=np.complex64)


def _gain(score: Sums, doubled: Sums, plain: float) -> Numbers:
    """Give sᵀG⁻¹s of cosine and sine, G from the sums of weights at twice the frequency and at none."""
    c, s = score.real.astype(np.float64), score.imag.astype(np.float64)
    a, b = 0.5 * (plain + doubled.real), 0.5 * (plain - doubled.real)
    off = 0.5 * doubled.imag.astype(np.float64)
    determinant = np.maximum(a * b - off * off, 1e-6 * plain * plain)
    return np.asarray((b * c * c - 2.0 * off * c * s + a * s * s) / determinant)
