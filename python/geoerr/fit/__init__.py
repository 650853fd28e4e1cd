"""The joint fit: all observations and all terms at once."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

from geoerr.effects import Catalogue, catalogue
from geoerr.fit.additions import Addition, Wanted, Way, additions, held_errors
from geoerr.fit.classic import Components
from geoerr.fit.fit import FitOptions, fit_terms, refit
from geoerr.fit.fitted import Fitted, Outlier
from geoerr.fit.given import complete_rows, frames_only, has_covariates, own_freedom
from geoerr.fit.history import figures_to_remember, history_of, steps_to
from geoerr.fit.joined import places_beyond, sightings_of, within_the_machine
from geoerr.fit.other_sessions import refuse_other_sessions
from geoerr.fit.result import FitResult, digest_of, figures_document, result_of
from geoerr.fit.shared_noise import with_shared_noise
from geoerr.fit.sightings import Numbers, Sightings
from geoerr.fit.split import Split
from geoerr.machine import Machine
from geoerr.model import Model
from geoerr.model.called import check_machine
from geoerr.observations import MeasuredTable
from geoerr.terms import Term

__all__ = [
    "Addition",
    "Components",
    "FitOptions",
    "FitResult",
    "Fitted",
    "Outlier",
    "Sightings",
    "Split",
    "Way",
    "complete_rows",
    "digest_of",
    "figures_document",
    "figures_to_remember",
    "fit_model",
    "fit_terms",
    "frames_only",
    "has_covariates",
    "own_freedom",
    "places_beyond",
    "refit",
    "result_of",
    "sightings_of",
    "within_the_machine",
]


def fit_model(
    machine: Machine | Model,
    *tables: MeasuredTable,
    components: Components | None = None,
    effects: Sequence[Wanted] | Wanted = (),
    known: Catalogue | None = None,
    way: Way | None = None,
    options: FitOptions | None = None,
    rig_sensitivity: Numbers | None = None,
    rig_covariance: Numbers | None = None,
    on_progress: Callable[[int, int], None] = lambda done, total: None,
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
        Measured points (any carrier, any components), circular tests and lengths.
    components
        `21` (Li), `12` (Dobariya: no angles) or `none`; short for the field of `options`, and wins over it.
    effects
        What there is beyond the classic errors: references (`"backlash:x"`), effects in their places
        (`own.at("x", "temp_bed")`), or terms; one or several. The model's history has an entry for each.
    known
        Where references are looked up: `load_catalogue(["own.toml"])` has a user's own beside the built-in ones.
    way
        Whether temperatures are followed with a lag, and in which form effects are written; what it leaves open is
        for the data to say.
    options
        Components, tangent-following, bases, robustness.
    rig_sensitivity, rig_covariance
        From `geoerr.rig_sensitivity(rig, observations)` and `rig.covariance`: the calibration's uncertainty is then
        part of every standard error.
    on_progress
        Called with the number of steps that are done, and of all.

    Raises
    ------
    GeometryError
        where nothing can be fitted.
    ShapeError
        for a machine or a table that is none.
    InputFileError
        for a reference that names no effect, an axis that it is not for, or a column that the data do not have.
    """
    check_machine(machine, tables, "fit_model(machine, observations)", or_model=True)
    options = options or FitOptions()
    terms: tuple[Term, ...] = ()
    joined = sightings_of(*tables)
    if isinstance(machine, Model):
        refuse_other_sessions(machine, joined)
        terms, components = (*machine.all_machine_terms, *machine.rig_terms), "none"
        machine = machine.machine
    described, options = machine, options if components is None else replace(options, components=components)

    def fit(more: Sequence[Term]) -> Fitted:
        return fit_terms(
            described,
            tables,
            effects=[*terms, *more],
            options=options,
            rig_sensitivity=rig_sensitivity,
            rig_covariance=rig_covariance,
        )

    wanted = list(effects) if isinstance(effects, Sequence) and not isinstance(effects, str) else [effects]
    on_progress(0, 2 + len(wanted))
    held = held_errors(options.components, terms)
    asked = additions(wanted, known or catalogue(), described, joined, held, fit, way)
    fitted = with_shared_noise(fit([term for one in asked for term in one.terms]))
    # A model that was composed names its new effects by having no values for them.
    added = [Addition(term.id, term.title, (term,)) for term in terms if _is_new(term)] + asked
    total, done = 2 + len(added), iter(range(1, 3 + len(added)))
    on_progress(next(done), total)
    steps = steps_to(fitted, added, lambda: on_progress(next(done), total))
    result = replace(result_of(fitted, history_of(steps, added)), steps=steps)
    on_progress(total, total)
    return result


def _is_new(term: Term) -> bool:
    return term.kind != "classic" and any(math.isnan(p.value) for p in (*term.coefficients, *term.inner))
