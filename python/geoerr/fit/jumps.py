"""Moments at which a term jumps: between two rows one is as good as another, and a derivative tells nothing.

Each gap between rows is a trial of its own. How sure the moment is follows from all of them: each counts by its
likelihood, and is as wide as it is.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from geoerr import _core
from geoerr.fit.sightings import Numbers, Sightings
from geoerr.fit.solve import Solved
from geoerr.fit.variables import clock_s
from geoerr.terms import CLOCK_NAME, Term, mentions

# Gaps that are tried one by one; of more than that a few are, evenly.
MOST_GAPS = 256
# So many gaps on each side of the best are weighed at first, and twice as many while the last weigh something.
_BESIDE, _NO_WEIGHT = 16, 1e-3
# A scale below this is none: a nanometre, or so many of the stated standard uncertainties.
_LEAST_SCALE = 1e-6


def jump_places(term: Term) -> tuple[int, ...]:
    """Give the places of inner parameters that are moments of a jump, `step(clock - t0)`, and nothing else."""
    texts = [text for part in term.parts for text in (part.expression or "", *(own for _, own in part.definitions))]
    places = []
    for place, one in enumerate(term.inner):
        name = re.escape(one.name)
        without = [re.sub(rf"(?<!\w)step\(\s*{CLOCK_NAME}\s*-\s*{name}\s*\)", "", text) for text in texts]
        if without != texts and not any(re.search(rf"(?<!\w){name}(?!\w)", text) for text in without):
            places.append(place)
    return tuple(places)


def is_jump_in_time(term: Term) -> bool:
    """Tell whether all that a term does begins at some moment, and follows nothing but the clock."""
    return term.variables == (CLOCK_NAME,) and all(mentions(part.expression or "", "step") for part in term.parts)


@dataclass(frozen=True, eq=False)
class Gaps:
    """Spans between the moments of rows that count, on the clock of all sessions.

    Attributes
    ----------
    middle, width : (n,)
        In seconds.
    """

    middle: Numbers
    width: Numbers

    @classmethod
    def of(cls, clock: Numbers) -> Gaps:
        """Give those between moments on the clock, in any order."""
        moments = np.unique(clock)
        return cls(0.5 * (moments[1:] + moments[:-1]), np.diff(moments))

    def within(self, low: float, high: float) -> Numbers | None:
        """Give the middles between two moments, (k,); None where there are none, or too many to try one by one."""
        inside = self.middle[(low <= self.middle) & (self.middle <= high)]
        return inside if 0 < len(inside) <= MOST_GAPS else None

    def standard_error(self, value: float, gains: Callable[[Numbers], Numbers]) -> float:
        """Give the root of the mean square from a moment, each gap with its likelihood and width.

        Parameters
        ----------
        gains
            Falls of the sum of squares at some moments.
        """
        if not len(self.middle):
            return 0.0
        best = int(np.argmin(np.abs(self.middle - value)))
        beside = _BESIDE
        while True:
            first, last = max(best - beside, 0), min(best + beside, len(self.middle) - 1)
            # Of many some will do, evenly.
            places = np.unique(np.linspace(first, last, min(last - first + 1, MOST_GAPS)).round().astype(np.int64))
            middle, width = self.middle[places], self.width[places]
            found = gains(middle)
            weight = width * np.exp(0.5 * (found - found.max()))
            edges = max(weight[0] if first else 0.0, weight[-1] if last < len(self.middle) - 1 else 0.0)
            if edges <= _NO_WEIGHT * weight.max() or len(self.middle) <= last - first + 1:
                return float(np.sqrt(np.average((middle - value) ** 2 + width**2 / 12.0, weights=weight)))
            beside *= 2


def jump_errors(
    problem: _core.FitProblem,
    solved: Solved,
    terms: Sequence[Term],
    sightings: Sightings,
    free: Sequence[int],
    scale: float,
    *,
    threads: int = 0,
) -> dict[int, float]:
    """Give the standard errors of moments of a jump in a fit, by the place of an inner parameter among all.

    All else as it was fitted: rows before a moment with their residual without the jump, rows after it with that with
    it.

    Parameters
    ----------
    free
        Places of inner parameters that were fitted.
    scale
        What the stated standard uncertainties were multiplied by.
    """
    places, first = list[int](), 0
    for term in terms:
        places += [first + place for place in jump_places(term) if first + place in free]
        first += len(term.inner)
    if not places or not np.isfinite(scale):
        return {}
    # Of data without noise the rows around a jump are all that is unsure.
    scale = max(scale, _LEAST_SCALE)
    clock = clock_s(sightings)[solved.used]
    gaps = Gaps.of(clock)
    order = np.argsort(clock, kind="stable")
    n_coefficients, errors = len(solved.state.coefficients), {}
    for place in places:
        value = float(solved.state.inner[place])

        def squares(moment: float, value: float = value, place: int = place) -> Numbers:
            correction = np.zeros(problem.n_columns)
            correction[n_coefficients + list(free).index(place)] = moment - value
            moved = problem.residuals(problem.corrected(solved.state, correction), threads)
            return np.asarray((problem.whitened(moved)[solved.used] ** 2).sum(axis=1)[order])

        ends = float(clock.max()) + 1.0, float(clock.min()) - 1.0
        before, after = (np.concatenate([[0.0], np.cumsum(squares(at))]) for at in ends)

        def gains(at: Numbers, before: Numbers = before, after: Numbers = after) -> Numbers:
            n_before = np.searchsorted(clock[order], at)
            return -(before[n_before] - after[n_before]) / scale**2

        errors[place] = gaps.standard_error(value, gains)
    return errors
