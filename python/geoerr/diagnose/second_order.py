"""What large effects do beyond the first order, in which a search takes everything.

An effect that turns a carriage by ε displaces a target at a distance r by ε r, and by ε² r/2 besides: of five
milliradians and 300 mm these are 4 µm, and follow the square of what turns it. So do two large effects together.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from geoerr.diagnose.functions import Functions
from geoerr.diagnose.scan import raw_columns
from geoerr.diagnose.search.settle import shapes_at
from geoerr.diagnose.space import Channels
from geoerr.fit.fitted import Fitted
from geoerr.fit.sightings import Numbers
from geoerr.terms import Term


def second_order(beside: Fitted, places: Sequence[int], searched: Fitted, known: np.ndarray) -> Numbers:
    """Give what some terms of a fit do beyond the first order, (n, 3), whitened by the stated uncertainties.

    By exact kinematics: where targets are with them less where they are without, less columns times coefficients.

    Parameters
    ----------
    beside
        The fit with the terms, of n rows.
    places
        Of the terms in it. Of curves nothing is given.
    searched, known
        A fit without them whose columns a search takes, in the same frames, and which of its rows (m,) the other has:
        how an axis came to a place is told by all the rows before.

    Notes
    -----
    Verified against kinematics written anew (`tests/hard_cases/test_turns_of_milliradians.py`).
    """
    terms = [beside.terms[place] for place in places if _is_of_formulas(beside.terms[place])]
    problem, state, threads = beside.problem, beside.solved.state, beside.threads
    correction = np.zeros(problem.n_columns)
    for term, own in zip(beside.terms, beside.compiled.coefficient_slices, strict=True):
        if term in terms:
            correction[own] = -np.asarray(state.coefficients)[own]
    without = problem.residuals(problem.corrected(state, correction), threads)
    result = np.asarray(problem.whitened(without - problem.residuals(state, threads)))
    channels = Channels(searched, np.ones((len(searched.sightings), 3)), threads=threads)
    functions = Functions(searched, terms)
    for term in terms:
        result -= _first_order(channels, functions, term)[known]
    return result


def _is_of_formulas(term: Term) -> bool:
    return all(part.basis is None for part in term.parts)


def _first_order(channels: Channels, functions: Functions, term: Term) -> Numbers:
    shapes = shapes_at(functions, term, [one.value for one in term.inner])
    columns = raw_columns(channels, shapes, functions.values(shapes.codes[0]))
    return np.asarray(columns @ np.array([one.value for one in term.coefficients]))
