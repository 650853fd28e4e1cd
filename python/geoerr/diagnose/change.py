"""Adding an effect to a model, or taking one away: refitted, with the errors before and after on the same rows.

The model's own terms are fitted along, with the bases that they have. Rows that lack a covariate of the effect take
no part in either figure. The model file remembers every change (`history`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from geoerr.diagnose.document import comparison_document
from geoerr.effects import Effect, catalogue
from geoerr.errors import GeoerrError
from geoerr.fit import FitOptions, FitResult, Fitted, fit_terms, refit, result_of, sightings_of
from geoerr.fit.additions import best_terms, refuse_wanting
from geoerr.fit.empirical import empirical_term, is_empirical
from geoerr.model import HistoryEntry, Model
from geoerr.observations import CircularTest, Observations
from geoerr.terms import Term, parse_effect_reference

# What `model.json` remembers of the errors before and after a change.
_REMEMBERED = ("rmse_um", "held_out_rmse_um", "noise_floor_um", "noise_um")


@dataclass(frozen=True, eq=False)
class Change:
    """An effect added or taken away.

    Attributes
    ----------
    result
        The model after it, with its history.
    before, after
        The fits without and with the change, on the same rows.
    """

    result: FitResult
    before: Fitted
    after: Fitted


def add_effect(
    model: Model,
    *tables: Observations | CircularTest,
    reference: str,
    effects: Sequence[Effect] = (),
    threads: int = 0,
) -> Change:
    """Add what a reference names, and fit the whole model again.

    Of an effect's forms, lagged and not, the one is taken that explains most of what the model leaves;
    `empirical:x@feed` is a curve without a cause (`geoerr.fit.empirical`).

    Parameters
    ----------
    model
        What there is: its terms are fitted along.
    tables
        The measurements.
    reference
        `ID[:AXIS][@COVARIATE]`.
    effects
        A user's own, beside the catalogue's.

    Raises
    ------
    InputFileError
        for a reference that names no effect, or one that these data cannot carry.
    GeoerrError
        where the model has the effect already.
    """
    if not is_empirical(reference):
        known = catalogue().extended(effects, "effects") if effects else catalogue()
        effect, resolved = known.resolve(reference)
        refuse_wanting(effect, resolved, sightings_of(*tables))
        name, title = str(resolved), effect.title
        _refuse_held(model, name)
        terms = best_terms(_fitted(model, tables, own_terms(model), threads), effect, resolved)
    else:
        name = str(parse_effect_reference(reference))
        _refuse_held(model, name)
        terms = (empirical_term(_fitted(model, tables, own_terms(model), threads), reference),)
        title = terms[0].title
    return add_terms(model, tables, terms, name, title, threads=threads)


def _refuse_held(model: Model, *names: str) -> None:
    held = {term.id for term in own_terms(model)}
    twice = [name for name in names if name in held]
    if twice:
        raise GeoerrError(f"{twice[0]} is in the model already\nhint: `geoerr remove` takes it out")


def add_terms(
    model: Model,
    tables: Sequence[Observations | CircularTest],
    terms: Sequence[Term],
    reference: str,
    title: str,
    *,
    threads: int = 0,
) -> Change:
    """Add an effect and fit the whole model again.

    Parameters
    ----------
    model
        What there is: its terms are fitted along.
    tables
        The measurements.
    terms
        The effect's, with values unknown.
    reference, title
        As the history names it.

    Raises
    ------
    GeoerrError
        where the model has the effect already.
    """
    _refuse_held(model, *(term.id for term in terms))
    held = {term.id for term in own_terms(model)}
    after = _fitted(model, tables, [*own_terms(model), *terms], threads)
    before = refit(after, [term for term in after.terms if term.id in held])
    return _change(model, before, after, "added", reference, title, [term.id for term in terms])


def remove_terms(
    model: Model,
    tables: Sequence[Observations | CircularTest],
    reference: str,
    *,
    threads: int = 0,
) -> Change:
    """Take an effect away and fit what is left again.

    Parameters
    ----------
    reference
        The effect's, as the model's report writes it: `thermal-expansion:x@temp_bed`.

    Raises
    ------
    GeoerrError
        where the model has no such effect, naming those that it has.
    """
    terms = own_terms(model)
    if not any(term.id == reference for term in terms):
        effects = [term.id for term in terms if term.kind != "classic"]
        raise GeoerrError(
            f"the model has no effect {reference!r}\nhint: it has {', '.join(effects) if effects else 'no effects'}"
        )
    title = next(term.title for term in terms if term.id == reference)
    before = _fitted(model, tables, terms, threads)
    after = refit(before, [term for term in before.terms if term.id != reference])
    return _change(model, before, after, "removed", reference, title, [reference])


def own_terms(model: Model) -> tuple[Term, ...]:
    """Give all terms of a model: of the machine, tables too, and of the rig."""
    return (*model.all_machine_terms, *model.rig_terms)


def figures_to_remember(fitted: Fitted) -> dict[str, float]:
    """Give the error figures that a history entry holds; NaN where one is not computable."""
    figures = comparison_document(fitted)
    return {name: math.nan if figures[name] is None else float(figures[name]) for name in _REMEMBERED}


def _fitted(
    model: Model, tables: Sequence[Observations | CircularTest], terms: Sequence[Term], threads: int
) -> Fitted:
    options = FitOptions(components="none", threads=threads)
    return fit_terms(model.machine, tables, effects=terms, options=options)


def _change(
    model: Model,
    before: Fitted,
    after: Fitted,
    action: str,
    reference: str,
    title: str,
    changed: Sequence[str],
) -> Change:
    held = after if action == "added" else before
    entry = HistoryEntry(
        reference=reference,
        title=title,
        figures_before=figures_to_remember(before),
        figures_after=figures_to_remember(after),
        parameters=tuple(p for term in held.terms if term.id in changed for p in (*term.coefficients, *term.inner)),
        action="added" if action == "added" else "removed",
    )
    earlier = () if model.record is None else model.record.history
    return Change(result_of(after, (*earlier, entry)), before, after)
