"""A search beside few knots, where many may have followed a wave; it counts where it names one.

That knots follow a wave is told by the fit alone, which knows nothing of offsets, drifts and missing effects: what it
takes for a wave may be any of these. Only the search can say; where a first look at waves sees none, it is not made.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from geoerr.diagnose.candidates import n_waves
from geoerr.diagnose.search import Searched, search, waves_seen
from geoerr.effects.collection import Catalogue
from geoerr.fit import Fitted, has_covariates, refit
from geoerr.fit.choose_again import choose_again, is_worth_asking
from geoerr.fit.sightings import Numbers
from geoerr.fit.wavy import MANY_WAVES, may_be_followed, without_waves
from geoerr.terms import Term


def searched_beside_knots(
    fitted: Fitted, known: Catalogue, *, present: Sequence[str] = (), threads: int = 0
) -> tuple[Fitted, Searched]:
    """Give what a search finds, and the fit that was searched: with few knots where it names what many followed.

    Parameters
    ----------
    present
        Ids of terms that the model has besides those of the fit.
    """
    plain = without_waves(fitted)
    if plain is not None:
        few = refit(fitted, plain)
        changed = [before for before, after in zip(fitted.terms, plain, strict=True) if after != before]
        if _is_followed(changed, waves_seen(few, known, present=present, threads=threads)):
            searched = search(few, known, present=present, threads=threads)
            if _is_followed(changed, _waves_found(searched)):
                return few, searched
    searched = search(fitted, known, present=present, threads=threads)
    beside = _beside(fitted, searched)
    if beside is None:
        return fitted, searched
    again, explained = _as_beside(fitted, beside)
    return again, search(again, known, present=present, explained=explained, threads=threads)


def _beside(fitted: Fitted, searched: Searched) -> Fitted | None:
    """Fit everything anew beside what was found, where that is large beside the noise; None where it is not.

    In the scatter of a large effect knots are few, and what they leave would be named a wave beside it. Rows that are
    far off by the effect alone are left out or winsorised, and what is left of it looks like another.
    """
    held_out = searched.bench.held_out
    columns = [one.settled.raw for one in searched.found]
    if not columns or not is_worth_asking(held_out.um([]), held_out.um(columns)):
        return None
    terms = [one.settled.term for one in searched.found if one.settled.term is not None]
    return refit(fitted, [*fitted.terms, *terms])


def _as_beside(fitted: Fitted, beside: Fitted) -> tuple[Fitted, Numbers]:
    """Give the fit with the bases, gross rows and frames of the one beside what was found; and what that explains.

    A frame follows what is missing, too: of a quarter of a millimetre of play a milliradian makes another error. Rows
    without the column of what was found hold it all the same: they are left out, as they are where it is added.
    """
    own = (choose_again(beside) or beside.terms)[: len(fitted.terms)]
    known = has_covariates(fitted.machine, fitted.sightings, beside.terms)
    used = np.zeros(len(known), dtype=bool)
    used[known] = beside.solved.used
    again = replace(fitted.again(own, used=used, around=beside.solved.state), choices=fitted.choices)
    explained = np.zeros_like(again.solved.whitened)
    explained[known] = again.solved.whitened[known] - beside.solved.whitened
    return again, explained


def _is_followed(changed: Sequence[Term], waves: Iterable[tuple[Term, float]]) -> bool:
    """Tell whether a wave is one that knots may have followed, and too many for a smooth error to be like it."""
    return any(count >= MANY_WAVES and any(may_be_followed(own, wave) for own in changed) for wave, count in waves)


def _waves_found(searched: Searched) -> list[tuple[Term, float]]:
    functions = searched.bench.functions
    terms = [one.settled.term for one in searched.found if one.settled.term is not None]
    return [(term, n_waves(functions, term, [one.value for one in term.inner])) for term in terms]
