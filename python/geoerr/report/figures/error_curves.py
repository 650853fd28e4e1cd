"""The 21 errors: 18 curves and three squarenesses."""

from __future__ import annotations

import textwrap
from collections.abc import Collection

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from geoerr.error_functions import (
    ROTATIONS,
    SQUARENESS,
    TRANSLATIONS,
    ErrorFunction,
    ErrorFunctions,
    is_angular,
)
from geoerr.machine import AXES
from geoerr.report.figures import style

_HEIGHT_PX = 1240
_SQUARENESS_ROW = 8
# Letters of a line of a reason, which a panel of a figure as narrow as figures become holds.
_LINE = 42


def error_curves(
    errors: ErrorFunctions,
    truth: ErrorFunctions | None = None,
    title: str = "The 21 geometric errors",
    *,
    absent: Collection[str] = (),
) -> go.Figure:
    """Draw the 21 errors: a column for each axis, a row for each direction, squareness below.

    Parameters
    ----------
    errors
        What was found; bands are ±1.96 standard uncertainties where it has them.
    truth
        What a simulation put in; dashed.
    title
        Heading of the figure.
    absent
        Names of what is not in the model: nobody looked for them.

    Returns
    -------
    plotly.graph_objects.Figure
        What is not determined has its reason where the curve would be.
    """
    directions = TRANSLATIONS + ROTATIONS
    names = [[f"E{direction}{axis.upper()}" for axis in AXES] for direction in directions]
    figure = make_subplots(
        rows=8,
        cols=3,
        specs=[[{}, {}, {}]] * 6 + [[None, None, None], [{}, {}, {}]],
        row_heights=[1.0] * 6 + [0.05, 0.35],
        vertical_spacing=0.042,
        horizontal_spacing=0.055,
        subplot_titles=[style.with_symbol(name) for row in names for name in row]
        + [_squareness_title(errors, name) for name in SQUARENESS],
    )
    reasons = {item.name: item.why for item in errors.not_determined}
    shown: set[str] = set()
    for row, names_of_row in enumerate(names, start=1):
        for column, name in enumerate(names_of_row, start=1):
            found = errors.functions.get(name)
            true = None if truth is None else truth.functions.get(name)
            _draw_function(figure, row, column, name, found, true, shown)
            if found is None:
                _say_why(figure, row, column, reasons.get(name), is_absent=name in absent)
        unit = "µrad" if is_angular(names_of_row[0]) else "µm"
        figure.update_yaxes(title_text=unit, row=row, col=1)
    for column, axis in enumerate(AXES, start=1):
        figure.update_xaxes(title_text=f"{axis.upper()}, mm", row=6, col=column)
    _draw_squareness(figure, errors, truth, shown, absent)
    return style.finish(
        figure,
        title,
        "actual minus nominal, tool seen from the work, at the carriage origin; ISO 230-1 name and Li's symbol; "
        "squareness last",
        _HEIGHT_PX,
        above_plots_px=24,
        bottom_px=50,
        legend=True,
    )


def _draw_function(
    figure: go.Figure,
    row: int,
    column: int,
    name: str,
    found: ErrorFunction | None,
    true: ErrorFunction | None,
    shown: set[str],
) -> None:
    factor = style.MICRO if is_angular(name) else style.UM_PER_MM
    unit = "µrad" if is_angular(name) else "µm"
    if found is not None:
        if found.std is not None:
            figure.add_trace(
                style.band(
                    found.position_mm,
                    found.value * factor,
                    found.std * factor * style.COVERAGE_95,
                    style.BLUE,
                    name="95 % interval",
                    legendgroup="interval",
                    showlegend=_first(shown, "interval"),
                ),
                row=row,
                col=column,
            )
        figure.add_trace(
            go.Scatter(
                x=found.position_mm,
                y=found.value * factor,
                mode="lines+markers",
                marker={"size": 4},
                line={"color": style.BLUE, "width": 1.6},
                name="found",
                legendgroup="found",
                showlegend=_first(shown, "found"),
                customdata=None if found.std is None else found.std * factor * style.COVERAGE_95,
                hovertemplate=f"{name} at %{{x:.1f}} mm: %{{y:.2f}}"
                + ("" if found.std is None else " ± %{customdata:.2f}")
                + f" {unit}<extra></extra>",
            ),
            row=row,
            col=column,
        )
    if true is not None:
        figure.add_trace(
            go.Scatter(
                x=true.position_mm,
                y=true.value * factor,
                mode="lines",
                line={"color": style.TRUTH, "width": 1.4, "dash": "dash"},
                name="truth",
                legendgroup="truth",
                showlegend=_first(shown, "truth"),
                hovertemplate=f"{name} at %{{x:.1f}} mm: %{{y:.2f}} {unit}<extra>truth</extra>",
            ),
            row=row,
            col=column,
        )


