"""Fits in which the model is given: only how the measuring devices stand is found, or the model's own numbers anew.

A machine that is known moves every point by a known amount. Of a machine without errors such a point is one that sits
elsewhere; so the terms need no columns, whatever their number, and what is left to fit is the pose of each session's
device and the places of the targets.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from geoerr import _core
from geoerr.errors import GeometryError
from geoerr.fit.calibration import calibration_unknowns
from geoerr.fit.fit import FitOptions, Given, Posed, beside
from geoerr.fit.fitted import Fitted
from geoerr.fit.gross_rows import stand_alone
from geoerr.fit.sightings import Numbers, Sightings
from geoerr.fit.standing import known_variables, standing
from geoerr.fit.start import Frames
from geoerr.fit.variables import Rows, complete_rows_of, times_s, variable_columns, why_lacking, with_rows
from geoerr.machine import AXES, Machine
from geoerr.model.compile import compile_terms, start_values
from geoerr.observations import MeasuredTable
from geoerr.terms import Term


def has_covariates(machine: Machine, sightings: Sightings, terms: Sequence[Term]) -> np.ndarray:
    """Tell which rows have all the covariates that the terms need, (n,).

    Raises
    ------
    GeoerrError
        for a covariate that is no column of the data.
    """
    return _known_rows(machine, sightings, terms)[2]


def _known_rows(machine: Machine, sightings: Sightings, terms: Sequence[Term]) -> tuple[Sequence[str], Numbers, Rows]:
    """Give the variables that the terms need, their values, and in which rows all of them are known."""
    names = compile_terms(machine, terms).variables
    variables = known_variables(sightings, names, terms)
    return names, variables, complete_rows_of(sightings, names, variables, terms)


def complete_rows(machine: Machine, sightings: Sightings, terms: Sequence[Term]) -> Sightings:
    """Give the rows that have all the covariates that the terms need; the others are counted.

    Raises
    ------
    GeoerrError
        for a covariate that is no column of the data.
    GeometryError
        where no row is left.
    """
    names, variables, known = _known_rows(machine, sightings, terms)
    if not known.any():
        needed = ", ".join(name for name in names if name not in AXES)
        raise GeometryError(
            f"no row has all that the model needs: {needed}\nhint: a row needs a number in each of these columns"
        )
    return sightings if known.all() else with_rows(sightings, known, why_lacking(names, variables, known))


def frames_only(machine: Machine, sightings: Sightings, terms: Sequence[Term], *, threads: int = 0) -> Fitted:
    """Fit how each session's device stands and where targets sit; the terms keep their values.

    Rows that lack a covariate that a term needs are left out, counted. Rows that stand alone among their neighbours
    (a glint, a wrong marker) take no part; a whole stretch that the model misses does.

    Parameters
    ----------
    terms
        With a value for each of their parameters, of the machine and of the rig.

    Returns
    -------
    Fitted
        Its own terms are none; `again(terms)` fits terms on top of what is given.

    Notes
    -----
    Exact: the same residuals as a fit of these terms with gauge rows that hold every coefficient, which a test
    compares.
    """
    rows = complete_rows(machine, sightings, terms)
    posed = Posed(machine, rows, None, FitOptions(components="none", is_robust=False, threads=threads))
    machine_terms = tuple(term for term in terms if not term.is_rig)
    moved = _displacement_mm(machine, posed.sightings, machine_terms, threads)
    posed.given = Given(moved, np.zeros_like(moved), np.ones(len(rows), dtype=bool))
    names = compile_terms(machine, terms).variables
    shown = variable_columns(posed.sightings, names)
    still = list(standing(posed.sightings, names, shown, terms))
    posed.shared = beside(posed.shared, posed.amounts(still, names, shown))
    fitted = posed.fit(())
    rig_terms = tuple(term for term in terms if term.is_rig)
    if rig_terms:
        posed.given = replace(posed.given, falsified_mm=_falsified_mm(posed, fitted, rig_terms))
        fitted = posed.fit(())
    alone = stand_alone(rows, fitted.solved.whitened)
    if alone.any():
        posed.given = replace(posed.given, is_used=~alone)
        fitted = posed.fit(())
    return fitted


def own_freedom(
    machine: Machine,
    sightings: Sightings,
    terms: Sequence[Term],
    *,
    tables: Sequence[MeasuredTable] = (),
    rig_sensitivity: Numbers | None = None,
    rig_covariance: Numbers | None = None,
    threads: int = 0,
) -> Fitted:
    """Fit the terms anew, bases as they are, inner parameters from the values that they have.

    `rig_sensitivity` (of the rows of the one table of points) and `rig_covariance` are the calibration, where it is
    to be fitted along; the sightings are those of `tables` then.
    """
    shared = calibration_unknowns(tables, sightings, rig_sensitivity, rig_covariance)
    return Posed(machine, sightings, shared, FitOptions(components="none", threads=threads)).fit(tuple(terms))


def _displacement_mm(machine: Machine, sightings: Sightings, terms: Sequence[Term], threads: int) -> Numbers:
    """Give what the machine's errors add to every row's point, (n, 3), in the order of the rows (lags and all)."""
    if not terms:
        return np.zeros((len(sightings), 3))
    compiled = compile_terms(machine, terms)
    return np.asarray(
        compiled.core.displacements(
            sightings.carrier,
            np.ascontiguousarray(sightings.commanded_mm),
            np.ascontiguousarray(sightings.offset_mm),
            np.ascontiguousarray(known_variables(sightings, compiled.variables, terms)),
            sightings.sequences,
            times_s(sightings) if compiled.needs_order else None,
            *start_values(terms),
            threads,
        )
    )


def with_terms(machine: Machine, fitted: Fitted, terms: tuple[Term, ...]) -> _core.FitProblem:
    """Pose the problem in which the terms have columns, where a fit of the frames alone has ended.

    Every inner parameter has a column, also one that is fixed; frames stand where the fit found them.
    """
    posed = Posed(machine, fitted.sightings, None, FitOptions(components="none", threads=fitted.threads))
    posed.frames = _found(posed, fitted)
    return posed.problem_of(terms, range(sum(len(term.inner) for term in terms)))


def _falsified_mm(posed: Posed, fitted: Fitted, terms: tuple[Term, ...]) -> Numbers:
    """Give what the rig's errors add to every measurement, (n, 3), with the devices where they were found."""
    posed.frames = _found(posed, fitted)
    with_rig = posed.problem_of(terms)
    without = posed.problem_of(())
    threads = posed.options.threads
    return np.asarray(without.residuals(without.start, threads) - with_rig.residuals(with_rig.start, threads))


def _found(posed: Posed, fitted: Fitted) -> Frames:
    state = fitted.solved.state
    return replace(
        posed.frames,
        rotations=np.asarray(state.rotations),
        translations_mm=np.asarray(state.translations_mm),
        excess_mm=np.asarray(state.excess_mm),
    )
