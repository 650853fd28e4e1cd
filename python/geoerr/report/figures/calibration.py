"""Residuals of the stereo calibration, view by view."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import plotly.graph_objects as go

from geoerr.report.figures import style

if TYPE_CHECKING:
    # OpenCV comes with it: only who calibrates pays for it.
    from geoerr.vision.calibrate import Calibration

# Above this many views their names no longer fit under the bars at 1366 pixels.
_MOST_NAMES = 60


@dataclass(frozen=True)
class CalibrationView:
    """One pair of board pictures: its rms reprojection error in each camera; None where it was dropped."""

    name: str
    left_rms_px: float | None
    right_rms_px: float | None
    why_dropped: str | None = None


def calibration_views(views: Sequence[CalibrationView]) -> go.Figure:
    """Draw the rms reprojection error of each view in both cameras; dropped views are named with the reason."""
    used = [view for view in views if view.why_dropped is None]
    dropped = [view for view in views if view.why_dropped is not None]
    figure = go.Figure()
    for label, color, values in (
        ("left camera", style.BLUE, [view.left_rms_px for view in used]),
        ("right camera", style.ORANGE, [view.right_rms_px for view in used]),
    ):
        figure.add_trace(
            go.Bar(
                x=[style.plain(view.name) for view in used],
                y=values,
                name=label,
                marker={"color": color},
                hovertemplate="%{x}: %{y:.3f} px<extra>" + label + "</extra>",
            )
        )
    bottom_px = 90
    if dropped:
        lines = [style.plain(f"dropped: {view.name} ({view.why_dropped})") for view in dropped]
        bottom_px += 16 * len(lines)
        figure.add_annotation(
            text="<br>".join(lines),
            x=0.0,
            y=0.0,
            xref="paper",
            yref="paper",
            xanchor="left",
            yanchor="top",
            yshift=-84,
            align="left",
            showarrow=False,
            font={"size": 12, "color": "#555555"},
        )
    figure.update_xaxes(type="category", tickangle=-45, showticklabels=len(used) <= _MOST_NAMES)
    figure.update_yaxes(title_text="rms reprojection error, px", rangemode="tozero")
    figure.update_layout(barmode="group")
    return style.finish(
        figure,
        "Calibration views",
        f"{len(used)} pairs used, {len(dropped)} dropped",
        360 + bottom_px,
        bottom_px=bottom_px,
        above_plots_px=6,
        legend=True,
    )


def views_of(calibration: Calibration) -> list[CalibrationView]:
    """Give the views of a calibration: those that took part, then those that were dropped."""
    used = [CalibrationView(view.name, view.left_rms_px, view.right_rms_px) for view in calibration.per_view]
    dropped = [CalibrationView(item.name, None, None, why_dropped=item.why) for item in calibration.pairs_dropped]
    return used + dropped


def calibration_quality(calibration: Calibration) -> go.Figure:
    """Draw the rms reprojection error of each view of a calibration in both cameras."""
    return calibration_views(views_of(calibration))
