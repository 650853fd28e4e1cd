"""What the data do not determine, in words: which error, and from what it cannot be told."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from geoerr.error_functions import LI_SQUARENESS, NotDetermined
from geoerr.fit.sightings import Numbers, Sightings
from geoerr.terms import SQUARENESS_CHANNELS, Term

# Entries of a null vector (largest 1) below this are round-off.
_NOTHING = 1e-6
_MOST_NAMED = 6
_ISO_OF_LI = {li: iso for iso, (li, _) in LI_SQUARENESS.items()}


def iso_name(term_id: str) -> str:
    """Give the name of a term as errors.json has it: S_xy is EC0Y."""
    return _ISO_OF_LI.get(term_id, term_id)


def not_determined(
    terms: Sequence[Term],
    is_determined: np.ndarray,
    null_space: Numbers,
    sightings: Sightings,
    first_frame_column: int,
    never_moved: Sequence[str],
    wanted: Sequence[str],
) -> tuple[NotDetermined, ...]:
    """List the terms of which some coefficient is not determined, with the reason.

    Parameters
    ----------
    terms
        All terms, in the order of their coefficients.
    is_determined : (n,)
        For every unknown.
    null_space : (n, k)
        Directions in which unknowns can change without any measurement noticing, each with largest entry 1.
    first_frame_column
        Where the unknowns of frames begin.
    never_moved
        Axes whose position is one and the same in all rows.
    wanted
        Names that a model of these components would have.
    """
    listed = [
        NotDetermined(iso_name(name), f"the {name[2].lower()} axis never moved")
        for name in wanted
        if name not in {term.id for term in terms} and name[2].lower() in never_moved
    ]
    spans = _spans(terms)
    for term in terms:
        own = spans[term.id]
        if is_determined[own].all():
            continue
        involved = np.abs(null_space[own]).max(axis=0, initial=0.0) > _NOTHING
        others = _others(term, terms, spans, null_space[:, involved], first_frame_column)
        listed.append(NotDetermined(iso_name(term.id), _why(term, others, sightings, never_moved)))
    return tuple(listed)


def _spans(terms: Sequence[Term]) -> dict[str, slice]:
    spans, first = {}, 0
    for term in terms:
        spans[term.id] = slice(first, first + len(term.coefficients))
        first += len(term.coefficients)
    return spans


def _others(
    term: Term, terms: Sequence[Term], spans: dict[str, slice], directions: Numbers, first_frame_column: int
) -> list[str]:
    names = [
        iso_name(other.id)
        for other in terms
        if other.id != term.id and np.abs(directions[spans[other.id]]).max(initial=0.0) > _NOTHING
    ]
    if np.abs(directions[first_frame_column:]).max(initial=0.0) > _NOTHING:
        names.append("the pose of the measuring frame")
    return names


def _why(term: Term, others: Sequence[str], sightings: Sightings, never_moved: Sequence[str]) -> str:
    if term.id in SQUARENESS_CHANNELS:
        still = [axis for axis in term.id[-2:] if axis in never_moved]
        if still:
            return f"the {' and the '.join(still)} axis never moved"
    if not others:
        what = "a target with a lever about its axis" if term.id[1:2] in "ABC" else "a component along it"
        return (
            f"no measured point responds to it; it needs {what}"
            if term.kind == "classic"
            else ("no measured point responds to it")
        )
    named = ", ".join(others[:_MOST_NAMED]) + (f" and {len(others) - _MOST_NAMED} more" if len(others) > 6 else "")
    return f"these measurements cannot tell it from {named}"
