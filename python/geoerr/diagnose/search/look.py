"""One look at everything: all candidates and probes against what a model leaves, and what chance finds there."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from geoerr.diagnose.candidates import Candidate
from geoerr.diagnose.hums import hums_of
from geoerr.diagnose.null import Null, largest_surprise, p_value_of_all
from geoerr.diagnose.probes import Probe, bodies, shapes_on
from geoerr.diagnose.scan import Scanner
from geoerr.diagnose.search.asked_for import AskedFor
from geoerr.diagnose.search.bench import Bench
from geoerr.diagnose.search.judged import (
    Judged,
    best_of_each,
    component_of,
    freedom_of,
    is_admissible,
    variables_of,
)
from geoerr.diagnose.space import Space
from geoerr.fit.sightings import Numbers
from geoerr.machine import AXES

_SEED = 19_820_601
# A wave in time that is less of a surprise is chance's, whatever its evidence: others surprise more in every search.
_LEAST_OF_HUM = 3.0
# A variable that does this share of what a wave in time does is what goes up and down.
_AS_MUCH = 0.9


@dataclass(frozen=True, eq=False)
class Round:
    """One look at everything: all candidates and probes against what a model leaves.

    Attributes
    ----------
    space, scanner
        What was left.
    candidates, probes
        Best first, by evidence; of candidates those that can be seen.
    invisible
        Candidates of which the model leaves nothing.
    null
        What chance finds among the candidates.
    null_of_probes
        What it finds among the probes.
    asked_for
        What was asked for by itself, the play of axes; where anything was, all this has half of the level only.
    """

    space: Space
    scanner: Scanner
    candidates: tuple[Judged, ...]
    probes: tuple[Judged, ...]
    invisible: tuple[Candidate, ...]
    null: Null
    null_of_probes: Null
    asked_for: tuple[AskedFor, ...] = ()

    @property
    def is_halved(self) -> bool:
        """Whether all this has half of the level only, and so p-values twice as large: axes were asked for play."""
        return bool(self.asked_for)

    @property
    def p_asked(self) -> float:
        """That there is nothing of what was asked for; 1 where nothing was."""
        return min((one.p_value for one in self.asked_for), default=1.0)

    @property
    def p_searched(self) -> float:
        """That there is nothing of what was searched for: the better of names and probes."""
        halves = (self.null, self.candidates), (self.null_of_probes, self.probes)
        return p_value_of_all(
            [(null, max((one.surprise for one in judged), default=-math.inf)) for null, judged in halves]
        )

    @property
    def p_value(self) -> float:
        """That nothing is missing, for all that was looked at, before any gate: uniform where nothing is.

        Candidates have one half of the level and probes the other, however many there are of each; and all these as
        much as what was asked for.
        """
        # That the smaller of two is so small (Šidák).
        searched = self.p_searched
        least = min(searched, self.p_asked)
        return least * (2.0 - least) if self.is_halved else searched

    def p_value_of(self, surprise: float) -> float:
        """Give the p-value of a candidate that surprises so much."""
        return min((2.0 if self.is_halved else 1.0) * self.null.p_value(surprise), 1.0)


def look(bench: Bench, space: Space, candidates: Sequence[Candidate], probes: Sequence[Probe]) -> Round:
    """Judge every candidate and probe."""
    everything: list[Candidate | Probe] = [*candidates, *probes]
    scanner = bench.scanner_of_look(space)
    scanned = iter(scanner.scan([shapes for what in everything for shapes in what.shapes]))
    judged: list[list[Judged]] = []
    nulls: list[Null] = []
    invisible: list[Candidate] = []
    groups: tuple[Sequence[Candidate | Probe], ...] = (candidates, probes)
    for group in groups:
        found = [(what, [next(scanned) for _ in what.shapes]) for what in group]
        best = best_of_each(space, found)
        invisible += [
            what for what, (one, _) in zip(group, best, strict=True) if one is None and isinstance(what, Candidate)
        ]
        # As for a draw of noise the largest over all trials, not that of the best one.
        own = [replace(one, surprise=most) for one, most in best if one is not None]
        of_draws = [
            (one.largest, what.n_trials)
            for (what, of_shapes), (top, _) in zip(found, best, strict=True)
            if top is not None
            for one in of_shapes
        ]
        largest = largest_surprise(of_draws, scanner.n_draws)
        if group is probes and probes:
            waves, drawn = hums(bench, space, scanner)
            own = [*(wave for wave in waves if not _is_of_a_variable(wave, own)), *own]
            largest = np.maximum(largest, drawn)
        null = Null(largest, bench.n_searches)
        nulls.append(null)
        own = [
            replace(one, p_value=null.p_value(one.surprise))
            for one in own
            if one.evidence <= 0.0 or is_admissible(space, scanner, one)
        ]
        # Of equals the one with the least freedom: with more of it, it says the same.
        judged.append(sorted(own, key=lambda one: (-round(one.evidence, 6), freedom_of(one))))
    return Round(space, scanner, tuple(judged[0]), tuple(judged[1]), tuple(invisible), nulls[0], nulls[1])


def _is_of_a_variable(wave: Judged, probes: Sequence[Judged]) -> bool:
    """Tell whether a variable does nearly as much as a wave in time: then it is what goes up and down.

    A temperature that is cycled is a wave itself, of a frequency that a wave in time can take.
    """
    component = component_of(wave)
    return any(
        one.gain >= _AS_MUCH * wave.gain and component_of(one) == component and "t" not in variables_of(one)
        for one in probes
    )


def hums(bench: Bench, space: Space, scanner: Scanner) -> tuple[list[Judged], Numbers]:
    """Judge waves in time: the best of each channel, and what chance finds in as many searches, (n_draws,).

    That some frequency has a surprise above s has a chance of e^-s at most: so it is drawn.
    """
    found = []
    channels = [f"{body}-{axis}" for body in bodies(bench.fitted) for axis in AXES]
    waves = list(hums_of(bench.waves, channels, space, bench.channels)) if scanner.n_draws else []
    for one in waves:
        if one.surprise < _LEAST_OF_HUM:
            continue
        codes = [bench.functions.given(column) for column in one.wave.columns]
        shapes = shapes_on(one.channel, [codes], [(one.wave.frequency,)])
        probe = Probe(one.channel[-1], ("t",), (shapes,), 1, "hum")
        judged, _ = best_of_each(space, [(probe, [scanner.exact(shapes)])])[0]
        if judged is not None:
            evidence = judged.evidence - math.log(one.n_trials)
            found.append(replace(judged, surprise=one.surprise, evidence=evidence))
    drawn = np.random.default_rng(_SEED).exponential(size=(max(len(waves), 1), scanner.n_draws))
    return found, np.max(drawn, axis=0) if waves else np.full(scanner.n_draws, -math.inf)
