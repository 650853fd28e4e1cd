"""The pictures of the middle: those of the reports, fitted into their panels, and what a mark changes in them."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, get_args

import numpy as np
import numpy.typing as npt
import plotly.graph_objects as go
from dash import Patch

from geoerr.diagnose import Comparison, Component
from geoerr.errors import InputFileError
from geoerr.machine import AXES
from geoerr.model import Model
from geoerr.report.figures import circle, residual_against, residual_of_regions, style, value_label
from geoerr.report.figures.error_field import field_difference, grid_traces
from geoerr.report.figures.regions import magnification_of_means
from geoerr.report.figures.residuals import of_component
from geoerr.report.figures.style import Numbers
from geoerr.report.figures.volume import (
    DIRECTIONS,
    Look,
    Volume,
    explained_strokes,
    marked_strokes,
    places_mm,
    residual_volume,
    volume_of,
)
from geoerr.workbench.circles import CircleRun
from geoerr.workbench.parts import um
from geoerr.workbench.program import conditions_of
from geoerr.workbench.room import ranges_mm
from geoerr.workbench.session import Rows, Seen, Session
from geoerr.workbench.typed import typed_number
from geoerr.workbench.view import CIRCLE, CORNER, DIFFERENCE, REGION, View

# For every picture of the page. Plotly offers to upload a chart to its makers' cloud: not from here.
CONFIG = {"displaylogo": False, "responsive": True, "showSendToCloud": False}
# Over a picture as narrow as half a panel they would hide its title; a box zooms in, two clicks zoom out.
WITHOUT_BUTTONS = {**CONFIG, "displayModeBar": False}
# What a browser without a graphics card turns and marks without a pause.
MOST_POINTS = 1_500
MOST_MARKED = 500
# Places of traces in the picture of the volume, and in the ball-bar plot.
_MARKED, _EXPLAINED = 2, 3
_MEASURED = 1
# Traces of each component in the picture of the residual: points, means, what would be explained.
_PER_COMPONENT = 3
# Vermillion that points show through.
_BOX_FILL = "rgba(213, 94, 0, 0.08)"
# Far enough away that the axes' names are inside a narrow panel, as far as the volume is a cube.
_EYES = {
    "above": {"x": 0.0, "y": 0.0, "z": 3.2},
    "front": {"x": 0.0, "y": -2.7, "z": 0.0},
    "side": {"x": 2.7, "y": 0.0, "z": 0.0},
    CORNER: {"x": 1.6, "y": -1.88, "z": 1.1},
}
# What is looked at: names of axes stand below the volume and at its left.
_LOOKED_AT = {CORNER: {"x": -0.05, "y": -0.04, "z": -0.18}}
_MIDDLE = {"x": 0.0, "y": 0.0, "z": 0.0}
# From a corner a long machine is seen from farther away: by this power of its diagonal to that of a cube as large.
_FARTHER = 1.2
# Beside a narrow panel's volume.
_COLORBAR = {"thickness": 10, "len": 0.8, "xpad": 4, "tickfont": {"size": 10}}
# The axis that is looked along.
_ALONG = {"above": "z", "front": "y", "side": "x"}
# Letters of a line that a narrow panel has room for.
_LINE = 54
_MOTION = {"d": 1.0, "s": 100.0, "v": 0.0}
_FEED_MM_MIN = 1000.0

_NO_WEBGL = (
    "This browser draws no 3-D pictures: it has no WebGL. Everything else works, with marks in the picture at the "
    "right and in the table of “regions”. Hardware acceleration in the browser's settings, or another browser, "
    "brings them."
)
# Looks that draw every row.
_DRAWN: dict[str, Look] = {look: look for look in get_args(Look)}


@dataclass(frozen=True, eq=False)
class Picture:
    """A figure, and the line under it."""

    figure: go.Figure
    caption: str


def volume_picture(session: Session, seen: Seen, explained_um: Numbers | None) -> Picture:
    """Draw the volume: what the view asks for, marked rows, what would be explained, the grid."""
    view = session.view
    if view.look == CIRCLE:
        return _circle_picture(session, seen, explained_um)
    if not session.has_webgl:
        return Picture(nothing_drawn(_NO_WEBGL), "")
    volume = _volume(session, seen)
    drawn = {REGION: _means, DIFFERENCE: _difference}.get(view.look, _residuals)(session, seen, volume)
    figure, caption = drawn.figure, drawn.caption
    if figure.layout.annotations:
        # It says why nothing is drawn.
        return drawn
    figure.add_traces(
        [
            _marked(seen.comparison, session.selected, volume, view.look),
            explained_strokes(volume, places_mm(seen.comparison), explained_um),
        ]
    )
    if view.shows_shape and view.look in _DRAWN:
        caption += _add_shape(figure, session)
    ticks = {"nticks": 5, "tickfont": {"size": 10}, "title": {"font": {"size": 12}}}
    figure.update_scenes(xaxis=ticks, yaxis=ticks, zaxis=ticks, dragmode="orbit", **_scene_of(view, figure))
    for axis, ends in ranges_mm(figure, seen, volume.magnification if view.look in _DRAWN else 0.0).items():
        figure.update_scenes({f"{axis}axis": {"range": ends}})
    for part in (one for trace in figure.data for one in (trace.line, trace.marker) if one.showscale):
        part.colorbar.update(_COLORBAR)
    return Picture(in_panel(figure, "volume", margin={"l": 0, "r": 0, "t": 0, "b": 0}), caption)


def _residuals(session: Session, seen: Seen, volume: Volume) -> Picture:
    look = _DRAWN[session.view.look]
    caption = (
        f"Measured minus predicted at {len(volume.rows):,} of {len(seen.comparison.points.sightings):,} rows, "
        f"drawn {volume.magnification:,.0f} times as long."
        if look != "magnitude"
        else f"Dot size and colour: how far measured and predicted are apart, {len(volume.rows):,} rows."
    )
    if look == "direction":
        caption += f" Colour: where it points ({DIRECTIONS}); clusters are no chance."
    return Picture(residual_volume(volume, look), caption)


def _means(session: Session, seen: Seen, volume: Volume) -> Picture:
    figure = residual_of_regions(seen.comparison, exaggeration=session.view.exaggeration)
    return Picture(
        figure,
        f"Mean residual of each region, drawn {volume.magnification:,.0f} times as long; cross: ± spread; colour: "
        "rms. A mean that is not 0 is an error that the model lacks. Click one to mark its rows.",
    )


def _difference(session: Session, _: Seen, __: Volume) -> Picture:
    reference = session.steps[session.reference]
    if session.reference == session.current:
        return Picture(nothing_drawn("this model is the reference ★: look at another one, or choose another ★"), "")
    at = _conditions(session, session.model, reference.model)
    if at is None:
        return Picture(nothing_drawn("the models need conditions: state them under “Correct a program”"), "")
    figure, magnification = field_difference(
        session.model, reference.model, exaggeration=session.view.exaggeration, at=at
    )
    return Picture(
        figure,
        f"What this model says beyond ★ {session.reference + 1}. {reference.name}: coloured grid, differences "
        f"{magnification:,.0f} times as large; grey grid: no difference.{_stated(session)}",
    )


def _circle_picture(session: Session, seen: Seen, explained_um: Numbers | None) -> Picture:
    """Draw the ball-bar plot of the chosen run: measured, by the model, and with what would be explained."""
    run = _chosen_run(session, seen)
    if run is None:
        return Picture(nothing_drawn("no run of these circular tests lies on a circle in a plane of the machine"), "")
    figure = circle(run.predicted, measured=run.measured, name_before="model")
    theta, radius_um = _with_cause(run, explained_um)
    figure.add_scatterpolar(
        theta=theta,
        r=radius_um,
        mode="lines",
        line={"color": style.ORANGE, "width": 3},
        name="with cause",
        hoverinfo="skip",
        showlegend=explained_um is not None,
    )
    for trace in figure.data:
        # A narrow panel has its legend in one row: how large the deviations are stands below.
        trace.name = trace.name and trace.name.partition(",")[0]
    measured = figure.data[_MEASURED]
    measured.update(selectedpoints=_selected_of_run(session, run), unselected={"marker": {"opacity": 0.2}})
    rings = figure.layout.annotations[0].text.rpartition(": ")[2]
    figure.layout.annotations = []
    in_panel(figure, f"circle {run.name}", margin={"l": 34, "r": 34, "t": 54, "b": 22})
    figure.update_layout(legend={"yref": "container", "y": 1.0, "yanchor": "top", "xref": "container", "x": 0.0})
    commanded = run.measured.circle
    deviations = [style.UM_PER_MM * one.circular_deviation_mm for one in (run.measured, run.predicted)]
    centre = ", ".join(f"{value:.4g}" for value in commanded.center_mm)
    caption = (
        f"Deviation from the least-squares circle, {rings}; circular deviation G (ISO 230-4): measured "
        f"{um(deviations[0])}, model {um(deviations[1])}. {commanded.plane} plane, radius "
        f"{commanded.radius_mm:.4g} mm about ({centre}) mm."
    )
    return Picture(figure, caption)


def residual_picture(session: Session, seen: Seen, explained_um: Numbers | None) -> Picture:
    """Draw the residual over the chosen variable."""
    view = session.view
    if not view.variable:
        return Picture(nothing_drawn("nothing varies in these data"), "")
    figure = residual_against(
        seen.comparison,
        view.variable,
        view.color_by or None,
        explained_um=explained_um,
        most_points=MOST_POINTS,
        is_live=True,
        has_webgl=session.has_webgl,
    )
    for place, rows in enumerate(_selected_points(seen, session.selected, view.variable)):
        figure.data[_PER_COMPONENT * place].selectedpoints = rows
    for trace in figure.data:
        trace.update(unselected={"marker": {"opacity": 0.12 if trace.customdata is not None else 1.0}})
    figure.update_layout(dragmode="select", shapes=_box_shapes(session))
    for axis in figure.select_yaxes():
        axis.title.text = axis.title.text.removeprefix("along ")
    # The first part tells the axes apart from those of another choice: zoom is kept while they are the same.
    panel = in_panel(figure, f"residual {view.variable}", margin={"l": 62, "r": 10, "t": 26, "b": 44})
    # From the panel's edge on: the buttons that a pointer brings up stand at the right. Of one that belongs to the
    # panel sideways only Plotly leaves all the width to its left to it, and none to the axis's title.
    panel.update_layout(legend={"xref": "container", "x": 0.0, "yref": "container", "y": 1.0, "yanchor": "top"})
    if CIRCLE in seen.looks and len(seen.looks) == 1:
        return Picture(
            panel, "Measured minus predicted radius. Drag a box over points to mark them in the circle too."
        )
    where = " in the volume too" if session.has_webgl else ""
    return Picture(panel, f"Measured minus predicted, along x, y and z. Drag a box over points to mark them{where}.")


def marks_in_volume(session: Session, seen: Seen) -> Patch:
    """Give what a new mark changes in the volume, or the circle, and nothing else of it."""
    run = _chosen_run(session, seen)
    changed = Patch()
    if session.view.look != CIRCLE:
        trace = _marked(seen.comparison, session.selected, _volume(session, seen), session.view.look)
        for axis in "xyz":
            changed["data"][_MARKED][axis] = _plain(trace[axis])
    elif run is not None:
        changed["data"][_MEASURED]["selectedpoints"] = _selected_of_run(session, run)
    return changed


def turned_volume(session: Session) -> Patch | None:
    """Give what another place to look from changes in the volume; None where none is drawn."""
    view = session.view
    if session.seen is None or view.look == CIRCLE:
        return None
    changed, drawn = Patch(), volume_picture(session, session.seen, None).figure
    for name, value in _scene_of(view, drawn).items():
        place = changed["layout"]["scene"]
        *above, last = name.split("_")
        for part in above:
            place = place[part]
        place[last] = value
    return changed


def marks_in_residual(session: Session, seen: Seen) -> Patch:
    """Give what a new mark changes in the residual's picture, and nothing else of it."""
    changed = Patch()
    for place, rows in enumerate(_selected_points(seen, session.selected, session.view.variable)):
        changed["data"][_PER_COMPONENT * place]["selectedpoints"] = None if rows is None else rows.tolist()
    changed["layout"]["shapes"] = _box_shapes(session)
    return changed


