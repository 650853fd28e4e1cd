"""The left panel: data, the model and its effects, the history of models."""

from __future__ import annotations

from typing import Any

from dash import dcc, html

from geoerr.summaries import counted
from geoerr.workbench.actions import DATA
from geoerr.workbench.inputs import Kind
from geoerr.workbench.notes import notes_of
from geoerr.workbench.parts import breakable, button, difference_um, figure_row, problem, section, sentence, um
from geoerr.workbench.session import Session
from geoerr.workbench.wanting import wanting

_FIGURES = (
    ("residual", "rmse_um", "how far measured and predicted are apart, root mean square (rms)"),
    (
        "held out",
        "held_out_rmse_um",
        "the same on passes that the fit did not see: the better model has less",
    ),
)
_NOISE = "what repeats scatter, or what is stated: between a right model's residual and its held-out error"


_KINDS: dict[Kind, str] = {
    "measurements": "measurements",
    "effects": "own effects",
    "model": "model",
    "rig": "calibration of the cameras",
}


def given_panel(session: Session) -> list[Any]:
    """Make the panel."""
    return [
        problem(session, DATA),
        section("Data", _files(session), name="data"),
        section("Model", _model(session), name="model"),
        _history(session),
    ]


def upload() -> Any:
    """Make the place to drop files on; it stays while the panel is drawn anew."""
    return dcc.Upload(
        html.Button("Add files …", type="button", title="Or drop them here"),
        id="files",
        multiple=True,
        className="upload",
        className_active="upload active",
    )


def _files(session: Session) -> list[Any]:
    if not session.files:
        return [html.P("None yet.")]
    parts: list[Any] = []
    for one in session.files:
        kind = _KINDS[one.kind]
        away = None if one.kind == "model" else button("×", "put-away", one.name, title=f"Do without {one.name}")
        parts.append(html.Li([html.Span([html.B(one.name), f" {kind}"]), away]))
    if session.measured is not None and session.seen is not None:
        sightings = session.seen.comparison.points.sightings
        parts.append(html.Li(sightings.in_words(grouped=True), className="why"))
    if session.calibration.is_given:
        parts.append(html.Li("The calibration's uncertainty takes part in every fit and search.", className="why"))
    notes = notes_of(session)
    folded = html.Details([html.Summary(counted(len(notes), "note")), html.Ul([html.Li(one) for one in notes])])
    return [html.Ul(parts, className="files"), folded if notes else None]


def _model(session: Session) -> list[Any]:
    step = session.step
    if step is None:
        return [html.P("None yet.")]
    machine = step.model.machine
    rows = [figure_row(name, um(step.figures.get(key)), why) for name, key, why in _FIGURES]
    floor = step.figures.get("noise_floor_um")
    noise = floor if floor is not None else step.figures.get("noise_um")
    rows.append(figure_row("noise", um(noise), _NOISE))
    explained = [*((name, why) for name, _, why in _FIGURES), ("noise", _NOISE)]
    effects = [
        html.Li([html.Span([title, html.Br(), html.Code(name)]),
                 button("Remove", "remove", name, rests=True, title=f"Take {name} out and fit again")])
        for name, title in step.effects
    ]  # fmt: skip
    wants = wanting(session)
    return [
        html.P([html.B(machine.name or "machine"), f" · {step.name}"]),
        html.Table(html.Tbody(rows), className="figures"),
        html.Details(
            [
                html.Summary("What these figures mean"),
                html.Ul([html.Li(f"{name}: {sentence(why)}") for name, why in explained], className="why"),
            ]
        ),
        html.P(f"{step.n_classic} classic errors and {counted(len(effects), 'effect')}", className="why"),
        html.Ul(effects, className="files") if effects else None,
        html.Div(
            [
                button("Fit the 21 errors", "fit", "21", rests=True, off=bool(wants),
                       is_main=step.model.is_nominal and not session.has_circles_only,
                       title="Positioning, straightness and angles of three axes, and squareness"),
                button("12, no angles", "fit", "12", rests=True, off=bool(wants),
                       title="Positioning, straightness and squareness only"),
                button("Undo", "undo", rests=True, off=step.parent is None,
                       title="Back to the model before this one"),
            ],
            className="buttons",
        ),
        html.P(wants, className="why") if wants else None,
    ]  # fmt: skip


def _history(session: Session) -> Any:
    told, figure = _compared_by(session)
    errors = [session.beside.of(session.steps, number).get(figure) for number in range(len(session.steps))]
    known = errors[session.reference] if errors else None
    rows = []
    for number, (step, error) in enumerate(zip(session.steps, errors, strict=True)):
        is_reference, is_current = number == session.reference, number == session.current
        rows.append(
            html.Tr(
                [
                    html.Td(button("★" if is_reference else "☆", "refer", str(number),
                                   title="The reference" if is_reference else "Make this the reference")),
                    html.Td(button(breakable(f"{number + 1}. {step.name}"), "show", str(number), rests=True,
                                   title="Look at this model"), className="name"),
                    html.Td("–" if error is None else f"{error:.1f}", className="number"),
                    html.Td("" if is_reference else difference_um(error, known), className="number"),
                ],
                className="current" if is_current else "",
            )
        )  # fmt: skip
    explanation = f"{told}, µm; beside it the difference to the reference ★. {session.beside.words}".rstrip()
    if session.measured is not None and not all(_is_compared(session, number) for number in range(len(errors))):
        explanation += " A model with a dash has no figure on these rows: look at it."
    return section(
        "Models so far",
        [html.Table(html.Tbody(rows), className="history") if rows else html.P("None yet."), *_earlier(session)],
        name="history",
        explanation=explanation,
    )


def _is_compared(session: Session, number: int) -> bool:
    return bool(session.beside.of(session.steps, number))


def _earlier(session: Session) -> list[Any]:
    """Offer the work before another machine or model came."""
    if not session.earlier:
        return []
    items = []
    for number, chapter in enumerate(session.earlier):
        names = ", ".join(one.name for one in chapter.files)
        told = html.Span([html.B(chapter.title), html.Br(), f"{counted(len(chapter.steps), 'model')} of {names}"])
        title = "Its files and its models are as they were; what is here now is kept in its place"
        items.append(html.Li([told, button("Go back", "go-back", str(number), rests=True, title=title)]))
    return [
        html.H3("Earlier work"),
        html.P("Another machine or model begins anew. What was here before it is kept.", className="why"),
        html.Ul(items, className="files"),
    ]


def _compared_by(session: Session) -> tuple[str, str]:
    """Say by which figure models are compared, and give its key: of lengths nothing is held out."""
    has_lengths_only = session.measured is not None and session.measured.has_lengths_only
    return ("Residual", "rmse_um") if has_lengths_only else ("Error held out", "held_out_rmse_um")
