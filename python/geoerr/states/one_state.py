"""The fit of what was measured at one temperature, with what rows of a pass have in common."""

from __future__ import annotations

import numpy as np

from geoerr.fit import FitOptions, Fitted, fit_terms
from geoerr.fit.sightings import Numbers
from geoerr.machine import Machine
from geoerr.observations import Observations
from geoerr.states.common import estimate_of
from geoerr.states.functions import Estimate
from geoerr.states.offsets import pass_offsets, with_offsets


def fit_state(machine: Machine, table: Observations, options: FitOptions) -> tuple[Fitted, Estimate, Numbers]:
    """Fit a table on given bases.

    Returns
    -------
    fitted, estimate, sensitivity
        Offsets of passes are in both; how unknowns of unit variance move the rows by them, (n, 3, p).
    """
    fitted = fit_terms(machine, [table], options=options)
    offsets = pass_offsets(fitted)
    sensitivity = offsets.sensitivity(fitted, len(table))
    estimate = estimate_of(fitted)
    if sensitivity.shape[2]:
        known = np.eye(sensitivity.shape[2])
        fitted = fit_terms(machine, [table], options=options, rig_sensitivity=sensitivity, rig_covariance=known)
        estimate = with_offsets(estimate_of(fitted), fitted, offsets)
    return fitted, estimate, sensitivity
