"""The lower part: correct a program with the model, and print the report."""

from __future__ import annotations

from typing import Any

from dash import dcc, html

from geoerr.model.program_conditions import needed_conditions
from geoerr.report.figures import variable_label
from geoerr.workbench.actions import PROGRAM
from geoerr.workbench.parts import button, figure_row, problem, section, sentence, um
from geoerr.workbench.pictures import in_panel
from geoerr.workbench.program import CorrectedProgram, default_condition
from geoerr.workbench.session import Session

_NEEDED = {"model": "a model", "comparison": "data", "diagnosis": "a search, or a new one in a saved session"}


def use_panel() -> list[Any]:
    """Make the two parts; what depends on the model is filled in later."""
    return [
        section(
            "Correct a program",
            [
                html.Div(id="conditions"),
                html.Label(
                    ["Program's zero in machine coordinates, mm",
                     dcc.Input("0, 0, 0", id="work-offset", type="text", className="code")]
                ),
                dcc.Checklist(
                    {
                        "hold": "beyond the measured range, hold the last error",
                        "pass": "pass lines through that cannot be corrected",
                    },
                    [],
                    id="wishes",
                    className="choice tall",
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
            explanation="Each opens in a page of its own, which can be saved and printed.",
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
                        placeholder="" if default is None else f"{default:g}",
                        className="code",
                    ),
                ]
            )
        )
    return fields


def program_result(session: Session) -> list[Any]:
    """Show what happened to the program."""
    parts = [problem(session, PROGRAM)]
    corrected = session.program
    if corrected is None:
        return parts
    path, result = corrected.trace.result, corrected.result
    rows = [
        html.Tr([html.Td(), html.Th("before", scope="col"), html.Th("after", scope="col")]),
        _pair("largest error", um(path.max_error_um_before), um(path.max_error_um_after)),
        _pair("error, rms", um(path.rms_um_before), um(path.rms_um_after)),
        _pair("moves", f"{path.moves_in:,}", f"{path.moves_out:,}"),
    ]
    told = [html.Li(str(one)) for one in result.warnings] + [html.Li(sentence(one)) for one in result.notes]
    return [
        *parts,
        html.P([html.B(corrected.name), f", by the model “{corrected.model_name}”"]),
        html.Table([html.Tbody(rows)], className="figures pair"),
        html.Ul(told, className="files") if told else None,
        button(f"Download {corrected.corrected_name}", "download", is_main=True),
        html.Div(
            dcc.Graph(figure=_path(corrected), config={"displaylogo": False, "responsive": True}), className="path"
        ),
    ]


def reports_list(session: Session) -> Any:
    """Offer the pages that can be made now."""
    offers = [("model", "All that is known of the machine", bool(session.steps))]
    offers += [("comparison", "How far and where the model is off", session.seen is not None)]
    offers += [("diagnosis", "What is missing, and how sure that is", session.diagnosis is not None)]
    items = [
        html.Li(
            html.A(text, href=f"/report/{name}", target="_blank")
            if is_there
            else html.Span(f"{text}: comes with {_NEEDED[name]}", className="why")
        )
        for name, text, is_there in offers
    ]
    items.append(
        html.Li(
            html.A("The model itself, model.json", href="/model.json")
            if session.steps
            else html.Span("model.json: comes with a model", className="why")
        )
    )
    return html.Ul(items, className="files")


def _pair(name: str, before: str, after: str) -> Any:
    row = figure_row(name, before)
    row.children.append(html.Td(after))
    return row


def _path(corrected: CorrectedProgram) -> Any:
    figure = corrected.trace.plot_error()
    return in_panel(figure, "path", margin={"l": 62, "r": 10, "t": 26, "b": 44})
