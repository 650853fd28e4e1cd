"""Waves along an axis that a look would speak for: what a whole search for them is worth."""

from __future__ import annotations

from collections.abc import Iterator

from geoerr.diagnose.candidates import is_wave_in_some_form, n_waves
from geoerr.diagnose.offers import Offers
from geoerr.diagnose.scan import all_channels
from geoerr.diagnose.search.bench import Bench
from geoerr.diagnose.search.judged import Judged, scanned_best
from geoerr.fit.fitted import Fitted
from geoerr.fit.sightings import Numbers
from geoerr.terms import Term

# A machine may have three waves on an axis, and many knots follow one that is not the best.
_LOOKS = 3


def waves_seen(fitted: Fitted, offers: Offers, *, threads: int = 0) -> Iterator[tuple[Term, float]]:
    """Give the waves that explain more than their freedom costs, and how many of each are over what was measured.

    The best of each candidate; then, beside all these, the next.
    """
    candidates, _, functions = offers.to(fitted)
    waves = [one for one in candidates if is_wave_in_some_form(functions, one)]
    if not waves:
        return
    bench = Bench(fitted, functions, names=all_channels([s for one in waves for s in one.shapes]), threads=threads)
    beside: list[Numbers] = []
    for _ in range(_LOOKS):
        scanner = bench.scanner(bench.space(beside), n_draws=0)
        best = [one for one, _ in scanned_best(scanner, waves) if one is not None and one.evidence > 0.0]
        for one in best:
            if one.shapes.term is not None:
                yield one.shapes.term, n_waves(functions, one.shapes.term, one.shapes.trials[one.trial])
        if not best:
            return
        beside += [scanner.raw_columns(one.shapes, trial) for one in best for trial in _around(one)]


def _around(judged: Judged) -> range:
    """Give the trial and those beside it: the period is between two of them, and what is left is no next wave."""
    return range(max(judged.trial - 1, 0), min(judged.trial + 2, len(judged.shapes.trials)))
