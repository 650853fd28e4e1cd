"""Advice for a diagnosis, for any tied candidates, and for a fit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from geoerr.arguments import check_threads
from geoerr.diagnose.advice.by_hand import by_hand
from geoerr.diagnose.advice.columns import Terms, poses_of
from geoerr.diagnose.advice.families import Company
from geoerr.diagnose.advice.separation import MARGIN, Advice, Adviser, firsts_of
from geoerr.diagnose.findings import Separation
from geoerr.diagnose.space import Space, beyond, freedom_of, noise_sums, whitened_space
from geoerr.effects import catalogue
from geoerr.effects.collection import Catalogue
from geoerr.errors import ShapeError
from geoerr.fit import FitResult, Fitted
from geoerr.fit.sightings import Numbers
from geoerr.model.called import kind_of
from geoerr.terms import Term

# A candidate that is worse by more than this in χ² is ruled out; so many at most are asked about.
_DECIDED, _MOST = 20.0, 8

if TYPE_CHECKING:
    from geoerr.diagnose.diagnosis import Diagnosis
    from geoerr.diagnose.search import Found, Judged, Settled


def advise(
    diagnosis: Diagnosis, *, known: Catalogue | None = None, margin: float = MARGIN, place: int = 0
) -> Separation | None:
    """Say which measurement would tell apart what a diagnosis leaves tied; None where nothing is tied.

    Parameters
    ----------
    known
        The catalogue for what nothing can be computed for; the built-in one if not said.
    margin
        Expected Δχ² that counts as told apart.
    place
        Which of what was found is asked about.
    """
    tied = diagnosis.tied_with(diagnosis.found[place]) if diagnosis.found else ()
    if not tied:
        return None
    first = diagnosis.searched.found[place]
    references = {str(one.reference) for one in (diagnosis.found[place], *tied)}
    # What is not tied now but not ruled out either would be, once the others are. What is too alike to be told by its
    # χ² is tied however far behind it is.
    rivals = [one for one in first.rivals if one.is_tied or one.behind < _DECIDED]
    judged = [(first.judged, first.settled), *((one.judged, one.settled) for one in rivals if not one.together)]
    forms = [own for one in judged if (own := forms_of(*one))]
    forms.sort(key=lambda own: own[0].id not in references)
    companies = _companies(first)
    candidates: list[Sequence[Term] | Company] = [forms[0], *companies, *forms[1:]]
    candidates = candidates[: max(_MOST, 1 + len(companies))]
    tied_now = [n for n, one in enumerate(candidates) if isinstance(one, Company) or one[0].id in references]
    return separation_for(first.looked.space, candidates, tied_now=tied_now, known=known, margin=margin)


def _companies(first: Found) -> list[Company]:
    """Give the rivals that do only together what the first does, at its own inner values."""
    assert first.settled.term is not None
    shared = {one.name: one for one in first.settled.term.inner}
    groups: dict[tuple[str | None, str | None], list[Term]] = {}
    for one in first.rivals:
        term = one.settled.term
        if one.together and term is not None:
            inner = tuple(shared.get(own.name, own) for own in term.inner)
            groups.setdefault((term.effect, term.covariate), []).append(replace(term, inner=inner))
    return [Company(tuple(terms)) for terms in groups.values()]


def separation_for(
    space: Space,
    candidates: Sequence[Term | Sequence[Term] | Company],
    *,
    added: Sequence[Term] = (),
    tied_now: Sequence[int] = (),
    known: Catalogue | None = None,
    margin: float = MARGIN,
    acceleration_mm_s2: float | None = None,
    threads: int = 1,
) -> Separation | None:
    """Give the measurement that tells candidates apart, or what the catalogue says where none can be computed.

    Where homing would tell, its course is laid out too; what comes of it a person reads.

    Parameters
    ----------
    space
        What a fit leaves; best the one whose noise was estimated with the first candidate in the model, because a
        noise that was estimated without has taken part of it for its own.
    candidates
        With the values that were found; one that can be written in several ways as a sequence of them, the one that
        fits best first; those that are one candidate only together as a `Company`.
    added
        Effects that were found before, and count as the model's own.
    tied_now
        Candidates, by their place, that the report cannot tell apart now: where nothing tells enough of all apart
        these come first. None: all alike.
    known
        The catalogue; the built-in one if not said.
    margin
        Expected Δχ² that counts as told apart.
    acceleration_mm_s2
        Of the axes, for how long moves take; boundless if not said.

    Raises
    ------
    ShapeError
        for what is no number of threads.
    """
    check_threads(threads)
    if space.fitted.sightings.has_lengths_only:
        # Nobody knows what the machine itself could be measured with.
        return _by_catalogue(firsts_of(candidates), known or catalogue())
    adviser = Adviser(space, candidates, added=added, acceleration_mm_s2=acceleration_mm_s2, threads=threads)
    advice = adviser.separation(margin=margin)
    if len(tied_now) > 1 and not advice.is_enough:
        nearer = adviser.separation(tied_now, margin=margin)
        advice = nearer if nearer.plan is not None else advice
    if advice.plan is not None:
        return advice
    said = _by_catalogue(adviser.firsts, known or catalogue())
    hand = by_hand(adviser.situation, adviser.firsts)
    if hand is not None:
        plan = hand.measurement
        return Advice(plan.title, hand.plan, plan.minutes(), measurements=((plan, 1),))
    return advice if said is None else said


def adviser_of(fitted: Fitted | FitResult, candidates: Sequence[Term], *, threads: int = 1) -> Adviser:
    """Give an adviser for a fit without any diagnosis: to ask what would tell two effects apart.

    The noise is estimated with the first candidate in the model, at the values that its inner parameters have.

    Raises
    ------
    ShapeError
        for what is no fit, or no number of threads.

    Examples
    --------
    >>> terms = [Effect.term("x", None, machine) for Effect in (backlash, lag)]  # doctest: +SKIP
    >>> print(adviser_of(fitted, terms).separation().plan)  # doctest: +SKIP
    """
    check_threads(threads)
    if isinstance(fitted, FitResult):
        fitted = fitted.fitted
    if not isinstance(fitted, Fitted):
        raise ShapeError(
            f"fitted: {kind_of(fitted)} was given\nhint: give what fit_model makes of measurements, or its .fitted"
        )
    return Adviser(_space_with(fitted, candidates[0], threads), candidates, threads=threads)


def forms_of(judged: Judged, settled: Settled) -> tuple[Term, ...]:
    """Give all ways to write a candidate that the search found: the settled one, then the others."""
    if settled.term is None:
        return ()
    others = [shapes.term for shapes in judged.what.shapes]
    return (settled.term, *(one for one in others if one is not None and one.parts != settled.term.parts))


def _by_catalogue(terms: Sequence[Term], known: Catalogue) -> Separation | None:
    for other in terms[1:]:
        names = [term.effect for term in (terms[0], other) if term.effect]
        rival = known.separation(*names) if len(names) == 2 and all(name in known for name in names) else None
        if rival is not None:
            return Separation(rival.separate_by, rival.plan, rival.minutes)
    return None


def _space_with(fitted: Fitted, term: Term, threads: int) -> Space:
    """Give the space that the model and a term leave, with the noise estimated with the term in the model."""
    solved, sightings = fitted.solved, fitted.sightings
    rows: Numbers = (sightings.is_measured & solved.used[:, None]).astype(np.float64)
    used = solved.used.astype(np.float64)
    own = freedom_of(fitted, solved.used, threads=threads).reshape(rows.size, -1)
    terms = Terms(fitted.machine, [term], with_inner=False)
    columns = terms.columns(sightings, poses_of(fitted), scale=used, threads=threads)[:, :, : terms.n_columns]
    new = beyond(own, (columns * rows[:, :, None]).reshape(rows.size, -1))
    basis = np.concatenate([own, new], axis=1).reshape(*rows.shape, -1)
    sums = noise_sums(fitted, rows, basis, threads=threads)
    return whitened_space(fitted, sums.fit(), rows, sums)


__all__ = ["Advice", "advise", "adviser_of", "forms_of", "separation_for"]
