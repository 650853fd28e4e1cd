"""By how much two candidates would differ: expected fall of χ² from the wrong one to the right one (T-optimality).

For a candidate that is true at the values that the data give it, the other is fitted to what would be measured: the
model anew, its coefficients, its inner parameters at every trial. What is left is the non-centrality of the
difference of χ², and its mean but for the coefficients that noise feeds.

Source: Atkinson & Fedorov, The design of experiments for discriminating between two rival models, Biometrika 62
(1975).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from geoerr.diagnose.advice.families import Family
from geoerr.diagnose.advice.information import Information, Measured
from geoerr.fit.sightings import Numbers

# A trial explains the data as well as the best one where χ² is within so much of it (two standard errors).
_AS_GOOD = 4.0
# What the model leaves of a direction: below this share a truth is not seen at all, an imitation is round-off.
_SEEN, _ROUND_OFF = 2e-3, 1e-7
# Truths that would be more than so many times as large in a plan as in the data would have been seen otherwise.
_LARGEST = 10.0
_MOST_TRUTHS = 7


@dataclass(frozen=True, eq=False)
class Truths:
    """What each candidate may be, by the data.

    Attributes
    ----------
    coefficients : (k, n)
        Of all columns, for each truth.
    family : (n,)
        Whose truth it is.
    """

    coefficients: Numbers
    family: np.ndarray

    def select(self, kept: np.ndarray) -> Truths:
        """Give some of them."""
        return Truths(self.coefficients[:, kept], self.family[kept])


class Candidates:
    """The candidates' columns, sorted by family and trial.

    Attributes
    ----------
    families
        In the order of their columns.
    columns
        For each family its columns by trial, (n_trials, width); of a narrower trial the last ones are one of nothing.
    n_columns
        Of all families; the column of nothing stands behind them.
    """

    def __init__(self, families: Sequence[Family]) -> None:
        self.families = tuple(families)
        self.n_columns = sum(len(term.coefficients) for family in self.families for term in family.terms)
        self.columns: list[np.ndarray] = []
        first = 0
        for family in self.families:
            own = family.columns()
            table = np.full((len(own), max(len(one) for one in own)), self.n_columns)
            for trial, columns in enumerate(own):
                table[trial, : len(columns)] = np.array(columns) + first
            self.columns.append(table)
            first += sum(len(term.coefficients) for term in family.terms)

    def gains(self, data: Measured) -> Numbers:
        """Give by how much each family at its best lets χ² of the data fall, (n_families,)."""
        beyond, raw, scores = _padded(data.information.beyond_model(), data.information.candidates, data.score)
        gains = []
        for columns in self.columns:
            score = scores[columns]
            inverse = _inverses(beyond, raw, columns, _SEEN)
            gains.append(float((score[:, None, :] @ inverse @ score[:, :, None]).max()))
        return np.array(gains)

    def truths(self, data: Measured) -> Truths:
        """Give for each family the trials that explain the data as well as its best, at their best coefficients."""
        beyond, raw, scores = _padded(data.information.beyond_model(), data.information.candidates, data.score)
        found, numbers = [], []
        for number, (family, columns) in enumerate(zip(self.families, self.columns, strict=True)):
            inverse = _inverses(beyond, raw, columns, _SEEN)
            score = scores[columns]
            theta = np.einsum("lij,lj->li", inverse, score)
            gain = (theta * score).sum(axis=1)
            good = np.flatnonzero((gain > gain.max() - _AS_GOOD) & family.is_spread)
            best = int(np.argmax(gain))
            if len(good) > _MOST_TRUTHS:
                good = good[np.rint(np.linspace(0, len(good) - 1, _MOST_TRUTHS)).astype(np.int64)]
            for trial in dict.fromkeys([best, *good.tolist()]):
                coefficients = np.zeros(self.n_columns + 1)
                coefficients[columns[trial]] = theta[trial]
                found.append(coefficients[:-1])
                numbers.append(number)
        return Truths(np.array(found).T, np.array(numbers))

    def apart(self, information: Information, truths: Truths) -> tuple[Numbers, Numbers]:
        """Give what every family, fitted instead, leaves of every truth, and all of it beyond the model.

        Returns
        -------
        left : (n_families, n_truths)
            0 of a truth's own family.
        whole : (n_truths,)
            χ² of the truth beyond the model: 1 − left/whole is the squared correlation of the two.
        """
        beyond, raw, _ = _padded(information.beyond_model(), information.candidates, None)
        pull = beyond[:, :-1] @ truths.coefficients
        size = (truths.coefficients * pull[:-1]).sum(axis=0)
        left = np.empty((len(self.families), len(size)))
        for number, columns in enumerate(self.columns):
            own = pull[columns]
            inverse = _inverses(beyond, raw, columns, _ROUND_OFF)
            explained = (own * (inverse @ own)).sum(axis=1)
            left[number] = size - explained.max(axis=0)
        left[truths.family, np.arange(len(size))] = 0.0
        return np.maximum(left, 0.0), size


def is_believable(data: Information, plan: Information, truths: Truths) -> np.ndarray:
    """Tell which truths are not absurdly larger in a plan than in the data, number for number, (n_truths,)."""
    theta = truths.coefficients
    each = [(theta * (one.candidates @ theta)).sum(axis=0) / one.n_numbers for one in (plan, data)]
    return np.asarray(each[0] <= _LARGEST**2 * np.maximum(each[1], 1e-300))


def _padded(beyond: Numbers, raw: Numbers, score: Numbers | None) -> tuple[Numbers, Numbers, Numbers]:
    """Give products and scores with those of the column of nothing behind them."""
    scores = np.zeros(len(raw)) if score is None else score
    return np.pad(beyond, (0, 1)), np.pad(raw, (0, 1)), np.append(scores, 0.0)


def _inverses(beyond: Numbers, raw: Numbers, columns: np.ndarray, least: float) -> Numbers:
    """Give the pseudo-inverse of every trial's products beyond the model, (n_trials, width, width).

    Directions of which the model leaves a smaller share than `least` of what they are without it are left out.
    """
    size = np.sqrt(np.maximum(np.diag(raw), 0.0))[columns]
    scale = np.where(size > 0.0, 1.0 / np.where(size > 0.0, size, 1.0), 0.0)
    own = beyond[columns[:, :, None], columns[:, None, :]] * scale[:, :, None] * scale[:, None, :]
    value, vector = np.linalg.eigh(own)
    inverse = np.where(value > least, 1.0 / np.maximum(value, least), 0.0)
    half = vector * np.sqrt(inverse)[:, None, :] * scale[:, :, None]
    return np.asarray(half @ half.transpose(0, 2, 1))
