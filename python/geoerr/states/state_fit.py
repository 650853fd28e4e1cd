"""One state's fit, with the offsets that its passes share and what of its rows is known from all states."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geoerr.fit import FitOptions, Fitted, fit_terms
from geoerr.fit.sightings import Numbers
from geoerr.machine import Machine
from geoerr.observations import Observations
from geoerr.states.common import estimate_of
from geoerr.states.functions import Estimate
from geoerr.states.offsets import pass_offsets, with_offsets
from geoerr.states.weights import Weights


@dataclass(frozen=True, eq=False)
class StateFit:
    """One state by itself.

    Attributes
    ----------
    fitted
        The fit.
    estimate
        Parameters with their covariance.
    sensitivity : (n, 3, p)
        What was found of offsets of passes: unknowns of unit variance and how they move the rows.
    """

    fitted: Fitted
    estimate: Estimate
    sensitivity: Numbers


def fit_state(
    machine: Machine, table: Observations, options: FitOptions, weights: Weights, known: Numbers | None = None
) -> StateFit:
    """Fit the errors of one state.

    Parameters
    ----------
    known : (n, 3, k)
        How unknowns of unit variance move the rows, beside offsets of passes.
    """
    sightings = weights.sightings([table])
    fitted = fit_terms(machine, [table], options=options, sightings=sightings)
    offsets = pass_offsets(fitted)
    sensitivity = offsets.sensitivity(fitted, len(table))
    beside = sensitivity if known is None else np.concatenate([sensitivity, known], axis=2)
    if not beside.shape[2]:
        return StateFit(fitted, estimate_of(fitted), sensitivity)
    fitted = fit_terms(
        machine,
        [table],
        options=options,
        rig_sensitivity=beside,
        rig_covariance=np.eye(beside.shape[2]),
        sightings=sightings,
    )
    estimate = estimate_of(fitted)
    if sensitivity.shape[2]:
        estimate = with_offsets(estimate, fitted, offsets)
    return StateFit(fitted, estimate, sensitivity)
