"""The order in which finds are told: as they were found, but that each lets the held-out error fall, or goes."""

from __future__ import annotations

from collections.abc import Sequence

from geoerr.diagnose.search.bench import Bench
from geoerr.diagnose.search.rivals import Found


def in_helpful_order(bench: Bench, found: Sequence[Found]) -> list[Found]:
    """Put what raises the held-out error, if it is added next, behind what lets it fall most.

    Of a machine that warms up, a curve in time may be found first: it explains most, and predicts worse than nothing
    until the temperature beside it is in the model. Whoever adds the first has to see the error fall.
    """
    told: list[Found] = []
    rest = list(found)
    while len(rest) > 1:
        columns = [one.settled.raw for one in told]
        before = bench.held_out.um(columns)
        after = [bench.held_out.um([*columns, one.settled.raw]) for one in rest]
        known = [um for um in after if um is not None]
        if before is None or len(known) < len(rest) or known[0] < before:
            told.append(rest.pop(0))
        else:
            told.append(rest.pop(known.index(min(known))))
    return [*told, *rest]


def without_harmful(bench: Bench, told: Sequence[Found]) -> list[Found]:
    """Leave out, from the last on, what was found later and raises the held-out error beside the others.

    However seldom chance does as much: what predicts worse where the fit did not see the data is another name's, or
    that of something without one. In the lines that are kept of the study no right name that is told later does.
    """
    kept = list(told)
    while len(kept) > 1:
        columns = [one.settled.raw for one in kept]
        before, after = bench.held_out.um(columns[:-1]), bench.held_out.um(columns)
        if before is None or after is None or after < before:
            break
        kept.pop()
    return kept
