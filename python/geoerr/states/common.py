"""Bases that all states share, chosen by what the states say together: the choice knows nothing of differences.

Every state is fitted with bases as rich as the positions allow (`richness`). The mean of these estimates, weighed by
their covariances (`mean`), is independent of every difference of two states that were measured alike; bases chosen
from the mean (`geoerr.fit.knots`) leave tests of differences as they were: a choice made from each state by itself
keeps the noise that happened to be large, and tests alarm two to four times too often. The mean is more certain than
a state, so that what the bases cannot follow is small against a state's own noise. An error that some state leaves
open gets its basis from those that determine it: their fits have it, and one too stiff spoils what stands beside it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from geoerr.bases import places_for_knots
from geoerr.error_functions import NotDetermined
from geoerr.fit import FitOptions, Fitted, fit_terms, sightings_of
from geoerr.fit.classic import MOST_FUNCTIONS, distinct_positions, moves_in_its_pass, names_of
from geoerr.fit.knots import choose_bases
from geoerr.fit.sightings import SAME_POSITION_MM, Numbers, Sightings
from geoerr.machine import AXES, Machine
from geoerr.model.gauge import is_determined
from geoerr.observations import ONE_PLACE, Observations
from geoerr.states.functions import Estimate, Functions, gauged, term_id_of, with_values
from geoerr.states.mean import mean_of
from geoerr.states.richness import richest
from geoerr.states.weights import Weights
from geoerr.terms import BasisSpec

# Tables have no more entries than this: where an axis stood at more places, they are spread evenly over them.
_MOST_ENTRIES = 41


@dataclass(frozen=True, eq=False)
class CommonBases:
    """What all states are fitted with.

    Attributes
    ----------
    bases
        By ISO name.
    position_mm
        Axis to the positions of its tables.
    not_determined
        For each state what it leaves open however few functions an error has: with fewer yet, others would stand in.
    """

    bases: dict[str, BasisSpec]
    position_mm: dict[str, Numbers]
    not_determined: tuple[tuple[NotDetermined, ...], ...]

    @property
    def by_state(self) -> tuple[CommonBases, ...]:
        """Give for each state what two measurements of it can be compared by."""
        return tuple(replace(self, not_determined=(own, own)) for own in self.not_determined)


def common_bases(
    machine: Machine,
    tables: Mapping[float, Observations],
    range_mm: Mapping[str, tuple[float, float]],
    given: Mapping[str, BasisSpec],
    threads: int,
    weights: Weights,
) -> CommonBases:
    """Choose bases for all states, and the positions of their tables.

    Parameters
    ----------
    tables
        Temperature to rows.
    range_mm
        Axis to the range that all states share: that of the tables.
    given
        Bases that are not to be chosen, by ISO name.
    weights
        Of rows that state no uncertainty.
    """
    sightings = [sightings_of(table) for table in tables.values()]
    places = {axis: _of_all([_places(one, axis) for one in sightings]) for axis in AXES}
    entries = {axis: _entries(found, *range_mm[axis]) for axis, found in places.items()}

    def fit(bases: Mapping[str, BasisSpec]) -> list[Fitted]:
        options = FitOptions(bases={**bases, **given}, threads=threads)
        return [
            fit_terms(machine, [table], options=options, sightings=weights.sightings([table]))
            for table in tables.values()
        ]

    rich, fits = richest(fit, [name for name in names_of("21") if name not in given], sightings, places)
    if not rich:
        return CommonBases(dict(given), entries, ((),) * len(tables))
    mean = mean_of(fits, [estimate_of(fitted) for fitted in fits])
    terms = with_values(fits[0].terms, mean.values)
    undecided = [term for term in terms if term.id in rich]
    choices = choose_bases(undecided, terms, mean.covariance, mean.null_space, places)
    chosen = {**given, **rich, **{choice.name: choice.basis for choice in choices}}
    return CommonBases(chosen, entries, tuple(fitted.not_determined for fitted in fits))


def _entries(places_mm: Numbers, low_mm: float, high_mm: float) -> Numbers:
    """Give the positions of a table from end to end of a range: the places between, if they are not too many."""
    if high_mm - low_mm <= SAME_POSITION_MM:
        return np.array([low_mm])
    if len(places_mm) > _MOST_ENTRIES:
        return np.linspace(low_mm, high_mm, _MOST_ENTRIES)
    near = max(ONE_PLACE * (high_mm - low_mm) / len(places_mm), SAME_POSITION_MM)
    between = places_mm[(places_mm > low_mm + near) & (places_mm < high_mm - near)]
    return np.array([low_mm, *between, high_mm])


def _of_all(places: Sequence[Numbers]) -> Numbers:
    """Give the fewest positions that some state has, from the lowest to the highest of any."""
    fewest = min(places, key=len).copy()
    if len(fewest) > 1:
        fewest[0], fewest[-1] = min(one[0] for one in places), max(one[-1] for one in places)
    return fewest


def _places(sightings: Sightings, axis: str) -> Numbers:
    """Give the positions of an axis in passes in which it moves: where it only stands tells little of its errors."""
    along_mm = sightings.commanded_mm[:, AXES.index(axis)]
    moves = moves_in_its_pass(sightings, along_mm)
    return places_for_knots(
        distinct_positions(along_mm[moves] if moves.any() else along_mm, SAME_POSITION_MM), MOST_FUNCTIONS
    )


def functions_of(machine: Machine, fits: Mapping[str, Fitted], common: CommonBases) -> Functions:
    """Give the errors that all states determine.

    Parameters
    ----------
    fits
        Each state, in words, to its fit with the common bases, in the order of these.
    """
    (first, *_) = fits.values()
    reasons: dict[str, dict[str, list[str]]] = {}
    for (state, fitted), rich in zip(fits.items(), common.not_determined, strict=True):
        own = {item.name: item.why for item in (*rich, *fitted.not_determined)}
        for name, rows in gauged(machine, fitted.terms, common.position_mm).items():
            if not is_determined(rows, fitted.null_space):
                own.setdefault(name, "the data do not determine it")
        for name, why in own.items():
            reasons.setdefault(name, {}).setdefault(why, []).append(state)
    lost = {term_id_of(name) for name in reasons} | set(reasons)
    gauge = {name: rows.by_parameter for name, rows in gauged(machine, first.terms, common.position_mm).items()}
    kept = {name: rows for name, rows in gauge.items() if name not in reasons and term_id_of(name) not in lost}
    missing = tuple(NotDetermined(name, _by_state(reasons[name])) for name in sorted(reasons))
    loose = np.hstack([fitted.null_space for fitted in fits.values()])
    return Functions(machine, first.terms, common.position_mm, kept, missing, loose)


def _by_state(reasons: Mapping[str, Sequence[str]]) -> str:
    return "; ".join(f"at {', '.join(states)}: {why}" for why, states in reasons.items())


def estimate_of(fitted: Fitted) -> Estimate:
    """Give a fit's parameters with their covariance.

    A fit holds stated uncertainties for right until chance seldom leaves as much. Here whatever is left beyond them
    counts (Birge's ratio, never below 1): tests of many numbers add up what no fit by itself could tell.
    """
    parameters = np.array([parameter.value for term in fitted.terms for parameter in term.coefficients])
    ratio = fitted.solved.chi_squared / fitted.dof if fitted.dof > 0 else math.nan
    is_as_stated = fitted.sightings.is_stated and fitted.scale == 1.0
    if is_as_stated and not ratio > 1.0:
        return Estimate(parameters, fitted.covariance, math.inf)
    # A scale that was found in the scatter is as certain as its count.
    covariance = fitted.covariance * ratio if is_as_stated else fitted.covariance
    return Estimate(parameters, covariance, float(fitted.dof))
