"""Where a model fails, in pictures: the residual against any variable, in the volume, by region, as a histogram."""

from __future__ import annotations

import math
from collections.abc import Mapping
from html import escape
from typing import get_args

import numpy as np
import plotly.graph_objects as go
import polars as pl
from plotly.subplots import make_subplots

from geoerr.diagnose import Comparison, Component
from geoerr.diagnose.labels import value_label, variable_label
from geoerr.diagnose.regions import region_name
from geoerr.diagnose.trends import trend_of, variables_of
from geoerr.errors import GeoerrError
from geoerr.fit import Fitted
from geoerr.machine import AXES
from geoerr.model.conditions import Conditions
from geoerr.report.figures import style
from geoerr.report.figures.error_field import grid_traces
from geoerr.report.figures.style import Numbers, thinned
from geoerr.report.figures.volume import (
    MOST_POINTS,
    Look,
    explained_strokes,
    places_mm,
    residual_volume,
    volume_of,
)

_ROW_PX = 230
_REGION_PX = 440
_HISTOGRAM_PX = 400
_MOST_BARS = 60
# Height of a histogram that the curve of the noise may take, in heights of its highest bar.
_MOST_NOISE = 2.0
_MOST_TEXTS = 30
_MOST_WHOLE = 6
_COLORS = {"x": style.BLUE, "y": style.ORANGE, "z": style.GREEN, "radius": style.PURPLE, "length": style.SKY}


def residual_against(
    comparison: Comparison,
    variable: str,
    color_by: str | None = None,
    *,
    explained_um: Numbers | None = None,
    most_points: int = MOST_POINTS,
    is_live: bool = False,
    has_webgl: bool = True,
) -> go.Figure:
    """Draw the residual over one variable, a row for each component, with the mean of its bins.

    Parameters
    ----------
    comparison
        What is drawn.
    variable
        A column of numbers, or `d_x`, `s_x`, `v_x`, `row`: as `comparison.trends` names them.
    color_by
        Another one, as colour: a loop that one variable leaves open closes over the right one. Or a column of texts.
    explained_um : (n, 3)
        What an effect would explain of the residual, drawn over it.
    most_points
        Of more rows every k-th is drawn; means are of all.
    is_live
        For a page that answers: points are drawn by the graphics card and know their rows, and every component has
        three traces, the last for `explained_um` even where that is None.
    has_webgl
        Whether the page's browser lets pages use the graphics card: without it points are shapes, slower and alike.

    Raises
    ------
    GeoerrError
        for a variable that the data do not have, or that never changes, naming those that there are.
    """
    fitted = comparison.points
    values = _numbers_of(fitted, variable, variables_of(fitted))
    colors, color_bar = (None, {}) if color_by is None else _colors_of(fitted, color_by)
    components = [one for one in comparison.components if is_live or (one.is_known & np.isfinite(values)).any()]
    points = go.Scattergl if is_live and has_webgl else go.Scatter
    place = value_label(escape(variable), "%{x:.6g}")
    figure = make_subplots(rows=len(components), cols=1, shared_xaxes=True, vertical_spacing=0.05)
    for row, component in enumerate(components, start=1):
        shown = thinned(component.is_known & np.isfinite(values), most_points)
        marker = {"size": 4, "opacity": 0.6, "color": _COLORS[component.name]}
        if colors is not None:
            marker = {"size": 4, "opacity": 0.8, "color": colors[shown], "coloraxis": "coloraxis"}
        figure.add_trace(
            points(
                x=values[shown],
                y=component.residual_um[shown],
                mode="markers",
                marker=marker,
                customdata=shown if is_live else None,
                name="one row",
                showlegend=row == 1,
                hovertemplate=f"{_in_words(component)} %{{y:+.1f}} µm, at {place}<extra></extra>",
            ),
            row=row,
            col=1,
        )
        bins = trend_of(fitted.sightings, variable, values, component).bins
        figure.add_trace(
            go.Scatter(
                x=[0.5 * (one.low + one.high) for one in bins],
                y=[one.mean_um for one in bins],
                error_y={"type": "data", "array": [style.COVERAGE_95 * one.std_error_um for one in bins]},
                mode="lines+markers",
                line={"color": style.BLACK, "width": 1.6},
                marker={"size": 6},
                name="mean, 95 %",
                showlegend=row == 1,
            ),
            row=row,
            col=1,
        )
        if is_live or explained_um is not None:
            moved_um = (
                np.full(len(shown), np.nan) if explained_um is None else of_component(explained_um, component)[shown]
            )
            figure.add_trace(
                points(
                    x=values[shown],
                    y=moved_um,
                    mode="markers",
                    marker={"size": 4, "color": style.VERMILLION},
                    hoverinfo="skip",
                    name="explained",
                    showlegend=row == 1 and explained_um is not None,
                ),
                row=row,
                col=1,
            )
        figure.update_yaxes(title_text=f"{_in_words(component)}, µm", row=row, col=1)
    figure.update_xaxes(title_text=_label(variable), row=len(components), col=1)
    figure.update_xaxes(tickvals=_few_whole(values))
    if color_by is not None:
        bar = {"title": {"text": _label(color_by), "side": "right"}, "thickness": 14, **color_bar}
        figure.update_layout(coloraxis={"colorscale": "Viridis", "colorbar": bar})
    coloured = "" if color_by is None else f"; colour: {_label(color_by)}"
    return style.finish(
        figure,
        f"Residual over {_label(variable).partition(',')[0]}",
        f"measured minus predicted, base axes{coloured}",
        max(_ROW_PX * len(components) + 110, 380),
        legend=True,
    )


