"""Where a fit begins: at what another one to the same rows, of which most columns are the same, sums up to.

Columns are first order at the nominal machine. Those of a term without inner parameters depend on the term, the rows
and the frames alone: beside one more effect they are what they were before, and so are their products.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from geoerr import _core
from geoerr.fit.fitted import BegunSums, Fitted
from geoerr.fit.sightings import Numbers, Sightings
from geoerr.fit.solve import Solved
from geoerr.fit.start import first_frame_column
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
    """Give what a fit has of the triangle of another one in its frames; None where that is little, or of other rows.

    Parameters
    ----------
    fitted
        The fit that there is.
    terms, compiled, problem
        Of the one that is to be made.
    sightings, shared
        Its rows, and the derivative by what they share.
    """
    if fitted.sightings is not sightings or fitted.shared is not shared:
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
    first_frame = first_frame_column(problem, sightings)
    places[first_frame:] = np.arange(first_frame, problem.n_columns) - problem.n_columns + fitted.problem.n_columns
    known = Known(fitted.solved.triangle, fitted.solved.row_scale, places)
    return known if known.is_most else None


def known_sums(fitted: Fitted, known: Known, solved: Solved) -> BegunSums | None:
    """Give what a fit has of the sums over folds of one whose triangle it has most of; None of other frames."""
    before, held_out = fitted.solved, fitted.held_out_if_known
    if held_out is None or held_out.sums is None or not np.array_equal(before.used, solved.used):
        return None
    if not _are_in_one_frame(before.design_state, solved.design_state):
        return None
    return BegunSums((held_out.sums, known.places))


def _are_in_one_frame(one: _core.FitState, other: _core.FitState) -> bool:
    return all(
        np.array_equal(getattr(one, name), getattr(other, name))
        for name in ("rotations", "translations_mm", "excess_mm")
    )


def _stands_alone(term: Term) -> bool:
    """Tell whether nothing but the rows and the frames decides a term's columns.

    How an axis came where it stands before its first move is told from all terms that ask.
    """
    return not term.inner and not any(is_motion(name, *HISTORY_NAMES) for name in term.variables)


def _have_one_form(one: Term, other: Term) -> bool:
    return one.parts == other.parts and [p.name for p in one.coefficients] == [p.name for p in other.coefficients]
