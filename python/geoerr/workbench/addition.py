"""Adding an effect to the model that is looked at: when it is asked for, or ahead of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from itertools import islice
from typing import Any, Final

from geoerr.diagnose import Change, Comparison, Diagnosis, Finding
from geoerr.diagnose.change import add_effect, add_terms
from geoerr.diagnose.circles import CircleDiagnosis
from geoerr.diagnose.steps import OnStep, Progress
from geoerr.effects import Effect
from geoerr.errors import GeoerrError, InputFileError
from geoerr.fit import Fitted
from geoerr.measurements import Measurements
from geoerr.model import Model
from geoerr.observations import MeasuredTable
from geoerr.workbench.calibration import Calibration
from geoerr.workbench.session import Prepared, Seen, Session

# So many names are added ahead at most: each model holds the measurements anew.
AHEAD: Final = 3


@dataclass(frozen=True, eq=False)
class Addition:
    """What an effect is added to: the session's, as they were when this was made.

    Attributes
    ----------
    own
        The fit of the model as it is, where it was fitted to these measurements.
    """

    model: Model
    data: Measurements
    effects: tuple[Effect, ...]
    calibration: Calibration
    threads: int
    own: Fitted | None

    @classmethod
    def to(cls, session: Session) -> Addition:
        """Take what the session has."""
        seen = session.seen
        own = seen.comparison.fitted if seen is not None and seen.comparison.freedom == "own" else None
        return cls(session.model, session.data, session.known_effects, session.calibration, session.threads, own)

    def of(
        self,
        reference: str,
        diagnosis: Diagnosis | CircleDiagnosis | None,
        progress: Progress | None = None,
        on_step: OnStep | None = None,
    ) -> Change:
        """Add an effect and fit again, from where a diagnosis found it, if it did; say what comes next."""
        told: Any = {"progress": progress, "on_step": on_step, "threads": self.threads, **vars(self.calibration)}
        tables, found = fittable(self.data), _found(diagnosis, reference)
        if not isinstance(diagnosis, Diagnosis) or found is None:
            return add_effect(
                self.model,
                *tables,
                reference=reference,
                effects=self.effects,
                known=self.own,
                **told,
            )
        # The search has found its form, its inner parameters, and the freedom that the rest has beside it.
        return add_terms(
            self.model,
            tables,
            [found.term],
            reference,
            found.effect.title,
            known=self.own,
            searched=None if self.own is None else diagnosis.fitted,
            **told,
        )

    def prepared(self, diagnosis: Diagnosis | CircleDiagnosis, say: Callable[[str], None]) -> tuple[Prepared, ...]:
        """Add what a search found, each alone, ahead of being asked: beside the search it takes no time."""
        if not isinstance(diagnosis, Diagnosis):
            return ()
        ready = []
        found = dict.fromkeys(str(one.reference) for one in (*diagnosis.found, *diagnosis.not_told_apart))
        for reference in islice(found, AHEAD):
            try:
                change = self.of(reference, diagnosis, on_step=partial(_said_ahead, say, reference))
                seen = seen_after(change)
            except (GeoerrError, MemoryError):
                # Who asks for it is told; what was found stays found.
                continue
            if seen is not None:
                ready.append(Prepared(reference, seen))
        return tuple(ready)


def _said_ahead(say: Callable[[str], None], reference: str, what: str) -> None:
    say(f"adding {reference} ahead: {what}")


def seen_after(change: Change) -> Seen | None:
    """Look at the model that a change gives, on all rows that it can do with: without an effect these may be more."""
    return Seen.of(Comparison(change.result.model, "own", change.result.fitted))


def fittable(data: Measurements) -> tuple[MeasuredTable, ...]:
    """Give the tables that a model is fitted to.

    Raises
    ------
    InputFileError
        where there are lengths only.
    """
    if data.has_lengths_only:
        raise InputFileError(
            "the measurements", "hold lengths only, which have no place to look at", remedy="use geoerr fit"
        )
    return data.tables


def _found(diagnosis: Diagnosis | CircleDiagnosis | None, reference: str) -> Finding | None:
    """Give what a search found of that name."""
    if not isinstance(diagnosis, Diagnosis):
        return None
    every = (*diagnosis.found, *diagnosis.not_told_apart, *diagnosis.candidates)
    return next((one for one in every if str(one.reference) == reference), None)