def explanation(session: Session, seen: Seen, explained_um: Numbers | None) -> tuple[Patch, Patch]:
    """Give what a candidate that is pointed at changes in the two pictures."""
    in_volume, in_residual = Patch(), Patch()
    run = _chosen_run(session, seen)
    if session.view.look != CIRCLE:
        trace = explained_strokes(_volume(session, seen), places_mm(seen.comparison), explained_um)
        for axis in "xyz":
            in_volume["data"][_EXPLAINED][axis] = _plain(trace[axis])
    elif run is not None:
        theta, radius_um = _with_cause(run, explained_um)
        in_volume["data"][_EXPLAINED]["theta"] = _plain(theta)
        in_volume["data"][_EXPLAINED]["r"] = _plain(radius_um)
        in_volume["data"][_EXPLAINED]["showlegend"] = explained_um is not None
    for place, (component, rows) in enumerate(_drawn_points(seen, session.view.variable)):
        moved = np.full(len(rows), np.nan) if explained_um is None else of_component(explained_um, component)[rows]
        in_residual["data"][_PER_COMPONENT * place + 2]["y"] = _plain(moved)
        in_residual["data"][_PER_COMPONENT * place + 2]["showlegend"] = place == 0 and explained_um is not None
    return in_volume, in_residual


def rows_in_box(seen: Seen, variable: str, box: Mapping[str, Sequence[float]]) -> Rows:
    """Tell which rows (n,) lie in a box that was drawn over the residual: all of them, drawn or not."""
    inside = np.ones(len(seen.comparison.points.sightings), dtype=bool)
    for name, ends in box.items():
        low, high = min(ends), max(ends)
        if name.startswith("x"):
            values = seen.variables[variable]
        else:
            values = seen.comparison.components[int(name[1:] or 1) - 1].residual_um
        with np.errstate(invalid="ignore"):
            inside &= (values >= low) & (values <= high)
    return np.asarray(inside & seen.comparison.points.solved.used)


