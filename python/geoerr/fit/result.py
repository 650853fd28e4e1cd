"""What a fit hands out: the model with its record, the figures, and all of it in plain values and in words."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import polars as pl

from geoerr.fit.elsewhere import off_between_places
from geoerr.fit.fit import refit
from geoerr.fit.fitted import Fitted
from geoerr.fit.sightings import SAME_POSITION_MM, Numbers, Sightings
from geoerr.fit.variables import variable_columns
from geoerr.machine import AXES
from geoerr.model import FitRecord, HistoryEntry, Model
from geoerr.model.fit_words import BETWEEN_PLACES, COUNTS_SHARED, FAR_BELOW_STATED, OF_STATED, PLACES_LEFT_OUT
from geoerr.model.summary import model_html
from geoerr.terms import RAW_VARIABLES, SESSION_NAME, has_span

# Directions of parameters whose part in the model is below this are those of the measuring frames alone.
_NOTHING = 1e-9
_UM_PER_MM = 1e3
# In a record's `noise`: how many unknowns of the calibration were fitted along, held by its covariance.
CALIBRATION_UNKNOWNS = "calibration_unknowns"


@dataclass(frozen=True, eq=False)
class FitResult:
    """A fitted model, and how it was found.

    Attributes
    ----------
    model
        The model with its record; `write_model` writes it.
    fitted
        Residuals, choices, outliers, and the core's objects.
    steps
        Fits of the same rows with none of the effects that were asked for, with the first, ..., with all; empty where
        the steps are not known.
    """

    model: Model
    fitted: Fitted
    steps: tuple[Fitted, ...] = ()

    def _repr_html_(self) -> str:
        """Show the model and its figures, for a notebook."""
        return model_html(self.model)

    @cached_property
    def before(self) -> Fitted:
        """The same rows fitted without the effects; where there are none, with a machine without errors."""
        return self.steps[0] if len(self.steps) > 1 else refit(self.fitted, ())

    @property
    def figures(self) -> dict[str, Any]:
        """Error figures, named as in `compare --json`."""
        return figures_document(self.fitted)

    def to_document(self) -> dict[str, Any]:
        """Give everything that `fit --json` says of the fit."""
        fitted = self.fitted
        return {
            **figures_document(fitted),
            "scale": fitted.scale,
            "counts_shared": fitted.shared_noise is not None,
            "converged": fitted.solved.converged,
            "rank": fitted.solved.solution.rank,
            "unknowns": fitted.problem.n_columns,
            "parameters": {
                f"{term.id}.{parameter.name}": {
                    "value": parameter.value,
                    "std": parameter.std,
                    "unit": parameter.unit,
                }
                for term in fitted.terms
                for parameter in (*term.coefficients, *term.inner)
            },
            "bases": {
                choice.name: {**choice.basis.to_document(), "free": choice.n_free} for choice in fitted.choices
            },
            "not_determined": [{"name": item.name, "why": item.why} for item in fitted.not_determined],
            "outliers": [
                {
                    "row": outlier.row + 1,
                    "line": outlier.line,
                    **dict(zip(AXES, outlier.commanded_mm, strict=True)),
                    "residual_um": list(outlier.residual_um),
                }
                for outlier in fitted.outliers
            ],
            "left_out": fitted.sightings.left_out,
        }


def result_of(fitted: Fitted, history: Sequence[HistoryEntry] = ()) -> FitResult:
    """Make the model of a fit."""
    sightings = fitted.sightings
    moved = {
        axis: (float(values.min()), float(values.max()))
        for axis, values in zip(AXES, sightings.commanded_mm.T, strict=True)
        if np.ptp(values) > 0.0
    }
    stood = {
        axis: float(np.median(values))
        for axis, values in zip(AXES, sightings.commanded_mm.T, strict=True)
        if np.ptp(values) <= SAME_POSITION_MM
    }
    needed = {name for term in fitted.terms for name in term.variables if name not in RAW_VARIABLES}
    own = {name for term in fitted.terms if not term.is_rig for name in term.variables if has_span(name)}
    names = sorted(needed | own)
    spans = {
        name: (float(np.nanmin(values)), float(np.nanmax(values)))
        for name, values in zip(names, variable_columns(sightings, names), strict=True)
        if np.isfinite(values).any()
    }
    sessions: dict[str, int] = {}
    if any(SESSION_NAME in term.variables for term in fitted.terms):
        sessions = sightings.numbers_of_set_ups
        spans[SESSION_NAME] = (float(min(sessions.values())), float(max(sessions.values())))
    record = FitRecord(
        covariance=fitted.covariance,
        null_space=_unit_columns(fitted.null_space),
        not_determined=fitted.not_determined,
        data_digest=digest_of(sightings),
        n_rows=fitted.figures.n,
        n_outliers=len(fitted.outliers),
        range_mm=moved,
        covariate_spans=spans,
        sessions=sessions,
        noise=_numbers(_scatter(fitted) | _shared(fitted) | _calibration(fitted)),
        figures=_numbers(
            {name: value for name, value in figures_document(fitted).items() if _is_plain(value)}
            | _freedom(fitted)
            | _between_places(fitted)
        ),
        history=tuple(history),
        stood_mm=stood,
        has_settled=fitted.solved.converged,
    )
    return FitResult(Model(fitted.machine, terms=fitted.terms, record=record), fitted)


def _scatter(fitted: Fitted) -> dict[str, float]:
    """Give what stated uncertainties were multiplied by; where none are stated, the scatter of a component.

    Beside it, where the scatter is so small a share of what is stated that its unit is in doubt, that share.
    """
    if not fitted.sightings.is_stated:
        return {"scatter_um": fitted.scale * _UM_PER_MM}
    share = fitted.share_of_stated
    return {"scale": fitted.scale} | ({OF_STATED: share} if share < FAR_BELOW_STATED else {})


def _shared(fitted: Fitted) -> dict[str, float]:
    """Say where standard uncertainties count what rows share; nothing where they share nothing."""
    return {} if fitted.shared_noise is None else {COUNTS_SHARED: 1.0}


def _calibration(fitted: Fitted) -> dict[str, float]:
    """Count the unknowns of the calibration that were fitted along; nothing where there are none."""
    count = (
        0 if fitted.prior is None else int(fitted.prior[:, fitted.problem.first_shared_column :].any(axis=1).sum())
    )
    return {CALIBRATION_UNKNOWNS: float(count)} if count else {}


def _freedom(fitted: Fitted) -> dict[str, float]:
    """Give what tells how sure the figures are: degrees of freedom, and how many components a row has in the mean."""
    residual_dof, noise_dof = fitted.split.dof
    return {
        "dof": float(fitted.dof),
        "lack_of_fit_dof": float(residual_dof - noise_dof),
        "components_per_row": components_of_a_row(fitted),
    }


def _between_places(fitted: Fitted) -> dict[str, float]:
    """Give what the model is off by between places of axes, and how many places tell: 0 where nothing does."""
    between = off_between_places(fitted)
    if between is None:
        return {PLACES_LEFT_OUT: 0.0}
    std_um = (between.std_mm * _UM_PER_MM).tolist()
    return dict(zip(BETWEEN_PLACES, std_um, strict=True)) | {PLACES_LEFT_OUT: float(between.n_places)}


def components_of_a_row(fitted: Fitted) -> float:
    """Give how many components a row has in the mean: a lack of fit is a sum over those that were measured."""
    return float(fitted.sightings.is_measured[fitted.solved.used].sum(axis=1).mean())


def figures_document(fitted: Fitted) -> dict[str, Any]:
    """Give the figures of a fit, named as in `compare --json`; null where one is not computable."""
    held = fitted.held_out.figures
    return {
        **fitted.figures.to_document(),
        "held_out_rmse_um": None if held is None else held.headline_um,
        "expected_held_out_rmse_um": _finite(fitted.expected_held_out_um),
        "held_out_not_computable": fitted.held_out.n_not_computable,
        "noise_floor_um": fitted.repeats.floor_um,
        "within_pass_floor_um": fitted.repeats.within_pass_floor_um,
        "noise_um": _finite(fitted.split.noise_um),
        "lack_of_fit_um": fitted.split.lack_of_fit_um,
        "lack_of_fit_p": fitted.split.lack_of_fit_p,
    }


def digest_of(sightings: Sightings) -> str:
    """Give the SHA-256 of the data: of every column's name and values, in the order of names."""
    return sightings.once("digest", _digest_of)


def _digest_of(sightings: Sightings) -> str:
    sums = hashlib.sha256()
    for name in sorted(sightings.table.columns):
        if name == "file_row":
            continue
        column = sightings.table[name]
        sums.update(name.encode() + b"\0")
        if column.dtype.is_numeric():
            values = column.cast(pl.Float64).fill_null(math.nan).to_numpy()
            sums.update(np.ascontiguousarray(values, dtype="<f8").tobytes())
        else:
            sums.update((column.cast(pl.String).fill_null("").str.join("\0").item() or "").encode())
    return sums.hexdigest()


def _unit_columns(directions: Numbers) -> Numbers:
    """Scale the core's directions, each with few entries, to length 1; turning them would mix rounding into all."""
    size = np.sqrt((directions**2).sum(axis=0))
    kept = size > _NOTHING
    return np.ascontiguousarray(directions[:, kept] / size[kept])


def _is_plain(value: object) -> bool:
    return value is None or (isinstance(value, int | float) and not isinstance(value, bool))


def _numbers(values: dict[str, Any]) -> dict[str, float]:
    return {name: math.nan if value is None else float(value) for name, value in values.items()}


def _finite(value: float | None) -> float | None:
    return value if value is not None and math.isfinite(value) else None
