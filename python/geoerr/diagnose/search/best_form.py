"""The form and the inner parameters in which a candidate is added: those that the data ask for, in its noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from geoerr.diagnose.candidates import Candidate, is_free, shapes_of
from geoerr.diagnose.scan import Scanner
from geoerr.diagnose.search.alike import other_periods
from geoerr.diagnose.search.bench import Bench
from geoerr.diagnose.search.judged import CLEARLY_BETTER, Judged, evidence_of
from geoerr.diagnose.search.look import Round
from geoerr.diagnose.search.settle import Settled, neighbours, settle, settle_as
from geoerr.diagnose.space import Space, whitened_space
from geoerr.fit.sightings import Numbers
from geoerr.terms import Term

# What was found with one harmonic may be the first of two, or the second.
_MULTIPLES = (1.0, 2.0)
# Standard errors within which a period is looked for again.
_REACH = 4.0


def in_best_form(bench: Bench, looked: Round, judged: Judged, added: Sequence[Numbers]) -> Judged:
    """Give a candidate in the form that the data ask for, its inner parameters as they are in the noise beside it.

    A drift that was estimated without a jump forgives it at the moment where it was, and sees it anywhere else. A
    second harmonic or time constant has to earn its freedom.
    """
    refined = judged.what.refined if isinstance(judged.what, Candidate) else ()
    if judged.is_settled or (judged.noise is None and not refined):
        return judged
    space, scanner = looked.space, looked.scanner
    if judged.noise is not None:
        space = whitened_space(bench.fitted, judged.noise, bench.rows, bench.sums(added))
        scanner = bench.scanner(space, n_draws=0)
    plain = settle(space, scanner, judged)
    best, most = plain, CLEARLY_BETTER
    is_used = space.rows.max(axis=1) > 0.0
    if plain.term is not None and other_periods(scanner.functions, plain.term, is_used) is None:
        for term in refined:
            other, n_ways = _refined(space, scanner, plain, term)
            evidence = _more_evidence(space, plain, other, n_ways)
            if evidence > most:
                best, most = other, evidence
    if best is plain:
        return judged if judged.noise is None else replace(judged, shapes=plain.shapes, trial=0, is_settled=True)
    return replace(
        judged,
        shapes=best.shapes,
        trial=0,
        gain=judged.gain + best.gain - plain.gain,
        rank=judged.rank + _freedom(best) - _freedom(plain),
        evidence=judged.evidence + most,
        is_settled=True,
    )


def _refined(space: Space, scanner: Scanner, plain: Settled, term: Term) -> tuple[Settled, int]:
    """Estimate a form that says more than one that was found, and give the number of ways to start it."""
    assert plain.term is not None
    known = {one.name: one for one in plain.term.inner}
    free = [place for place, one in enumerate(term.inner) if is_free(one)]
    if len(free) == 1 and term.inner[free[0]].name in known:
        (place,), own = free, known[term.inner[free[0]].name]
        low, high = term.inner[place].low or 0.0, term.inner[place].high or np.inf
        starts = [times for times in _MULTIPLES if low <= times * own.value <= high]
        found = []
        for times in starts:
            inner = [one.value for one in term.inner]
            inner[place] = times * own.value
            reach = _REACH * times * own.std
            bounds = {place: (max(low, inner[place] - reach), min(high, inner[place] + reach))}
            found.append(settle_as(space, scanner, term, inner, bounds))
        return max(found, key=lambda one: one.gain), len(starts)
    shapes = shapes_of(scanner.functions, term)
    trial = int(np.argmax(scanner.exact(shapes).gain))
    bounds = {place: neighbours(shapes, trial, place) for place in free}
    return settle_as(space, scanner, term, list(shapes.trials[trial]), bounds), len(shapes.trials)


def _more_evidence(space: Space, plain: Settled, refined: Settled, n_ways: int) -> float:
    rank = np.array(_freedom(refined) - _freedom(plain))
    return float(evidence_of(space, np.array(refined.gain - plain.gain), rank, n_ways))


def _freedom(settled: Settled) -> int:
    assert settled.term is not None
    return len(settled.term.coefficients) + sum(is_free(one) for one in settled.term.inner)
