"""How uncertain the error is over the volume: slices at heights, before and after compensation."""

from __future__ import annotations

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from geoerr.budget import Budget, UncertaintyMap, uncertainty_map
from geoerr.report.figures import style
from geoerr.report.figures.style import Numbers

_HEIGHT_PX = 900
_SLICES = 3
_UNKNOWN = "#BBBBBB"
_BAR_PX = 14
_BOTTOM_PX = 50
_ABOVE_PX = 26
_GAP_SHARE = 0.09


def uncertainty_slices(volume: UncertaintyMap, n_slices: int = _SLICES) -> go.Figure:
    """Draw slices of the volume: the error without compensation, and what is left of it, with how sure that is.

    Parameters
    ----------
    volume
        Of `geoerr.budget.uncertainty_map`.
    n_slices
        How many heights, the lowest and the highest among them.

    Returns
    -------
    plotly.graph_objects.Figure
        Three rows of maps over X and Y, a column a height, one scale of colours a row: the predicted error's length
        before compensation; its standard uncertainty; the length that a compensated part's error stays below with
        95 %. What the data do not determine is grey with crosses.
    """
    heights = np.unique(np.linspace(0, len(volume.z_mm) - 1, min(n_slices, len(volume.z_mm))).round().astype(int))
    rows = (
        ("without compensation: length of the predicted error", volume.error_um, "Viridis"),
        ("how sure that is: standard uncertainty of the prediction", volume.prediction_um, "Cividis"),
        ("after compensation: the error's length stays below (95 %)", volume.part_95_um, "Viridis"),
    )
    figure = make_subplots(
        rows=len(rows),
        cols=len(heights),
        horizontal_spacing=0.06,
        vertical_spacing=_GAP_SHARE,
        shared_xaxes="all",
        shared_yaxes="all",
        subplot_titles=[f"z = {volume.z_mm[height]:g} mm" for _ in rows for height in heights],
    )
    for number, (_, values, colours) in enumerate(rows, start=1):
        _add_row(figure, volume, number, heights, values, colours)
    style.finish(
        figure,
        "Uncertainty over the volume",
        _subtitle(volume),
        _HEIGHT_PX,
        above_plots_px=_ABOVE_PX + 18,
        bottom_px=_BOTTOM_PX,
    )
    for number, (title, *_) in enumerate(rows, start=1):
        top = figure.layout[_axis_name("yaxis", (number - 1) * len(heights) + 1)].domain[1]
        figure.add_annotation(
            text=f"<b>{title}, µm</b>",
            x=0.0,
            y=top,
            yshift=20,
            xref="paper",
            yref="paper",
            xanchor="left",
            yanchor="bottom",
            showarrow=False,
            font={"size": 13},
        )
    figure.update_xaxes(title_text="X, mm", row=len(rows), constrain="domain")
    figure.update_xaxes(showticklabels=True, zeroline=False, range=_ends(volume.x_mm, volume))
    figure.update_yaxes(showticklabels=True, zeroline=False, range=_ends(volume.y_mm, volume))
    figure.update_yaxes(title_text="Y, mm", col=1)
    figure.update_layout(showlegend=False, margin={"r": 80})
    return figure


def budget_slices(budget: Budget, n: int = 11) -> go.Figure:
    """Draw a budget over the volume, on a grid of so many places along each edge."""
    return uncertainty_slices(uncertainty_map(budget, n))


def _add_row(
    figure: go.Figure, volume: UncertaintyMap, number: int, heights: np.ndarray, values: Numbers, colours: str
) -> None:
    known = values[np.isfinite(values)]
    largest = float(known.max()) if known.size else 1.0
    name = "coloraxis" if number == 1 else f"coloraxis{number}"
    for column, height in enumerate(heights, start=1):
        slice_um = values[:, :, height].T
        figure.add_trace(
            go.Heatmap(
                x=volume.x_mm,
                y=volume.y_mm,
                z=slice_um,
                coloraxis=name,
                zsmooth="best" if volume.is_determined.all() else False,
                hovertemplate="(%{x:.0f}, %{y:.0f}) mm: %{z:.2f} µm<extra></extra>",
            ),
            row=number,
            col=column,
        )
        if not np.isfinite(slice_um).all():
            _mark_unknown(figure, volume, number, column, np.isfinite(slice_um))
    place = figure.layout[_axis_name("yaxis", (number - 1) * len(heights) + 1)].domain
    figure.update_layout(
        {
            name: {
                "colorscale": colours,
                "cmin": 0.0,
                "cmax": max(largest, 1e-6),
                "colorbar": {
                    "thickness": _BAR_PX,
                    "len": place[1] - place[0],
                    "y": 0.5 * (place[0] + place[1]),
                    "x": 1.01,
                    "title": {"text": "µm", "side": "top"},
                },
            }
        }
    )


def _mark_unknown(figure: go.Figure, volume: UncertaintyMap, row: int, column: int, is_known: np.ndarray) -> None:
    """Draw crosses where the data determine nothing; a gap alone could be taken for a small number."""
    y, x = np.nonzero(~is_known)
    figure.add_trace(
        go.Scatter(
            x=volume.x_mm[x],
            y=volume.y_mm[y],
            mode="markers",
            marker={"symbol": "x-thin", "size": 6, "line": {"width": 1.2, "color": _UNKNOWN}},
            hovertemplate="(%{x:.0f}, %{y:.0f}) mm: not determined<extra></extra>",
        ),
        row=row,
        col=column,
    )


def _ends(position_mm: Numbers, volume: UncertaintyMap) -> list[float]:
    """Give the ends of an axis: the volume's, or half a cell more where cells and crosses are drawn."""
    room = 0.0 if volume.is_determined.all() or len(position_mm) < 2 else 0.5 * (position_mm[1] - position_mm[0])
    return [float(position_mm[0] - room), float(position_mm[-1] + room)]


def _subtitle(volume: UncertaintyMap) -> str:
    known = np.isfinite(volume.error_um)
    if not known.any():
        return "the data determine the error at no place of the volume"
    before = style.text_um(float(volume.error_um[known].max()))
    after = style.text_um(float(volume.part_95_um[known].max()))
    text = f"largest error without compensation {before}; at its worst place a compensated part stays below {after}"
    share = 100.0 * (1.0 - float(known.mean()))
    return text if known.all() else f"{text}; crosses: not determined, {share:.0f} % of the volume"


def _axis_name(kind: str, number: int) -> str:
    return kind if number == 1 else f"{kind}{number}"
