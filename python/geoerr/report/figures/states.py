"""One machine at several temperatures: the 21 errors of each, how two differ, and where in the volume."""

from __future__ import annotations

import numpy as np
import plotly.graph_objects as go
from plotly.colors import sample_colorscale, unlabel_rgb
from plotly.subplots import make_subplots

from geoerr.error_functions import ROTATIONS, SQUARENESS, TRANSLATIONS, is_angular
from geoerr.machine import AXES
from geoerr.report.figures import style
from geoerr.report.figures.style import Numbers
from geoerr.states import Difference, States, VolumeDifference
from geoerr.summaries import p_words

_CURVES_PX = 1280
_MAP_PX = 860
_SLICES = 3
_GREY = "#999999"
# Share of the shorter edge of a slice that the largest arrow is drawn as.
_LARGEST_ARROW = 0.16
# Part of the colour scale that is dark enough on white, from cold to hot.
_COLD, _HOT = 0.0, 0.78


def state_curves(states: States) -> go.Figure:
    """Draw the 21 errors at every temperature: a column for each axis, a row for each direction, squareness below.

    Parameters
    ----------
    states
        Of `identify_states`.

    Returns
    -------
    plotly.graph_objects.Figure
        Bands are ±1.96 standard uncertainties; dark is cold, bright is hot. Squareness over temperature.
    """
    temperatures = np.array(states.temperatures_degc)
    colors = _colors(temperatures)
    figure = _grid()
    for state, color in zip(states.states, colors, strict=True):
        label = f"{state.temperature_degc:g} °C"
        is_first = True
        for name, row, column in _places():
            factor = style.MICRO if is_angular(name) else style.UM_PER_MM
            table = state.errors.functions.get(name)
            if table is None:
                continue
            assert table.std is not None
            half_width = style.COVERAGE_95 * factor * table.std
            figure.add_trace(
                style.band(
                    table.position_mm, factor * table.value, half_width, color, legendgroup=label, showlegend=False
                ),
                row=row,
                col=column,
            )
            figure.add_trace(
                go.Scatter(
                    x=table.position_mm,
                    y=factor * table.value,
                    mode="lines",
                    line={"color": color, "width": 1.6},
                    name=label,
                    legendgroup=label,
                    showlegend=is_first,
                    hovertemplate=f"{name} at %{{x:.1f}} mm: %{{y:.1f}}<extra>{label}</extra>",
                ),
                row=row,
                col=column,
            )
            is_first = False
    for column, name in enumerate(SQUARENESS, start=1):
        found = [state.errors.squareness.get(name) for state in states.states]
        known = [one is not None for one in found]
        values = np.array([style.MICRO * one.value_rad for one in found if one is not None])
        std = np.array([style.MICRO * (one.std_rad or 0.0) for one in found if one is not None])
        _points(figure, column, temperatures[known], values, style.COVERAGE_95 * std, style.BLACK)
        figure.update_xaxes(title_text="°C", row=8, col=column)
    _say_what_is_not_determined(figure, states.functions.names)
    return style.finish(
        figure,
        "The 21 errors at each temperature",
        "actual minus nominal, tool seen from the work; bands: 95 %; ISO 230-1 name and Li's symbol; squareness last",
        _CURVES_PX,
        above_plots_px=24,
        legend=True,
    )


def difference_curves(difference: Difference) -> go.Figure:
    """Draw how each of the 21 errors differs between two states.

    Parameters
    ----------
    difference
        Of `States.difference`.

    Returns
    -------
    plotly.graph_objects.Figure
        The bands hold for all functions and positions at once (95 %): where one leaves 0 out, the machine differs.
        A function that differs beyond chance as a whole is drawn in colour.
    """
    figure = _grid()
    shown: set[str] = set()
    for name, row, column in _places():
        one = difference.by_name.get(name)
        if one is None:
            continue
        factor = style.MICRO if is_angular(name) else style.UM_PER_MM
        label = "beyond chance" if one.p_value < 0.05 else "within chance"
        color = style.VERMILLION if one.p_value < 0.05 else _GREY
        figure.add_trace(
            style.band(
                one.position_mm,
                factor * one.value,
                factor * one.half_width,
                color,
                legendgroup=label,
                showlegend=False,
            ),
            row=row,
            col=column,
        )
        figure.add_trace(
            go.Scatter(
                x=one.position_mm,
                y=factor * one.value,
                mode="lines",
                line={"color": color, "width": 1.6},
                name=label,
                legendgroup=label,
                showlegend=label not in shown,
                customdata=factor * one.half_width,
                hovertemplate=f"{name} at %{{x:.1f}} mm: %{{y:.1f}} ± %{{customdata:.1f}}<extra></extra>",
            ),
            row=row,
            col=column,
        )
        shown.add(label)
    for column, name in enumerate(SQUARENESS, start=1):
        one = difference.by_name.get(name)
        if one is not None:
            color = style.VERMILLION if one.p_value < 0.05 else _GREY
            _points(figure, column, np.zeros(1), style.MICRO * one.value, style.MICRO * one.half_width, color)
        figure.update_xaxes(visible=False, row=8, col=column)
    _say_what_is_not_determined(figure, difference.functions.names)
    return style.finish(
        figure,
        f"What differs: {difference.second} minus {difference.first}",
        f"bands hold for all functions at once (95 %, ± {difference.band_factor:.1f} standard uncertainties); "
        f"{p_words(difference.p_value)} that nothing differs",
        _CURVES_PX,
        above_plots_px=24,
        legend=True,
    )