def rows_between(seen: Seen, variable: str, low: str | None, high: str | None) -> Rows | None:
    """Tell which rows (n,) lie between two limits as typed: those of a box as high as the picture.

    An empty field is no limit; None where both are empty.

    Raises
    ------
    InputFileError
        for what is no number.
    """
    ends = (typed_number("from", low), typed_number("to", high))
    if ends == (None, None):
        return None
    return rows_in_box(
        seen, variable, {"x": [-np.inf if ends[0] is None else ends[0], np.inf if ends[1] is None else ends[1]]}
    )


def span_of(seen: Seen, variable: str) -> tuple[float, float] | None:
    """Give the least and the largest value of a variable; None where it has none."""
    values = seen.variables.get(variable, np.zeros(0))
    known = values[np.isfinite(values)]
    return (float(known.min()), float(known.max())) if known.size else None


def rows_of_pass(seen: Seen, row: int) -> Rows:
    """Tell which rows (n,) belong to the same pass as one."""
    sightings = seen.comparison.points.sightings
    return np.asarray(sightings.pass_number == sightings.pass_number[row])


def in_panel(figure: go.Figure, revision: str, *, margin: dict[str, int]) -> go.Figure:
    """Take heading and size from a figure: the panel has its own. Zoom and turn stay while `revision` does."""
    figure.update_layout(
        title={"text": "", "subtitle": {"text": ""}}, height=None, autosize=True, margin=margin, uirevision=revision
    )
    figure.update_layout(legend={"y": 1.0, "yanchor": "bottom", "x": 0.0, "font": {"size": 11}})
    figure.update_yaxes(title={"font": {"size": 11}})
    figure.update_xaxes(title={"font": {"size": 12}})
    return figure