def residual_over(
    comparison: Comparison,
    over: str | None = None,
    color_by: str | None = None,
    explained_um: Numbers | None = None,
) -> go.Figure:
    """Draw the residual over a variable, or over the one that it follows most; over it what an effect would explain.

    Raises
    ------
    GeoerrError
        for a variable that the data do not have, naming those that there are; where nothing varies; for an effect's
        displacements (n, 3) that are not of these rows.
    """
    _refuse_other_rows(comparison, explained_um)
    if over is None and not comparison.trends:
        raise GeoerrError("nothing varies in these data\nhint: name what to draw the residual over")
    return residual_against(comparison, over or comparison.trends[0].variable, color_by, explained_um=explained_um)


def residual_in_volume(
    comparison: Comparison,
    look: Look = "length",
    exaggeration: float = 1.0,
    explained_um: Numbers | None = None,
    shape_at: Conditions | None = None,
) -> go.Figure:
    """Draw every residual in the volume: as a stroke coloured by length or direction, or as a dot (`magnitude`).

    Parameters
    ----------
    explained_um : (n, 3)
        What an effect would explain, drawn as strokes over it.
    shape_at
        Conditions at which the machine's shape is drawn, a grid with its errors magnified; {} of a model that needs
        none. None draws none.
    """
    if look not in get_args(Look):
        known = ", ".join((*get_args(Look), "region"))
        raise GeoerrError(f"{look!r} is no way to look at residuals\nhint: there are {known}")
    _refuse_other_rows(comparison, explained_um)
    volume = volume_of(comparison, exaggeration=exaggeration)
    figure = residual_volume(volume, look)
    if explained_um is not None:
        figure.add_trace(explained_strokes(volume, places_mm(comparison), explained_um))
    if shape_at is not None:
        figure.add_traces(grid_traces(comparison.model, exaggeration=exaggeration, at=shape_at)[0])
    return figure


def _refuse_other_rows(comparison: Comparison, explained_um: Numbers | None) -> None:
    n = len(comparison.points.sightings)
    if explained_um is not None and np.shape(explained_um) != (n, 3):
        raise GeoerrError(
            f"what would be explained has the shape {np.shape(explained_um)}, and {n} rows were compared\n"
            "hint: take `explained_um` of a finding in a diagnosis of the same model and data"
        )


