"""Error along a program's path, before and after compensation."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from geoerr.report.figures import style
from geoerr.report.figures.style import Numbers

_HEIGHT_PX = 400
# More points than pixels draw nothing more; each drawn point is then the largest error of its stretch.
_MOST_POINTS = 2000
_NAMES = ("before", "after")


def path_error(
    distance_mm: npt.ArrayLike,
    before_mm: npt.ArrayLike,
    after_mm: npt.ArrayLike,
    tolerance_mm: float | None = None,
) -> go.Figure:
    """Draw how far the tool is from the programmed path, against the distance travelled.

    Parameters
    ----------
    distance_mm : (n,)
        Travelled along the programmed path.
    before_mm, after_mm : (n,)
        Distance from the programmed path without and with compensation.
    tolerance_mm
        Drawn as a line.
    """
    distance = np.asarray(distance_mm, dtype=np.float64)
    figure = go.Figure()
    for name, color, error in (
        ("before", style.BEFORE, np.asarray(before_mm, dtype=np.float64)),
        ("after", style.AFTER, np.asarray(after_mm, dtype=np.float64)),
    ):
        largest = float(error.max(initial=0.0)) * style.UM_PER_MM
        at, drawn = _largest_of_stretches(distance, error * style.UM_PER_MM)
        figure.add_trace(
            go.Scatter(
                x=at,
                y=drawn,
                mode="lines",
                line={"color": color, "width": 1.4},
                name=f"{name}, largest {style.text_um(largest)}",
                hovertemplate="%{x:.1f} mm: %{y:.3g} µm<extra>" + name + "</extra>",
            )
        )
    if tolerance_mm is not None and distance.size:
        figure.add_trace(
            go.Scatter(
                x=[float(distance[0]), float(distance[-1])],
                y=[tolerance_mm * style.UM_PER_MM] * 2,
                mode="lines",
                line={"color": style.INK, "width": 1, "dash": "dot"},
                name=f"tolerance {style.text_um(tolerance_mm * style.UM_PER_MM)}",
                hoverinfo="skip",
            )
        )
    # Before and after usually differ by a factor of a hundred: only a logarithmic axis shows both.
    figure.update_yaxes(title_text="error, µm", type="log", dtick=1)
    figure.update_xaxes(title_text="distance travelled, mm")
    return style.finish(
        figure,
        "Error along the path",
        "distance of the tool from the programmed path, by the model",
        _HEIGHT_PX,
        above_plots_px=6,
        bottom_px=56,
        legend=True,
    )


def path_places(places_mm: npt.ArrayLike, before_mm: npt.ArrayLike, after_mm: npt.ArrayLike) -> go.Figure:
    """Draw the programmed path from above, twice: coloured by how far the tool is from it, before and after.

    Parameters
    ----------
    places_mm : (n, 3)
        Where the program means the tool to be.
    before_mm, after_mm : (n,)
        Distance from the programmed path there, without and with compensation.
    """
    places = np.asarray(places_mm, dtype=np.float64).reshape(-1, 3)
    starts = _starts_of_stretches(len(places))
    figure = make_subplots(rows=1, cols=2, shared_yaxes=True, horizontal_spacing=0.03, subplot_titles=_NAMES)
    for column, error in enumerate((before_mm, after_mm), start=1):
        error_um = np.asarray(error, dtype=np.float64) * style.UM_PER_MM
        largest = np.maximum.reduceat(error_um, starts) if starts.size else error_um
        figure.add_trace(
            go.Scatter(
                x=places[starts, 0],
                y=places[starts, 1],
                customdata=np.column_stack([places[starts, 2], largest]),
                mode="markers",
                marker={"size": 4, "color": largest, "coloraxis": "coloraxis"},
                name=_NAMES[column - 1],
                showlegend=False,
                hovertemplate="(%{x:.1f}, %{y:.1f}, %{customdata[0]:.1f}) mm: %{customdata[1]:.3g} µm<extra></extra>",
            ),
            row=1,
            col=column,
        )
    figure.update_xaxes(title_text="X, mm", matches="x")
    figure.update_yaxes(matches="y", scaleanchor="x", scaleratio=1.0)
    figure.update_yaxes(title_text="Y, mm", row=1, col=1)
    largest_um = max(float(np.max(one, initial=0.0)) for one in (before_mm, after_mm)) * style.UM_PER_MM
    bar = {"title": {"text": "µm"}, "thickness": 14}
    colors = {"colorscale": "Viridis", "cmin": 0.0, "cmax": largest_um or 1.0, "colorbar": bar}
    figure.update_layout(coloraxis=colors)
    figure.update_annotations(font_size=12)
    return style.finish(
        figure,
        "Where the path is off",
        "from above; colour: distance of the tool from the programmed path, by the model",
        _HEIGHT_PX,
        above_plots_px=24,
        bottom_px=56,
    )


def _starts_of_stretches(n_samples: int) -> npt.NDArray[np.int64]:
    return np.unique(np.linspace(0, n_samples, min(n_samples, _MOST_POINTS), endpoint=False).astype(np.int64))


def _largest_of_stretches(distance_mm: Numbers, error_um: Numbers) -> tuple[Numbers, Numbers]:
    """Keep the largest error of each of at most 2000 stretches of samples; a zero has no place on a log axis."""
    starts = _starts_of_stretches(len(error_um))
    if not starts.size:
        return distance_mm, error_um
    largest = np.maximum.reduceat(error_um, starts)
    return distance_mm[starts], np.where(largest > 0.0, largest, np.nan)