def difference_map(volume: VolumeDifference, title: str = "Difference over the volume") -> go.Figure:
    """Draw how the error differs over the volume, on slices at heights.

    Parameters
    ----------
    volume
        Of `Difference.volume` on a grid.
    title
        Heading.

    Returns
    -------
    plotly.graph_objects.Figure
        Above the part in X and Y, as arrows on its length; below the part along Z. Crosses: within chance.
    """
    if volume.shape is None:
        raise ValueError("a map needs a difference over a grid, not at places of one's own")
    x_mm, y_mm, z_mm = (np.unique(volume.position_mm[:, axis]) for axis in range(3))
    vectors = style.UM_PER_MM * volume.difference_mm.reshape(*volume.shape, 3)
    beyond = volume.is_beyond.reshape(volume.shape)
    heights = np.unique(np.linspace(0, len(z_mm) - 1, min(_SLICES, len(z_mm))).round().astype(int))
    rows = ("in X and Y", "along Z")
    figure = make_subplots(
        rows=2,
        cols=len(heights),
        horizontal_spacing=0.06,
        vertical_spacing=0.13,
        shared_xaxes="all",
        shared_yaxes="all",
        subplot_titles=[f"<b>{row}</b>, z = {z_mm[height]:g} mm" for row in rows for height in heights],
    )
    across = np.linalg.norm(vectors[:, :, :, :2], axis=3)
    largest, highest = max(float(across.max()), 1e-6), max(float(np.abs(vectors[:, :, :, 2]).max()), 1e-6)
    cell = min(np.ptp(x_mm) / max(len(x_mm) - 1, 1), np.ptp(y_mm) / max(len(y_mm) - 1, 1))
    scale = max(_LARGEST_ARROW * min(np.ptp(x_mm), np.ptp(y_mm)), 0.9 * cell) / largest
    for column, height in enumerate(heights, start=1):
        _slice(figure, 1, column, x_mm, y_mm, across[:, :, height], "coloraxis")
        _arrows(figure, column, x_mm, y_mm, vectors[:, :, height, :2] * scale)
        _slice(figure, 2, column, x_mm, y_mm, vectors[:, :, height, 2], "coloraxis2")
        for row in (1, 2):
            _crosses(figure, row, column, x_mm, y_mm, ~beyond[:, :, height])
    bar = {"thickness": 14, "len": 0.46, "x": 1.01, "title": {"text": "µm", "side": "top"}}
    figure.update_layout(
        coloraxis={"colorscale": "Blues", "cmin": 0.0, "cmax": largest, "colorbar": {**bar, "y": 0.78}},
        coloraxis2={"colorscale": "RdBu_r", "cmin": -highest, "cmax": highest, "colorbar": {**bar, "y": 0.22}},
        showlegend=False,
    )
    figure.update_xaxes(title_text="X, mm", row=2)
    x_room, y_room = (float(scale * np.abs(vectors[..., axis]).max()) for axis in range(2))
    figure.update_xaxes(showticklabels=True, zeroline=False, constrain="domain", range=_room(x_mm, x_room))
    figure.update_yaxes(showticklabels=True, zeroline=False, range=_room(y_mm, y_room))
    figure.update_yaxes(title_text="Y, mm", col=1)
    style.finish(
        figure,
        title,
        f"{volume.rms_um:.1f} µm rms, by chance {volume.rms_by_chance_um:.1f} µm; arrows {1e3 * scale:,.0f} times; "
        f"crosses: within chance ({int((~volume.is_beyond).sum())} of {volume.is_beyond.size} places); taken off: "
        f"the work's set-up{'' if volume.growth is None else ', the growth of each axis'}",
        _MAP_PX,
        above_plots_px=24,
    )
    figure.update_layout(margin={"r": 80})
    return figure


