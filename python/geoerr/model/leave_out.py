"""Which errors a name means when they are to be left out of a model."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Sequence

from geoerr.error_functions import ALL_NAMES, LI_SQUARENESS
from geoerr.errors import GeoerrError
from geoerr.model.groups import GROUPS
from geoerr.terms import Term


def names_left_out(names: Iterable[str], terms: Sequence[Term]) -> tuple[frozenset[str], frozenset[str]]:
    """Give ISO names, and ids of terms, that the names mean.

    Raises
    ------
    GeoerrError
        for a name that is neither one of the 21 errors, a group of them, a term nor an effect of the model.
    """
    iso: set[str] = set()
    ids: set[str] = set()
    for name in names:
        of_terms = {term.id for term in terms if name in (term.id, term.effect) and term.id not in ALL_NAMES}
        if not of_terms and name not in GROUPS and name not in ALL_NAMES:
            effects = [term.id for term in terms if term.kind != "classic"]
            also = f"; the model's other terms are {', '.join(effects)}" if effects else ""
            raise GeoerrError(
                f"{name!r} is neither one of the 21 errors nor a group of them{', nor a term' if terms else ''}\n"
                f"hint: groups are {', '.join(GROUPS)}; errors are named like ECX or EC0Y{also}"
            )
        ids |= of_terms
        if not of_terms:
            iso.update(GROUPS.get(name, (name,)))
    return frozenset(iso), frozenset(ids)


def terms_without(
    terms: Sequence[Term], iso_names: Iterable[str], ids: frozenset[str]
) -> tuple[dict[int, None], tuple[Term, ...]]:
    """Give the numbers of the terms that stay, and these terms.

    A classic term loses its parts on the channels of the ISO names (straightness that follows from an angle is a part
    of the angle's term), and goes when none is left.
    """
    channels = {LI_SQUARENESS[name][0] if name in LI_SQUARENESS else name for name in iso_names}
    kept: dict[int, Term] = {}
    for number, term in enumerate(terms):
        if term.id in ids:
            continue
        if term.kind != "classic":
            kept[number] = term
            continue
        parts = tuple(part for part in term.parts if part.channel not in channels)
        if parts:
            kept[number] = dataclasses.replace(term, parts=parts)
    return dict.fromkeys(kept), tuple(kept.values())
