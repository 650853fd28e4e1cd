"""Bases that all states share, chosen by what the states say together: the choice knows nothing of differences.

Every state is fitted with bases as rich as the positions allow. The mean of these estimates, weighed by their
covariances, is independent of every difference of two states that were measured alike; bases chosen from the mean
(`geoerr.fit.knots`) leave tests of differences as they were: a choice made from each state by itself keeps the noise
that happened to be large, and tests alarm two to four times too often. The mean is more certain than a state, so that
what the bases cannot follow is small against a state's own noise.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from geoerr.bases import places_for_knots
from geoerr.error_functions import NotDetermined
from geoerr.fit import FitOptions, Fitted, fit_terms, sightings_of
from geoerr.fit.classic import (
    MOST_FUNCTIONS,
    distinct_positions,
    moves_in_its_pass,
    names_of,
    rich_basis,
    tells_noise,
)
from geoerr.fit.knots import choose_bases
from geoerr.fit.sightings import SAME_POSITION_MM, Numbers, Sightings
from geoerr.machine import AXES, Machine
from geoerr.model.gauge import is_determined
from geoerr.observations import Observations
from geoerr.states.evidence import pooled
from geoerr.states.functions import Estimate, Functions, gauged, term_id_of
from geoerr.states.weights import Weights
from geoerr.terms import BasisSpec

# Tables have no more entries than this: where an axis stood at more places, they are spread evenly over them.
_MOST_ENTRIES = 41
# Functions for each position, at most: fewer are tried where some state cannot tell them apart.
_SHARES = (1.0, 0.7, 0.45)
_FEWEST_FUNCTIONS = 5


def common_bases(
    machine: Machine,
    tables: Mapping[float, Observations],
    given: Mapping[str, BasisSpec],
    threads: int,
    weights: Weights,
) -> tuple[dict[str, BasisSpec], dict[str, Numbers]]:
    """Choose bases for all states, and the positions of their tables.

    Parameters
    ----------
    tables
        Temperature to rows, all within one range.
    given
        Bases that are not to be chosen, by ISO name.
    weights
        Of rows that state no uncertainty.
    """
    sightings = [sightings_of(table) for table in tables.values()]
    is_stated = all(one.is_stated for one in sightings)
    places = {axis: _of_all([_places(one, axis) for one in sightings]) for axis in AXES}
    entries = {
        axis: found if len(found) <= _MOST_ENTRIES else np.linspace(float(found[0]), float(found[-1]), _MOST_ENTRIES)
        for axis, found in places.items()
    }
    best: tuple[Functions, dict[str, BasisSpec], list[Fitted]] | None = None
    for share in _SHARES:
        rich = dict(given)
        for name in names_of("21"):
            found = places[name[2].lower()]
            most = min(max(round(share * len(found)), _FEWEST_FUNCTIONS), MOST_FUNCTIONS)
            is_noise_told = all(tells_noise(one, names_of("21"), places, most) for one in sightings)
            basis = rich_basis(name[2].lower(), found, is_stated=is_stated, is_noise_told=is_noise_told, most=most)
            if name not in rich and basis is not None:
                rich[name] = basis
        if set(rich) == set(given):
            return rich, entries
        options = FitOptions(bases=rich, threads=threads)
        fits = [
            fit_terms(machine, [table], options=options, sightings=weights.sightings([table]))
            for table in tables.values()
        ]
        functions = functions_of(machine, fits, entries)
        if best is None or len(functions.names) > len(best[0].names):
            best = functions, rich, fits
        if not functions.not_determined:
            break
    assert best is not None
    functions, rich, fits = best
    mean = pooled(functions, [estimate_of(fitted) for fitted in fits])
    terms = functions.with_values(mean.parameters)
    loose = np.hstack([fitted.null_space for fitted in fits])
    undecided = [term for term in terms if term.id in rich and term.id not in given]
    choices = choose_bases(undecided, terms, mean.covariance, loose, places)
    return {**rich, **{choice.name: choice.basis for choice in choices}}, entries


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


def functions_of(machine: Machine, fits: Sequence[Fitted], position_mm: Mapping[str, Numbers]) -> Functions:
    """Give the errors that all of some fits with the same terms determine."""
    terms = fits[0].terms
    gauge = {name: rows.by_parameter for name, rows in gauged(machine, terms, position_mm).items()}
    reasons: dict[str, NotDetermined] = {}
    for fitted in fits:
        reasons |= {item.name: item for item in fitted.not_determined}
        for name, rows in gauged(machine, fitted.terms, position_mm).items():
            if not is_determined(rows, fitted.null_space):
                reasons.setdefault(name, NotDetermined(name, "the data do not determine it"))
    lost = {term_id_of(name) for name in reasons} | set(reasons)
    kept = {name: rows for name, rows in gauge.items() if name not in reasons and term_id_of(name) not in lost}
    missing = tuple(reasons[name] for name in sorted(reasons))
    return Functions(machine, terms, position_mm, kept, missing, np.hstack([fitted.null_space for fitted in fits]))


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
