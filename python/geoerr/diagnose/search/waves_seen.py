"""Waves along an axis that a look would speak for: what a whole search for them is worth."""

from __future__ import annotations

from collections.abc import Sequence

from geoerr.diagnose.candidates import Candidate, candidates_of, n_waves
from geoerr.diagnose.functions import Functions
from geoerr.diagnose.scan import all_channels
from geoerr.diagnose.search.bench import Bench
from geoerr.diagnose.search.judged import best_of_each
from geoerr.effects.collection import Catalogue
from geoerr.fit.fitted import Fitted
from geoerr.terms import Term


def waves_seen(
    fitted: Fitted, known: Catalogue, *, present: Sequence[str] = (), threads: int = 0
) -> list[tuple[Term, float]]:
    """Give the waves that explain more than their freedom costs, and how many of each are over what was measured."""
    candidates, _, functions = candidates_of(fitted, known, present)
    waves = [one for one in candidates if _is_wave(functions, one)]
    if not waves:
        return []
    bench = Bench(fitted, functions, names=all_channels([s for one in waves for s in one.shapes]), threads=threads)
    space = bench.space([])
    scanned = iter(bench.scanner(space, n_draws=0).scan([shapes for one in waves for shapes in one.shapes]))
    judged = best_of_each(space, [(one, [next(scanned) for _ in one.shapes]) for one in waves])
    return [
        (one.shapes.term, n_waves(functions, one.shapes.term, one.shapes.trials[one.trial]))
        for one, _ in judged
        if one is not None and one.shapes.term is not None and one.evidence > 0.0
    ]


def _is_wave(functions: Functions, candidate: Candidate) -> bool:
    """Tell whether a candidate is a wave in some form."""
    return any(
        shapes.term is not None and n_waves(functions, shapes.term, shapes.trials[0]) > 0.0
        for shapes in candidate.shapes
    )
