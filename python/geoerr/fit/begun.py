"""Where the triangle of a fit begins: at another fit's to the same rows, of which most columns are the same.

Columns are first order at the nominal machine. Those of a term without inner parameters depend on the term, the rows
and the frames alone: beside one more effect they are what they were before, and so are their products.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from geoerr import _core
from geoerr.fit.fitted import Fitted
from geoerr.fit.sightings import Numbers, Sightings
from geoerr.fit.start import N_UNKNOWNS
from geoerr.fit.triangles import Known
from geoerr.model.compile import Compiled
from geoerr.terms import HISTORY_NAMES, Term, is_motion


def known_columns(
    fitted: Fitted,
    terms: Sequence[Term],
    compiled: Compiled,
    problem: _core.FitProblem,
    sightings: Sightings,
    shared: Numbers | None,
) -> Known | None:
    """Give what a fit has of the triangle of another one's start; None where that is of other rows or frames.

    Parameters
    ----------
    fitted
        The fit that there is.
    terms, compiled, problem
        Of the one that is to be made.
    sightings, shared
        Its rows, and the derivative by what they share.
    """
    is_of_these_rows = fitted.sightings is sightings and fitted.shared is shared
    if not is_of_these_rows or not _are_alike(fitted.solved.design_state, problem.start):
        return None
    before = {
        term.id: (term, own)
        for term, own in zip(fitted.terms, fitted.compiled.coefficient_slices, strict=True)
        if _stands_alone(term)
    }
    places = np.full(problem.n_columns, -1, dtype=np.int64)
    for term, own in zip(terms, compiled.coefficient_slices, strict=True):
        same, there = before.get(term.id, (None, own))
        if same is not None and _have_one_form(same, term):
            places[own] = np.arange(there.start, there.stop)
    first_frame = problem.first_shared_column - sum(N_UNKNOWNS[kind] for kind in sightings.frames)
    places[first_frame:] = np.arange(first_frame, problem.n_columns) - problem.n_columns + fitted.problem.n_columns
    return Known(fitted.solved.triangle, fitted.solved.row_scale, places)


def _are_alike(one: _core.FitState, other: _core.FitState) -> bool:
    """Tell whether frames are the same to the last digit."""
    return (
        np.array_equal(one.rotations, other.rotations)
        and np.array_equal(one.translations_mm, other.translations_mm)
        and np.array_equal(one.excess_mm, other.excess_mm)
    )


def _stands_alone(term: Term) -> bool:
    """Tell whether nothing but the rows and the frames decides a term's columns.

    How an axis came where it stands before its first move is told from all terms that ask.
    """
    return not term.inner and not any(is_motion(name, *HISTORY_NAMES) for name in term.variables)


def _have_one_form(one: Term, other: Term) -> bool:
    return one.parts == other.parts and [p.name for p in one.coefficients] == [p.name for p in other.coefficients]