def _colors(temperatures: Numbers) -> list[str]:
    """Give a colour for each temperature, dark when cold."""
    share = (temperatures - temperatures.min()) / max(float(np.ptp(temperatures)), 1e-9)
    found = sample_colorscale("Plasma", (_COLD + (_HOT - _COLD) * share).tolist())
    return ["#" + "".join(f"{round(part):02x}" for part in unlabel_rgb(color)) for color in found]


def _places() -> list[tuple[str, int, int]]:
    """Give name, row and column of each of the 18 functions."""
    return [
        (f"E{direction}{axis.upper()}", row, column)
        for row, direction in enumerate(TRANSLATIONS + ROTATIONS, start=1)
        for column, axis in enumerate(AXES, start=1)
    ]


def _grid() -> go.Figure:
    names = [name for name, _, _ in _places()]
    figure = make_subplots(
        rows=8,
        cols=3,
        specs=[[{}, {}, {}]] * 6 + [[None, None, None], [{}, {}, {}]],
        row_heights=[1.0] * 6 + [0.05, 0.6],
        vertical_spacing=0.04,
        horizontal_spacing=0.055,
        subplot_titles=[style.with_symbol(name) for name in (*names, *SQUARENESS)],
    )
    for row in range(1, 7):
        figure.update_yaxes(title_text="µm" if row <= 3 else "µrad", row=row, col=1)
    for column, axis in enumerate(AXES, start=1):
        figure.update_xaxes(title_text=f"{axis.upper()}, mm", row=6, col=column)
    figure.update_yaxes(title_text="µrad", row=8, col=1)
    return figure


def _points(figure: go.Figure, column: int, x: Numbers, value: Numbers, half_width: Numbers, color: str) -> None:
    figure.add_trace(
        go.Scatter(
            x=x,
            y=value,
            mode="markers",
            marker={"size": 8, "color": color},
            error_y={"type": "data", "array": half_width, "color": color, "width": 6},
            showlegend=False,
            hovertemplate="%{y:.1f} µrad<extra></extra>",
        ),
        row=8,
        col=column,
    )


def _say_what_is_not_determined(figure: go.Figure, names: tuple[str, ...]) -> None:
    places = [*_places(), *((name, 8, column) for column, name in enumerate(SQUARENESS, start=1))]
    for name, row, column in places:
        if name not in names:
            style.say_instead(figure, row, column, ["<i>not determined in every state</i>"])


def _slice(
    figure: go.Figure, row: int, column: int, x_mm: Numbers, y_mm: Numbers, values: Numbers, axis: str
) -> None:
    figure.add_trace(
        go.Heatmap(
            x=x_mm,
            y=y_mm,
            z=values.T,
            coloraxis=axis,
            zsmooth="best",
            hovertemplate="(%{x:.0f}, %{y:.0f}) mm: %{z:.1f} µm<extra></extra>",
        ),
        row=row,
        col=column,
    )


def _arrows(figure: go.Figure, column: int, x_mm: Numbers, y_mm: Numbers, vectors: Numbers) -> None:
    """Draw arrows (nx, ny, 2), in mm on the page, as lines with a dot where they start."""
    x, y = (values.ravel() for values in np.meshgrid(x_mm, y_mm, indexing="ij"))
    ends = vectors.reshape(-1, 2)
    pen_up = np.full(len(x), np.nan)
    figure.add_trace(
        go.Scatter(
            x=np.column_stack([x, x + ends[:, 0], pen_up]).ravel(),
            y=np.column_stack([y, y + ends[:, 1], pen_up]).ravel(),
            mode="lines",
            line={"color": style.INK, "width": 1.6},
            hoverinfo="skip",
        ),
        row=1,
        col=column,
    )
    figure.add_trace(
        go.Scatter(x=x, y=y, mode="markers", marker={"size": 4, "color": style.INK}, hoverinfo="skip"),
        row=1,
        col=column,
    )


def _crosses(figure: go.Figure, row: int, column: int, x_mm: Numbers, y_mm: Numbers, is_within: np.ndarray) -> None:
    x, y = np.nonzero(is_within)
    figure.add_trace(
        go.Scatter(
            x=x_mm[x],
            y=y_mm[y],
            mode="markers",
            marker={"symbol": "x-thin", "size": 9, "line": {"width": 1.6, "color": "#777777"}},
            hovertemplate="(%{x:.0f}, %{y:.0f}) mm: within chance<extra></extra>",
        ),
        row=row,
        col=column,
    )


def _room(position_mm: Numbers, arrow_mm: float) -> list[float]:
    """Give the ends of an axis: room for the half cell that a map has beyond its places, and for arrows."""
    room = max(0.55 * float(np.ptp(position_mm)) / max(len(position_mm) - 1, 1), 1.1 * arrow_mm)
    return [float(position_mm[0]) - room, float(position_mm[-1]) + room]
