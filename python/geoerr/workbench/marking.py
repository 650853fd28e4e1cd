"""Marking rows: by a box, a stroke, a region or two limits; what is marked shows in both pictures."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any

from dash import ALL, ClientsideFunction, Dash, Input, Output, Patch, State, ctx, no_update

from geoerr.errors import InputFileError
from geoerr.workbench import actions
from geoerr.workbench.clicks import clicked
from geoerr.workbench.panel_where import marked_words, rows_of_region
from geoerr.workbench.parts import wrong_field
from geoerr.workbench.pictures import marks_in_residual, marks_in_volume, rows_between, rows_in_box, rows_of_pass
from geoerr.workbench.session import Box, Rows, Seen, Session
from geoerr.workbench.view import REGION
from geoerr.workbench.view_box import rows_in_view_box

# Button to what `mark` takes it for.
_SOURCES = {"mark-region": "region", "unmark": "none"}


def mark(session: Session, source: str, what: Any) -> list[Any] | None:
    """Mark rows as a picture, a region, two limits or a button asks for.

    Returns
    -------
    list or None
        What is said of it; None where nothing is to be seen. What it changes in the pictures is for `mark_residual`
        and `mark_volume` to say.

    Raises
    ------
    InputFileError
        for a limit that is no number.
    """
    with session.lock:
        seen = session.seen
        if seen is None:
            return None
        rows = None
        box = Box(session.view.variable, what["range"]) if source == "residual" and what else None
        if box is not None:
            rows = rows_in_box(seen, box.variable, box.ends)
        elif source == "volume" and what:
            rows = _rows_of_stroke(session, seen, what["points"][0].get("customdata") or [])
        elif source == "view-box":
            rows = rows_in_view_box(seen, what)
        elif source == "region":
            rows = rows_of_region(seen, int(what))
        elif source == "limits":
            rows = rows_between(seen, session.view.variable, *what)
        actions.select(session, rows)
        session.box = box
        return marked_words(session)


def after_drawing(session: Session, drawn: int) -> tuple[list[Any], Any]:
    """Say what is marked, once pictures are drawn; those of an earlier mark, by its number, are to be marked anew."""
    with session.lock:
        return marked_words(session), no_update if drawn == session.n_marks else time.monotonic()


def mark_residual(session: Session) -> Patch | None:
    """Give what the rows that are marked change in the residual's picture; a box that did not mark them goes away."""
    with session.lock:
        return None if session.seen is None else marks_in_residual(session, session.seen)


def mark_volume(session: Session) -> Patch | None:
    """Give what the rows that are marked change in the volume, or the circle."""
    with session.lock:
        return None if session.seen is None else marks_in_volume(session, session.seen)


def _rows_of_stroke(session: Session, seen: Seen, told: Sequence[Any]) -> Rows | None:
    """Give what a stroke in the volume stands for: its last number is its region, or its row; a grid tells none."""
    if len(told) <= 6:
        return session.selected
    return rows_of_region(seen, int(told[-1])) if session.view.look == REGION else rows_of_pass(seen, int(told[-1]))


def _answer(words: list[Any] | None) -> tuple[Any, Any, None]:
    """Give the words, when they were said, and no wrong limit; only the last where nothing was marked otherwise."""
    return (no_update, no_update, None) if words is None else (words, time.monotonic(), None)


def wire_marks(app: Dash, session: Session) -> None:
    """Put the callbacks of marking on the page."""
    app.clientside_callback(
        ClientsideFunction("limits", "emptied"),
        Output("mark-from", "value"),
        Output("mark-to", "value"),
        Output("limited", "data"),
        Input("variable", "value"),
        State("limited", "data"),
        prevent_initial_call=True,
    )

    # Where there is no volume there is no box over it either.
    app.clientside_callback(
        "(chosen, isAway) => [isAway, isAway || chosen.length === 0]",
        Output("view-box-choice", "hidden"),
        Output("view-box-sheet", "hidden"),
        Input("marks-by-box", "value"),
        Input("volume-controls", "hidden"),
    )

    @app.callback(
        Output("marked", "children", allow_duplicate=True),
        Output("marks", "data"),
        Output("wrong-limit", "children"),
        Input("volume", "clickData"),
        Input("view-box", "data"),
        Input("box", "data"),
        Input({"do": "mark-region", "what": ALL}, "n_clicks"),
        Input({"do": "unmark", "what": ALL}, "n_clicks"),
        Input("mark-limits", "n_clicks"),
        Input("mark-from", "n_submit"),
        Input("mark-to", "n_submit"),
        State("mark-from", "value"),
        State("mark-to", "value"),
        prevent_initial_call=True,
    )
    def _mark(pointed: Any, view_box: Any, box: Any, *rest: Any) -> Any:
        source, limits = ctx.triggered_id, rest[-2:]
        told = {"volume": ("volume", pointed), "view-box": ("view-box", view_box), "box": ("residual", box)}
        try:
            if isinstance(source, str):
                words = mark(session, *told.get(source, ("limits", limits)))
            else:
                asked = clicked()
                words = None if asked is None else mark(session, _SOURCES[asked[0]], asked[1])
        except InputFileError as error:
            return no_update, no_update, wrong_field(error)
        return _answer(words)

    # By itself: pictures that were asked for before a mark come after its answer, and would take it back.
    @app.callback(
        Output("marked", "children", allow_duplicate=True),
        Output("marks", "data", allow_duplicate=True),
        Input("drawn", "data"),
        prevent_initial_call=True,
    )
    def _say_again(drawn: int) -> Any:
        return after_drawing(session, drawn)

    # Pictures are slow to draw without a graphics card: what was asked for is answered first.
    @app.callback(
        Output("residual", "figure", allow_duplicate=True), Input("marks", "data"), prevent_initial_call=True
    )
    def _mark_residual(_: float) -> Any:
        return mark_residual(session) or no_update

    @app.callback(Output("volume", "figure", allow_duplicate=True), Input("marks", "data"), prevent_initial_call=True)
    def _mark_volume(_: float) -> Any:
        return mark_volume(session) or no_update
