"""The ball-bar plot: radial deviation round the circle, magnified."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from geoerr.report.figures import style
from geoerr.report.figures.style import Numbers
from geoerr.verify.ballbar import CircularTestResult, MeasuredRun, Trace

_HEIGHT_PX = 600
_SMALL_PX = 500
# Outermost deviation as a share of the plot's radius beyond and within the ring that stands for no deviation.
_INWARD = 2.0
# Where there is no deviation the rings are still ones that can be read.
_LEAST_UM = 0.01
# Measured runs beside before (vermillion) and after (blue), told apart in grey print too.
_RUN_COLORS = (style.BLACK, style.GREEN, style.PURPLE, style.ORANGE, style.SKY)
_RUN_SYMBOLS = ("circle", "diamond-open", "square", "triangle-up-open", "cross", "circle-open", "star")
# A legend of runs: a line each below the plots, for in one row their names run into each other.
_ENTRY_PX = 20
_ABOVE_LEGEND_PX = 62

# Name, trace, and how Plotly draws it.
_Curve = tuple[str, Trace, dict[str, object]]


def circle(
    trace_before: Trace,
    trace_after: Trace | None = None,
    measured: Trace | Sequence[MeasuredRun] | None = None,
    *,
    name_before: str = "before",
) -> go.Figure:
    """Draw radial deviations from the least-squares circle; the radial axis is in µm, the ring at 0 is the circle.

    Parameters
    ----------
    trace_before
        Without compensation.
    trace_after
        With compensated commands; it gets a second plot at its own scale.
    measured
        A measured trace, or the measured runs of a circular test.
    name_before
        What the legend calls the first trace where nothing is compensated.
    """
    left: list[_Curve] = []
    runs = _measured_traces(measured)
    for number, (name, trace) in enumerate(runs):
        marker = {
            "size": 5,
            "color": _RUN_COLORS[number % len(_RUN_COLORS)],
            "symbol": _RUN_SYMBOLS[number % len(_RUN_SYMBOLS)],
        }
        left.append((name, trace, {"mode": "markers", "marker": marker}))
    left.append((name_before, trace_before, {"mode": "lines", "line": {"color": style.BEFORE, "width": 2}}))
    panels = [left]
    if trace_after is not None:
        after: _Curve = ("after", trace_after, {"mode": "lines", "line": {"color": style.AFTER, "width": 2}})
        left.append(after)
        panels.append([after])
    figure = make_subplots(
        rows=1, cols=len(panels), specs=[[{"type": "polar"}] * len(panels)], horizontal_spacing=0.1
    )
    titles = []
    for column, curves in enumerate(panels, start=1):
        ring_um = _draw_panel(figure, column, curves)
        name = "before and after" if column == 1 and len(panels) > 1 else ("after, at its own scale" * (column > 1))
        titles.append(f"<b>{name or name_before}</b>: rings {ring_um:g} µm apart")
    for column, title in enumerate(titles, start=1):
        _name_panel(figure, column, title)
    below_px = _ENTRY_PX * len(left) if len(runs) > 1 else 0
    commanded = trace_before.circle
    place = ", ".join(f"{value:g}" for value in commanded.center_mm)
    style.finish(
        figure,
        "Circular test",
        f"radial deviation from the least-squares circle, µm; {commanded.plane} plane, "
        f"radius {commanded.radius_mm:g} mm, centre ({place}) mm; G = circular deviation (ISO 230-4)",
        _HEIGHT_PX + below_px,
        above_plots_px=24,
        bottom_px=70 + below_px,
        legend=True,
    )
    if below_px:
        plots_px = _HEIGHT_PX - 70 - figure.layout.margin.t
        legend = {"orientation": "v", "y": -_ABOVE_LEGEND_PX / plots_px, "yanchor": "top", "itemsizing": "constant"}
        figure.update_layout(legend=legend)
    figure.update_layout(margin={"l": 50, "r": 50})
    return figure


def circular_test(result: CircularTestResult) -> go.Figure:
    """Draw a circular test: before and after compensation, and what was measured; of no errors the latter alone."""
    if is_of_no_errors(result):
        return circle(result.before[0], None, result.runs, name_before="machine without errors")
    return circle(result.before[0], result.after[0], result.runs or None)


def is_of_no_errors(result: CircularTestResult) -> bool:
    """Tell whether runs were measured and the model has nothing to say of them: a machine without errors."""
    largest_mm = max(trace.circular_deviation_mm for trace in (*result.before, *result.after))
    return bool(result.runs) and largest_mm * style.UM_PER_MM < _LEAST_UM


def predicted_circles(pairs: Sequence[tuple[Trace, Trace]]) -> go.Figure:
    """Draw circles side by side, each counter-clockwise and clockwise, at its own scale.

    Parameters
    ----------
    pairs
        Of each circle the trace counter-clockwise and the one clockwise.
    """
    figure = make_subplots(rows=1, cols=len(pairs), specs=[[{"type": "polar"}] * len(pairs)], horizontal_spacing=0.08)
    for column, (there, back) in enumerate(pairs, start=1):
        curves: list[_Curve] = [
            ("counter-clockwise", there, {"mode": "lines", "line": {"color": style.BLUE, "width": 2}}),
            ("clockwise", back, {"mode": "lines", "line": {"color": style.ORANGE, "width": 2, "dash": "dash"}}),
        ]
        ring_um = _draw_panel(figure, column, curves, names_deviation=False)
        deviations = " and ".join(
            style.text_um(trace.circular_deviation_mm * style.UM_PER_MM) for trace in (there, back)
        )
        _name_panel(figure, column, f"<b>{there.circle.plane}</b>: G {deviations}<br>rings {ring_um:g} µm apart")
    radii_mm = [there.circle.radius_mm for there, _ in pairs]
    style.finish(
        figure,
        "Circular tests, predicted",
        f"radial deviation from the least-squares circle, µm; radius {_span(radii_mm)} mm; "
        "G = circular deviation (ISO 230-4), counter-clockwise and clockwise",
        _SMALL_PX,
        above_plots_px=24,
        bottom_px=90,
        legend=True,
    )
    figure.update_layout(margin={"l": 40, "r": 40})
    return figure


def _span(values: Sequence[float]) -> str:
    low, high = min(values), max(values)
    return f"{low:g}" if low == high else f"{low:g} to {high:g}"


def _name_panel(figure: go.Figure, column: int, text: str) -> None:
    domain = figure.layout[f"polar{'' if column == 1 else column}"].domain.x
    figure.add_annotation(
        text=text,
        x=(domain[0] + domain[1]) / 2.0,
        y=-0.07,
        xref="paper",
        yref="paper",
        xanchor="center",
        yanchor="top",
        showarrow=False,
        font={"size": 13},
    )


def _measured_traces(measured: Trace | Sequence[MeasuredRun] | None) -> list[tuple[str, Trace]]:
    if measured is None:
        return []
    if isinstance(measured, Trace):
        return [("measured", measured)]
    return [(f"measured {run.label}", run.measured) for run in measured]


def _draw_panel(figure: go.Figure, column: int, curves: Sequence[_Curve], *, names_deviation: bool = True) -> float:
    largest_um = max(float(np.abs(trace.radial_deviation_mm).max()) for _, trace, _ in curves) * style.UM_PER_MM
    largest_um = max(largest_um, _LEAST_UM)
    ring_um = style.round_up_125(largest_um / 3.0)
    outer = 1.1 * largest_um
    inner = -_INWARD * largest_um
    turn = np.linspace(0.0, 360.0, 361)
    figure.add_trace(
        go.Scatterpolar(
            theta=turn,
            r=np.zeros(len(turn)),
            mode="lines",
            line={"color": "#777777", "width": 1},
            hoverinfo="skip",
            showlegend=False,
        ),
        row=1,
        col=column,
    )
    for name, trace, look in curves:
        angle, deviation = _closed(trace)
        deviation_um = style.text_um(trace.circular_deviation_mm * style.UM_PER_MM)
        told = f", G = {deviation_um}".replace("= below", "below") if names_deviation else ""
        figure.add_trace(
            go.Scatterpolar(
                theta=np.rad2deg(angle),
                r=deviation * style.UM_PER_MM,
                name=style.plain(f"{name}{told}"),
                showlegend=column == 1,
                hovertemplate="%{theta:.0f}°: %{r:.2f} µm<extra>%{fullData.name}</extra>",
                **look,
            ),
            row=1,
            col=column,
        )
    plane = curves[0][1].circle.plane
    first, second = plane[0], plane[1]
    steps = np.arange(np.ceil(inner / ring_um) + 1, np.floor(outer / ring_um) + 1)
    figure.update_polars(
        radialaxis={
            "range": [inner, outer],
            "tickvals": steps * ring_um,
            "ticktext": [f"{step * ring_um:+g}".replace("-", "−") if step else "0" for step in steps],
            "angle": 22.5,
            "tickfont": {"size": 11},
            "ticks": "",
        },
        angularaxis={
            "tickvals": list(range(0, 360, 45)),
            "ticktext": [f"+{first}", "45°", f"+{second}", "135°", f"−{first}", "225°", f"−{second}", "315°"],
        },
        selector=column - 1,
    )
    return ring_um


def _closed(trace: Trace) -> tuple[Numbers, Numbers]:
    """Join the last point to the first where the trace is a whole turn."""
    angle, deviation = trace.angle_rad, trace.radial_deviation_mm
    gap = np.angle(np.exp(1j * (angle[0] - angle[-1])))
    if abs(gap) < 3.0 * (2.0 * np.pi / len(angle)):
        return np.append(angle, angle[0]), np.append(deviation, deviation[0])
    return angle, deviation