def residual_vectors(comparison: Comparison) -> go.Figure:
    """Draw every residual as a stroke at its commanded position, coloured by its length."""
    return residual_volume(volume_of(comparison), "length")


def residual_directions(comparison: Comparison) -> go.Figure:
    """Draw every residual as a stroke coloured by its direction.

    Clusters of one colour are what a model lacks; noise has every colour everywhere (mrcal's view of directions).
    """
    return residual_volume(volume_of(comparison), "direction")


def residual_by_region(comparison: Comparison) -> go.Figure:
    """Draw mean ± standard deviation of each component by region, and how many rows each holds."""
    regions = comparison.regions
    names = [region_name(region).replace(", ", "<br>") for region in regions]
    figure = make_subplots(rows=2, cols=1, shared_xaxes=True, vertical_spacing=0.06, row_heights=[0.7, 0.3])
    for component in comparison.components:
        figure.add_trace(
            go.Scatter(
                x=names,
                y=[region.mean_um.get(component.name) for region in regions],
                error_y={"type": "data", "array": [region.std_um.get(component.name) for region in regions]},
                mode="markers",
                marker={"size": 8, "color": _COLORS[component.name]},
                name=_in_words(component),
            ),
            row=1,
            col=1,
        )
    counts = [region.n for region in regions]
    figure.add_trace(
        go.Bar(x=names, y=counts, marker={"color": style.SKY}, name="rows", showlegend=False), row=2, col=1
    )
    figure.update_yaxes(title_text="mean ± std, µm", row=1, col=1)
    figure.update_yaxes(title_text="rows", rangemode="tozero", row=2, col=1)
    figure.update_xaxes(tickfont={"size": 9}, row=2, col=1)
    figure.update_layout(scattermode="group")
    return style.finish(
        figure,
        "Residual by region",
        "a mean that is not 0 is an error that the model does not have; few rows: hardly looked there (mm)",
        _REGION_PX,
        bottom_px=90,
        legend=True,
    )


def residual_histogram(comparison: Comparison) -> go.Figure:
    """Draw the histogram of each component beside what noise of the repeats' size (or as stated) would give."""
    fitted = comparison.points
    components = comparison.components
    figure = make_subplots(rows=1, cols=len(components), horizontal_spacing=0.07)
    variance_mm2 = fitted.repeats.variance_mm2
    has_noise = False
    for column, component in enumerate(components, start=1):
        known = component.residual_um[component.is_known]
        low, high = float(known.min()), float(known.max())
        n_bars = int(np.clip(np.sqrt(len(known)), 8, _MOST_BARS))
        edges = np.linspace(low, high, n_bars + 1) if high > low else np.array([low - 0.5, low + 0.5])
        counts, _ = np.histogram(known, edges)
        width = float(edges[1] - edges[0])
        figure.add_trace(
            go.Bar(
                x=0.5 * (edges[1:] + edges[:-1]),
                y=counts,
                width=width,
                marker={"color": style.transparent(_COLORS[component.name], 0.6)},
                name="residual",
                showlegend=column == 1,
            ),
            row=1,
            col=column,
        )
        # Repeats of radii and lengths stand in the first component: beside points it is theirs.
        is_own = component.name in AXES or len(components) == 1
        index = AXES.index(component.name) if component.name in AXES else 0
        sigma_um = float(np.sqrt(variance_mm2[index])) * style.UM_PER_MM if is_own else math.nan
        highest = float(counts.max())
        if np.isfinite(sigma_um) and sigma_um > 0.0:
            reach = max(abs(low), abs(high), 3.0 * sigma_um)
            at = np.union1d(np.linspace(-reach, reach, 101), sigma_um * np.linspace(-4.0, 4.0, 101))
            density = np.exp(-0.5 * (at / sigma_um) ** 2) / (sigma_um * np.sqrt(2.0 * np.pi))
            figure.add_trace(
                go.Scatter(
                    x=at,
                    y=density * width * len(known),
                    mode="lines",
                    line={"color": style.BLACK, "width": 1.6},
                    name="noise floor (repeats)",
                    showlegend=not has_noise,
                ),
                row=1,
                col=column,
            )
            has_noise = True
            # A noise far below the residual is a needle: it leaves the plot at its top, and bars stay to be seen.
            highest = max(highest, min(float(density.max()) * width * len(known), _MOST_NOISE * highest))
        figure.update_yaxes(range=[0.0, 1.05 * highest], row=1, col=column)
        figure.update_xaxes(title_text=f"{_in_words(component)}, µm", row=1, col=column)
    figure.update_yaxes(title_text="rows", row=1, col=1)
    floor = fitted.repeats.floor_um
    said = (
        "nothing was measured twice under the same conditions: no noise floor"
        if floor is None
        else f"noise floor {style.text_um(floor)}"
    )
    return style.finish(
        figure,
        "Histogram of the residual",
        f"rms {style.text_um(comparison.rmse_um)}; {said}",
        _HISTOGRAM_PX,
        legend=True,
    )


