"""A search beside few knots, where many may have followed a wave; it counts where it names one.

That knots follow a wave is told by the fit alone, which knows nothing of offsets, drifts and missing effects: what it
takes for a wave may be any of these. Only the search can say.
"""

from __future__ import annotations

from collections.abc import Callable

from geoerr.diagnose.candidates import n_waves
from geoerr.diagnose.search import Searched
from geoerr.fit import Fitted, refit
from geoerr.fit.wavy import MANY_WAVES, may_be_followed, without_waves
from geoerr.terms import Term


def searched_beside_knots(fitted: Fitted, run: Callable[[Fitted], Searched]) -> tuple[Fitted, Searched]:
    """Give what a search finds, and the fit that was searched: with few knots where it names what many followed."""
    plain = without_waves(fitted)
    if plain is not None:
        few = refit(fitted, plain)
        searched = run(few)
        changed = [before for before, after in zip(fitted.terms, plain, strict=True) if after != before]
        terms = [one.settled.term for one in searched.found if one.settled.term is not None]
        if any(may_be_followed(own, term) and _is_many(searched, term) for own in changed for term in terms):
            return few, searched
    return fitted, run(fitted)


def _is_many(searched: Searched, term: Term) -> bool:
    """Tell whether a term is so many waves that no smooth error is like it."""
    return n_waves(searched.bench.functions, term, [one.value for one in term.inner]) >= MANY_WAVES
