"""What a plan was made to show, and so is asked for by itself, beside the search: the play of its axes."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from geoerr.distributions import never_zero
from geoerr.summaries import p_text, p_words
from geoerr.terms import EffectReference


@dataclass(frozen=True)
class AskedFor:
    """One effect that was asked for by itself, with half of the level.

    Attributes
    ----------
    reference
        Which.
    gain, rank
        Twice the logarithm of the ratio of the likelihoods with it and without it, the noise estimated anew in both,
        and its degrees of freedom; a gain of 0 where too little of it was to be seen to look closely.
    n_passes
        Passes, each of which counts as one number.
    n_trials
        Ways to write it.
    surprise
        −ln of the chance of such a gain, less ln of the trials: the smaller one of χ² over rows and of Fisher's F
        over passes.
    n_questions
        How many were asked for, in how many searches there may be.
    """

    reference: EffectReference
    gain: float
    rank: int
    n_passes: int
    n_trials: int
    surprise: float
    n_questions: int

    @property
    def p_value(self) -> float:
        """That chance does as much in any of the questions (Bonferroni), the search not counted."""
        return never_zero(min(self.n_questions * math.exp(-self.surprise), 1.0))

    def words(self) -> str:
        """Say it, and what it is beside the search: the level is halved between the two."""
        whole = min(2.0 * self.p_value, 1.0)
        beside = f"with the search counted {p_text(whole)}"
        return f"{self.reference} was asked for by itself: {p_words(self.p_value)}, {beside}"

    def to_document(self) -> dict[str, Any]:
        """Give it as `diagnose --json` has it."""
        return {
            "effect": self.reference.effect,
            "axis": self.reference.axis,
            "covariate": self.reference.covariate,
            "gain": self.gain,
            "rank": self.rank,
            "n_passes": self.n_passes,
            "n_trials": self.n_trials,
            "surprise": self.surprise,
            "n_questions": self.n_questions,
            "p_value": self.p_value,
        }
