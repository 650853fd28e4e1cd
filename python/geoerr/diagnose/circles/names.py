"""Names: causes are added, dropped and exchanged one by one while the evidence grows.

A real machine shows several causes at once, so that no single one is judged alone: each is judged with the others in
the model.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import scipy

from geoerr.diagnose.circles.bench import Group, Judged, Null
from geoerr.diagnose.circles.causes import Way
from geoerr.diagnose.circles.found import Found
from geoerr.diagnose.circles.state import ALPHA, FEW_TRIALS, State
from geoerr.fit.sightings import Numbers

MOST_CAUSES = 12
_MOST_CHANGES = 40
# Another cause takes a cause's place only where the logarithm of the evidence grows by as much.
_EXCHANGE = 1.0
# Of a wave with a second harmonic, and so near to half its period that of the harmonic alone is looked for.
_SECOND_HARMONIC, _NEAR = "A2", 1e-3
# Of names whose evidence differs by less the more common one speaks.
_AS_GOOD = 0.5


class Names:
    """The search for names, from one state."""

    def __init__(self, state: State, chance: Null) -> None:
        self.state, self.chance = state, chance

    def search(self) -> list[Found]:
        """Add the best that chance does not explain, drop and exchange, until nothing helps."""
        found: list[Found] = []
        for _ in range(_MOST_CHANGES):
            if len(found) >= MOST_CAUSES:
                break
            basis, left = self.state.context(found)
            taken = {one.number for one in found}
            judged = [one for one in self.state.bench.judge(basis, left, self.state.n) if one.what not in taken]
            judged = [
                one for one in judged if one.evidence > 0.0 and self.chance.p_value(one.surprise) <= 0.5 * ALPHA
            ]
            if not judged:
                break
            best = _foremost(judged)
            added = self._settled(best, basis, left, self.chance.p_value(best.surprise))
            found.append(added)
            if added.judged.group.by_run or added.judged.group.n_trials > FEW_TRIALS:
                self.state.weigh(found)
            found = self._exchanged(self.needed(found))
        return self._usual(found)

    def _usual(self, found: list[Found]) -> list[Found]:
        """Of names that explain as much give the more common one, each with all the others in the model."""
        for place, one in enumerate(found):
            others = [*found[:place], *found[place + 1 :]]
            basis, left = self.state.context(others)
            evidence, _ = self.state.evidence(one, others)
            taken = {other.number for other in found}
            most = None if one.n_trials > FEW_TRIALS else FEW_TRIALS
            judged = self.state.bench.judge(basis, left, self.state.n, most_trials=most)
            alike = [
                other
                for other in judged
                if other.what < one.number and other.what not in taken and other.evidence > evidence - _AS_GOOD
            ]
            if alike:
                usual = min(alike, key=lambda other: other.what)
                found = [*found[:place], self._settled(usual, basis, left, 0.5 * one.p_value), *found[place + 1 :]]
        return found

    def needed(self, found: list[Found]) -> list[Found]:
        """Drop what the others make superfluous, the least needed first."""
        while len(found) > 1:
            evidence = [self.state.evidence(one, [*found[:k], *found[k + 1 :]])[0] for k, one in enumerate(found)]
            worst = int(np.argmin(evidence))
            if evidence[worst] > 0.0:
                break
            found = [*found[:worst], *found[worst + 1 :]]
        return found

    def _exchanged(self, found: list[Found]) -> list[Found]:
        """Exchange a cause for a better one, as long as that helps."""
        for _ in range(2 * MOST_CAUSES):
            best: tuple[float, int, Judged] | None = None
            taken = {one.number for one in found}
            for place, one in enumerate(found):
                others = [*found[:place], *found[place + 1 :]]
                basis, left = self.state.context(others)
                own, _ = self.state.evidence(one, others)
                # A wave takes the place of a wave only.
                most = None if one.n_trials > FEW_TRIALS else FEW_TRIALS
                for other in self.state.bench.judge(basis, left, self.state.n, most_trials=most):
                    more = other.evidence - own
                    if other.what not in taken and more > _EXCHANGE and (best is None or more > best[0]):
                        best = (more, place, other)
            if best is None:
                return found
            _, place, judged = best
            others = [*found[:place], *found[place + 1 :]]
            basis, left = self.state.context(others)
            found = [*others, self._settled(judged, basis, left, self.chance.p_value(judged.surprise))]
            found = self.needed(found)
        return found

    def _settled(self, judged: Judged, basis: Numbers, left: Numbers, p_value: float) -> Found:
        """Refine the inner parameters of each way to write a cause, and take the best way."""
        ways = self.state.bench.judge(basis, left, self.state.n, only=judged.what)
        settled = [self._settled_way(one, basis, left, p_value) for one in ways]
        settled += [half for one in settled if (half := self._of_half_the_period(one, basis, left)) is not None]

        def evidence(one: Found) -> float:
            return 0.5 * self.state.gain(self.state.white(one), basis, left) - self.state.penalty(one)

        return max(settled, key=evidence)

    def _settled_way(self, judged: Judged, basis: Numbers, left: Numbers, p_value: float) -> Found:
        suspect = self.state.suspects[judged.what]
        way = suspect.ways[judged.group.way]
        inner = list(way.trials[judged.trial])
        for place, values in enumerate(zip(*way.trials, strict=True)):
            tried = sorted(set(values))
            at = tried.index(inner[place])
            low, high = tried[max(at - 1, 0)], tried[min(at + 1, len(tried) - 1)]
            if low < high:
                inner[place] = self._best(judged.group, way, inner, place, (low, high), basis, left)
        columns = self.state.columns(judged.group, way, inner)
        return Found(
            suspect,
            way,
            judged.group.seen,
            tuple(inner),
            columns,
            judged,
            min(2.0 * p_value, 1.0),
            self.state.n_trials[judged.what],
        )

    def _of_half_the_period(self, one: Found, basis: Numbers, left: Numbers) -> Found | None:
        """Give a wave with a second harmonic as one of half its period; None where it is none.

        Waves too short to be tried are reached as the second harmonic of others, which have nothing to do with it.
        """
        if _SECOND_HARMONIC not in {parameter.name for parameter in one.way.term.coefficients}:
            return None
        half = 0.5 * one.inner[0]
        for place, way in enumerate(one.suspect.ways):
            group = next((own for own in self.state.groups if (own.what, own.way) == (one.number, place)), None)
            names = {parameter.name for parameter in way.term.coefficients}
            low = way.term.inner[0].low if way.term.inner else None
            if group is None or _SECOND_HARMONIC in names or low is None or half < low:
                continue
            inner = [half, *one.inner[1:]]
            near = (half * (1.0 - _NEAR), half * (1.0 + _NEAR))
            inner[0] = self._best(group, way, inner, 0, near, basis, left)
            columns = self.state.columns(group, way, inner)
            judged = replace(one.judged, group=group, trial=_nearest(way, inner))
            return replace(one, way=way, seen=group.seen, inner=tuple(inner), columns=columns, judged=judged)
        return None

    def _best(
        self,
        group: Group,
        way: Way,
        inner: Sequence[float],
        place: int,
        ends: tuple[float, float],
        basis: Numbers,
        left: Numbers,
    ) -> float:
        is_log = way.term.inner[place].spacing == "log" and ends[0] > 0.0

        def loss(value: float) -> float:
            trial = [*inner[:place], float(np.exp(value)) if is_log else value, *inner[place + 1 :]]
            return -self.state.gain(self.state.noise.whiten(self.state.columns(group, way, trial)), basis, left)

        low, high = (float(np.log(end)) for end in ends) if is_log else ends
        found = scipy.optimize.minimize_scalar(
            loss, bounds=(low, high), method="bounded", options={"xatol": 2e-4 * (high - low)}
        )
        at_start = float(np.log(inner[place])) if is_log else inner[place]
        # The search stays inside: an end is tried itself, so that a value there is the end and no other.
        best = min((at_start, low, high, float(found.x)), key=loss)
        ends_as_given = {low: ends[0], high: ends[1], at_start: inner[place]}
        return ends_as_given.get(best, float(np.exp(best)) if is_log else best)

    def refined(self, found: list[Found]) -> list[Found]:
        """Settle inner parameters once more with all the others in the model."""
        for _ in range(2):
            for place, one in enumerate(found):
                if not one.inner:
                    continue
                others = [*found[:place], *found[place + 1 :]]
                basis, left = self.state.context(others)
                inner = list(one.inner)
                for number, parameter in enumerate(one.way.term.inner):
                    if parameter.low == parameter.high:
                        continue
                    ends = self._around(one, number)
                    inner[number] = self._best(one.judged.group, one.way, inner, number, ends, basis, left)
                columns = self.state.columns(one.judged.group, one.way, inner)
                settled = replace(one, inner=tuple(inner), columns=columns)
                half = self._of_half_the_period(settled, basis, left)
                ways = [settled] if half is None else [settled, half]
                found[place] = max(ways, key=lambda way: self.state.evidence(way, others)[0])
        return found

    def _around(self, one: Found, number: int) -> tuple[float, float]:
        tried = sorted({trial[number] for trial in one.way.trials})
        at = int(np.searchsorted(tried, one.inner[number]))
        return tried[max(at - 1, 0)], tried[min(at + 1, len(tried) - 1)]


def _nearest(way: Way, inner: Sequence[float]) -> int:
    return int(np.argmin([abs(trial[0] - inner[0]) for trial in way.trials]))


def _foremost(judged: Sequence[Judged]) -> Judged:
    """Give the best; of those that are as good the one that comes first."""
    top = max(one.evidence for one in judged)
    return min((one for one in judged if one.evidence > top - _AS_GOOD), key=lambda one: one.what)
