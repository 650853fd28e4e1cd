"""How far, and where, a model is off: the figures of `compare --json`, as plain values."""

from __future__ import annotations

from typing import Any

import numpy as np

from geoerr.fit import Fitted, figures_document
from geoerr.fit.figures import figures_of
from geoerr.machine import AXES

_UM_PER_MM = 1e3
_MOST_WORST = 10


def comparison_document(fitted: Fitted) -> dict[str, Any]:
    """Give a fit's figures as FORMATS names them: overall, the worst rows, by line, by axis of the base frame.

    Residuals are measured minus predicted in base axes, µm; a component that was not measured is null. The worst rows
    are of all rows, those that the fit left out as gross outliers too (`is_outlier`).
    """
    sightings = fitted.sightings
    overall = figures_document(fitted)
    lines = np.asarray(sightings.texts("line") if "line" in sightings.table.columns else [""] * len(sightings))
    by_line = {}
    for name in dict.fromkeys(lines.tolist()):
        rows = (lines == name) & fitted.solved.used
        figures = figures_of(sightings, fitted.residual_mm, rows)
        by_line[name] = {"rmse_um": figures.headline_um, "n": figures.n}
    each = overall["rms_per_component_um"]
    return {
        **overall,
        "worst": _worst(fitted, lines),
        "by_line": by_line,
        "by_axis": {axis: {"rms_um": value} for axis, value in zip(AXES, each, strict=True)},
    }


def _worst(fitted: Fitted, lines: np.ndarray) -> list[dict[str, Any]]:
    sightings = fitted.sightings
    residual_um = np.where(sightings.is_measured, fitted.residual_mm * _UM_PER_MM, np.nan)
    size = np.sqrt(np.nansum(residual_um**2, axis=1))
    order = np.argsort(-size, kind="stable")[:_MOST_WORST]
    return [
        {
            "line": str(lines[row]),
            **dict(zip(AXES, sightings.commanded_mm[row].tolist(), strict=True)),
            "residual_um": [None if np.isnan(value) else float(value) for value in residual_um[row]],
            "is_outlier": bool(~fitted.solved.used[row]),
        }
        for row in order
    ]
