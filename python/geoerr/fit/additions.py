"""From a reference to the terms that are fitted: what the data carry, and in which way the effect is written best.

An effect may have several forms, and a temperature is followed at once or with a lag; all of them are one candidate
under one name. Which way it is written is for the data to say, or for the user (`Way`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from geoerr.effects import Catalogue, Effect, PlacedEffect
from geoerr.effects.covariates import columns_wanting, temperature_choices
from geoerr.effects.effect import DEFAULT_TIME_RANGE_S
from geoerr.errors import InputFileError
from geoerr.fit.beside_effects import with_few_knots
from geoerr.fit.classic import Components, names_of
from geoerr.fit.empirical import empirical_term, is_empirical
from geoerr.fit.fitted import Fitted
from geoerr.fit.inner import best_start, where_known
from geoerr.fit.sightings import Sightings
from geoerr.fit.variables import clock_span_s
from geoerr.machine import Machine
from geoerr.terms import SQUARENESS_CHANNELS, EffectReference, Term, parse_effect_reference

# Of the variance that a fit without an effect leaves, a share that may be noise at least, where none is stated.
_LEAST_LEFT = 1e-6
# What can be asked for: a term as it is, an effect in its place (or with only one), a reference.
Wanted: TypeAlias = Term | Effect | PlacedEffect | EffectReference | str


@dataclass(frozen=True)
class Way:
    """How effects are to be written; what is None is for the data to say.

    Attributes
    ----------
    lagged
        Whether effects that follow a temperature do so through a first-order lag.
    form
        Name of the form, for effects that have one of that name.
    """

    lagged: bool | None = None
    form: str | None = None


@dataclass(frozen=True)
class Addition:
    """An effect beyond the classic errors: its reference as reports write it, its title, its terms."""

    reference: str
    title: str
    terms: tuple[Term, ...]


def additions(
    wanted: Sequence[Wanted],
    known: Catalogue,
    machine: Machine,
    sightings: Sightings,
    held: Collection[str],
    fit: Callable[[Sequence[Term]], Fitted],
    way: Way | None = None,
) -> list[Addition]:
    """Give effects that were asked for as terms whose values are unknown.

    Parameters
    ----------
    wanted
        References, effects in their places, or terms as they are.
    known
        Where references are looked up.
    machine
        For ranges, sides and the reference temperature.
    sightings
        The data: they must hold the columns that an effect needs.
    held
        Classic errors of the model (`held_errors`): one of them is not added a second time.
    fit
        Fits the model with these terms beyond its own: asked for where the data have to say how an effect is written.
    way
        How to write them.

    Raises
    ------
    InputFileError
        for a reference that names no effect, a column that the data do not have, what the model holds already, or a
        form or a lag that no effect has.
    """
    way = way or Way()
    _refuse_way(way, wanted, known)
    added: list[Addition] = []
    for one in wanted:
        found = _addition(one, known, machine, sightings, way, lambda: fit([t for a in added for t in a.terms]))
        channels = [channel for term in found.terms for channel in term.channels]
        if not isinstance(one, Term) and _is_classic(found, known) and set(held).issuperset(channels):
            raise InputFileError(
                found.reference,
                f"is in the model already, among its errors of axes: {', '.join(channels)}",
                remedy="leave it out, or fit it with --components none",
            )
        names = {term.id for other in added for term in other.terms}
        if names.intersection(term.id for term in found.terms):
            raise InputFileError(found.reference, "is added twice", remedy="name it once")
        added.append(found)
    return added


def held_errors(components: Components, terms: Sequence[Term] = ()) -> set[str]:
    """Name the classic errors of a model: those of these components, and those among its terms."""
    own = {channel for term in terms if term.kind == "classic" for channel in term.channels}
    return own | {*names_of(components), *(() if components == "none" else SQUARENESS_CHANNELS)}


def _refuse_way(way: Way, wanted: Sequence[Wanted], known: Catalogue) -> None:
    """Refuse a lag or a form that nothing that was asked for can have."""
    references = [one for one in wanted if isinstance(one, str | EffectReference)]
    effects = [known.resolve(one)[0] for one in references if not is_empirical(str(one))]
    if way.lagged is not None and not any(effect.follows_temperature for effect in effects):
        raise InputFileError("lag", "is asked for, and no effect follows a temperature", remedy="leave it out")
    forms = dict.fromkeys(name for effect in effects for name in effect.form_names if name)
    if way.form is not None and way.form not in forms:
        has = (
            f"forms are {', '.join(map(repr, forms))}" if forms else "these effects have one form each; leave it out"
        )
        raise InputFileError(way.form, "is a form of none of these effects", remedy=has)


def _addition(
    wanted: Wanted,
    known: Catalogue,
    machine: Machine,
    sightings: Sightings,
    way: Way,
    fit: Callable[[], Fitted],
) -> Addition:
    if isinstance(wanted, Term):
        return Addition(wanted.id, wanted.title, (wanted,))
    if isinstance(wanted, Effect | PlacedEffect):
        placed = wanted.at() if isinstance(wanted, Effect) else wanted
        refuse_wanting(placed.effect, placed.reference, sightings)
        return Addition(str(placed.reference), placed.effect.title, _placed(placed, machine, sightings))
    if is_empirical(str(wanted)):
        term = empirical_term(fit(), wanted)
        return Addition(term.id, term.title, (term,))
    effect, reference = known.resolve(wanted)
    refuse_wanting(effect, reference, sightings)
    ways = ways_of(effect, reference, machine, sightings, way)
    usual = usual_terms(effect, reference, machine, sightings)
    terms = best_terms(with_few_knots(fit(), usual), effect, reference, way) if len(ways) > 1 else (*ways,)
    return Addition(str(reference), effect.title, terms or usual)


def _placed(wanted: PlacedEffect, machine: Machine, sightings: Sightings) -> tuple[Term, ...]:
    if wanted.effect.is_smooth:
        return wanted.terms(machine)
    return (_term(wanted.effect, wanted.reference, machine, sightings, wanted.form, lagged=wanted.lagged),)


def _is_classic(found: Addition, known: Catalogue) -> bool:
    name = parse_effect_reference(found.reference).effect
    return name in known and known[name].is_classic


def refuse_wanting(effect: Effect, reference: EffectReference, sightings: Sightings) -> None:
    """Refuse an effect that the data cannot carry.

    Raises
    ------
    InputFileError
        naming the column or the measurement that is wanting.
    """
    columns = sightings.effect_columns
    wanting = effect.wanting(
        columns,
        n_sessions=sightings.n_set_ups,
        is_circular=bool(np.isin("circle", sightings.frames)),
    )
    may_follow = f"columns that an effect may follow are {', '.join(sightings.free_columns) or 'none'}"
    if wanting is not None:
        named = "; one that holds a temperature is named temp or temp_..., as temp_bed"
        raise InputFileError(
            str(reference),
            f"cannot be fitted to these data: {wanting}",
            remedy=f"{may_follow}{named}" if effect.follows_temperature and "temperature" in wanting else None,
        )
    absent = [name for name in reference.covariate_columns if name not in columns]
    if absent:
        raise InputFileError(str(reference), f"the data have no column {absent[0]}", remedy=may_follow)


def usual_terms(
    effect: Effect, reference: EffectReference, machine: Machine, sightings: Sightings
) -> tuple[Term, ...]:
    """Give the terms of an effect in its usual form, values unknown."""
    if effect.is_smooth:
        return effect.terms(reference.axis, reference.covariate, machine)
    return (_term(effect, reference, machine, sightings, None, lagged=False),)


def best_terms(
    fitted: Fitted, effect: Effect, reference: EffectReference, way: Way | None = None
) -> tuple[Term, ...]:
    """Give the terms of an effect in the form, lagged or not, that explains most of what a fit leaves.

    Forms are compared by Schwarz's evidence, so that a lag has to earn its parameter. Inner parameters have the
    values from which a fit starts.
    """
    if effect.is_smooth:
        return effect.terms(reference.axis, reference.covariate, fitted.machine)
    ways = ways_of(effect, reference, fitted.machine, fitted.sightings, way)
    # On the same rows for all of them.
    fitted = where_known(fitted, ways)
    begun = [best_start(fitted, term, threads=fitted.threads) for term in ways]
    if not begun:
        return usual_terms(effect, reference, fitted.machine, fitted.sightings)
    # What the effect does itself is no noise: beside it even a lag of an hour would be worth nothing.
    left = fitted.unit**2 - max(gain for _, gain in begun) / max(fitted.dof, 1)
    least = min(1.0, fitted.unit**2) if fitted.sightings.is_stated else _LEAST_LEFT * fitted.unit**2
    sigma2 = max(left, least)
    price = 0.5 * math.log(max(int(fitted.sightings.is_measured[fitted.solved.used].sum()), 2))

    def evidence(started: tuple[Term, float]) -> float:
        term, gain = started
        return 0.5 * gain / sigma2 - price * (len(term.coefficients) + len(term.inner))

    return (max(begun, key=evidence)[0],)


def ways_of(
    effect: Effect, reference: EffectReference, machine: Machine, sightings: Sightings, way: Way | None = None
) -> list[Term]:
    """Give the term of every form that the data carry, lagged and not, as far as `way` leaves it open.

    Raises
    ------
    InputFileError
        for a lag in data that have no time.
    """
    way, columns = way or Way(), sightings.effect_columns
    if effect.is_smooth:
        return []
    can_lag = reference.covariate is not None and effect.follows_temperature
    if way.lagged and can_lag and "t" not in columns:
        raise InputFileError(
            str(reference),
            "can have no lag: the data have no time",
            remedy="add a column t (s), or leave the lag out",
        )
    ways = []
    for form in [one for one in effect.forms if one.name == way.form] or effect.forms:
        if columns_wanting(form, effect.parameter_names, columns) is not None:
            continue
        if reference.covariate not in (*temperature_choices(form, columns, is_ordered=True), *form.covariates):
            continue
        for lagged in (False, True) if way.lagged is None or not can_lag else (way.lagged,):
            if lagged and (not can_lag or "t" not in columns):
                continue
            try:
                ways.append(_term(effect, reference, machine, sightings, form.name, lagged=lagged))
            except InputFileError:
                # This form belongs to another covariate.
                continue
    return ways


def _term(
    effect: Effect,
    reference: EffectReference,
    machine: Machine,
    sightings: Sightings,
    form: str | None,
    *,
    lagged: bool,
) -> Term:
    return effect.term(
        reference.axis,
        reference.covariate,
        machine,
        lagged=lagged,
        form=form,
        time_range_s=clock_span_s(sightings) or DEFAULT_TIME_RANGE_S,
        sessions=sightings.set_ups,
    )
