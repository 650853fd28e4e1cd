"""The volumetric error field in 3-D: a nominal grid and where the machine really puts it."""

from __future__ import annotations

import itertools
from collections.abc import Callable

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from geoerr.model import Model
from geoerr.model.conditions import Conditions
from geoerr.report.figures import style
from geoerr.report.figures.style import Numbers
from geoerr.verify.ballbar import usable_range_mm

_HEIGHT_PX = 620
# Share of the shortest edge of the volume that the largest error is drawn as.
_LARGEST_DRAWN = 0.15
# No machine is off by a kilometre.
_FARTHEST_MM = 1e6
_POINTS_OF_LINE = 17


def error_field(
    model: Model,
    compensated: Callable[[Numbers], Numbers] | None = None,
    n_lines: int = 5,
    *,
    at: Conditions | None = None,
) -> go.Figure:
    """Draw the error over the working volume as a deformed grid, before and, beside it, after compensation.

    Parameters
    ----------
    model
        Its `error_mm` is the field before.
    compensated
        Gives the remaining error (n, 3) in mm at positions (n, 3); None draws one panel.
    n_lines
        Grid lines along each edge of the volume.
    at
        Conditions that the model needs.

    Returns
    -------
    plotly.graph_objects.Figure
        Errors magnified so that the largest before compensation is about a tenth of the shortest edge; the
        magnification is stated and the same in both panels, as are the colours.
    """
    low, high = usable_range_mm(model)
    lines = _lines_on_faces(low, high, n_lines)
    nodes = lines.reshape(-1, 3)
    before = model.error_mm(nodes, at=at)
    fields = [("before compensation" if compensated is not None else "the machine as it is", before)]
    if compensated is not None:
        fields.append(("after compensation", compensated(nodes)))
    largest = float(np.linalg.norm(before, axis=1).max())
    magnification = _magnification(low, high, largest)
    figure = make_subplots(
        rows=1,
        cols=len(fields),
        specs=[[{"type": "scene"}] * len(fields)],
        horizontal_spacing=0.02,
        subplot_titles=[_panel_title(name, error) for name, error in fields],
    )
    for column, (_, error) in enumerate(fields, start=1):
        for trace in _grid(lines, error.reshape(lines.shape), magnification, largest, shows_scale=column == 1):
            figure.add_trace(trace, row=1, col=column)
    style.finish_volume(
        figure,
        "Volumetric error",
        f"errors magnified {magnification:,.0f} times; grey: nominal grid; colour: length of the error",
        _HEIGHT_PX,
        above_plots_px=20,
    )
    return figure.update_scenes(**_ranges(low, high))


def field_difference(
    model: Model, reference: Model, *, exaggeration: float = 1.0, at: Conditions | None = None, n_lines: int = 5
) -> tuple[go.Figure, float]:
    """Draw what a model says of the volume beyond another one, as a deformed grid; give the magnification too.

    Parameters
    ----------
    model, reference
        Of one machine; the grid is where the reference puts the volume, drawn straight.
    exaggeration
        Times the magnification that draws the largest difference as about a tenth of the shortest edge.
    at
        Conditions that either model needs.

    Returns
    -------
    figure, magnification
        Two traces: the differences, coloured by length, and the straight grid.
    """

    def beyond(nodes: Numbers) -> Numbers:
        return model.error_mm(nodes, at=_asked(at, model)) - reference.error_mm(nodes, at=_asked(at, reference))

    (straight, bent), difference, magnification = _magnified(model, beyond, exaggeration, n_lines)
    figure = go.Figure([bent, straight])
    style.finish_volume(
        figure,
        "Difference of two models over the volume",
        f"{_sizes(difference)}; magnified {magnification:,.0f} times; grey: no difference",
        _HEIGHT_PX,
    )
    return figure, magnification


def _asked(at: Conditions | None, model: Model) -> Conditions:
    """Give those conditions that a model follows."""
    return {name: value for name, value in (at or {}).items() if name in model.conditions}


def _ranges(low_mm: Numbers, high_mm: Numbers) -> dict[str, object]:
    """Give both scenes the same axes, with room for the drawn errors, so that the boxes compare."""
    room = 1.1 * _LARGEST_DRAWN * float((high_mm - low_mm).min())
    return {
        f"{name}axis": {"range": [low - room, high + room], "nticks": 6}
        for name, low, high in zip("xyz", low_mm.tolist(), high_mm.tolist(), strict=True)
    }


def _panel_title(name: str, error: Numbers) -> str:
    return f"<b>{name}</b>: {_sizes(error)}"


