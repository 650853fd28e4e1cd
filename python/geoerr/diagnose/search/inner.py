"""Inner parameters of a candidate: the values at which its gain is largest.

They are looked for one after the other, then together along the valley that may run between them. Two or more may
have several valleys: what a plan shows of a bowl's slope and height is that of a flat one far off and of a round one
nearer, and only its curvature, the least of it, tells. So the valleys that a coarse grid over all ranges shows are
followed, too, and one that explains as much as another makes both uncertain.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from itertools import product

import numpy as np

from geoerr.diagnose.candidates import Shapes, is_free
from geoerr.diagnose.scan import Scanner, Seen, seen
from geoerr.diagnose.space import Space, lengths
from geoerr.fit.jumps import Gaps, jump_places
from geoerr.fit.sightings import Numbers
from geoerr.fit.ties import first_best
from geoerr.fit.variables import clock_s
from geoerr.terms import Parameter, Term

# Refinement of an inner parameter: points between two trials.
_REFINED = 17
# Steps along a valley between inner parameters, shares of a step that are tried, and a gain that is none.
_MOST_STEPS, _SHARES, _NO_MORE = 12, (1.0, 0.5, 0.25, 0.125), 1e-3
# Values of each parameter on a grid over all of them, by their number, and valleys of it that are followed.
_ON_GRID, _MOST_VALLEYS = {2: 17, 3: 7}, 3
# Standard errors around a value within which it is looked for again.
_REACH = 4.0


@dataclass(frozen=True, eq=False)
class Derived:
    """A term at inner values, with its derivatives by those that are free.

    Attributes
    ----------
    inner
        All inner values.
    coefficients : (k,)
        Those that fit best.
    gain
        Fall of the sum of squares.
    raw : (n, 3, k + free)
        Columns in units of the stated uncertainties: coefficients, then inner derivatives.
    seen
        The same as the space sees them.
    """

    inner: tuple[float, ...]
    coefficients: Numbers
    gain: float
    raw: Numbers
    seen: Seen

    @property
    def values(self) -> Numbers:
        """Coefficients, then all inner values."""
        return np.array([*self.coefficients, *self.inner])

    def covariance(self) -> Numbers:
        """Give that of coefficients and free inner parameters at once, (k + free, k + free)."""
        gram = self.seen.gram_beyond
        size = lengths(gram)
        return np.asarray(np.linalg.pinv(gram / np.outer(size, size), rcond=1e-9) / np.outer(size, size))


@dataclass(frozen=True, eq=False)
class InnerSearch:
    """A term in a space, of which inner parameters are looked for."""

    space: Space
    scanner: Scanner
    term: Term
    # Shapes at some trial values.
    at: Callable[[Sequence[Sequence[float]]], Shapes]

    @property
    def free(self) -> list[int]:
        """Places of inner parameters that may have any value in their range."""
        return [place for place, one in enumerate(self.term.inner) if is_free(one)]

    @cached_property
    def gaps(self) -> dict[int, Gaps]:
        """Spans between rows, by the places of inner parameters that are moments of a jump."""
        places = [place for place in jump_places(self.term) if is_free(self.term.inner[place])]
        if not places:
            return {}
        clock = clock_s(self.space.fitted.sightings)[self.space.rows.any(axis=1)]
        return dict.fromkeys(places, Gaps.of(clock))

    def jump_errors(self, found: Derived) -> dict[int, float]:
        """Give the standard errors of moments of a jump, by place."""

        def gains(place: int, moments: Numbers) -> Numbers:
            trials = [[*found.inner[:place], float(at), *found.inner[place + 1 :]] for at in moments]
            return self._gains(trials)

        return {
            place: gaps.standard_error(found.inner[place], partial(gains, place)) for place, gaps in self.gaps.items()
        }

    def best(
        self, start: Sequence[float], bounds: dict[int, tuple[float, float]], refinements: int
    ) -> tuple[Derived, list[Derived]]:
        """Find the inner values of the largest gain, from a start and between bounds by place.

        Where more than one is looked for, valleys beyond the bounds are followed, too.

        Returns
        -------
        found
            The best.
        others
            The ends of the other valleys.
        """
        found = self.derived(self._one_after_the_other(start, bounds, refinements))
        if not refinements or len(bounds) < 2:
            return found, []
        found = self._along_valley(found)
        ends = [self._along_valley(self.derived(begin)) for begin in self._other_valleys(found, list(bounds))]
        best = max([found, *ends], key=lambda one: one.gain - (0.0 if one is found else _NO_MORE))
        return best, [one for one in (found, *ends) if one is not best]

    def derived(self, inner: Sequence[float]) -> Derived:
        """Estimate the term at inner values, and give it with its derivatives by those that are free."""
        raw = self.scanner.raw_columns(self.at([inner]), 0)
        own = seen(self.space, raw)
        coefficients, gain = own.estimate(self.space)
        slopes = []
        for place in self.free:
            low, high = self.term.inner[place].ends
            is_log = self.term.inner[place].spacing == "log"
            step = 1e-4 * (abs(inner[place]) if is_log else high - low)
            ends = [[*inner[:place], inner[place] + sign * step, *inner[place + 1 :]] for sign in (1.0, -1.0)]
            sides = self.at(ends)
            up, down = (self.scanner.raw_columns(sides, side) @ coefficients for side in (0, 1))
            slopes.append(((up - down) / (2.0 * step))[:, :, None])
        if slopes:
            derivatives = np.concatenate(slopes, axis=2)
            raw, own = np.concatenate([raw, derivatives], axis=2), own.beside(seen(self.space, derivatives))
        return Derived(tuple(inner), coefficients, float(gain), raw, own)

    def _gains(self, trials: Sequence[Sequence[float]]) -> Numbers:
        return self.scanner.exact(self.at(trials)).gain

    def _one_after_the_other(
        self, start: Sequence[float], bounds: dict[int, tuple[float, float]], refinements: int
    ) -> list[float]:
        inner, narrowed = list(start), dict(bounds)
        for _ in range(refinements):
            for place, (low, high) in narrowed.items():
                if not low < high:
                    continue
                points = self._points(place, low, high)
                trials = [[*inner[:place], value, *inner[place + 1 :]] for value in points]
                best = first_best(self._gains(trials))
                inner[place] = points[best]
                narrowed[place] = (points[max(best - 1, 0)], points[min(best + 1, len(points) - 1)])
        return inner

    def _points(self, place: int, low: float, high: float) -> list[float]:
        """Give the values of a parameter to try between bounds: of a jump's moment every gap, where few are."""
        gaps = self.gaps[place].within(low, high) if place in self.gaps else None
        return _between(self.term.inner[place], low, high, _REFINED) if gaps is None else gaps.tolist()

    def _along_valley(self, found: Derived) -> Derived:
        """Follow all inner parameters together to where the gain is largest: Gauss & Newton, steps halved if need be.

        One after the other they stop in a valley that runs between them.
        """
        for _ in range(_MOST_STEPS):
            step = self._step(found)
            trials = [self._inside(found.inner, [share * one for one in step]) for share in _SHARES]
            gains = self._gains(trials)
            most = first_best(gains)
            if gains[most] <= found.gain + _NO_MORE:
                break
            found = self.derived(trials[most])
        return found

    def _step(self, found: Derived) -> list[float]:
        """Give the step of Gauss and Newton; a parameter that would leave its range from its end stays there."""
        k, held = len(found.coefficients), set[int]()
        whole, score = found.seen.gram_beyond, found.seen.score(self.space)
        while True:
            free = [place for place in self.free if place not in held]
            columns = [*range(k), *(k + self.free.index(place) for place in free)]
            gram = whole[np.ix_(columns, columns)]
            size = lengths(gram)
            step = np.linalg.pinv(gram / np.outer(size, size), rcond=1e-12) @ (score[columns] / size) / size
            result = [0.0] * len(found.inner)
            for place, value in zip(free, step[k:], strict=True):
                result[place] = float(value)
            outward = {place for place in free if self._leaves(place, found.inner[place], result[place])}
            if not outward:
                return result
            held |= outward

    def _leaves(self, place: int, value: float, step: float) -> bool:
        low, high = self.term.inner[place].ends
        return (value <= low and step < 0.0) or (value >= high and step > 0.0)

    def _inside(self, inner: Sequence[float], step: Sequence[float]) -> list[float]:
        moved = [a + b for a, b in zip(inner, step, strict=True)]
        for place in self.free:
            moved[place] = float(np.clip(moved[place], *self.term.inner[place].ends))
        return moved

    def _other_valleys(self, found: Derived, places: Sequence[int]) -> list[list[float]]:
        """Give the highest points of a grid over some parameters that have no higher one beside them."""
        n_points = _ON_GRID.get(len(places))
        if n_points is None:
            return []
        axes = [_between(self.term.inner[place], *self.term.inner[place].ends, n_points) for place in places]
        trials = []
        for values in product(*axes):
            trial = list(found.inner)
            for place, value in zip(places, values, strict=True):
                trial[place] = value
            trials.append(trial)
        gains = self._gains(trials).reshape([n_points] * len(places))
        around = np.lib.stride_tricks.sliding_window_view(
            np.pad(gains, 1, constant_values=-np.inf), [3] * len(places)
        ).max(axis=tuple(range(-len(places), 0)))
        peaks = np.flatnonzero(gains >= around)
        highest = peaks[np.argsort(-gains.ravel()[peaks], kind="stable")]
        return [trials[peak] for peak in highest[:_MOST_VALLEYS]]


