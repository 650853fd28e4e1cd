"""What a model predicts of its machine, computed and drawn in one call."""

from __future__ import annotations

import plotly.graph_objects as go

from geoerr.diagnose.stages import stages_of
from geoerr.error_functions import ErrorFunctions
from geoerr.errors import GeoerrError
from geoerr.machine import AXES
from geoerr.model import Model
from geoerr.model.conditions import Conditions
from geoerr.model.program_conditions import approach_conditions
from geoerr.report.figures.circle import predicted_circles
from geoerr.report.figures.error_curves import error_curves
from geoerr.report.figures.error_field import error_field, field_difference
from geoerr.report.figures.fall import error_fall
from geoerr.report.figures.positioning import positioning_curves
from geoerr.verify.ballbar import middle_circle, predict_trace
from geoerr.verify.circle import PLANES
from geoerr.verify.positioning import axis_line_mm, diagonals_mm, predict_positioning

# Of more names than fit below a heading the number.
_MOST_NAMED = 4


def model_errors(model: Model, truth: ErrorFunctions | None = None, at: Conditions | None = None) -> go.Figure:
    """Draw the 21 errors of a model, with their bands, beside the truth of a simulation."""
    return error_curves(model.error_functions(at=at), truth, absent=model.not_in_model)


def model_field(model: Model, at: Conditions | None = None) -> go.Figure:
    """Draw the error over the volume; of motion, what is not stated is as when reached from below, at rest."""
    stated = {**approach_conditions(model), **(at or {})}
    return _with_open(error_field(model, at=stated), model, at)


def model_difference(model: Model, reference: Model, at: Conditions | None = None) -> go.Figure:
    """Draw what a model says of the volume beyond another one; what is not stated as for `model_field`."""
    stated = {**approach_conditions(reference), **approach_conditions(model), **(at or {})}
    return field_difference(model, reference, at=stated)[0]


def model_circles(model: Model, at: Conditions | None = None) -> go.Figure:
    """Draw a circle about the middle of the volume in each plane, both ways round (ISO 230-4)."""
    circles = [middle_circle(model, plane) for plane in PLANES]
    traces = [(predict_trace(model, one, at=at), predict_trace(model, one, clockwise=True, at=at)) for one in circles]
    return _with_open(predicted_circles(traces), model, at)


def model_positioning(model: Model, at: Conditions | None = None) -> go.Figure:
    """Draw the positioning of each axis through the middle of the volume, both ways (ISO 230-2)."""
    tests = {axis.upper(): predict_positioning(model, *axis_line_mm(model, axis), at=at) for axis in AXES}
    figure = positioning_curves(tests, "Positioning, predicted", "by the model, of the tool point")
    return _with_open(figure, model, at)


def model_diagonals(model: Model, at: Conditions | None = None) -> go.Figure:
    """Draw the deviation along the four space diagonals, both ways (ISO 230-6)."""
    tests = {name: predict_positioning(model, *ends, at=at) for name, ends in diagonals_mm(model).items()}
    subtitle = "by the model, of the tool point; P: that axis rises from the first corner, N: it falls"
    return _with_open(positioning_curves(tests, "Space diagonals, predicted", subtitle), model, at)


def model_fall(model: Model) -> go.Figure:
    """Draw how the error fell, by the model's own history.

    Raises
    ------
    GeoerrError
        for a model without one.
    """
    stages = () if model.record is None else stages_of(model.record.history)
    if not stages:
        raise GeoerrError(
            "the model has no history: nothing was added to it or taken from it\n"
            "hint: add_effect and remove_terms (`geoerr add`, `geoerr remove`) write one"
        )
    return error_fall(stages)


def _with_open(figure: go.Figure, model: Model, at: Conditions | None) -> go.Figure:
    """Say below the heading what the prediction takes as 0 though nobody knows it: unknown is not zero."""
    tables = model.error_functions(at=at)
    told = []
    for what, names in (
        ("not determined", [one.name for one in tables.not_determined]),
        ("not in the model", model.not_in_model),
    ):
        if names:
            told.append(f"{', '.join(names) if len(names) <= _MOST_NAMED else len(names)} {what}")
    if told:
        figure.layout.title.subtitle.text += f"; taken as 0: {', '.join(told)}"
    return figure
