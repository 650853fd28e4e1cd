"""What follows what on the page: every callback of Dash, each a call of a function that knows nothing of Dash."""

from __future__ import annotations

import base64
import hashlib
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from dash import ALL, ClientsideFunction, Dash, Input, Output, State, ctx, dcc, no_update
from plotly.io.json import to_json_plotly

from geoerr.errors import GeoerrError
from geoerr.workbench import actions, reports
from geoerr.workbench.clicks import clicked
from geoerr.workbench.explained import TRIAL, what_is_shown
from geoerr.workbench.layout import BEAT_MS, RESTING_BEAT_MS, status, stop
from geoerr.workbench.marking import wire_marks
from geoerr.workbench.own_effect import OwnFormula
from geoerr.workbench.panel_given import given_panel
from geoerr.workbench.panel_missing import missing_panel, own_result
from geoerr.workbench.panel_use import conditions_form, program_result, reports_list, wrong_number
from geoerr.workbench.panel_where import (
    fall_graph,
    limits_shown,
    options_of,
    regions_table,
)
from geoerr.workbench.pictures import (
    explanation,
    nothing_drawn,
    residual_picture,
    turned_volume,
    volume_picture,
)
from geoerr.workbench.program import Wish
from geoerr.workbench.session import Session
from geoerr.workbench.view import CIRCLE, DIFFERENCE, LOOKS, REGION
from geoerr.workbench.wanting import wanting

# For so much of a beat a question waits for the end of work: one is waiting nearly always, and never two.
_MOST_OF_A_BEAT = 0.95
# Panels that take a while to draw.
_DRAWN = ("given", "missing", "fall", "own", "conditions", "program", "reports")
# What the session's content is counted by, among their digests.
_CONTENT = "content"
# Actions of buttons to the panel in which a refusal is shown.
PLACES = {
    "fit": actions.DATA,
    "remove": actions.DATA,
    "undo": actions.DATA,
    "show": actions.DATA,
    "refer": actions.DATA,
    "go-back": actions.DATA,
    "put-away": actions.DATA,
    "diagnose": actions.MISSING,
    "add": actions.MISSING,
    "add-trial": actions.OWN,
    "report": actions.REPORT,
    "stop": actions.DATA,
    "dismiss": actions.DATA,
}


# Button to what it does; `what` is the button's own text of what it means.
_ACTIONS: dict[str, Callable[[Session, str], None]] = {
    "fit": actions.fit_classic,
    "diagnose": lambda session, _: actions.find_missing(session),
    "add": actions.add,
    "remove": actions.remove,
    "undo": lambda session, _: actions.undo(session),
    "show": lambda session, what: actions.show(session, int(what)),
    "refer": lambda session, what: actions.refer_to(session, int(what)),
    "go-back": lambda session, what: actions.go_back(session, int(what)),
    "put-away": actions.put_away,
    "add-trial": lambda session, _: actions.add_trial(session),
    "report": reports.write,
    "stop": lambda session, _: session.stop(),
    "dismiss": actions.dismiss,
}


def do(session: Session, action: str, what: str) -> None:
    """Do what a button asks for; a refusal is shown in its panel."""
    try:
        _ACTIONS[action](session, what)
    except GeoerrError as error:
        refuse(session, PLACES[action], error)


def refuse(session: Session, place: str, error: GeoerrError) -> None:
    """Show a refusal in a panel."""
    session.show_problem(place, str(error))
    session.changed()


def drawn_panels(session: Session) -> dict[str, Any]:
    """Give the panels that take a while to draw; that work begins or is stopped changes none of them."""
    return {
        "given": given_panel(session),
        "missing": missing_panel(session),
        "fall": fall_graph(session),
        "own": own_result(session),
        "conditions": conditions_form(session),
        "program": program_result(session),
        "reports": reports_list(session),
    }


def other_parts(session: Session) -> dict[str, Any]:
    """Give everything else that a change of the session may change, pictures aside."""
    seen = session.seen
    options = [] if seen is None else options_of(seen)
    return {
        "variables": options,
        "variable": session.view.variable or None,
        "color": session.view.color_by or None,
        "looks": LOOKS if seen is None else seen.looks,
        "look": session.view.look,
        "runs": [] if seen is None else [one.name for one in seen.circles],
        "run": session.view.run or None,
        "status": status(session),
        "stop": stop(session),
        "beat": BEAT_MS if session.is_busy else RESTING_BEAT_MS,
    }


