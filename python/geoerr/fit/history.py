"""What adding effects did to the error: a fit of the same rows after each, and an entry of the model's history."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

from geoerr.fit.additions import Addition
from geoerr.fit.fit import refit
from geoerr.fit.fitted import Fitted
from geoerr.fit.result import figures_document
from geoerr.model import HistoryEntry

# What `model.json` remembers of the errors before and after a change.
_REMEMBERED = ("rmse_um", "held_out_rmse_um", "noise_floor_um", "noise_um")


def figures_to_remember(fitted: Fitted) -> dict[str, float]:
    """Give the error figures that a history entry holds; NaN where one is not computable."""
    figures = figures_document(fitted)
    return {name: math.nan if figures[name] is None else float(figures[name]) for name in _REMEMBERED}


def steps_to(
    fitted: Fitted, added: Sequence[Addition], on_step: Callable[[], None] = lambda: None
) -> tuple[Fitted, ...]:
    """Fit the same rows with none of the effects, with the first, with the first two ...; the last is `fitted`."""
    steps = []
    for number in range(len(added)):
        left_out = {term.id for one in added[number:] for term in one.terms}
        steps.append(refit(fitted, [term for term in fitted.terms if term.id not in left_out]))
        on_step()
    return (*steps, fitted)


def history_of(steps: Sequence[Fitted], added: Sequence[Addition]) -> tuple[HistoryEntry, ...]:
    """Give an entry for each effect, in the order in which they were asked for: `steps` are the fits between them."""
    found = {term.id: term for term in steps[-1].terms}
    return tuple(
        HistoryEntry(
            reference=one.reference,
            title=one.title,
            figures_before=figures_to_remember(before),
            figures_after=figures_to_remember(after),
            parameters=tuple(p for term in one.terms for p in (*found[term.id].coefficients, *found[term.id].inner)),
        )
        for one, before, after in zip(added, steps[:-1], steps[1:], strict=True)
    )
