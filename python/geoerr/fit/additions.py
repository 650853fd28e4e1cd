"""From a reference to the terms that are fitted: what the data carry, and in which way the effect is written best.

An effect may have several forms, and a temperature is followed at once or with a lag; all of them are one candidate
under one name. Which way it is written is for the data to say.
"""

from __future__ import annotations

import math

import numpy as np

from geoerr.effects import Effect
from geoerr.effects.covariates import columns_wanting, temperature_choices
from geoerr.effects.effect import DEFAULT_TIME_RANGE_S
from geoerr.errors import InputFileError
from geoerr.fit.fitted import Fitted
from geoerr.fit.inner import best_start
from geoerr.fit.sightings import Sightings
from geoerr.fit.variables import times_s
from geoerr.machine import Machine
from geoerr.terms import EffectReference, Term


def refuse_wanting(effect: Effect, reference: EffectReference, sightings: Sightings) -> None:
    """Refuse an effect that the data cannot carry.

    Raises
    ------
    InputFileError
        naming the column or the measurement that is wanting.
    """
    columns = sightings.covariate_columns
    wanting = effect.wanting(
        columns,
        n_sessions=len(sightings.sessions),
        is_circular=bool(np.isin("circle", sightings.frames)),
    )
    if wanting is not None:
        raise InputFileError(str(reference), f"cannot be fitted to these data: {wanting}")
    absent = [name for name in reference.covariate_columns if name not in columns]
    if absent:
        raise InputFileError(
            str(reference),
            f"the data have no column {absent[0]}",
            remedy=f"their columns of numbers are {', '.join(columns)}",
        )


def usual_terms(
    effect: Effect, reference: EffectReference, machine: Machine, sightings: Sightings
) -> tuple[Term, ...]:
    """Give the terms of an effect in its usual form, values unknown."""
    if effect.is_smooth:
        return effect.terms(reference.axis, reference.covariate, machine)
    return (_term(effect, reference, machine, sightings, None, lagged=False),)


def best_terms(fitted: Fitted, effect: Effect, reference: EffectReference) -> tuple[Term, ...]:
    """Give the terms of an effect in the form, lagged or not, that explains most of what a fit leaves.

    Forms are compared by Schwarz's evidence, so that a lag has to earn its parameter. Inner parameters have the
    values from which a fit starts.
    """
    if effect.is_smooth:
        return effect.terms(reference.axis, reference.covariate, fitted.machine)
    sigma = fitted.scale if math.isfinite(fitted.scale) and fitted.scale > 0.0 else 1.0
    price = 0.5 * math.log(max(int(fitted.sightings.is_measured[fitted.solved.used].sum()), 2))
    found, most = None, -math.inf
    for term in _ways(fitted, effect, reference):
        started, gain = best_start(fitted, term, threads=fitted.threads)
        evidence = 0.5 * gain / sigma**2 - price * (len(term.coefficients) + len(term.inner))
        if evidence > most:
            found, most = started, evidence
    return usual_terms(effect, reference, fitted.machine, fitted.sightings) if found is None else (found,)


def _ways(fitted: Fitted, effect: Effect, reference: EffectReference) -> list[Term]:
    """Give the term of every form that the data carry, lagged and not."""
    sightings, columns = fitted.sightings, fitted.sightings.covariate_columns
    ways = []
    for form in effect.forms:
        if columns_wanting(form, effect.parameter_names, columns) is not None:
            continue
        if reference.covariate not in (*temperature_choices(form, columns), *form.covariates):
            continue
        for lagged in (False, True):
            if lagged and (reference.covariate is None or not effect.follows_temperature or "t" not in columns):
                continue
            try:
                ways.append(_term(effect, reference, fitted.machine, sightings, form.name, lagged=lagged))
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
    times = times_s(sightings)
    span = (float(times.min()), float(times.max())) if len(times) else DEFAULT_TIME_RANGE_S
    return effect.term(
        reference.axis,
        reference.covariate,
        machine,
        lagged=lagged,
        form=form,
        time_range_s=span if span[1] > span[0] else DEFAULT_TIME_RANGE_S,
        n_sessions=len(sightings.sessions),
    )
