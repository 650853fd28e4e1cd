"""What every diagnosis answers, by measured points or by circular tests alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal

from geoerr.diagnose.findings import Named, Nameless
from geoerr.fit import Fitted, refit
from geoerr.terms import Term

Verdict = Literal["missing", "nothing-missing", "unknown", "ambiguous"]


@dataclass(frozen=True, eq=False)
class Answer:
    """What is missing in a model.

    Attributes
    ----------
    verdict
        `missing` (named), `nothing-missing`, `unknown` (something is, without a name) or `ambiguous` (named, but not
        alone).
    p_value
        That nothing is missing, for everything that was looked at; before any gate.
    fitted
        The fit that was diagnosed.
    found
        What the search added, in that order.
    candidates
        For the first of them, best first.
    unknown
        Structure without a name, or None.
    not_offered
        What could not be looked for, and why.
    """

    verdict: Verdict
    p_value: float
    fitted: Fitted
    found: Sequence[Named]
    candidates: Sequence[Named]
    unknown: Nameless | None
    not_offered: tuple[tuple[str, str], ...]

    @property
    def noise_floor_um(self) -> float | None:
        """Scatter of repeated rows; None without repeats."""
        return self.fitted.repeats.floor_um

    @cached_property
    def held_out_rmse_um(self) -> float | None:
        """Held-out error of the model as it was."""
        return held_out_um(self.fitted)

    def to_document(self) -> dict[str, Any]:
        """Give it as `diagnose --json` has it."""
        return {
            "verdict": self.verdict,
            "p_value": self.p_value,
            "noise_floor_um": self.noise_floor_um,
            "held_out_rmse_um": self.held_out_rmse_um,
            "found": [one.to_document() for one in self.found],
            "candidates": [one.to_document() for one in self.candidates],
            "not_offered": [{"effect": effect, "why": why} for effect, why in self.not_offered],
            "unknown": None if self.unknown is None else self.unknown.to_document(),
        }


def held_out_um(fitted: Fitted) -> float | None:
    """Give a fit's held-out error; None where it is not computable."""
    figures = fitted.held_out.figures
    return None if figures is None else figures.headline_um


def with_terms(fitted: Fitted, terms: Sequence[Term | None]) -> Fitted:
    """Fit with more terms: everything free, inner parameters starting where the search found them."""
    added = [term for term in terms if term is not None]
    return refit(fitted, [*fitted.terms, *added]) if added else fitted
