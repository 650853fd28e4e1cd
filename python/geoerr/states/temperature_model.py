"""One model with temperature in it: the chosen terms fitted to all observations of all states at once."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import polars as pl

from geoerr.fit import (
    FitOptions,
    FitResult,
    complete_rows,
    digest_of,
    fit_terms,
    result_of,
    sightings_of,
    within_the_machine,
)
from geoerr.fit.sightings import Numbers
from geoerr.machine import Machine
from geoerr.model import Model
from geoerr.observations import Observations, as_read_together
from geoerr.states.functions import Functions
from geoerr.states.joint import TemperatureFit
from geoerr.states.shapes import coefficient_name, temperature_terms, term_id
from geoerr.states.weights import Weights
from geoerr.terms import Term

# Rows times unknowns of offsets that the joint fit takes along: with three components some 500 MB.
_MOST_NUMBERS = 20_000_000


@dataclass(frozen=True, eq=False)
class TemperatureModel:
    """A fitted model that follows temperature.

    Attributes
    ----------
    result
        The fit; `result.model` is written by `write_model` and compensates with `--at temp=90`.
    covariate
        The condition that predictions need.
    chosen
        What its terms were chosen by.
    notes
        Sentences for the reader.
    """

    result: FitResult
    covariate: str
    chosen: TemperatureFit
    notes: tuple[str, ...] = ()

    @property
    def model(self) -> Model:
        """The model."""
        return self.result.model

    @property
    def temperature_terms(self) -> tuple[Term, ...]:
        """The terms that follow temperature, with values whose uncertainty counts the choice of terms.

        The covariance of `model` does not: it holds for the terms chosen.
        """
        by_choice = {
            (term_id(shape.name, shape.power, self.covariate), coefficient_name(shape)): float(std)
            for shape, std in zip(self.chosen.shapes, self.chosen.std_of_choice, strict=True)
        }
        return tuple(
            replace(
                term,
                coefficients=tuple(
                    replace(one, std=math.hypot(one.std, by_choice[term.id, one.name])) for one in term.coefficients
                ),
            )
            for term in self.model.terms
            if self.covariate in term.variables
        )


def temperature_model(
    machine: Machine,
    covariate: str,
    functions: Functions,
    chosen: TemperatureFit,
    observations: Sequence[Observations],
    sensitivities: Sequence[Numbers],
    weights: Weights,
    *,
    as_given: Sequence[Observations] = (),
    threads: int = 0,
) -> TemperatureModel:
    """Fit the 21 errors and the chosen shapes of temperature to all states' observations.

    Parameters
    ----------
    observations
        Of each state.
    sensitivities
        For each state how its offsets of passes move its rows, (n, 3, p).
    as_given
        The same rows as tables of their own, under the names of their sessions: what the model knows its data by.
    weights
        Of rows that state no uncertainty.
    """
    frame = pl.concat([one.frame for one in observations], how="diagonal_relaxed")
    joined = Observations(frame, tuple(source for one in observations for source in one.sources))
    bases = {term.id: spec for term in functions.terms if (spec := term.parts[0].basis) is not None}
    size = sum(len(one) for one in sensitivities) * sum(one.shape[2] for one in sensitivities)
    notes: tuple[str, ...] = ()
    if size > _MOST_NUMBERS:
        sensitivities = [one[:, :, :0] for one in sensitivities]
        notes = (
            "one model: offsets of passes would take more memory than there may be, and are not in its covariance; "
            "those of states and differences have them",
        )
    offsets = _side_by_side(sensitivities)
    fitted = fit_terms(
        machine,
        [joined],
        effects=temperature_terms(chosen.shapes, functions, covariate, machine.reference_temperature_degc),
        options=FitOptions(bases=bases, threads=threads),
        rig_sensitivity=offsets,
        rig_covariance=None if offsets is None else np.eye(offsets.shape[2]),
        sightings=weights.sightings([joined]),
    )
    terms_of_heat = {term.id for term in fitted.terms if covariate in term.variables}
    notes += tuple(
        f"one model: {item.name} is not determined by all rows together, and its value says nothing: {item.why}"
        for item in fitted.not_determined
        if item.name in terms_of_heat
    )
    result = _known_by(as_given, _with_misfit(result_of(fitted), functions, chosen, covariate))
    return TemperatureModel(result, covariate, chosen, notes)


def _known_by(tables: Sequence[Observations], result: FitResult) -> FitResult:
    """Let a model know its data by the tables as their files are read together: here sessions have other names."""
    record = result.model.record
    if not tables or record is None:
        return result
    model = result.model
    read = within_the_machine(sightings_of(as_read_together(tables)), model.machine)
    sightings = complete_rows(model.machine, read, model.terms)
    known = replace(model, record=replace(record, data_digest=digest_of(sightings)))
    return replace(result, model=known)


def _with_misfit(result: FitResult, functions: Functions, chosen: TemperatureFit, covariate: str) -> FitResult:
    """Add to a model's covariance what functions that break the law of temperature may be off by."""
    if not chosen.astray:
        return result
    model = result.model
    keys = [(term.id, one.name) for term in model.terms for one in term.coefficients]
    place_of = {key: place for place, key in enumerate(keys)}
    own = [(term.id, one.name) for term in functions.terms for one in term.coefficients]
    own += [(term_id(shape.name, shape.power, covariate), coefficient_name(shape)) for shape in chosen.shapes]
    kept = [number for number, key in enumerate(own) if key in place_of]
    places = [place_of[own[number]] for number in kept]
    assert model.record is not None
    covariance = model.record.covariance.copy()
    covariance[np.ix_(places, places)] += chosen.misfit_covariance[np.ix_(kept, kept)]
    std = dict(zip(keys, np.sqrt(np.maximum(np.diag(covariance), 0.0)), strict=False))
    terms = tuple(
        replace(
            term,
            coefficients=tuple(
                one if math.isnan(one.std) else replace(one, std=float(std[term.id, one.name]))
                for one in term.coefficients
            ),
        )
        for term in model.terms
    )
    record = replace(model.record, covariance=covariance)
    return replace(result, model=Model(model.machine, terms=terms, record=record))


def _side_by_side(sensitivities: Sequence[Numbers]) -> Numbers | None:
    """Join (n_s, 3, p_s) of states to (Σ n, 3, Σ p): every state has unknowns of its own."""
    total = sum(one.shape[2] for one in sensitivities)
    if not total:
        return None
    joined = np.zeros((sum(len(one) for one in sensitivities), 3, total))
    row = column = 0
    for one in sensitivities:
        joined[row : row + len(one), :, column : column + one.shape[2]] = one
        row, column = row + len(one), column + one.shape[2]
    return joined
