"""Positioning deviations of Li's nine lines (Li Fig. 9)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import plotly.graph_objects as go
from plotly.subplots import make_subplots

from geoerr.error_functions import ErrorFunctions
from geoerr.machine import AXES
from geoerr.report.figures import style
from geoerr.report.figures.style import Numbers

_HEIGHT_PX = 470
_BOTTOM_PX = 120

# Offsets of the target from lines 1, 2, 3 in the paper, mm.
LI_OFFSETS_MM: Mapping[int, float] = {4: 200.0, 5: 150.0, 6: 200.0, 7: 150.0, 8: 200.0, 9: 200.0}

# Line: its axis, line through the origin, angular error, sign and direction of the arm (Li Eqs. 17 and 18).
_FROM_ERRORS: Mapping[int, tuple[str, str, float, str]] = {
    4: ("x", "EBX", +1.0, "z"),
    5: ("x", "ECX", -1.0, "y"),
    6: ("y", "EAY", -1.0, "z"),
    7: ("y", "ECY", +1.0, "x"),
    8: ("z", "EAZ", +1.0, "y"),
    9: ("z", "EBZ", -1.0, "x"),
}
_MARKERS = ("circle", "square", "diamond")


@dataclass(frozen=True)
class LineCurve:
    """One of the nine lines: ΔL along it.

    Attributes
    ----------
    number
        Li's number of the line, 1 to 9.
    axis
        The axis that moves.
    label
        Its place, for the legend.
    position_mm, deviation_mm : (n,)
        Commanded position and distance travelled minus nominal distance.
    std_mm : (n,) or None
        Standard uncertainty of the deviation.
    """

    number: int
    axis: str
    label: str
    position_mm: Numbers
    deviation_mm: Numbers
    std_mm: Numbers | None = None


def lines_of_errors(errors: ErrorFunctions, offsets_mm: Mapping[int, float] = LI_OFFSETS_MM) -> tuple[LineCurve, ...]:
    """Compute ΔL of the nine lines from positioning and angular errors (Li Eqs. 17 and 18, solved for ΔL).

    Lines whose errors are not determined are left out.
    """
    curves = []
    for number, axis in enumerate(AXES, start=1):
        along = errors.functions.get(f"E{axis.upper() * 2}")
        if along is not None:
            curves.append(LineCurve(number, axis, f"{number}: through the origin", along.position_mm, along.value))
    for number, (axis, angular_name, sign, arm) in _FROM_ERRORS.items():
        along = errors.functions.get(f"E{axis.upper() * 2}")
        angular = errors.functions.get(angular_name)
        if along is None or angular is None:
            continue
        offset = offsets_mm[number]
        curves.append(
            LineCurve(
                number,
                axis,
                f"{number}: {arm} = {offset:g} mm",
                along.position_mm,
                along.value + sign * offset * angular.at(along.position_mm),
            )
        )
    return tuple(curves)


def nine_lines(lines: ErrorFunctions | Sequence[LineCurve]) -> go.Figure:
    """Draw ΔL of the nine lines, three lines an axis, with 95 % bands where there are uncertainties."""
    curves = lines_of_errors(lines) if isinstance(lines, ErrorFunctions) else tuple(lines)
    figure = make_subplots(
        rows=1,
        cols=3,
        subplot_titles=[f"<b>Lines along {axis.upper()}</b>" for axis in AXES],
        horizontal_spacing=0.06,
    )
    for column, axis in enumerate(AXES, start=1):
        of_axis = sorted((curve for curve in curves if curve.axis == axis), key=lambda curve: curve.number)
        for index, curve in enumerate(of_axis):
            _draw(figure, column, curve, index)
        figure.update_xaxes(title_text=f"{axis.upper()}, mm", row=1, col=column)
    figure.update_yaxes(title_text="ΔL, µm", row=1, col=1)
    style.finish(
        figure,
        "Positioning deviations of the nine lines",
        "ΔL = distance travelled along the fitted line minus nominal distance; lines differ by the axis's angles",
        _HEIGHT_PX,
        above_plots_px=26,
        bottom_px=_BOTTOM_PX,
    )
    for column in (1, 2, 3):
        # One legend under each plot: nine entries in one row would run into each other.
        left, _ = figure.layout[f"xaxis{'' if column == 1 else column}"].domain
        place = {"x": left, "xanchor": "left", "y": -0.2, "yanchor": "top", "orientation": "v"}
        figure.update_layout({f"legend{'' if column == 1 else column}": place})
    return figure


def _draw(figure: go.Figure, column: int, curve: LineCurve, index: int) -> None:
    color = style.SERIES[index % len(style.SERIES)]
    legend = f"legend{'' if column == 1 else column}"
    deviation = curve.deviation_mm * style.UM_PER_MM
    if curve.std_mm is not None:
        half = curve.std_mm * style.UM_PER_MM * style.COVERAGE_95
        figure.add_trace(
            style.band(curve.position_mm, deviation, half, color, showlegend=False, legend=legend), row=1, col=column
        )
    figure.add_trace(
        go.Scatter(
            x=curve.position_mm,
            y=deviation,
            mode="lines+markers",
            line={"color": color, "width": 1.6},
            marker={"symbol": _MARKERS[index % len(_MARKERS)], "size": 6},
            name=curve.label,
            legend=legend,
            hovertemplate=f"line {curve.number} at %{{x:.1f}} mm: %{{y:.2f}} µm<extra></extra>",
        ),
        row=1,
        col=column,
    )
