"""The whole search: beside few knots where many followed a wave, and once more beside an effect that was large.

A large effect hides what is small. In its scatter bases are chosen that are too stiff, or follow it, and what they
leave would be named a wave beside it. Rows that are far off by the effect alone are left out or winsorised, and what
is left of it looks like another. So where what was found lets the error fall far, everything is fitted anew beside
it, and the search begins again with the bases, rows and frames of that fit. What has no name is fitted as a
curve: a name may be found then. A search is of the first order, and a turn of some milliradians leaves a second that
would be called another formula: it is taken off, as the fit beside has it.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from geoerr.diagnose.few_knots import with_few_knots
from geoerr.diagnose.gaps import unread_rows
from geoerr.diagnose.offers import Offers
from geoerr.diagnose.probes import Probe, curve_term
from geoerr.diagnose.search import Found, Searched, channel_of, search
from geoerr.diagnose.second_order import second_order
from geoerr.diagnose.steps import RoundSteps, Steps
from geoerr.effects.collection import Catalogue
from geoerr.fit import Fitted, has_covariates, refit
from geoerr.fit.choose_again import choose_again, is_worth_asking
from geoerr.fit.sightings import Numbers
from geoerr.terms import Term

# A search ends where something large is found, and begins again beside it; after so many times it goes on to its end.
_MOST_TIMES = 3


def searched_whole(
    fitted: Fitted,
    known: Catalogue,
    *,
    held: Sequence[Term] = (),
    doubt: Numbers | None = None,
    steps: Steps | None = None,
    threads: int = 0,
) -> tuple[Fitted, Searched]:
    """Give what a search finds, and the fit that was searched.

    Parameters
    ----------
    held
        Terms that the model has besides those of the fit.
    doubt : (n, 3, k) or None
        How far that part of the model may be off.
    steps
        Told what is done next.
    """
    steps = steps or Steps()
    offers = Offers(known, held)
    few = with_few_knots(fitted, offers, steps=steps, threads=threads)
    if few is not None:
        kept = {term.id for term in few.changed}
        beside_few = _searched(few.fitted, offers, doubt, steps, threads, kept=kept)
        if few.is_named_in(beside_few[1]):
            return beside_few
    again, searched = _searched(fitted, offers, doubt, steps, threads)
    if searched.finds_nothing and unread_rows(fitted.sightings).any():
        # What those rows alone would show is no temperature's that they lack.
        searched.let_go()
        with_all = _searched(fitted, offers, doubt, steps, threads, with_unread=True)
        if not with_all[1].finds_nothing:
            return with_all
    return again, searched


def _searched(
    fitted: Fitted,
    offers: Offers,
    doubt: Numbers | None,
    steps: Steps,
    threads: int,
    *,
    with_unread: bool = False,
    kept: Collection[str] = (),
) -> tuple[Fitted, Searched]:
    """Search, and search again beside what was large; give the last search and the fit that it was of.

    Errors of axes that are kept have few knots, and no more beside what was large: they would follow the next wave.
    """
    again, explained, beside_large = fitted, None, list[str]()
    rounds = RoundSteps(steps)
    looked_for = partial(
        search,
        offers=offers,
        doubt=doubt,
        with_unread=with_unread,
        # What nothing is found in without some rows is searched again with them.
        n_searches=2 if unread_rows(fitted.sightings).any() else 1,
        steps=rounds,
        threads=threads,
    )
    searched: Searched | None = None
    for _ in range(_MOST_TIMES):
        # What the one before was judged in is gigabytes of many rows.
        searched = None
        searched = looked_for(again, explained=explained, ends_beside_large=beside_large)
        is_first = explained is None
        beside = _fitted_beside(fitted, searched, rounds) if is_first or searched.ends_early else None
        if beside is None:
            break
        again, explained = _as_beside(fitted, beside, kept)
        beside_large = [term.id for term in beside.terms[len(fitted.terms) :]]
    assert searched is not None
    if searched.ends_early:
        searched = None
        searched = looked_for(again, explained=explained)
    return again, searched


def _fitted_beside(fitted: Fitted, searched: Searched, rounds: RoundSteps) -> Fitted | None:
    """Fit everything anew beside what was found, where that is large beside the noise; None where it is not."""
    held_out = searched.bench.held_out
    found = [*searched.found, *([] if searched.unknown is None else [searched.unknown])]
    columns = [one.settled.raw for one in found]
    if not columns or not is_worth_asking(held_out.um([]), held_out.um(columns)):
        return None
    terms = [term for one in found if (term := _term_of(fitted, one)) is not None]
    if not terms:
        return None
    rounds.next("what was found is large: all is fitted anew beside it, and searched again")
    return refit(fitted, [*fitted.terms, *terms])


def _term_of(fitted: Fitted, found: Found) -> Term | None:
    """Give what was found as a term, of what has no name a curve; None where the data leave nothing to draw it by."""
    what = found.judged.what
    return curve_term(fitted, what, channel_of(found.judged)) if isinstance(what, Probe) else found.settled.term


def _as_beside(fitted: Fitted, beside: Fitted, kept: Collection[str]) -> tuple[Fitted, Numbers]:
    """Give the fit with the bases, gross rows and frames of the one beside what was found; and what that explains.

    A frame follows what is missing, too: of a quarter of a millimetre of play a milliradian makes another error. Rows
    without the column of what was found hold it all the same: they are left out, as they are where it is added.
    """
    chosen = (choose_again(beside) or beside.terms)[: len(fitted.terms)]
    own = tuple(before if before.id in kept else term for before, term in zip(fitted.terms, chosen, strict=True))
    has_all, has_own = (has_covariates(fitted.machine, fitted.sightings, terms) for terms in (beside.terms, own))
    used = np.zeros(len(has_all), dtype=bool)
    used[has_all] = beside.solved.used
    again = replace(fitted.again(own, used=used, around=beside.solved.state), choices=fitted.choices)
    known = has_all[has_own]
    whitened = again.solved.whitened.copy()
    whitened[known] -= second_order(beside, range(len(fitted.terms), len(beside.terms)), again, known)
    explained = np.zeros_like(whitened)
    explained[known] = whitened[known] - beside.solved.whitened
    return replace(again, solved=replace(again.solved, whitened=whitened)), explained
