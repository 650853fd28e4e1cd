"""What a catalogue offers for a fit, laid out once for searches that follow each other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from geoerr.diagnose.candidates import Candidate, candidates_of
from geoerr.diagnose.functions import Functions
from geoerr.effects.collection import Catalogue
from geoerr.fit.fitted import Fitted
from geoerr.fit.sightings import Sightings
from geoerr.terms import Term


@dataclass(frozen=True, eq=False)
class _LaidOut:
    sightings: Sightings
    used: np.ndarray
    terms: tuple[str, ...]
    candidates: tuple[Candidate, ...]
    not_offered: tuple[tuple[str, str], ...]
    functions: Functions

    def serves(self, fitted: Fitted) -> bool:
        """Tell whether it is what a fit is offered: of the same rows the same count, and its terms are the same."""
        return (
            self.sightings is fitted.sightings
            and self.terms == _names(fitted)
            and np.array_equal(self.used, fitted.solved.used)
        )


def _names(fitted: Fitted) -> tuple[str, ...]:
    return tuple(term.id for term in fitted.terms)


class Offers:
    """What a catalogue offers for one fit after another, to the same rows mostly.

    Parameters
    ----------
    known
        The catalogue.
    held
        Terms that the model has besides those of a fit.
    """

    def __init__(self, known: Catalogue, held: Sequence[Term] = ()) -> None:
        self.known, self.held = known, held
        self._last: _LaidOut | None = None

    def to(self, fitted: Fitted) -> tuple[list[Candidate], tuple[tuple[str, str], ...], Functions]:
        """Give what `candidates_of` gives; functions are a search's own, to which it may add."""
        if self._last is None or not self._last.serves(fitted):
            # Two of them would be hundreds of megabytes of many rows.
            self._last = None
            candidates, not_offered, functions = candidates_of(
                fitted,
                self.known,
                # Of an effect that it has the machine may have come to have more.
                present=[term.id for term in self.held if term.kind == "classic"],
            )
            own = fitted.sightings, fitted.solved.used, _names(fitted)
            self._last = _LaidOut(*own, tuple(candidates), tuple(not_offered), functions)
        last = self._last
        return list(last.candidates), last.not_offered, last.functions.copy()
