"""The joint fit: all observations and all terms at once."""

from __future__ import annotations

from collections.abc import Sequence

from geoerr.fit.fit import FitOptions, fit_terms, refit
from geoerr.fit.fitted import Fitted, Outlier
from geoerr.fit.result import FitResult, digest_of, figures_document, result_of
from geoerr.fit.sightings import Numbers, Sightings, sightings_of
from geoerr.fit.split import Split
from geoerr.machine import Machine
from geoerr.observations import CircularTest, Observations
from geoerr.terms import Term

__all__ = [
    "FitOptions",
    "FitResult",
    "Fitted",
    "Outlier",
    "Sightings",
    "Split",
    "digest_of",
    "figures_document",
    "fit",
    "fit_terms",
    "refit",
    "result_of",
    "sightings_of",
]


def fit(
    machine: Machine,
    *tables: Observations | CircularTest,
    effects: Sequence[Term] = (),
    options: FitOptions | None = None,
    rig_sensitivity: Numbers | None = None,
    rig_covariance: Numbers | None = None,
) -> FitResult:
    """Fit a volumetric model to measurements.

    Parameters
    ----------
    machine
        Chain, ranges and tool offset; `Machine.from_chain("wYbZXt", ...)` for one that nobody listed.
    tables
        Measured points (any carrier, any components) and circular tests.
    effects
        Terms beyond the classic errors: `geoerr.effects.catalogue()["backlash"].term("x", None, machine)`.
    options
        Components (`21` Li, `12` Dobariya, `none`), tangent-following, bases, robustness.
    rig_sensitivity, rig_covariance
        From `geoerr.rig_sensitivity(rig, observations)` and `rig.covariance`: the calibration's uncertainty is then
        part of every standard error.

    Raises
    ------
    GeometryError
        where nothing can be fitted.
    """
    fitted = fit_terms(
        machine,
        tables,
        effects=effects,
        options=options,
        rig_sensitivity=rig_sensitivity,
        rig_covariance=rig_covariance,
    )
    return result_of(fitted)
