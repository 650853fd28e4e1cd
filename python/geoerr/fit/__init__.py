"""The joint fit: all observations and all terms at once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from geoerr.effects import catalogue
from geoerr.fit.classic import Components
from geoerr.fit.fit import FitOptions, fit_terms, refit
from geoerr.fit.fitted import Fitted, Outlier
from geoerr.fit.given import complete_rows, frames_only, has_covariates, own_freedom
from geoerr.fit.result import FitResult, digest_of, figures_document, result_of
from geoerr.fit.sightings import Numbers, Sightings, sightings_of
from geoerr.fit.split import Split
from geoerr.machine import Machine
from geoerr.model import Model
from geoerr.observations import CircularTest, Observations
from geoerr.terms import EffectReference, Term

__all__ = [
    "Components",
    "FitOptions",
    "FitResult",
    "Fitted",
    "Outlier",
    "Sightings",
    "Split",
    "complete_rows",
    "digest_of",
    "figures_document",
    "fit_model",
    "fit_terms",
    "frames_only",
    "has_covariates",
    "own_freedom",
    "refit",
    "result_of",
    "sightings_of",
]


def fit_model(
    machine: Machine | Model,
    *tables: Observations | CircularTest,
    components: Components | None = None,
    effects: Sequence[Term | EffectReference | str] = (),
    options: FitOptions | None = None,
    rig_sensitivity: Numbers | None = None,
    rig_covariance: Numbers | None = None,
) -> FitResult:
    """Fit a volumetric model to measurements.

    Li's 21 components, Dobariya's 12, and a machine that nobody listed are one line each:

    >>> geoerr.fit_model(machine, observations)  # doctest: +SKIP
    >>> geoerr.fit_model(machine, observations, components="12")  # doctest: +SKIP
    >>> geoerr.fit_model(Machine.from_chain("wYbZXt", (400, 300, 250)), observations)  # doctest: +SKIP

    A model is fitted as it is composed, its terms with the bases that they have:

    >>> geoerr.fit_model(result.model + "thermal-expansion:x@temp_bed", observations)  # doctest: +SKIP

    Parameters
    ----------
    machine
        Chain, ranges and tool offset; `Machine.from_chain("wYbZXt", ...)` for one that nobody listed. Or a model: its
        terms are fitted, and `components` is not asked.
    tables
        Measured points (any carrier, any components) and circular tests.
    components
        `21` (Li), `12` (Dobariya: no angles) or `none`; short for the field of `options`, and wins over it.
    effects
        What there is beyond the classic errors: references to built-in effects (`"backlash:x"`), or terms, as
        `load_effects("own.toml")[0].term("x", None, machine)`.
    options
        Components, tangent-following, bases, robustness.
    rig_sensitivity, rig_covariance
        From `geoerr.rig_sensitivity(rig, observations)` and `rig.covariance`: the calibration's uncertainty is then
        part of every standard error.

    Raises
    ------
    GeometryError
        where nothing can be fitted.
    InputFileError
        for a reference that names no effect, or an axis that it is not for.
    """
    options = options or FitOptions()
    terms: tuple[Term, ...] = ()
    if isinstance(machine, Model):
        terms, components = (*machine.all_machine_terms, *machine.rig_terms), "none"
        machine = machine.machine
    fitted = fit_terms(
        machine,
        tables,
        effects=[*terms, *(e if isinstance(e, Term) else _term_of(e, machine) for e in effects)],
        options=options if components is None else replace(options, components=components),
        rig_sensitivity=rig_sensitivity,
        rig_covariance=rig_covariance,
    )
    return result_of(fitted)


def _term_of(reference: str | EffectReference, machine: Machine) -> Term:
    effect, checked = catalogue().resolve(reference)
    return effect.term(checked.axis, checked.covariate, machine)