def _sizes(error: Numbers) -> str:
    length = np.linalg.norm(error, axis=1) * style.UM_PER_MM
    return f"largest {style.text_um(length.max())}, rms {style.text_um(np.sqrt(np.mean(length**2)))}"


def grid_traces(
    model: Model, *, exaggeration: float = 1.0, at: Conditions | None = None, n_lines: int = 5
) -> tuple[list[go.Scatter3d], float]:
    """Draw the volume's nominal grid and where the model puts it; give the magnification too.

    Parameters
    ----------
    exaggeration
        Times the magnification that draws the largest error as about a tenth of the shortest edge.
    at
        Conditions that the model needs.
    """
    traces, _, magnification = _magnified(model, lambda nodes: model.error_mm(nodes, at=at), exaggeration, n_lines)
    return traces, magnification


def _magnified(
    model: Model, displaced: Callable[[Numbers], Numbers], exaggeration: float, n_lines: int
) -> tuple[list[go.Scatter3d], Numbers, float]:
    """Draw a volume's grid straight and displaced; give the displacements (n, 3) and their magnification."""
    low, high = usable_range_mm(model)
    lines = _lines_on_faces(low, high, n_lines)
    error = displaced(lines.reshape(-1, 3))
    # Far outside its data a model may say what is no length any more: that is not drawn.
    error = np.where((np.abs(error) < _FARTHEST_MM).all(axis=1, keepdims=True), error, np.nan)
    largest = float(np.nan_to_num(np.linalg.norm(error, axis=1)).max())
    magnification = style.exaggerated(_magnification(low, high, largest), exaggeration)
    return _grid(lines, error.reshape(lines.shape), magnification, largest, shows_scale=True), error, magnification


def _magnification(low: Numbers, high: Numbers, largest_mm: float) -> float:
    shortest = float((high - low).min())
    return 1.0 if largest_mm == 0.0 else max(style.round_down_125(_LARGEST_DRAWN * shortest / largest_mm), 1.0)


def _grid(
    lines: Numbers, error: Numbers, magnification: float, largest_mm: float, *, shows_scale: bool
) -> list[go.Scatter3d]:
    nominal = _joined(lines)
    drawn = _joined(lines + magnification * error)
    length = np.nan_to_num(_joined(np.linalg.norm(error, axis=2, keepdims=True))[:, 0]) * style.UM_PER_MM
    return [
        go.Scatter3d(
            x=nominal[:, 0],
            y=nominal[:, 1],
            z=nominal[:, 2],
            mode="lines",
            line={"color": "#B8B8B8", "width": 1.5},
            hoverinfo="skip",
            name="nominal",
        ),
        go.Scatter3d(
            x=drawn[:, 0],
            y=drawn[:, 1],
            z=drawn[:, 2],
            mode="lines",
            line={
                "color": length,
                "colorscale": "Viridis",
                "cmin": 0.0,
                "cmax": max(largest_mm * style.UM_PER_MM, 1e-6),
                "width": 4,
                "showscale": shows_scale,
                "colorbar": {"title": {"text": "µm", "side": "top"}, "thickness": 14, "len": 0.7, "x": 1.0},
            },
            customdata=np.column_stack([nominal, _joined(error) * style.UM_PER_MM]),
            hovertemplate=(
                "at (%{customdata[0]:.0f}, %{customdata[1]:.0f}, %{customdata[2]:.0f}) mm<br>"
                "error (%{customdata[3]:.1f}, %{customdata[4]:.1f}, %{customdata[5]:.1f}) µm<extra></extra>"
            ),
            name="actual",
        ),
    ]


def _lines_on_faces(low_mm: Numbers, high_mm: Numbers, n_lines: int) -> Numbers:
    """Give the grid lines on the faces of the box, (number of lines, points of a line, 3); inside they would hide."""
    shares = np.linspace(0.0, 1.0, n_lines)
    along = np.linspace(0.0, 1.0, _POINTS_OF_LINE)
    lines = []
    for axis in range(3):
        others = [other for other in range(3) if other != axis]
        for first, second in itertools.product(range(n_lines), repeat=2):
            if not {first, second} & {0, n_lines - 1}:
                continue
            line = np.empty((_POINTS_OF_LINE, 3))
            line[:, axis] = along
            line[:, others[0]] = shares[first]
            line[:, others[1]] = shares[second]
            lines.append(line)
    return np.asarray(low_mm + np.array(lines) * (high_mm - low_mm))


def _joined(lines: Numbers) -> Numbers:
    """Join lines (n, m, k) into one polyline (n (m + 1), k); a row of NaN lifts the pen between two."""
    pen_up = np.full((len(lines), 1, lines.shape[2]), np.nan)
    return np.concatenate([lines, pen_up], axis=1).reshape(-1, lines.shape[2])
