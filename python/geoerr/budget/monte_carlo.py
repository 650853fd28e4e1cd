"""The check by Monte-Carlo: distributions propagated as GUM Supplement 1 (JCGM 101) describes.

Every source is drawn from its own distribution (Student's t, rectangles, bounded lengths) and sent through the linear
model. This checks the combination: that the sum is nearly normal, and that U = k·u holds. The linear model itself is
checked by exact refits (`refits`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from geoerr.budget.budget import Budget, Quantity
from geoerr.budget.combine import PROBABILITY
from geoerr.model.arrays import Numbers

# Supplement 1, 7.9.4 a: at least 100 / (1 − p) trials a block, and 10⁴ where that is more.
_BLOCK = 10_000
_MOST_TRIALS = 1_000_000
_UM_PER_MM = 1e3
# The half of a 95 % interval in standard deviations.
_COVERAGE = 1.959964
# A picometre: what differs by less is the same, in µm.
_NOTHING_UM = 1e-6


@dataclass(frozen=True, eq=False)
class Propagated:
    """What the trials found, about the estimate, at the places of the budget; µm.

    Attributes
    ----------
    n_trials
        How many it took.
    is_stable
        Whether every result is known to the tolerance (Supplement 1, 7.9.4); False where the trials ran out.
    std_um, low_um, high_um
        (n, 4) standard uncertainty and ends of the probabilistically symmetric 95 % interval: of x, y, z, and of the
        length, whose interval begins at 0 and whose standard uncertainty is its root mean square.
    ratio
        (n, 4) of the standard uncertainty to the propagated one.
    ratio_half_width
        (n, 4) half of the 95 % interval of the ratio.
    tolerance_um
        (n, 4) δ of Supplement 1, 7.9.2.
    difference_um
        (n, 4) the larger distance of the ends of the interval from ± U (8.2).
    """

    n_trials: int
    is_stable: bool
    std_um: Numbers
    low_um: Numbers
    high_um: Numbers
    ratio: Numbers
    ratio_half_width: Numbers
    tolerance_um: Numbers
    difference_um: Numbers

    @property
    def is_validated(self) -> bool:
        """Whether propagation and trials agree within the tolerance at every place (Supplement 1, 8.1)."""
        known = np.isfinite(self.difference_um)
        return bool(known.any() and (self.difference_um[known] <= self.tolerance_um[known]).all())


def propagate_distributions(
    budget: Budget,
    of: Quantity = "prediction",
    *,
    seed: int = 0,
    n_digits: int = 1,
    most_trials: int = _MOST_TRIALS,
) -> Propagated:
    """Draw all sources until every result is stable (Supplement 1, 7.9.4); the same for the same seed.

    Parameters
    ----------
    n_digits
        Significant digits of the standard uncertainty that count: δ is half of the last one.
    most_trials
        Where to stop. All trials are kept (7.9.4 e): a million at a dozen places are 0.3 GB.
    """
    rng = np.random.default_rng([seed, 0])
    chosen = budget.chosen(of)
    results: list[Numbers] = []
    blocks: list[Numbers] = []
    known = np.column_stack([budget.is_determined, budget.is_determined.all(axis=1)])
    is_stable = False
    tolerance = np.zeros_like(known, dtype=np.float64)
    while not is_stable and (len(blocks) + 1) * _BLOCK <= max(most_trials, 2 * _BLOCK):
        error = np.zeros((_BLOCK, len(budget.q_mm), 3))
        for source, root in chosen:
            flat = root.reshape(-1, root.shape[2])
            error += (source.draw(rng, _BLOCK, root.shape[2]) @ flat.T).reshape(error.shape)
        blocks.append(error * _UM_PER_MM)
        results.append(summary(blocks[-1]))
        if len(blocks) < 2:
            continue
        mean, spread = np.mean(results, axis=0), np.std(results, axis=0, ddof=1) / math.sqrt(len(results))
        tolerance = tolerance_of(mean[1], n_digits)
        is_stable = bool((2.0 * spread[:, known] < tolerance[known]).all())
    return compared(budget, of, np.concatenate(blocks), tolerance, is_stable=is_stable)


def summary(trials: Numbers) -> Numbers:
    """Give mean, standard uncertainty and 95 % interval (4, n, 4) of trials (t, n, 3): of x, y, z and the length."""
    length = np.linalg.norm(trials, axis=2)
    tail = 0.5 * (1.0 - PROBABILITY)
    mean, std = trials.mean(axis=0), trials.std(axis=0, ddof=1)
    low, high = np.quantile(trials, [tail, 1.0 - tail], axis=0)
    of_length = (
        length.mean(axis=0),
        np.sqrt((std**2).sum(axis=1)),
        np.zeros(length.shape[1]),
        np.quantile(length, PROBABILITY, axis=0),
    )
    pairs = zip((mean, std, low, high), of_length, strict=True)
    return np.array([np.column_stack([three, one]) for three, one in pairs])


def tolerance_of(std_um: Numbers, n_digits: int) -> Numbers:
    """Give δ: half a unit of the last of `n_digits` significant digits (Supplement 1, 7.9.2)."""
    size = np.maximum(std_um, _NOTHING_UM)
    return np.asarray(0.5 * 10.0 ** (np.floor(np.log10(size)) - (n_digits - 1)))


def compared(
    budget: Budget, of: Quantity, trials: Numbers, tolerance_um: Numbers, *, is_stable: bool = True
) -> Propagated:
    """Hold trials (t, n, 3) in µm about the estimate against a budget."""
    _, std, low, high = summary(trials)
    propagated = np.column_stack([budget.standard_um(of), budget.standard_length_um(of)])
    wide, wide_length = budget.expanded_um(of), budget.expanded_length_um(of)
    squares = np.concatenate([trials**2, (trials**2).sum(axis=2)[:, :, None]], axis=2)
    is_something = propagated > _NOTHING_UM
    mean_square = np.where(is_something, squares.mean(axis=0), np.nan)
    half_width = _COVERAGE * squares.std(axis=0, ddof=1) / (2.0 * mean_square * math.sqrt(len(trials)))
    ends = np.maximum(np.abs(low[:, :3] + wide), np.abs(high[:, :3] - wide))
    return Propagated(
        n_trials=len(trials),
        is_stable=is_stable,
        std_um=_where(is_something, std),
        low_um=_where(is_something, low),
        high_um=_where(is_something, high),
        ratio=std / np.where(is_something, propagated, np.nan),
        ratio_half_width=half_width,
        tolerance_um=tolerance_um,
        difference_um=_where(is_something, np.column_stack([ends, np.abs(high[:, 3] - wide_length)])),
    )


def _where(is_something: npt.NDArray[np.bool_], values: Numbers) -> Numbers:
    return np.where(is_something, values, np.nan)