def _volume(session: Session, seen: Seen) -> Volume:
    view = session.view
    volume = volume_of(seen.comparison, exaggeration=view.exaggeration, most_points=MOST_POINTS)
    if view.look != REGION:
        return volume
    # What would be explained is drawn as long as the means are.
    return replace(volume, magnification=view.exaggeration * magnification_of_means(seen.comparison))


def _scene_of(view: View, drawn: go.Figure) -> dict[str, Any]:
    """Give what of the volume depends on where it is looked at from; an axis that is looked along is a point."""
    along = _ALONG.get(view.stand)
    farther = 1.0 if along is not None else _length_to_a_cube(drawn) ** _FARTHER
    # Plotly never again names an axis that was invisible once.
    hidden = {"title_text": "", "showticklabels": False, "showgrid": False, "showline": False, "zeroline": False}
    shown = {"showticklabels": True, "showgrid": True, "showline": True, "zeroline": True}
    axes = {axis: hidden if axis == along else {**shown, "title_text": f"{axis.upper()}, mm"} for axis in AXES}
    return {
        "camera_eye": {name: farther * value for name, value in _EYES.get(view.stand, _EYES[CORNER]).items()},
        "camera_center": _LOOKED_AT.get(view.stand, _MIDDLE),
        "camera_up": {"x": 0.0, "y": 1.0, "z": 0.0} if along == "z" else {"x": 0.0, "y": 0.0, "z": 1.0},
        "camera_projection_type": "perspective" if along is None else "orthographic",
        **{f"{axis}axis_{name}": value for axis, how in axes.items() for name, value in how.items()},
        # New with every wish: until then the picture stays as a person turned it.
        "uirevision": f"turned {view.turns}",
    }


