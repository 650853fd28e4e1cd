"""What effects of single axes do together: an effect of all axes alike is hidden in them, and they in it."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from geoerr.diagnose.candidates import Candidate, is_free
from geoerr.diagnose.scan import Scanner, seen
from geoerr.diagnose.search.judged import Judged, reference_of
from geoerr.diagnose.search.look import Round
from geoerr.diagnose.search.settle import Settled, explained_share, shapes_at
from geoerr.effects.collection import Catalogue
from geoerr.fit.sightings import Numbers
from geoerr.terms import Term


@dataclass(frozen=True, eq=False)
class Together:
    """Effects of one kind, one for each axis, that together may do what one of all axes does.

    Attributes
    ----------
    members
        One for each axis that these data show.
    correlation
        Share, as a cosine, of what the one explains that they could have explained.
    gain
        Fall of the sum of squares with all of them.
    columns : (n, 3, k)
        Of all of them, in units of the stated uncertainties.
    """

    members: tuple[Judged, ...]
    correlation: float
    gain: float
    columns: Numbers

    @property
    def axes(self) -> tuple[str, ...]:
        """Of the members, x before y before z."""
        return tuple(sorted(str(reference_of(one).axis) for one in self.members))


def together(looked: Round, known: Catalogue, first: Judged, best: Settled) -> list[Together]:
    """Give, for an effect of all axes alike, its twins of single axes by effect and temperature.

    They are asked at its own inner values: a scale of the cameras' that lags behind a temperature is the growth of
    three axes that lag as much.
    """
    own = reference_of(first)
    if own.axis is not None or best.term is None:
        return []
    groups: dict[tuple[str, str | None], list[Judged]] = {}
    for one in looked.candidates:
        reference = reference_of(one)
        if reference.axis is not None and known.are_twins(own, reference):
            groups.setdefault((reference.effect, reference.covariate), []).append(one)
    shared = {one.name: one.value for one in best.term.inner}
    found = []
    for members in groups.values():
        terms = [term for one in members if (term := _with_inner(one, shared)) is not None]
        if 1 < len(terms) == len(members):
            columns = [_columns(looked.scanner, term, shared) for term in terms]
            found.append(_asked(looked, best, members, np.concatenate(columns, axis=2)))
    return found


def _asked(looked: Round, best: Settled, members: Sequence[Judged], columns: Numbers) -> Together:
    own = seen(looked.space, columns)
    _, gain = own.estimate(looked.space)
    return Together(tuple(members), explained_share(best, own), float(gain), columns)


def _with_inner(judged: Judged, shared: dict[str, float]) -> Term | None:
    """Give the form of a candidate that has these inner parameters, the plainest first."""
    assert isinstance(judged.what, Candidate)
    terms = sorted(judged.what.terms, key=lambda term: len(term.inner))
    return next((term for term in terms if set(shared) <= {one.name for one in term.inner}), None)


def _columns(scanner: Scanner, term: Term, shared: dict[str, float]) -> Numbers:
    """Give a term's columns (n, 3, k) at the shared inner values, and at both ends of the others' ranges."""
    choices = [
        (shared[one.name],) if one.name in shared else one.ends if is_free(one) else (one.value,)
        for one in term.inner
    ]
    corners = [shapes_at(scanner.functions, term, inner) for inner in itertools.product(*choices)]
    return np.concatenate([scanner.raw_columns(one, 0) for one in corners], axis=2)