def standard_errors(free: Sequence[int], found: Derived, others: Sequence[Derived]) -> Numbers:
    """Give standard errors of coefficients and all inner parameters, (k + inner,); 0 for what is not looked for.

    Each valley counts by its likelihood, and is as far off as it is.

    Parameters
    ----------
    free
        Places of inner parameters that were looked for.
    found, others
        The end of the best valley, and of others.
    """
    k = len(found.coefficients)
    varied = [*range(k), *(k + place for place in free)]
    ends = [found, *others]
    weights = np.exp(0.5 * (np.array([one.gain for one in ends]) - found.gain))
    variances = [np.diag(one.covariance()) + (one.values - found.values)[varied] ** 2 for one in ends]
    result = np.zeros(len(found.values))
    result[varied] = np.sqrt(np.maximum(np.average(variances, axis=0, weights=weights), 0.0))
    return result


def around(parameter: Parameter, value: float, std: float) -> tuple[float, float]:
    """Give the bounds within a few standard errors of a value, inside the parameter's range."""
    low, high = parameter.ends
    return max(low, value - _REACH * std), min(high, value + _REACH * std)


def neighbours(shapes: Shapes, trial: int, place: int) -> tuple[float, float]:
    """Give the trial values on both sides of one; the whole range of a parameter that was not tried."""
    assert shapes.term is not None
    tried = sorted({values[place] for values in shapes.trials})
    if len(tried) == 1:
        return shapes.term.inner[place].ends
    at = tried.index(shapes.trials[trial][place])
    return tried[max(at - 1, 0)], tried[min(at + 1, len(tried) - 1)]


def _between(parameter: Parameter, low: float, high: float, n_points: int) -> list[float]:
    spaced = np.geomspace if parameter.spacing == "log" else np.linspace
    return [float(value) for value in spaced(low, high, n_points)]
