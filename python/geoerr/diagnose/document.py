"""How far, and where, a model is off: the figures of `compare --json`, as plain values."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import numpy as np

from geoerr.diagnose.components import UM_PER_MM
from geoerr.diagnose.lengths import LengthComparison
from geoerr.diagnose.parts import Part, by_text
from geoerr.fit import Fitted, figures_document
from geoerr.fit.lengths import is_told
from geoerr.machine import AXES

if TYPE_CHECKING:
    from geoerr.diagnose.comparison import Comparison

_MOST_WORST = 10
_NO_POINTS: dict[str, Any] = {
    "rmse_um": None,
    "rms_per_component_um": [None, None, None],
    "n_components": [0, 0, 0],
    "n": 0,
    "held_out_rmse_um": None,
    "expected_held_out_rmse_um": None,
    "held_out_not_computable": 0,
    "noise_floor_um": None,
    "within_pass_floor_um": None,
    "noise_um": None,
    "lack_of_fit_um": None,
    "lack_of_fit_p": None,
    "worst": [],
    "by_line": {},
    "by_axis": {axis: {"rms_um": None} for axis in AXES},
}


def comparison_document(fitted: Fitted) -> dict[str, Any]:
    """Give a fit's figures as `--json` names them: overall, the worst rows, by line, by axis of the base frame.

    Residuals are measured minus predicted in base axes, µm; a component that was not measured is null. The worst rows
    are of all rows, those that the fit left out as gross outliers too (`is_outlier`).
    """
    overall = figures_document(fitted)
    each = overall["rms_per_component_um"]
    return {
        **overall,
        "worst": worst_rows(fitted),
        "by_line": _parts(by_text(fitted, "line")),
        "by_axis": {axis: {"rms_um": value} for axis, value in zip(AXES, each, strict=True)},
    }


def document_of(comparison: Comparison) -> dict[str, Any]:
    """Give a comparison as `compare --json` has it: the figures, then where and along what the model fails."""
    lengths = comparison.lengths
    if comparison.fitted is None:
        document = _NO_POINTS | figures_document(comparison.whole) | {"lack_of_fit_p": comparison.lack_of_fit_p}
    else:
        document = comparison_document(comparison.fitted) | {"lack_of_fit_p": comparison.lack_of_fit_p}
    document |= {"model_takes_part": not comparison.is_held, "is_own_data": comparison.freedom == "own"}
    if lengths is not None:
        document["lengths"] = _lengths(lengths)
    if comparison.fitted is not None:
        document |= _where(comparison, comparison.fitted)
    return document


def _where(comparison: Comparison, fitted: Fitted) -> dict[str, Any]:
    set_up = comparison.set_up
    return {
        "expected_rmse_um": comparison.expected_rmse_um,
        "set_up": None
        if set_up is None
        else {
            "as_measured_rms_um": set_up.as_measured_um,
            "shifted_rms_um": set_up.shifted_um,
            "turned_rms_um": set_up.turned_um,
        },
        "by_direction": _parts(comparison.by_direction),
        "by_session": _parts(comparison.by_session),
        "by_carrier": _parts(comparison.by_carrier),
        "by_target": _parts(comparison.by_target),
        "by_region": [
            {
                "low_mm": list(region.low_mm),
                "high_mm": list(region.high_mm),
                "n": region.n,
                "rmse_um": region.rmse_um,
                "mean_um": region.mean_um,
                "std_um": region.std_um,
            }
            for region in comparison.regions
        ],
        "trends": [
            {
                "variable": trend.variable,
                "component": trend.component,
                "worth_um": trend.worth_um,
                "bins": [
                    {
                        "low": one.low,
                        "high": one.high,
                        "n": one.n,
                        "mean_um": one.mean_um,
                        "std_error_um": one.std_error_um,
                        "rms_um": one.rms_um,
                    }
                    for one in trend.bins
                ],
            }
            for trend in comparison.trends
        ],
        "spread_trends": [asdict(one) | {"stands_out": one.stands_out} for one in comparison.spread_trends],
        "outliers": _rows(fitted, np.flatnonzero(~fitted.solved.used)),
        "left_out": dict(fitted.sightings.left_out),
        "notes": list(fitted.sightings.notes),
    }


def _parts(parts: tuple[Part, ...]) -> dict[str, Any]:
    return {part.name: {"rmse_um": part.rmse_um, "n": part.figures.n, "mean_um": part.mean_um} for part in parts}


def _lengths(lengths: LengthComparison) -> dict[str, Any]:
    order = np.argsort(-np.abs(lengths.residual_um), kind="stable")[:_MOST_WORST]
    names = [str(name or "") for name in lengths.frame["feature"].to_list()]
    return {
        "rms_um": lengths.rms_um,
        "n": len(lengths),
        "noise_floor_um": lengths.noise_floor_um,
        "left_out": lengths.n_lacking,
        "by_group": {name: {"rms_um": rms, "n": n} for name, (rms, n) in lengths.by("group").items()},
        "worst": [
            {
                "feature": names[row],
                "nominal_mm": float(lengths.nominal_mm[row]),
                "residual_um": float(lengths.residual_um[row]),
            }
            for row in order
        ],
    }


def worst_rows(fitted: Fitted, most: int = _MOST_WORST) -> list[dict[str, Any]]:
    """Give the rows with the longest residuals, whether the fit used them or not."""
    return _rows(fitted, worst_first(fitted)[:most])


def worst_first(fitted: Fitted) -> np.ndarray:
    """Give the rows from the longest residual on; of a length its second end."""
    told = is_told(fitted.sightings)
    square = (np.where(told, fitted.residual_mm, 0.0) ** 2).sum(axis=1)
    order = np.argsort(-square, kind="stable")
    return np.asarray(order[told[order].any(axis=1)])


def _rows(fitted: Fitted, rows: np.ndarray) -> list[dict[str, Any]]:
    """Give rows: line, commanded position, residual, whether the fit left them out."""
    sightings = fitted.sightings
    lines = sightings.texts("line") if "line" in sightings.table.columns else [""] * len(sightings)
    residual_um = np.where(is_told(sightings), fitted.residual_mm * UM_PER_MM, np.nan)
    return [
        {
            "line": lines[row],
            **dict(zip(AXES, sightings.commanded_mm[row].tolist(), strict=True)),
            "residual_um": [None if np.isnan(value) else float(value) for value in residual_um[row]],
            "is_outlier": bool(~fitted.solved.used[row]),
        }
        for row in rows
    ]
