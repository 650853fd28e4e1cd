"""What chance alone finds: the whole search repeated on draws of noise.

The largest statistic over all candidates and all their trials is compared with the largest of each draw (Westfall &
Young 1993): the family-wise error is controlled whatever the dependence between candidates, and the p-value of the
largest is uniform where the noise is as it was drawn. Beyond what the draws can show, the tail is that of the largest
of M numbers from a χ² distribution, M and the scale of its logarithm by the moments of the draws.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import special

from geoerr.distributions import never_zero
from geoerr.fit.sightings import Numbers

N_DRAWS = 119
# With fewer draws above it the share of draws is too coarse, and the tail speaks.
_FEW = 10
# Half a χ² beyond which its tail is computed by its leading terms.
_FAR = 600.0
# Standard deviation of a Gumbel variable of scale 1, and Euler's constant, its mean.
_GUMBEL_STD = math.pi / math.sqrt(6.0)
_EULER = 0.5772156649015329


def surprise(gain: Numbers, rank: np.ndarray | int, n_trials: np.ndarray | int) -> Numbers:
    """Give −ln of the χ² tail beyond the gain, less ln of the number of trials; lower than 0 for nothing at all."""
    half, degrees = 0.5 * np.maximum(np.asarray(gain, dtype=np.float64), 0.0), 0.5 * np.maximum(rank, 1)
    with np.errstate(divide="ignore"):
        log_tail = np.log(special.gammaincc(degrees, half))
    # Where the tail is no number any more: the leading terms of its continued fraction.
    far = (degrees - 1.0) * np.log(np.maximum(half, 1.0)) - half - special.gammaln(degrees)
    far -= np.log1p(-np.minimum((degrees - 1.0) / np.maximum(half, 1.0), 0.5))
    return np.asarray(-np.where(half > _FAR, far, log_tail) - np.log(np.maximum(n_trials, 1)))


def largest_surprise(groups: Iterable[tuple[Numbers, int]], n_draws: int) -> Numbers:
    """Give the largest surprise of each draw, (n_draws,), over groups.

    Parameters
    ----------
    groups
        Of each the largest gains by rank (n_ranks, n_draws), −1 for none, and its number of trials.

    Notes
    -----
    Of as many trials and one rank the larger gain is the larger surprise: the tails are only those of the largest.
    """
    gains: dict[tuple[int, int], Numbers] = {}
    for largest, n_trials in groups:
        for rank in range(1, len(largest)):
            if n_draws and largest[rank, 0] >= 0.0:
                own = largest[rank]
                before = gains.get((rank, n_trials))
                gains[rank, n_trials] = own if before is None else np.maximum(before, own)
    found = np.full(n_draws, -math.inf)
    for (rank, n_trials), own in gains.items():
        found = np.maximum(found, surprise(own, rank, n_trials))
    return found


@dataclass(frozen=True, eq=False)
class Null:
    """The largest surprise of every draw, (n_draws,).

    Attributes
    ----------
    n_searches
        How many such searches chance may be seen in, where any one of them decides (Bonferroni).
    """

    largest: Numbers
    n_searches: int = 1

    @cached_property
    def _tail(self) -> tuple[float, float]:
        """Place and scale of the tail."""
        std = float(np.std(self.largest, ddof=1))
        # A scale below 1 would be a tail lighter than that of χ²: what is left of chance is not to be trusted so far.
        scale = max(std / _GUMBEL_STD, 1.0)
        return float(np.mean(self.largest)) - _EULER * scale, scale

    @property
    def is_empty(self) -> bool:
        """Whether there was nothing to find anything in."""
        return not np.isfinite(self.largest).all() or not len(self.largest)

    def standardized(self, found: Numbers | float) -> Numbers:
        """Give surprises in units of the tail: what is as rare in two searches is the same number in both."""
        where, scale = self._tail
        return np.asarray((found - where) / scale)

    def p_value(self, found: float) -> float:
        """Give the probability that chance finds as much anywhere in the search, or in one of as many searches."""
        return min(self.n_searches * self._p_value_of_one(found), 1.0)

    def _p_value_of_one(self, found: float) -> float:
        above = int((self.largest >= found).sum())
        share = (1 + above) / (len(self.largest) + 1)
        if above >= _FEW or not math.isfinite(found):
            return share
        return never_zero(float(-np.expm1(-np.exp(-float(self.standardized(found))))))


def p_value_of_all(searches: Sequence[tuple[Null, float]]) -> float:
    """Give the probability that chance does as well in the best of some searches of the same data, each as likely.

    Of every search the largest surprise is given with its null. What is rare in a search of few trials need not be so
    in one of many: they are compared by how rare each is, for the data and for every draw (Westfall & Young's min P).
    """
    known = [(null, found) for null, found in searches if not null.is_empty]
    if not known:
        return 1.0
    drawn = Null(
        np.max([null.standardized(null.largest) for null, _ in known], axis=0),
        max(null.n_searches for null, _ in known),
    )
    return drawn.p_value(max(float(null.standardized(found)) for null, found in known))
