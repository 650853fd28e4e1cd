"""The form and the inner parameters in which a candidate is added: those that the data ask for, in its noise."""

from __future__ import annotations

import math
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
from geoerr.diagnose.search.settle import Settled, resettle, settle, settle_as
from geoerr.diagnose.space import Space
from geoerr.fit.sightings import Numbers
from geoerr.fit.ties import first_best
from geoerr.terms import Parameter, Term

# What was found with one harmonic may be the first of two, or the second.
_MULTIPLES = (1.0, 2.0)
# Standard errors from the least that is looked for at which an inner parameter is surely more.
_SURELY = 3.0


def in_best_form(bench: Bench, looked: Round, judged: Judged, added: Sequence[Numbers]) -> tuple[Judged, Settled]:
    """Give a candidate in the form that the data ask for, its inner parameters as they are in the noise beside it.

    A drift that was estimated without a jump forgives it at the moment where it was, and sees it anywhere else. A
    second harmonic or time constant has to earn its freedom. The values are those in the space of the look.
    """
    space, scanner = looked.space, looked.scanner
    if judged.noise is not None:
        space = bench.space_to_estimate_in(judged.noise, added)
        scanner = bench.scanner(space, n_draws=0)
    plain = settle(space, scanner, judged)
    best, most = plain, CLEARLY_BETTER
    refined = judged.what.refined if isinstance(judged.what, Candidate) else ()
    is_used = space.rows.max(axis=1) > 0.0
    if plain.term is not None and other_periods(scanner.functions, plain.term, is_used) is None:
        for term in refined:
            other, n_ways = _refined(space, scanner, judged, plain.term, term)
            evidence = _more_evidence(space, plain, other, n_ways)
            if evidence > most:
                best, most = other, evidence
    if best is plain and judged.noise is None:
        return judged, plain
    judged = _rewritten(judged, plain, best, most if best is not plain else 0.0)
    return judged, best if judged.noise is None else settle(looked.space, looked.scanner, judged)


def at_its_values(judged: Judged, settled: Settled) -> Judged:
    """Give a candidate with what it gains at the inner values that were found, and not at those that were tried."""
    more = settled.gain - judged.gain
    if judged.noise is not None or more <= 0.0:
        return judged
    return replace(judged, gain=settled.gain, evidence=judged.evidence + 0.5 * more)


def in_form_of(first: Term, looked: Round, judged: Judged, plain: Settled) -> tuple[Judged, Settled]:
    """Give a candidate in the form in which another of the same effect was found, where it has that form.

    One time constant beside two is another curve, on whichever body: what two candidates do is compared in one form.
    """
    term = None if plain.term is None else _like(first, judged)
    if term is None or plain.term is None or _names(plain.term) == _names(first):
        return judged, plain
    inner = [one.value for one in first.inner]
    bounds = {place: around(one, one.value, one.std) for place, one in enumerate(first.inner) if one.std > 0.0}
    other = settle_as(looked.space, looked.scanner, term, inner, bounds)
    evidence = _more_evidence(looked.space, plain, other, 1)
    return (_rewritten(judged, plain, other, evidence), other) if evidence > 0.0 else (judged, plain)


def beside_others(space: Space, scanner: Scanner, judged: Judged, settled: Settled) -> Settled:
    """Give a candidate as it is estimated in another space, and without a lag that has come to be none there.

    A drift that has learnt what a candidate does makes a lag of it, which goes where the candidate stands for itself.
    """
    again = resettle(space, scanner, settled)
    plain = None if again.term is None else _without_what_is_least(again.term, judged)
    if again.term is None or plain is None:
        return again
    inner = {one.name: one for one in again.term.inner}
    own = [inner[one.name] for one in plain.inner]
    bounds = {place: around(one, one.value, one.std) for place, one in enumerate(own) if one.std > 0.0}
    other = settle_as(space, scanner, plain, [one.value for one in own], bounds)
    earned = evidence_of(space, np.array(again.gain - other.gain), np.array(1), 1)
    return other if float(earned) <= 0.0 else again


def _without_what_is_least(term: Term, judged: Judged) -> Term | None:
    """Give the form of a candidate that lacks one inner parameter that may be as little as its range begins with."""
    if not isinstance(judged.what, Candidate):
        return None
    names = set(_names(term))
    left = [names - {one.name} for one in term.inner if one.low is not None and _may_be(one.low, one)]
    return next((one for one in judged.what.terms if set(_names(one)) in left), None)


def _may_be(value: float, parameter: Parameter) -> bool:
    return math.isclose(parameter.value, value) or abs(parameter.value - value) < _SURELY * parameter.std


def _like(first: Term, judged: Judged) -> Term | None:
    """Give the form of a candidate that has the parameters of another of its effect."""
    if not isinstance(judged.what, Candidate) or judged.what.reference.effect != first.effect:
        return None
    return next((term for term in judged.what.terms if _names(term) == _names(first)), None)


def _names(term: Term) -> list[str]:
    return [one.name for one in (*term.coefficients, *term.inner)]


def _rewritten(judged: Judged, plain: Settled, best: Settled, more_evidence: float) -> Judged:
    """Give a candidate as it was judged, in a form that says more, or with inner parameters that were found."""
    return replace(
        judged,
        gain=judged.gain + best.gain - plain.gain,
        rank=judged.rank + _more_freedom(plain, best),
        evidence=judged.evidence + more_evidence,
        shapes=best.shapes,
        trial=0,
        is_settled=True,
    )


def _refined(space: Space, scanner: Scanner, judged: Judged, plain: Term, term: Term) -> tuple[Settled, int]:
    """Estimate a form that says more than one that was found, and give the number of ways to start it.

    What the plainer form leaves biases its inner value by more than its standard error: of eight turns with a second
    harmonic, which knots follow in part, a period by fifty. It is looked for as far as the trials beside it.
    """
    known = {one.name: one for one in plain.inner}
    free = [place for place, one in enumerate(term.inner) if is_free(one)]
    if len(free) == 1 and term.inner[free[0]].name in known:
        (place,), own = free, known[term.inner[free[0]].name]
        low, high = term.inner[place].low or 0.0, term.inner[place].high or np.inf
        starts = [times for times in _MULTIPLES if low <= times * own.value <= high]
        beside = neighbours(judged.shapes, judged.trial, plain.inner.index(own))
        found = []
        for times in starts:
            inner = [one.value for one in term.inner]
            inner[place] = times * own.value
            near = around(term.inner[place], inner[place], times * own.std)
            bounds = {place: (min(near[0], max(low, times * beside[0])), max(near[1], min(high, times * beside[1])))}
            found.append(settle_as(space, scanner, term, inner, bounds))
        return max(found, key=lambda one: one.gain), len(starts)
    shapes = shapes_of(scanner.functions, term)
    trial = first_best(scanner.exact(shapes).gain)
    bounds = {place: neighbours(shapes, trial, place) for place in free}
    return settle_as(space, scanner, term, list(shapes.trials[trial]), bounds), len(shapes.trials)


def _more_evidence(space: Space, plain: Settled, refined: Settled, n_ways: int) -> float:
    rank = np.array(_more_freedom(plain, refined))
    return float(evidence_of(space, np.array(refined.gain - plain.gain), rank, n_ways))


def _more_freedom(plain: Settled, refined: Settled) -> int:
    assert plain.term is not None
    assert refined.term is not None
    return freedom_of_term(refined.term) - freedom_of_term(plain.term)