def panels(session: Session) -> dict[str, Any]:
    """Give everything that a change of the session may change, pictures aside."""
    with session.lock:
        return drawn_panels(session) | other_parts(session)


def pictures(session: Session, shown: str) -> dict[str, Any]:
    """Give both pictures, of regions their table, and which mark is drawn."""
    with session.lock:
        seen = session.seen
        if seen is None:
            # While files are read nobody knows yet.
            return {
                "volume": nothing_drawn("" if session.is_busy else wanting(session)),
                "residual": nothing_drawn(""),
                "regions": None,
                "captions": ("", ""),
                "limits": ("", "", ""),
                "drawn": session.n_marks,
            }
        explained = what_is_shown(session, shown)
        residual = residual_picture(session, seen, explained)
        volume = volume_picture(session, seen, explained)
        return {
            "volume": volume.figure,
            "residual": residual.figure,
            "regions": regions_table(seen) if session.view.look == REGION else None,
            "captions": (volume.caption, residual.caption),
            "limits": limits_shown(seen, session.view.variable),
            "drawn": session.n_marks,
        }


def choose(session: Session, look: str, variable: str | None, color: str | None, run: str | None) -> None:
    """Look at what was chosen, as far as the data have it: the page may ask for what they had before."""
    view, seen = session.view, session.seen
    if seen is None:
        view.look = look
        return
    if look in seen.looks:
        view.look = look
    if run in {one.name for one in seen.circles}:
        view.run = run or ""
    if variable in seen.variables:
        view.variable = variable or ""
        view.color_by = color if color is not None and color in seen.variables else ""


def pin(session: Session, name: str, pinned: str) -> str:
    """Give what is shown from now on: a candidate, or nothing where it was shown already.

    Of a saved session it is searched for again, and shown when it is found.
    """
    if name == TRIAL or session.diagnosis is not None:
        return "" if name == pinned else name
    try:
        actions.find_missing(session, is_shown=True)
    except GeoerrError as error:
        refuse(session, actions.MISSING, error)
    return name


def wire(app: Dash, session: Session) -> None:
    """Put all callbacks on the page."""
    _wire_actions(app, session)
    _wire_panels(app, session)
    _wire_pictures(app, session)
    _wire_stand(app, session)
    wire_marks(app, session)
    _wire_pointing(app, session)
    _wire_forms(app, session)
    _wire_program(app, session)


def _wire_actions(app: Dash, session: Session) -> None:
    @app.callback(
        Output("tick", "data", allow_duplicate=True),
        *(Input({"do": action, "what": ALL}, "n_clicks") for action in PLACES),
        prevent_initial_call=True,
    )
    def _act(*_: Any) -> Any:
        asked = clicked()
        if asked is None:
            return no_update
        do(session, *asked)
        return session.version

    @app.callback(
        Output("tick", "data", allow_duplicate=True),
        Output("files", "contents"),
        Input("files", "contents"),
        State("files", "filename"),
        prevent_initial_call=True,
    )
    def _take(contents: Sequence[str] | None, names: Sequence[str] | None) -> Any:
        if not contents or not names:
            return no_update, no_update
        try:
            actions.take_dropped(session, names, [_decoded(one) for one in contents])
        except GeoerrError as error:
            refuse(session, actions.DATA, error)
        # The page tells of a change only: a file that is dropped twice has to be news the second time too.
        return session.version, None

    @app.callback(
        Output("under-way", "children", allow_duplicate=True),
        Output("tick", "data", allow_duplicate=True),
        Input("beat", "n_intervals"),
        State("tick", "data"),
        prevent_initial_call=True,
    )
    def _beat(_: Any, tick: int) -> Any:
        job = session.job
        if job is not None and tick == session.version:
            # The end of work is told when it comes, and not a beat later.
            job.wait(_MOST_OF_A_BEAT * BEAT_MS * 1e-3)
        is_news = tick != session.version
        # What stands still is not said again, and that work is done is said with what came of it.
        return status(session) if session.is_busy else no_update, session.version if is_news else no_update