def _in_words(component: Component) -> str:
    return f"along {component.name}" if component.name in AXES else component.name


def of_component(moved_um: Numbers, component: Component) -> Numbers:
    """Give one component (n,) of displacements (n, 3); a radius stands in the first."""
    return moved_um[:, AXES.index(component.name) if component.name in AXES else 0]


def _numbers_of(fitted: Fitted, name: str, variables: Mapping[str, Numbers]) -> Numbers:
    """Give a variable (n,), or any other column of numbers that the data have.

    Raises
    ------
    GeoerrError
        where there is none of that name, or it never changes.
    """
    if name in variables:
        return variables[name]
    values = fitted.sightings.numbers(name)
    known = values[np.isfinite(values) & fitted.solved.used]
    if not known.size or float(np.ptp(known)) == 0.0:
        texts = [column for column in _text_columns(fitted) if column not in variables]
        colours = f"; for colour also {', '.join(texts)}" if texts else ""
        raise GeoerrError(
            f"the residual cannot be drawn over {name!r}: no such variable of numbers, or it never changes\n"
            f"hint: there are {', '.join(variables)}{colours}"
        )
    return values


def _few_whole(values: Numbers) -> list[float] | None:
    """Give the values where they are few whole numbers: a direction has no half, and a repetition neither."""
    found = np.unique(values[np.isfinite(values)])
    is_few = 0 < len(found) <= _MOST_WHOLE and bool((found == np.round(found)).all())
    return found.tolist() if is_few else None


def _colors_of(fitted: Fitted, name: str) -> tuple[Numbers, dict[str, object]]:
    """Give the colour (n,) of each row, and what its bar shows: of texts each by name, in their order in the data."""
    if name not in _text_columns(fitted):
        values = _numbers_of(fitted, name, variables_of(fitted))
        return values, {"tickvals": _few_whole(values)}
    texts = fitted.sightings.texts(name)
    places = {text: place for place, text in enumerate(dict.fromkeys(texts))}
    if len(places) > _MOST_TEXTS:
        raise GeoerrError(
            f"{name!r} has {len(places)} different texts: nobody tells more than {_MOST_TEXTS} colours apart\n"
            "hint: colour by a column with fewer"
        )
    shown = [escape(text) if text else "(empty)" for text in places]
    ticks: dict[str, object] = {"tickvals": list(places.values()), "ticktext": shown}
    return np.array([places[text] for text in texts], dtype=np.float64), ticks


def _text_columns(fitted: Fitted) -> tuple[str, ...]:
    """Name the columns of texts that have more than one."""
    table = fitted.sightings.table
    return tuple(name for name in table.columns if table[name].dtype == pl.String and table[name].n_unique() > 1)


def _label(name: str) -> str:
    """Name a variable with its unit; what a file calls its columns is no mark-up."""
    return variable_label(escape(name))
