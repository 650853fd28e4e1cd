r"""Rows of a state that warms while it is measured, referred to its mean temperature by what all states say.

A state has one set of errors, of its mean temperature T̄. With θ(T) = θ_0 + Σ β_j T^{p_j} w_j found from all states
(`joint`), a row that was measured at T is off by

    J (θ(T) − θ(T̄)) = Σ_j β_j (T^{p_j} − T̄^{p_j}) J w_j,

J the first-order columns of its point. That is taken off what was measured, and the uncertainty of β is one unknown
of unit variance for each column of the root of its covariance. Bases, slopes and offsets were found from rows that
were not referred yet, so that it is done twice.

Verified: tests/states/test_one_temperature.py.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import polars as pl

from geoerr.fit import FitOptions
from geoerr.fit.sightings import Numbers
from geoerr.machine import Machine
from geoerr.observations import Observations
from geoerr.states.common import CommonBases, functions_of
from geoerr.states.functions import Functions, root_of
from geoerr.states.joint import TemperatureFit, fit_temperature
from geoerr.states.state_fit import StateFit, fit_state
from geoerr.states.weights import Weights

# Temperatures of one state that are closer together than this are one: no sensor of a machine tells them apart.
_STEADY_K = 0.1
_ROUNDS = 2
_UM_PER_MM = 1e3
# Below this it is not worth a sentence.
_TOLD_UM = 1.0


@dataclass(frozen=True, eq=False)
class Referred:
    """Rows of a state as they would be at its mean temperature.

    Attributes
    ----------
    table
        The rows.
    sensitivity : (n, 3, k)
        What the uncertainty of the slopes moves them by.
    most_um
        The longest way that a row was moved.
    """

    table: Observations
    sensitivity: Numbers
    most_um: float


def at_one_temperature(
    machine: Machine,
    covariate: str,
    tables: dict[float, Observations],
    fits: dict[float, StateFit],
    common: CommonBases,
    options: FitOptions,
    weights: Weights,
) -> tuple[dict[float, StateFit], tuple[str, ...]]:
    """Refer the rows of states whose temperature was not steady to its mean, and fit them anew; and say so.

    Parameters
    ----------
    fits
        Of the rows as they were measured, by the state's temperature.
    """
    heat = {one: table.numbers(covariate)[:, 0] for one, table in tables.items()}
    mean = {one: float(np.nanmean(values)) for one, values in heat.items()}
    unsteady = [one for one, values in heat.items() if np.nanmax(values) - np.nanmin(values) > _STEADY_K]
    notes: list[str] = []
    for _ in range(_ROUNDS if unsteady else 0):
        functions = functions_of(machine, {f"{one:g} °C": fit.fitted for one, fit in fits.items()}, common)
        follows = fit_temperature(
            functions,
            {mean[one]: fit.estimate for one, fit in fits.items()},
            machine.reference_temperature_degc,
            may_be_square=False,
        )
        if not follows.shapes:
            break
        notes.clear()
        fits = dict(fits)
        for one in unsteady:
            referred = refer(tables[one], heat[one], mean[one], functions, follows, fits[one])
            fits[one] = fit_state(machine, referred.table, options, weights, referred.sensitivity)
            if referred.most_um > _TOLD_UM:
                notes.append(
                    f"the state at {one:g} °C had {covariate} from {np.nanmin(heat[one]):.1f} to "
                    f"{np.nanmax(heat[one]):.1f} °C while it was measured: its rows are referred to the mean of "
                    f"{mean[one]:.1f} °C by what all states say of temperature, by {referred.most_um:.1f} µm at most"
                )
    return fits, tuple(notes)


def refer(
    table: Observations,
    heat_degc: Numbers,
    mean_degc: float,
    functions: Functions,
    follows: TemperatureFit,
    fit: StateFit,
) -> Referred:
    """Refer rows to their mean temperature; those without a temperature stay as they are.

    Parameters
    ----------
    heat_degc : (n,)
        Of the rows of the table.
    follows
        How the errors follow temperature.
    fit
        The state's fit: where its devices stand.
    """
    sightings, core = fit.fitted.sightings, functions.compiled.core
    columns = np.asarray(
        core.columns(
            sightings.carrier,
            np.ascontiguousarray(sightings.commanded_mm),
            np.ascontiguousarray(sightings.offset_mm),
            np.zeros((0, len(sightings))),
            sightings.sequences,
            None,
            np.ascontiguousarray(fit.estimate.parameters),
            np.zeros(0),
            fit.fitted.threads,
        )
    )
    warm = heat_degc[sightings.source_row] - follows.reference_degc
    still = mean_degc - follows.reference_degc
    powers = np.array([shape.power for shape in follows.shapes])
    more = np.nan_to_num(warm[:, None] ** powers - still**powers)
    along = columns @ np.column_stack([shape.parameters for shape in follows.shapes]) * more[:, None, :]
    # Axes of the measuring frame as seen in base axes: one vector of each row for each of them.
    turned = np.zeros_like(along)
    for axis in range(3):
        unit = np.ascontiguousarray(np.tile(np.eye(3)[axis], (len(sightings), 1)))
        in_base = np.asarray(fit.fitted.problem.in_base_axes(fit.fitted.solved.state, unit))
        turned[:, axis] = np.einsum("ni,nik->nk", in_base, along)
    moved_mm = np.zeros((len(table), 3))
    moved_mm[sightings.source_row] = turned @ follows.coefficients
    sensitivity = np.zeros((len(table), 3, turned.shape[2]))
    sensitivity[sightings.source_row] = turned @ _root_of_slopes(follows)
    measured = table.measured_mm - moved_mm
    named = {name: pl.Series(measured[:, axis]).fill_nan(None) for axis, name in enumerate(("mx", "my", "mz"))}
    frame = table.frame.with_columns(
        **{name: values for name, values in named.items() if name in table.frame.columns}
    )
    return Referred(
        Observations(frame, table.sources, table.set_aside),
        sensitivity,
        _UM_PER_MM * float(np.linalg.norm(moved_mm, axis=1).max(initial=0.0)),
    )


def _root_of_slopes(follows: TemperatureFit) -> Numbers:
    """Give the root (k, k) of the covariance of the coefficients, the choice of shapes counted."""
    first = follows.basis.shape[1]
    missed = follows.taken_for[first:]
    covariance = follows.covariance[first:, first:] + missed @ missed.T
    root = np.zeros_like(covariance)
    found = root_of(covariance)
    root[:, : found.shape[1]] = found
    return root
