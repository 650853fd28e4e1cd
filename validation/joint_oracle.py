"""The best that any linear estimate could do: one that knows how the virtual machines are drawn.

A fit with as many splines as positions, and nothing known of their smoothness, holds all that the observations say:
estimate x with covariance C, at first order. How the generator draws error functions is known here, as second moments
E[f(p) f(q)] at the measured positions over many drawn machines; with them as the prior covariance, the estimate of
least mean square among all that are linear in the observations is (Kalman's form, R the rows of the prior's root)

    x − C Rᵀ (1 + R C Rᵀ)⁻¹ R x.

Straightness and angle count as independent, as in the fit that assumes nothing of the carriage. A fit that has to
find the smoothness in the data cannot be expected below this.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache

import numpy as np

from geoerr.bases import basis_of
from geoerr.error_functions import LINEAR_AND_ANGULAR, ErrorFunctions, is_angular
from geoerr.fit import FitOptions, FitResult, fit_model
from geoerr.machine import AXES, Axis, Machine
from geoerr.model import Model
from geoerr.observations import Observations
from geoerr.simulate.guideway import AxisPlan, ErrorPlan, build_errors
from geoerr.terms import Term

_N_MACHINES = 600
# Second moments from a finite number of machines: directions below this share of the largest are none.
_RANK = 1e-9


def kind_of(name: str) -> str:
    """Give what kind of function an ISO name is: each kind is drawn alike for all axes."""
    if is_angular(name):
        return "roll" if name[1] == "ABC"[AXES.index(name[2].lower())] else "pitch and yaw"
    return "positioning" if name[1] == name[2] else "straightness"


@cache
def second_moments(plan: AxisPlan, positions_mm: tuple[float, ...]) -> dict[str, np.ndarray]:
    """Give E[f(p) f(q)] at positions (n,) of every axis for each kind of function, (n, n), from drawn machines."""
    places = np.array(positions_mm)
    # The order of axes turns signs only.
    machine = Machine("drawn", "wZbXYt", {axis: Axis((positions_mm[0], positions_mm[-1])) for axis in AXES})
    sums = {kind: np.zeros((len(places), len(places))) for kind in map(kind_of, LINEAR_AND_ANGULAR)}
    counts = dict.fromkeys(sums, 0)
    for number in range(_N_MACHINES):
        errors = build_errors(machine, ErrorPlan(dict.fromkeys(AXES, plan), {}), np.random.SeedSequence([number, 77]))
        for name, function in errors.functions.items():
            value = function(places)
            value = value - value[0]
            sums[kind_of(name)] += np.outer(value, value)
            counts[kind_of(name)] += 1
    return {kind: total / counts[kind] for kind, total in sums.items()}


def best_linear(
    machine: Machine, observations: Observations, smooth: FitResult, plan: AxisPlan, positions_mm: Sequence[float]
) -> ErrorFunctions:
    """Give the errors by the estimate that knows the second moments, in the gauge of all tables.

    Parameters
    ----------
    machine, observations
        As for the fit.
    smooth
        A fit of them, for its bases.
    plan
        How each axis's errors were drawn.
    positions_mm
        Of the tables, the same for every axis.
    """
    bases = {choice.name: choice.basis for choice in smooth.fitted.choices}
    bare = fit_model(machine, observations, options=FitOptions(bases=bases, threads=1)).model
    assert bare.record is not None
    moments = second_moments(plan, tuple(positions_mm))
    rows = _prior_rows(bare.terms, moments, np.array(positions_mm))
    x = np.array([parameter.value for term in bare.terms for parameter in term.coefficients])
    covariance = bare.record.covariance
    gain = np.linalg.solve(np.eye(len(rows)) + rows @ covariance @ rows.T, rows @ covariance).T
    # Joseph's form: a covariance whatever the rounding.
    left = np.eye(len(x)) - gain @ rows
    covariance = left @ covariance @ left.T + gain @ gain.T
    covariance = 0.5 * (covariance + covariance.T)
    values = x - gain @ (rows @ x)
    terms, first = [], 0
    for term in bare.terms:
        own = slice(first, first + len(term.coefficients))
        first = own.stop
        std = np.sqrt(np.diagonal(covariance)[own])
        terms.append(term.with_values(values[own].tolist(), coefficients_std=std.tolist()))
    record = replace(bare.record, covariance=covariance)
    return Model(machine, None, tuple(terms), record).error_functions(dict.fromkeys(AXES, positions_mm))


def _prior_rows(terms: Sequence[Term], moments: dict[str, np.ndarray], positions_mm: np.ndarray) -> np.ndarray:
    """Give rows R of the coefficients with R c = 0 ± 1 for functions that are drawn with these second moments."""
    blocks, first = [], 0
    size = sum(len(term.coefficients) for term in terms)
    for term in terms:
        own = slice(first, first + len(term.coefficients))
        first = own.stop
        basis = term.parts[0].basis
        if basis is None:
            continue
        spread, direction = np.linalg.eigh(moments[kind_of(term.id)])
        spread = np.maximum(spread, _RANK * float(spread[-1]))
        block = np.zeros((len(spread), size))
        block[:, own] = (direction / np.sqrt(spread)).T @ basis_of(basis).evaluate(positions_mm)
        blocks.append(block)
    return np.concatenate(blocks)
