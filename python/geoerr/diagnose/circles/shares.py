"""What each cause is worth, and what of the trace the causes explain together.

Squares do not add where causes overlap (backlash and servo mismatch: 0.85). Repairing a cause takes its trace f away,
and what that saves depends on what was repaired before. The mean saving over all orders of repair (Shapley 1953) is,
for traces, the mean of f times the sum of all traces: these add up to the whole. A cause that makes up for another
has a negative part: repaired alone it makes the circle worse.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geoerr.diagnose.circles.noise import Noise
from geoerr.diagnose.circles.runs import Runs
from geoerr.fit.sightings import Numbers


@dataclass(frozen=True)
class Shares:
    """Mean squares of the trace, µm²; the set-up is taken off everywhere.

    Attributes
    ----------
    total
        Of the measured trace.
    explained
        Of all causes together.
    by_cause
        Parts of `explained`.
    noise
        Expected of the noise, and of what a given model may be off by.
    rest
        Of what is left beyond the noise: neither cause nor noise; 0 where nothing is.
    """

    total: float
    explained: float
    by_cause: tuple[float, ...]
    noise: float
    rest: float

    @property
    def explainable(self) -> float:
        """Mean square beyond the noise."""
        return self.explained + self.rest

    def percent(self, place: int) -> float:
        """Give a cause's part of the explainable, in per cent."""
        return 100.0 * self.by_cause[place] / self.explainable if self.explainable > 0.0 else 0.0

    @property
    def percent_unexplained(self) -> float:
        """Part of the explainable that no cause explains, in per cent."""
        return 100.0 * self.rest / self.explainable if self.explainable > 0.0 else 0.0


def shares_of(
    runs: Runs,
    noise: Noise,
    set_up: Numbers,
    traces_um: Numbers,
    rest_um: Numbers,
    floor_um: float | None,
    unknown_um: Numbers | None,
    doubt_um2: float = 0.0,
) -> Shares:
    """Share out the mean square of the measured trace.

    Parameters
    ----------
    set_up : (n, r)
        Orthonormal columns of the set-up.
    traces_um : (n, k)
        Of the causes, off the set-up.
    rest_um : (n,)
        What they leave.
    floor_um
        Scatter of repeated rows, where there are any: what repeats is no noise.
    unknown_um : (n,) or None
        Structure without a name, where chance does not explain it.
    doubt_um2
        Mean square of what a given model may be off by.
    """
    n = len(runs)
    signal = traces_um.sum(axis=1) + rest_um
    free = 1.0 - (set_up.shape[1] + traces_um.shape[1]) / n
    seen_um, _ = noise.seen_um(set_up)
    expected = (seen_um if floor_um is None else floor_um) ** 2 * free + doubt_um2
    left = float(np.mean(rest_um**2))
    rest = max(left - expected, 0.0)
    if unknown_um is None and floor_um is None:
        # Without repeats and without structure that stands out, what is left is what the noise was learnt from.
        rest = 0.0
        expected = left
    elif unknown_um is not None:
        rest = max(rest, float(np.mean(unknown_um**2)))
    return Shares(
        total=float(np.mean(signal**2)),
        explained=float(np.mean(traces_um.sum(axis=1) ** 2)) if traces_um.shape[1] else 0.0,
        by_cause=_parts(traces_um),
        noise=min(expected, left),
        rest=rest,
    )


def _parts(traces: Numbers) -> tuple[float, ...]:
    """Give every trace's part of the mean square of their sum."""
    whole = traces.sum(axis=1)
    return tuple(float(np.mean(own * whole)) for own in traces.T)
