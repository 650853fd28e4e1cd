"""Functions that the data do not tell apart: which of them keeps what is common.

Seen at one point of the tool, an angle that turns a constant arm moves it as a translation does: of the two only the
sum is determined. To choose how much freedom the sum needs, one of them has to stand for it. Along directions that
the data leave free every point fits as well; the one is taken where functions, angles before translations, are no
more than their simplest form, as far as they can be made so.

| symbol | code | what |
|---|---|---|
| N | `null_space` | (m, d) directions that the data leave free |
| C | `bent` | (n, k) what a function is beyond its simplest form, at places along its axis (the triangle of that) |
| x − N (C N)⁺ C x | `simplified` | the same for the data, and simplest |

Verified in tests/fit/test_aliases.py.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from geoerr.bases import basis_of
from geoerr.error_functions import is_angular
from geoerr.fit.sightings import Numbers
from geoerr.terms import BasisSpec, Term

# Singular values below this share of the largest are none.
_RANK = 1e-6
# A variance that has become less than this share of what it was has gone.
_GONE = 1e-9


@dataclass(frozen=True, eq=False)
class Determined:
    """What a fit says of its parameters.

    Attributes
    ----------
    values : (m,)
        The parameters; 0 for those that are not coefficients.
    covariance : (m, m)
        On what is determined.
    null_space : (m, d)
        What is not.
    simple
        Functions for which others stand: they are no more than their simplest form.
    """

    values: Numbers
    covariance: Numbers
    null_space: Numbers
    simple: frozenset[str] = frozenset()


def simplified(
    terms: Sequence[Term], simplest: Mapping[str, BasisSpec], positions_mm: Mapping[str, Numbers], known: Determined
) -> Determined:
    """Move along free directions to where functions are as simple as can be, angles first.

    Parameters
    ----------
    terms
        All terms of the fit, in the order of their coefficients.
    simplest
        By the id of a function the simplest basis that it may be given; other terms are left as they are.
    positions_mm
        Distinct positions of each axis.
    """
    first = np.cumsum([0, *(len(term.coefficients) for term in terms)])
    functions = [number for number, term in enumerate(terms) if term.id in simplest and term.parts[0].basis]
    for number in sorted(functions, key=lambda number: not is_angular(terms[number].id)):
        if not known.null_space.shape[1]:
            break
        term = terms[number]
        spec = term.parts[0].basis
        assert spec is not None
        bent = _beyond(spec, simplest[term.id], positions_mm[spec.axis])
        own = slice(first[number], first[number + 1])
        before, known = known, _straightened(known, bent, own)
        was, left = (float(np.trace(bent @ one.covariance[own, own] @ bent.T)) for one in (before, known))
        if known is not before and left <= _GONE * was:
            known = replace(known, simple=known.simple | {term.id})
    return known


def _beyond(spec: BasisSpec, simplest: BasisSpec, places_mm: Numbers) -> Numbers:
    """Give what a function of one basis is beyond another one, (n, k): as long, and turned into as few rows."""
    simple, _ = np.linalg.qr(basis_of(simplest).evaluate(places_mm))
    columns = basis_of(spec).evaluate(places_mm)
    return np.asarray(np.linalg.qr(columns - simple @ (simple.T @ columns), mode="r"))


def _straightened(known: Determined, bent: Numbers, own: slice) -> Determined:
    moved = bent @ known.null_space[own]
    left, size, turned = np.linalg.svd(moved)
    rank = int((size > _RANK * np.linalg.norm(bent) * np.abs(known.null_space).max(initial=0.0)).sum())
    if not rank:
        return known
    # Which way along the free directions one unit of what is seen of the function lies.
    back = known.null_space @ (turned[:rank].T / size[:rank]) @ left[:, :rank].T @ bent
    turn = np.eye(len(known.values))
    turn[:, own] -= back
    return replace(
        known,
        values=turn @ known.values,
        covariance=turn @ known.covariance @ turn.T,
        null_space=known.null_space @ turned[rank:].T,
    )
