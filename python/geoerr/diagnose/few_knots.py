"""A fit with few knots, where many may have followed a wave; it counts where it names one.

That knots follow a wave is told by the fit alone, which knows nothing of offsets, drifts and missing effects: what it
takes for a wave may be any of these. Only a search can say; where a first look at waves sees none, it is not made.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from geoerr.diagnose.candidates import Candidate, n_waves_in_some_form
from geoerr.diagnose.offers import Offers
from geoerr.diagnose.search import Searched, waves_seen
from geoerr.diagnose.steps import Steps
from geoerr.fit import Fitted, refit
from geoerr.fit.classic import positions_by_axis
from geoerr.fit.sightings import SAME_POSITION_MM
from geoerr.fit.wavy import MANY_WAVES, follows_waves, may_be_followed, with_few_knots_along, without_waves
from geoerr.terms import Term


@dataclass(frozen=True)
class FewKnots:
    """A fit with few knots where many may have followed a wave.

    Attributes
    ----------
    fitted
        With few knots.
    changed
        Errors that had many, as they were: of an axis of which one may have followed a wave, all.
    """

    fitted: Fitted
    changed: tuple[Term, ...]

    def is_named_in(self, searched: Searched) -> bool:
        """Tell whether a search beside few knots names a wave that the many followed."""
        return _is_followed(self.fitted, self.changed, _waves_found(searched))


def with_few_knots(fitted: Fitted, offers: Offers, *, steps: Steps, threads: int = 0) -> FewKnots | None:
    """Fit with few knots; None where many follow no wave, or a first look at waves sees none beside few."""
    plain = without_waves(fitted)
    if plain is None:
        return None
    plain = with_few_knots_along(fitted, plain)
    steps.next("whether the model's curves follow waves")
    few = refit(fitted, plain)
    changed = tuple(before for before, after in zip(fitted.terms, plain, strict=True) if after != before)
    seen = waves_seen(few, offers, threads=threads)
    return FewKnots(few, changed) if _is_followed(few, changed, seen) else None


def _is_followed(fitted: Fitted, changed: Sequence[Term], waves: Iterable[tuple[Term, float]]) -> bool:
    """Tell whether a wave is one that knots may have followed, and too many for a smooth error to be like it."""
    positions = positions_by_axis(fitted.sightings.commanded_mm, SAME_POSITION_MM)
    return any(
        count >= MANY_WAVES
        and any(may_be_followed(own, wave) and follows_waves(own, count, positions) for own in changed)
        for wave, count in waves
    )


def _waves_found(searched: Searched) -> list[tuple[Term, float]]:
    functions = searched.bench.functions
    found = [(one.judged.what, one.settled.term) for one in searched.found]
    return [
        (term, n_waves_in_some_form(functions, what, term))
        for what, term in found
        if term is not None and isinstance(what, Candidate)
    ]
