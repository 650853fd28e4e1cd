"""Waves in time without a cause: what `empirical:z@t` is where something hums or breathes.

A polynomial of the time follows no wave of more than a few turns. Where a wave has more evidence (Schwarz's, each of
the frequencies that are tried as likely as another) the curve is one: A cos 2π(t − t₀)/P + B sin 2π(t − t₀)/P, each
session with its own A and B, for what hums does not wait for a session to begin. P is fitted with them; t₀ is the
middle of the session, so that P does not move with A and B. Verified in tests/fit/test_empirical_wave.py: period and
size within their standard errors, by Monte-Carlo.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from geoerr.effects.definitions import number_text
from geoerr.fit.seen import Seen
from geoerr.fit.sightings import Numbers
from geoerr.fit.variables import times_s
from geoerr.fit.waves_in_time import WavesInTime
from geoerr.terms import SESSION_NAME, EffectReference, Parameter, Part, Term

TIME = "t"
_PERIOD = "P"


@dataclass(frozen=True, eq=False)
class EmpiricalWave:
    """The wave in time with the most evidence.

    Attributes
    ----------
    evidence
        Against the fit without it.
    period, low, high
        Where a fit starts, and where it looks: to the next frequencies that were tried.
    middle
        Of the time of each session that shows any, by the session's number.
    unit
        Of the time: rows where the data have none.
    """

    evidence: float
    period: float
    low: float
    high: float
    middle: dict[int, float]
    unit: str

    @classmethod
    def of(cls, seen: Seen) -> EmpiricalWave | None:
        """Look at all frequencies that the data can show; None where they show none."""
        sightings = seen.fitted.sightings
        waves = WavesInTime(sightings)
        y = np.einsum("nc,nc->n", seen.direction, seen.residual)
        found = waves.best(y, (seen.direction**2).sum(axis=1))
        if found is None:
            return None
        shown = found.columns[found.columns.any(axis=1)]
        _, gram, along = seen.off(shown)
        scale = np.sqrt(np.maximum(gram.diagonal(), 0.0))
        if np.linalg.matrix_rank(gram / np.maximum(np.outer(scale, scale), 1e-300)) < len(along):
            return None
        times = times_s(sightings)
        middle = {
            number: 0.5 * float(own.min() + own.max())
            for number, rows in zip(sightings.session_numbers.tolist(), sightings.rows_of_sessions, strict=True)
            if found.columns[:, rows].any() and (own := times[rows]).size
        }
        f, step = found.frequency, waves.step
        evidence = seen.evidence(gram, along, n_inner=1, n_trials=len(waves.frequencies))
        return cls(evidence, 1.0 / f, 1.0 / (f + step), 1.0 / (f - step), middle, waves.unit)

    def term(self, reference: EffectReference, channel: str, title: str) -> Term:
        """Give it as a term; its period has the value from which a fit starts."""
        coefficients, texts = [], []
        for place, (number, middle) in enumerate(self.middle.items(), 1):
            suffix = f"_{place}" if len(self.middle) > 1 else ""
            turns = f"2*pi*({TIME} - {number_text(middle)})/{_PERIOD}"
            own = [f"A{suffix}", f"B{suffix}"]
            text = f"{own[0]}*cos({turns}) + {own[1]}*sin({turns})"
            texts.append(f"({text})*({SESSION_NAME} == {number})" if suffix else text)
            coefficients += [Parameter(name, "mm") for name in own]
        period = Parameter(_PERIOD, self.unit, value=self.period, low=self.low, high=self.high)
        return Term(
            id=str(reference),
            title=title,
            kind="empirical",
            effect=None,
            axis=reference.axis,
            covariate=reference.covariate,
            parts=(Part(channel, " + ".join(texts)),),
            coefficients=tuple(coefficients),
            inner=(period,),
            source="user",
        )


def turn_of(term: Term, n_points: int) -> tuple[Numbers, Numbers]:
    """Give one turn of a wave in the session where it is largest.

    Returns
    -------
    at : (n_points,)
        Time since the turn began, which is the middle of the session.
    functions : (n_points, n_coefficients)
        What each coefficient does there.
    """
    sizes = [
        math.hypot(a.value, b.value) for a, b in zip(term.coefficients[::2], term.coefficients[1::2], strict=True)
    ]
    largest = 2 * int(np.argmax(sizes))
    turns = np.linspace(0.0, 1.0, n_points)
    functions = np.zeros((n_points, len(term.coefficients)))
    functions[:, largest] = np.cos(2.0 * np.pi * turns)
    functions[:, largest + 1] = np.sin(2.0 * np.pi * turns)
    return term.inner[0].value * turns, functions