def _squareness_title(errors: ErrorFunctions, name: str) -> str:
    found = errors.squareness.get(name)
    if found is None:
        return style.with_symbol(name)
    text = f"{found.value_rad * style.MICRO:.1f}"
    if found.std_rad is not None:
        text += f" ± {found.std_rad * style.MICRO * style.COVERAGE_95:.1f}"
    return f"{style.with_symbol(name)}:  {text} µrad".replace("-", "−")


def _draw_squareness(
    figure: go.Figure,
    errors: ErrorFunctions,
    truth: ErrorFunctions | None,
    shown: set[str],
    absent: Collection[str],
) -> None:
    reasons = {item.name: item.why for item in errors.not_determined}
    for column, name in enumerate(SQUARENESS, start=1):
        found = errors.squareness.get(name)
        true = None if truth is None else truth.squareness.get(name)
        values = []
        half = 0.0
        if found is None:
            _say_why(figure, _SQUARENESS_ROW, column, reasons.get(name), is_absent=name in absent)
        else:
            values.append(found.value_rad * style.MICRO)
            half = 0.0 if found.std_rad is None else found.std_rad * style.MICRO * style.COVERAGE_95
            figure.add_trace(_squareness_point(name, values[0], half, shown), row=_SQUARENESS_ROW, col=column)
        if true is not None:
            values.append(true.value_rad * style.MICRO)
            figure.add_trace(_squareness_truth(name, values[-1], shown), row=_SQUARENESS_ROW, col=column)
        if values:
            # Room for the interval and the truth, at a scale at which the interval is seen.
            reach = max(1.4 * half, 1.6 * float(np.ptp(values)), 1e-3 * abs(values[0]), 0.1)
            figure.update_xaxes(
                range=[values[0] - reach, values[0] + reach], title_text="µrad", row=_SQUARENESS_ROW, col=column
            )
        figure.update_xaxes(nticks=6, zeroline=False, tickformat=",.0f", row=_SQUARENESS_ROW, col=column)
        figure.update_yaxes(range=[-1.0, 1.0], visible=False, row=_SQUARENESS_ROW, col=column)


def _squareness_point(name: str, value: float, half: float, shown: set[str]) -> go.Scatter:
    return go.Scatter(
        x=[value],
        y=[0.0],
        mode="markers",
        marker={"size": 9, "color": style.BLUE},
        error_x={"type": "data", "array": [half], "color": style.BLUE, "width": 7} if half else None,
        name="found",
        legendgroup="found",
        showlegend=_first(shown, "found"),
        hovertemplate=f"{name}: {value:.1f} ± {half:.1f} µrad<extra></extra>",
    )


def _squareness_truth(name: str, value: float, shown: set[str]) -> go.Scatter:
    return go.Scatter(
        x=[value, value],
        y=[-0.8, 0.8],
        mode="lines",
        line={"color": style.TRUTH, "width": 1.4, "dash": "dash"},
        name="truth",
        legendgroup="truth",
        showlegend=_first(shown, "truth"),
        hovertemplate=f"{name}: {value:.1f} µrad<extra>truth</extra>",
    )


def _say_why(figure: go.Figure, row: int, column: int, reason: str | None, *, is_absent: bool) -> None:
    """Say that a function is not in the model, or not determined, and why where that is known."""
    what = "not in the model" if is_absent else "not determined"
    is_squareness = row == _SQUARENESS_ROW
    why = textwrap.wrap("" if is_absent else reason or "", _LINE, max_lines=3, placeholder=" …")
    style.say_instead(figure, row, column, [f"<i>{what}</i>", *why], from_top=is_squareness)


def _first(shown: set[str], what: str) -> bool:
    if what in shown:
        return False
    shown.add(what)
    return True
