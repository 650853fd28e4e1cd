"""The form and the inner parameters in which a candidate is added: those that the data ask for, in its noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from geoerr.diagnose.candidates import Candidate, is_free, shapes_of
from geoerr.diagnose.scan import Scanner
from geoerr.diagnose.search.alike import other_periods
from geoerr.diagnose.search.bench import Bench
from geoerr.diagnose.search.inner import around, neighbours
from geoerr.diagnose.search.judged import CLEARLY_BETTER, Judged, evidence_of, freedom_of_term
from geoerr.diagnose.search.look import Round
from geoerr.diagnose.search.settle import Settled, settle, settle_as
from geoerr.diagnose.space import Space
from geoerr.fit.sightings import Numbers
from geoerr.terms import Term

# What was found with one harmonic may be the first of two, or the second.
_MULTIPLES = (1.0, 2.0)


def in_best_form(bench: Bench, looked: Round, judged: Judged, added: Sequence[Numbers]) -> tuple[Judged, Settled]:
    """Give a candidate in the form that the data ask for, its inner parameters as they are in the noise beside it.

    A drift that was estimated without a jump forgives it at the moment where it was, and sees it anywhere else. A
    second harmonic or time constant has to earn its freedom. The values are those in the space of the look.
    """
    space, scanner = looked.space, looked.scanner
    if judged.noise is not None:
        space = bench.space_in(judged.noise, bench.sums(added))
        scanner = bench.scanner(space, n_draws=0)
    plain = settle(space, scanner, judged)
    best, most = plain, CLEARLY_BETTER
    refined = judged.what.refined if isinstance(judged.what, Candidate) else ()
    is_used = space.rows.max(axis=1) > 0.0
    if plain.term is not None and other_periods(scanner.functions, plain.term, is_used) is None:
        for term in refined:
            other, n_ways = _refined(space, scanner, plain.term, term)
            evidence = _more_evidence(space, plain, other, n_ways)
            if evidence > most:
                best, most = other, evidence
    if best is not plain:
        judged = replace(
            judged,
            gain=judged.gain + best.gain - plain.gain,
            rank=judged.rank + _more_freedom(plain, best),
            evidence=judged.evidence + most,
        )
    elif judged.noise is None:
        return judged, plain
    judged = replace(judged, shapes=best.shapes, trial=0, is_settled=True)
    return judged, best if judged.noise is None else settle(looked.space, looked.scanner, judged)


def _refined(space: Space, scanner: Scanner, plain: Term, term: Term) -> tuple[Settled, int]:
    """Estimate a form that says more than one that was found, and give the number of ways to start it."""
    known = {one.name: one for one in plain.inner}
    free = [place for place, one in enumerate(term.inner) if is_free(one)]
    if len(free) == 1 and term.inner[free[0]].name in known:
        (place,), own = free, known[term.inner[free[0]].name]
        low, high = term.inner[place].low or 0.0, term.inner[place].high or np.inf
        starts = [times for times in _MULTIPLES if low <= times * own.value <= high]
        found = []
        for times in starts:
            inner = [one.value for one in term.inner]
            inner[place] = times * own.value
            bounds = {place: around(term.inner[place], inner[place], times * own.std)}
            found.append(settle_as(space, scanner, term, inner, bounds))
        return max(found, key=lambda one: one.gain), len(starts)
    shapes = shapes_of(scanner.functions, term)
    trial = int(np.argmax(scanner.exact(shapes).gain))
    bounds = {place: neighbours(shapes, trial, place) for place in free}
    return settle_as(space, scanner, term, list(shapes.trials[trial]), bounds), len(shapes.trials)


def _more_evidence(space: Space, plain: Settled, refined: Settled, n_ways: int) -> float:
    rank = np.array(_more_freedom(plain, refined))
    return float(evidence_of(space, np.array(refined.gain - plain.gain), rank, n_ways))


def _more_freedom(plain: Settled, refined: Settled) -> int:
    assert plain.term is not None
    assert refined.term is not None
    return freedom_of_term(refined.term) - freedom_of_term(plain.term)