def _wire_panels(app: Dash, session: Session) -> None:
    @app.callback(
        output={
            "given": Output("given", "children"),
            "missing": Output("missing", "children"),
            "fall": Output("fall", "children"),
            "own": Output("own-result", "children"),
            "conditions": Output("conditions", "children"),
            "program": Output("program-result", "children"),
            "reports": Output("reports", "children"),
            "variables": Output("variable", "options"),
            "variable": Output("variable", "value"),
            "colors": Output("color", "options"),
            "color": Output("color", "value"),
            "looks": Output("look", "options"),
            "look": Output("look", "value"),
            "runs": Output("run", "options"),
            "run": Output("run", "value"),
            "status": Output("under-way", "children"),
            "stop": Output("stop", "children"),
            "beat": Output("beat", "interval"),
            "sight": Output("sight", "data"),
            "shown": Output("shown", "data"),
        },
        inputs={"_": Input("tick", "data"), "sight": State("sight", "data"), "shown": State("shown", "data")},
    )
    def _refresh(_: Any, sight: int, shown: Mapping[str, str]) -> dict[str, Any]:
        found, digests = _unlike(session, shown)
        has_new = ctx.triggered_id is None or sight != session.sight
        names = ("variables", "variable", "color", "looks", "look", "runs", "run")
        if not has_new:
            # What is drawn stays; a person may be choosing right now.
            found |= dict.fromkeys(names, no_update)
        return found | {
            "colors": found["variables"],
            "sight": session.sight if has_new else no_update,
            "shown": digests,
        }


def _unlike(session: Session, shown: Mapping[str, str]) -> tuple[dict[str, Any], dict[str, str]]:
    """Leave the panels out that a page shows as they are, by their digests: to draw them again takes a while."""
    with session.lock:
        content = str(session.content)
        if shown.get(_CONTENT) == content:
            return other_parts(session) | dict.fromkeys(_DRAWN, no_update), dict(shown)
        found = panels(session)
    digests = {name: hashlib.sha256(to_json_plotly(found[name]).encode()).hexdigest() for name in _DRAWN}
    same = {name: no_update for name, digest in digests.items() if shown.get(name) == digest}
    return found | same, digests | {_CONTENT: content}


def _wire_pictures(app: Dash, session: Session) -> None:
    app.clientside_callback(
        ClientsideFunction("workbench", "hasWebgl"), Output("webgl", "data"), Input("webgl", "id")
    )

    @app.callback(
        output={
            "volume": Output("volume", "figure"),
            "residual": Output("residual", "figure"),
            "regions": Output("regions", "children"),
            "hidden": {
                "regions": Output("regions", "hidden"),
                "volume_controls": Output("volume-controls", "hidden"),
                "circle_controls": Output("circle-controls", "hidden"),
                "shape": Output("shape-control", "hidden"),
            },
            "captions": (Output("volume-caption", "children"), Output("residual-caption", "children")),
            "limits": (
                Output("mark-from", "placeholder"),
                Output("mark-to", "placeholder"),
                Output("mark-unit", "children"),
            ),
            "drawn": Output("drawn", "data"),
        },
        inputs={
            "_": Input("sight", "data"),
            "webgl": Input("webgl", "data"),
            "look": Input("look", "value"),
            "shape": Input("shape", "value"),
            "power": Input("power", "value"),
            "variable": Input("variable", "value"),
            "color": Input("color", "value"),
            "run": Input("run", "value"),
            "shown": State("pinned", "data"),
        },
    )
    def _draw(_: Any, webgl: bool, look: str, shape: list[str], power: float, variable: str | None,
              color: str | None, run: str | None, shown: str) -> dict[str, Any]:  # fmt: skip
        view, session.has_webgl = session.view, webgl
        view.shows_shape, view.power = bool(shape), float(power)
        choose(session, look, variable, color, run)
        is_circle = view.look == CIRCLE
        hidden = {
            "regions": view.look != REGION,
            "volume_controls": is_circle or not webgl,
            "circle_controls": not is_circle,
            # Means and differences have a grid of their own.
            "shape": view.look in (REGION, DIFFERENCE),
        }
        return pictures(session, shown) | {"hidden": hidden}