def _length_to_a_cube(drawn: go.Figure) -> float:
    """Give the diagonal of what is drawn to that of a cube of the same volume; 1 where it is drawn as a cube."""
    traces = [trace for trace in drawn.data if trace.type == "scatter3d"]
    if drawn.layout.scene.aspectmode == "cube" or not traces:
        return 1.0
    by_axis = [np.concatenate([np.asarray(trace[axis], dtype=np.float64) for trace in traces]) for axis in AXES]
    span_mm = np.array([np.nanmax(one) - np.nanmin(one) if np.isfinite(one).any() else 0.0 for one in by_axis])
    if not span_mm.all():
        return 1.0
    return float(np.linalg.norm(span_mm) / (np.sqrt(3.0) * np.cbrt(span_mm.prod())))


def _chosen_run(session: Session, seen: Seen) -> CircleRun | None:
    return next((one for one in seen.circles if one.name == session.view.run), None)


def _selected_of_run(session: Session, run: CircleRun) -> list[int] | None:
    """Give the places of marked rows among the points of a run; None where nothing is marked."""
    return None if session.selected is None else np.flatnonzero(session.selected[run.rows]).tolist()


def _with_cause(run: CircleRun, explained_um: Numbers | None) -> tuple[Numbers, Numbers]:
    """Give angle (degrees) and radial deviation of the model's circle with a cause; of its rows that are known."""
    if explained_um is None:
        return np.zeros(0), np.zeros(0)
    moved_um = explained_um[run.rows, 0]
    known = np.isfinite(moved_um)
    radius_um = run.predicted.radial_deviation_mm * style.UM_PER_MM + moved_um
    return np.rad2deg(run.predicted.angle_rad[known]), radius_um[known]


def _marked(comparison: Comparison, selected: Rows | None, volume: Volume, look: str) -> go.Scatter3d:
    rows = np.zeros(0, dtype=np.int64) if selected is None else np.flatnonzero(selected)
    error = np.where(comparison.points.sightings.is_measured, comparison.residual_mm, 0.0)
    # Beside means and differences only the places: a row's own residual is no part of those.
    is_stroke = look in _DRAWN
    magnification = volume.magnification if is_stroke else 0.0
    trace = marked_strokes(
        places_mm(comparison)[rows], error[rows], magnification, style.VERMILLION, "marked", most=MOST_MARKED
    )
    return trace if is_stroke else trace.update(mode="markers", marker={"size": 1.5, "color": style.VERMILLION})


