"""The lower part: correct a program with the model, and print the report."""

from __future__ import annotations

from typing import Any

from dash import dcc, html

from geoerr.diagnose.labels import value_label
from geoerr.errors import InputFileError
from geoerr.model.program_conditions import needed_conditions
from geoerr.report.figures import variable_label
from geoerr.summaries import counted, listed
from geoerr.workbench.actions import PROGRAM, REPORT
from geoerr.workbench.page_words import HOLD, PASS, ZERO, on_the_page
from geoerr.workbench.parts import STAYS, button, figure_row, problem, section, sentence, um, wrong_field
from geoerr.workbench.pictures import WITHOUT_BUTTONS, in_panel
from geoerr.workbench.program import CorrectedProgram, conditions_of, default_condition
from geoerr.workbench.reports import REPORTS, can_write
from geoerr.workbench.session import Session

_WITHOUT_PATH = "There is no path to compare: no move begins and ends at places that are known."
_NEEDED = {"model": "a model", "comparison": "data", "diagnosis": "a search"}


def use_panel() -> list[Any]:
    """Make the two parts; what depends on the model is filled in later."""
    return [
        section(
            "Correct a program",
            [
                html.Div(id="conditions"),
                html.Label(
                    [
                        ZERO,
                        dcc.Input(id="work-offset", type="text", placeholder="0, 0, 0", className="code", **STAYS),
                    ]
                ),
                dcc.Checklist(
                    {"hold": HOLD, "pass": PASS}, [], id="wishes", className="choice tall", **STAYS
                ),
                dcc.Upload(
                    html.Button("Choose a program …", type="button", title="Or drop it here", className="main"),
                    id="program",
                    className="upload one",
                    className_active="upload one active",
                ),
                html.Div(id="program-result"),
                dcc.Download(id="download"),
            ],
            name="program",
            explanation="The file stays on this computer. Its moves change so that the tool goes where it means.",
        ),
        section(
            "Report",
            [html.Div(id="reports")],
            name="report",
            explanation="Written here, each opens in a page of its own, which can be saved and printed.",
        ),
    ]  # fmt: skip


def conditions_form(session: Session) -> list[Any]:
    """Ask for the conditions that the model follows and no program tells."""
    if session.step is None:
        return []
    model = session.step.model
    spans = {} if model.record is None else model.record.covariate_spans
    fields = []
    for name in needed_conditions(model):
        default = default_condition(model, name)
        measured = f" (measured {spans[name][0]:.4g} to {spans[name][1]:.4g})" if name in spans else ""
        fields.append(
            html.Label(
                [
                    f"While it runs: {variable_label(name)}{measured}",
                    dcc.Input(
                        session.view.conditions.get(name, ""),
                        id={"condition": name},
                        type="text",
                        debounce=True,
                        placeholder="" if default is None else f"{default:g}",
                        className="code",
                    ),
                ]
            )
        )
    return [*fields, html.Div(wrong_number(session), id="wrong-number")]


def wrong_number(session: Session) -> Any:
    """Say which condition is no number; nothing where all are."""
    if session.step is None:
        return None
    try:
        conditions_of(session.step.model, session.view.conditions)
    except InputFileError as error:
        return wrong_field(error)
    return None


def program_result(session: Session) -> list[Any]:
    """Show what happened to the program."""
    again = None
    if session.dropped is not None:
        name = session.dropped[0]
        title = "With the model that is looked at, and with what is stated above"
        again = button(f"Correct {name} again", "correct-again", rests=True, title=title)
    parts = [problem(session, PROGRAM), again]
    corrected = session.program
    if corrected is None:
        return parts
    result = corrected.result
    warnings = [html.Li(sentence(str(one))) for one in result.warnings]
    notes = [html.Li(sentence(on_the_page(one))) for one in result.notes]
    return [
        *parts,
        html.P([html.B(corrected.name), f", by the model “{corrected.model_name}”{_at(corrected)}"]),
        html.P(_assumed(corrected), className="why") if corrected.assumed else None,
        html.Table([html.Tbody(_figures(corrected))], className="figures pair"),
        None if corrected.has_path or corrected.left_because else html.P(_WITHOUT_PATH, className="why"),
        html.P(html.B(sentence(corrected.left_because)))
        if corrected.left_because
        else button(f"Download {corrected.corrected_name}", "download", is_main=True),
        html.Ul(warnings, className="told") if warnings else None,
        _folded(notes),
        _pictures(corrected) if corrected.has_path and not corrected.left_because else None,
    ]