def _wire_stand(app: Dash, session: Session) -> None:
    @app.callback(
        Output("volume", "figure", allow_duplicate=True),
        Input({"do": "look-from", "what": ALL}, "n_clicks"),
        prevent_initial_call=True,
    )
    def _look_from(_: Any) -> Any:
        asked = clicked()
        if asked is None:
            return no_update
        session.view.look_from(asked[1])
        return turned_volume(session) or no_update


def _wire_pointing(app: Dash, session: Session) -> None:
    @app.callback(
        Output("volume", "figure", allow_duplicate=True),
        Output("residual", "figure", allow_duplicate=True),
        Input("hovered", "data"),
        Input("pinned", "data"),
        prevent_initial_call=True,
    )
    def _explain(hovered: str, pinned: str) -> Any:
        seen = session.seen
        if seen is None:
            return no_update, no_update
        return explanation(session, seen, what_is_shown(session, hovered or pinned))

    @app.callback(
        Output("pinned", "data"),
        Output("tick", "data", allow_duplicate=True),
        Input({"do": "point", "what": ALL}, "n_clicks"),
        State("pinned", "data"),
        prevent_initial_call=True,
    )
    def _pin(_: Any, pinned: str) -> Any:
        asked = clicked()
        if asked is None:
            return no_update, no_update
        return pin(session, asked[1], pinned), session.version


def _wire_forms(app: Dash, session: Session) -> None:
    @app.callback(
        Output("tick", "data", allow_duplicate=True),
        Input("own-try", "n_clicks"),
        Input("own-formula", "n_submit"),
        State("own-name", "value"),
        State("own-channel", "value"),
        State("own-axis", "value"),
        State("own-formula", "value"),
        State("own-searched", "value"),
        prevent_initial_call=True,
    )
    def _try(_: Any, __: Any, name: str, channel: str, axis: str, formula: str, searched: str) -> Any:
        try:
            actions.try_formula(session, OwnFormula(name or "", channel, axis, formula or "", searched or ""))
        except GeoerrError as error:
            refuse(session, actions.OWN, error)
        return session.version

    @app.callback(
        Output("sight", "data", allow_duplicate=True),
        Output("wrong-number", "children"),
        Output("reports", "children", allow_duplicate=True),
        Input({"condition": ALL}, "value"),
        State({"condition": ALL}, "id"),
        prevent_initial_call=True,
    )
    def _state_conditions(values: Sequence[str | None], ids: Sequence[dict[str, str]]) -> Any:
        typed = {one["condition"]: value or "" for one, value in zip(ids, values, strict=True)}
        if typed == {name: session.view.conditions.get(name, "") for name in typed}:
            return no_update, no_update, no_update
        session.view.conditions |= typed
        session.sight += 1
        # What was written tells of the machine under other conditions.
        session.reports = {}
        return session.sight, wrong_number(session), reports_list(session)


def _wire_program(app: Dash, session: Session) -> None:
    @app.callback(
        Output("tick", "data", allow_duplicate=True),
        Output("program", "contents"),
        Input("program", "contents"),
        Input({"do": "correct-again", "what": ALL}, "n_clicks"),
        State("program", "filename"),
        State("work-offset", "value"),
        State("wishes", "value"),
        prevent_initial_call=True,
    )
    def _correct(
        contents: str | None, _: Any, name: str | None, work_offset: str | None, wishes: Sequence[str]
    ) -> Any:
        asked = None
        if ctx.triggered_id == "program":
            asked = (name or "program.gcode", _decoded(contents)) if contents else None
        elif clicked() is not None:
            asked = session.dropped
        if asked is None:
            return no_update, no_update
        wish = Wish(session.view.conditions, work_offset or "", "hold" in wishes, "pass" in wishes)
        try:
            actions.compensate(session, *asked, wish)
        except GeoerrError as error:
            refuse(session, actions.PROGRAM, error)
        # As with files: the same program again, after a look at it, is a new wish.
        return session.version, None

    @app.callback(
        Output("download", "data"), Input({"do": "download", "what": ALL}, "n_clicks"), prevent_initial_call=True
    )
    def _download(_: Any) -> Any:
        corrected = session.program
        if corrected is None or clicked() is None:
            return no_update
        return dcc.send_bytes(corrected.content, corrected.corrected_name)


def _decoded(contents: str) -> bytes:
    """Give the bytes of what Dash sends for a dropped file: `data:...;base64,...`."""
    return base64.b64decode(contents.partition(",")[2])
