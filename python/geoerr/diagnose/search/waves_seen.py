"""Waves along an axis that a look would speak for: what a whole search for them is worth."""

from __future__ import annotations

from geoerr.diagnose.candidates import is_wave_in_some_form, n_waves
from geoerr.diagnose.offers import Offers
from geoerr.diagnose.scan import all_channels
from geoerr.diagnose.search.bench import Bench
from geoerr.diagnose.search.judged import scanned_best
from geoerr.fit.fitted import Fitted
from geoerr.terms import Term


def waves_seen(fitted: Fitted, offers: Offers, *, threads: int = 0) -> list[tuple[Term, float]]:
    """Give the waves that explain more than their freedom costs, and how many of each are over what was measured."""
    candidates, _, functions = offers.to(fitted)
    waves = [one for one in candidates if is_wave_in_some_form(functions, one)]
    if not waves:
        return []
    bench = Bench(fitted, functions, names=all_channels([s for one in waves for s in one.shapes]), threads=threads)
    judged = scanned_best(bench.scanner(bench.space([]), n_draws=0), waves)
    return [
        (one.shapes.term, n_waves(functions, one.shapes.term, one.shapes.trials[one.trial]))
        for one, _ in judged
        if one is not None and one.shapes.term is not None and one.evidence > 0.0
    ]