def _add_shape(figure: go.Figure, session: Session) -> str:
    """Draw the grid, and say how far it is magnified; a grid that cannot be drawn says why."""
    model = session.model
    if model.is_nominal:
        return ""
    at = _conditions(session, model)
    if at is None:
        return " The machine's shape needs conditions: state them under “Correct a program”."
    traces, magnification = grid_traces(model, exaggeration=session.view.exaggeration, at=at)
    nominal, bent = traces
    bent.line = {"color": style.SKY, "width": 3}
    figure.add_traces([nominal, bent])
    return (
        f" Blue grid: the machine's shape as the model has it, errors {magnification:,.0f} times as large."
        f"{_stated(session)}"
    )


def _conditions(session: Session, *models: Model) -> dict[str, npt.ArrayLike | str] | None:
    """Give the conditions that models need: motion as usual, the rest as stated; None where one is wanting."""
    names = {name for model in models for name in model.conditions}
    at: dict[str, npt.ArrayLike | str] = {name: value for name in names if (value := _motion(name)) is not None}
    try:
        for model in models:
            at |= conditions_of(model, session.view.conditions)
    except InputFileError:
        # The form says what is wrong with a number.
        return None
    return at if names <= set(at) else None


def _stated(session: Session) -> str:
    """Say at which conditions."""
    stated = conditions_of(session.model, session.view.conditions)
    told = ", ".join(value_label(name, f"{value:g}") for name, value in stated.items())
    return f" At {told}." if told else ""


def _motion(name: str) -> float | None:
    head, _, axis = name.rpartition("_")
    if axis in ("x", "y", "z") and head in _MOTION:
        return _MOTION[head]
    return {"feed": _FEED_MM_MIN, "moving": 0.0}.get(name)


def _box_shapes(session: Session) -> list[dict[str, Any]]:
    """Give the box that marked rows over the variable that the residual is drawn over."""
    box = session.box
    if box is None or box.variable != session.view.variable:
        return []
    # One without ends along an axis reaches all over the picture.
    sides: dict[str, tuple[str, Sequence[float]]] = {"x": ("paper", (0.0, 1.0)), "y": ("paper", (0.0, 1.0))}
    sides |= {name[0]: (name, ends) for name, ends in box.ends.items()}
    shape: dict[str, Any] = {"type": "rect", "fillcolor": _BOX_FILL, "layer": "below"}
    shape["line"] = {"color": style.VERMILLION, "width": 1.5, "dash": "dash"}
    for side, (axis, ends) in sides.items():
        shape |= {f"{side}ref": axis, f"{side}0": min(ends), f"{side}1": max(ends)}
    return [shape]


def _drawn_points(seen: Seen, variable: str) -> list[tuple[Component, np.ndarray]]:
    values = seen.variables[variable]
    return [
        (component, style.thinned(component.is_known & np.isfinite(values), MOST_POINTS))
        for component in seen.comparison.components
    ]


def _selected_points(seen: Seen, selected: Rows | None, variable: str) -> list[np.ndarray | None]:
    """Give the places of marked rows among the drawn points of each component; None where nothing is marked."""
    return [None if selected is None else np.flatnonzero(selected[rows]) for _, rows in _drawn_points(seen, variable)]


def _plain(values: object) -> list[float | None]:
    numbers = np.asarray(values, dtype=np.float64)
    rounded = np.round(numbers, 4)
    return [None if np.isnan(value) else value for value in rounded.tolist()]


def nothing_drawn(text: str) -> go.Figure:
    """Say why nothing is drawn, with traces in the places where marks and causes would be."""
    figure = go.Figure([go.Scatter(visible=False) for _ in range(_EXPLAINED + 1)])
    lines = "<br>".join(textwrap.wrap(text, _LINE))
    figure.add_annotation(text=lines, showarrow=False, font={"size": 13, "color": style.INK})
    figure.update_layout(template=style.template(), xaxis={"visible": False}, yaxis={"visible": False})
    return in_panel(figure, "empty", margin={"l": 10, "r": 10, "t": 10, "b": 10})
