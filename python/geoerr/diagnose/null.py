"""What chance alone finds: signs of whole passes turned at random, the whole search repeated for each.

Under the null the scores of passes are symmetric about 0 and, in the metric of the noise, independent. The largest
statistic over all candidates and all their trials is compared with the largest of each turn of signs (Westfall &
Young 1993): the family-wise error is controlled whatever the dependence between candidates and within passes. Beyond
what the turns can show, the tail is that of the largest of M numbers from a χ² distribution, M and the scale of its
logarithm by the moments of the turns.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

from geoerr.diagnose.scan import Scanned
from geoerr.fit.sightings import Numbers

N_TURNS = 199
_SEED = 20_210_917
# With fewer turns above it the share of turns is too coarse, and the tail speaks.
_FEW = 10
# Standard deviation of a Gumbel variable of scale 1, and Euler's constant, its mean.
_GUMBEL_STD = math.pi / math.sqrt(6.0)
_EULER = 0.5772156649015329


def turns(n_passes: int, n_turns: int = N_TURNS) -> Numbers:
    """Give signs (n_passes, n_turns), always the same ones."""
    return np.random.default_rng(_SEED).choice([-1.0, 1.0], size=(n_passes, n_turns))


def surprise(gain: Numbers, rank: np.ndarray | int, n_trials: int) -> Numbers:
    """Give −ln of the χ² tail beyond the gain, less ln of the number of trials; lower than 0 for nothing at all."""
    return np.asarray(-stats.chi2.logsf(np.maximum(gain, 0.0), np.maximum(rank, 1)) - math.log(max(n_trials, 1)))


def turned(scanned: Sequence[Scanned], signs: Numbers, n_trials: int) -> Numbers:
    """Give the surprise of one candidate (all its forms) for each turn of signs, (n_turns,)."""
    best: dict[int, Numbers] = {}
    for one in scanned:
        n, k, n_passes = one.by_pass.shape
        gain = ((one.by_pass.reshape(-1, n_passes) @ signs).reshape(n, k, -1) ** 2).sum(axis=1)
        for rank in np.unique(one.rank):
            if rank == 0:
                continue
            largest = gain[one.rank == rank].max(axis=0)
            best[int(rank)] = np.maximum(best[int(rank)], largest) if int(rank) in best else largest
    if not best:
        return np.full(signs.shape[1], -math.inf)
    return np.asarray(np.max([surprise(gain, rank, n_trials) for rank, gain in best.items()], axis=0))


@dataclass(frozen=True, eq=False)
class Null:
    """The largest surprise of every turn of signs, (n_turns,)."""

    largest: Numbers

    def p_value(self, found: float) -> float:
        """Give the probability that chance finds as much anywhere in the search."""
        above = int((self.largest >= found).sum())
        share = (1 + above) / (len(self.largest) + 1)
        if above >= _FEW or not math.isfinite(found):
            return share
        std = float(np.std(self.largest, ddof=1))
        # A scale below 1 would be a tail lighter than that of χ²: what is left of chance is not to be trusted so far.
        scale = max(std / _GUMBEL_STD, 1.0)
        where = float(np.mean(self.largest)) - _EULER * scale
        return float(-np.expm1(-np.exp(-(found - where) / scale)))