def _at(corrected: CorrectedProgram) -> str:
    """Say at what the program was corrected: at another temperature it would be another program."""
    told = [value_label(name, f"{value:g}") for name, value in corrected.conditions.items()]
    return f", at {listed(told)}" if told else ""


def _assumed(corrected: CorrectedProgram) -> str:
    names = listed(corrected.assumed)
    return f"Nobody stated {names}: it is the middle of what was measured. State it above, and correct again."


def _figures(corrected: CorrectedProgram) -> list[Any]:
    path = corrected.trace.result
    largest: tuple[float | None, ...] = path.max_error_um_before, path.max_error_um_after
    rms: tuple[float | None, ...] = path.rms_um_before, path.rms_um_after
    if not corrected.has_path:
        # Of no path at all the largest distance is none, not nothing.
        largest = rms = None, None
    return [
        html.Tr([html.Td(), html.Th("before", scope="col"), html.Th("after", scope="col")]),
        _pair("largest distance from the programmed path", *map(um, largest)),
        _pair("distance from it, rms", *map(um, rms)),
        _pair("moves", f"{path.moves_in:,}", f"{path.moves_out:,}"),
    ]


def _pictures(corrected: CorrectedProgram) -> Any:
    figures = [
        html.Figure(
            [
                html.Div(dcc.Graph(figure=figure, config=WITHOUT_BUTTONS, responsive=True), className="path"),
                html.Figcaption(caption),
            ]
        )
        for figure, caption in _paths(corrected)
    ]
    return html.Div(figures, className="pictures")


def _folded(notes: list[Any]) -> Any:
    if not notes:
        return None
    return html.Details([html.Summary(counted(len(notes), "note")), html.Ul(notes, className="told")])


def reports_list(session: Session) -> list[Any]:
    """Offer the reports that can be written now, and open those that are."""
    items = [html.Li(_report(session, name, text)) for name, text in REPORTS.items()]
    items.append(
        html.Li(
            html.A("The model itself, model.json", href="/model.json")
            if session.steps
            else html.Span("model.json: comes with a model", className="why")
        )
    )
    return [problem(session, REPORT), html.Ul(items, className="files")]


def _report(session: Session, name: str, text: str) -> list[Any]:
    if name in session.reports:
        return [html.A(f"Open: {text}", href=f"/report/{name}", target="_blank")]
    if name == "diagnosis" and session.diagnosis is None and session.told is not None:
        said = f"{text}: the saved session has it in words only"
        return [html.Span(said, className="why"), button("Look again", "diagnose", rests=True)]
    if not can_write(session, name):
        return [html.Span(f"{text}: comes with {_NEEDED[name]}", className="why")]
    return [html.Span(text), button("Write", "report", name, rests=True, title=f"Write the report: {text}")]


def _pair(name: str, before: str, after: str) -> Any:
    row = figure_row(name, before)
    row.children.append(html.Td(after))
    return row


def _paths(corrected: CorrectedProgram) -> list[tuple[Any, str]]:
    trace = corrected.trace
    where = in_panel(trace.plot_places(), "places", margin={"l": 62, "r": 10, "t": 26, "b": 44})
    along = in_panel(trace.plot_error(), "path", margin={"l": 62, "r": 10, "t": 26, "b": 44})
    return [
        (where, "The path from above; colour: how far the tool is from it, before and after, as the model has it."),
        (along, "The same along the path. What the model does not know, noise above all, comes on top."),
    ]
