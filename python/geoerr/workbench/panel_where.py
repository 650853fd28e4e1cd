"""The middle: where the model fails, in two pictures that know of each other, and how the error fell so far."""

from __future__ import annotations

from typing import Any

import numpy as np
from dash import dcc, html

from geoerr.diagnose.regions import Region, region_name
from geoerr.machine import AXES
from geoerr.report.figures import error_fall, variable_label, variable_unit
from geoerr.summaries import capitalised, counted
from geoerr.workbench.parts import button, signed, um
from geoerr.workbench.pictures import CONFIG, WITHOUT_BUTTONS, in_panel, span_of
from geoerr.workbench.session import Rows, Seen, Session
from geoerr.workbench.side_by_side import story
from geoerr.workbench.view import CIRCLE, LARGEST_POWER, LEAST_POWER, LOOKS, STANDS, View

# Twice the pixels each way, Plotly's usual, are four times the work where no graphics card does it.
_CONFIG = {**CONFIG, "scrollZoom": False, "plotGlPixelRatio": 1}
_VOLUME_CONFIG = {**_CONFIG, "scrollZoom": True, "modeBarButtonsToRemove": ["resetCameraLastSave3d", "tableRotation"]}
_RESIDUAL_CONFIG = {
    **_CONFIG,
    "modeBarButtonsToRemove": ["lasso2d", "autoScale2d", "toImage", "zoomIn2d", "zoomOut2d"],
}
_MARKS = {-3: "⅛", -2: "¼", -1: "½", 0: "1", 1: "2", 2: "4", 3: "8"}
_STEPS_DRAWN = 7
# Axis, and a little above; the two bars of a model have as much as the style says, and fewer than two models as two.
_AXIS_PX, _ABOVE_PX, _LEAST_MODELS = 40, 6, 2


def where_panel(session: Session) -> list[Any]:
    """Make the panel with its controls; pictures come when they are drawn."""
    view = session.view
    return [
        html.H2("Where it fails"),
        html.Div([_volume_figure(view), _residual_figure()], className="pictures"),
        html.Div(id="regions", className="regions", hidden=True),
        html.Div(id="marked", className="marked", role="status"),
    ]


def _volume_figure(view: View) -> Any:
    looks = dcc.RadioItems(dict(LOOKS), view.look, id="look", inline=True, className="choice")
    shape = dcc.Checklist(
        {"shape": "machine's shape"},
        ["shape"] if view.shows_shape else [],
        id="shape",
        inline=True,
        className="choice",
    )
    power = dcc.Slider(
        LEAST_POWER,
        LARGEST_POWER,
        0.5,
        value=view.power,
        id="power",
        marks=_MARKS,
        included=False,
        allow_direct_input=False,
    )
    stands = [
        button(text, "look-from", name, title=f"Look at the volume from {text}") for name, text in STANDS.items()
    ]
    by_box = dcc.Checklist({"box": "mark by a box"}, [], id="marks-by-box", inline=True, className="choice")
    return html.Figure(
        [
            html.Div([looks], className="controls", role="group", **{"aria-label": "What the volume shows"}),
            html.Div(
                [
                    html.Div(
                        [
                            html.Div(shape, id="shape-control"),
                            html.Span("Exaggerate", className="why"),
                            html.Div(power, className="slider"),
                        ],
                        className="controls row",
                    ),
                    html.Div([html.Span("Look from", className="why"), *stands], className="controls small",
                             role="group", **{"aria-label": "Look at the volume from"}),
                ],
                id="volume-controls",
            ),
            html.Div(
                html.Label(["Run", dcc.Dropdown(id="run", clearable=False, searchable=False)]),
                id="circle-controls",
                className="controls row",
                hidden=True,
            ),
            html.Div(
                [
                    dcc.Graph(id="volume", config=_VOLUME_CONFIG, responsive=True),
                    html.Div(by_box, id="view-box-choice"),
                    _view_box_sheet(),
                ],
                id="volume-frame",
                className="picture",
            ),
            html.Figcaption(id="volume-caption"),
        ]
    )  # fmt: skip


def _view_box_sheet() -> Any:
    """Make what lies over the volume while a box is drawn there; without it the pointer turns the volume."""
    return html.Div(
        [
            html.Span("drag a box; or arrows move it, Shift + arrows size it, Enter marks", className="why"),
            html.Div(className="box", hidden=True),
        ],
        id="view-box-sheet",
        tabIndex=0,
        hidden=True,
        role="application",
        **{"aria-label": "A box over the volume: arrows move it, Shift + arrows size it, Enter marks its rows"},
    )


def _residual_figure() -> Any:
    return html.Figure(
        [
            html.Div(
                [
                    html.Label(["Residual over", dcc.Dropdown(id="variable", clearable=False, searchable=False)]),
                    html.Label(["Colour", dcc.Dropdown(id="color", placeholder="none", searchable=False)]),
                ],
                className="controls",
            ),
            _limits_form(),
            html.Div(
                [
                    dcc.Graph(id="residual", config=_RESIDUAL_CONFIG, responsive=True),
                    html.Div(className="box", hidden=True),
                ],
                id="residual-frame",
                className="picture",
            ),
            html.Figcaption(id="residual-caption"),
        ]
    )


def _limits_form() -> Any:
    """Make the fields that mark rows as a box over the picture does, without a mouse and to the digit."""
    fields = [
        html.Label([word, dcc.Input("", id=f"mark-{word}", type="text", className="code", autoComplete="off")])
        for word in ("from", "to")
    ]
    return html.Div(
        [
            html.Span("Rows", className="why"),
            *fields,
            html.Span(id="mark-unit", className="why"),
            html.Button("Mark", id="mark-limits", n_clicks=0, type="button", title="Mark the rows between the two"),
            html.Div(id="wrong-limit"),
        ],
        className="controls small",
        role="group",
        **{"aria-label": "Mark rows by what the residual is drawn over"},
    )


def limits_shown(seen: Seen, variable: str) -> tuple[str, str, str]:
    """Give what stands in the empty fields, the variable's ends, and its unit."""
    span = span_of(seen, variable)
    low, high = ("", "") if span is None else (f"{end:.4g}".replace("-", "−") for end in span)
    return low, high, variable_unit(variable)


def options_of(seen: Seen) -> list[dict[str, str]]:
    """Give the variables to choose from, what the residual follows most first."""
    names = [*seen.by_worth, *(name for name in seen.variables if name not in seen.by_worth)]
    return [{"label": variable_label(name), "value": name} for name in names]


def regions_table(seen: Seen) -> Any:
    """List the regions of the volume, worst first: mean, spread and count; each can be marked."""
    names = [component.name for component in seen.comparison.components]
    known = [(number, region) for number, region in enumerate(seen.comparison.regions) if region.rmse_um is not None]
    ranked = sorted(known, key=lambda item: -(item[1].rmse_um or 0.0))
    head = ["region, mm", "rms, µm", *(f"{name}, µm" for name in names), "rows"]
    rows = [
        html.Tr(
            [
                html.Td(
                    button(_span(region), "mark-region", str(number), title=f"Mark the rows of {region_name(region)}")
                ),
                html.Td(f"{region.rmse_um:.1f}", className="number"),
                *(html.Td(_mean_over_spread(region, name), className="number") for name in names),
                html.Td(f"{region.n:,}", className="number"),
            ]
        )
        for number, region in ranked
    ]
    table = html.Table([html.Thead(html.Tr([html.Th(text, scope="col") for text in head])), html.Tbody(rows)])
    return html.Details(
        [
            html.Summary(f"{len(ranked)} regions, worst first: rms, mean ± spread, how many rows"),
            table,
        ],
        open=True,
    )


def _span(region: Region) -> str:
    spans = [
        f"{axis} {low:.0f} … {high:.0f}".replace("-", "−")
        for axis, low, high in zip(AXES, region.low_mm, region.high_mm, strict=True)
    ]
    return " · ".join(spans)


def _mean_over_spread(region: Region, name: str) -> list[Any]:
    mean, _, spread = _mean(region.mean_um.get(name), region.std_um.get(name)).partition(" ")
    return [html.B(mean), " ", html.Span(spread, className="why")]


def rows_of_region(seen: Seen, number: int) -> Rows:
    """Tell which rows (n,) lie in a region."""
    region = seen.comparison.regions[number]
    q_mm = seen.comparison.points.sightings.commanded_mm
    inside = (q_mm >= np.array(region.low_mm) - 1e-9) & (q_mm <= np.array(region.high_mm) + 1e-9)
    return np.asarray(inside.all(axis=1) & seen.comparison.points.solved.used)


def marked_words(session: Session) -> list[Any]:
    """Say what is marked: how many rows, and their mean and spread."""
    seen, rows = session.seen, session.selected
    if seen is None:
        return []
    if rows is None:
        other = " or say from where to where"
        if session.view.look != CIRCLE:
            other = ", or left with “mark by a box”; or click an arrow or a region"
        return [html.Span(f"Nothing is marked: drag a box at the right{other}.")]
    texts = []
    for component in seen.comparison.components:
        own = component.residual_um[rows & component.is_known]
        if own.size:
            spread = float(own.std(ddof=1)) if own.size > 1 else float("nan")
            texts.append(f"{component.name} {_mean(float(own.mean()), spread)}")
    figures = seen.comparison.figures_on(rows)
    marked = counted(int(rows.sum()), "row", grouped=True)
    told = f"{marked} marked: {um(figures.headline_um)} rms; mean ± spread {', '.join(texts)} µm"
    return [html.Span(told), button("Unmark", "unmark")]


def fall_graph(session: Session) -> Any:
    """Draw the error from model to model."""
    stages = story(session.steps, session.current, session.beside) if session.steps else ()
    if not stages:
        return html.Div()
    figure = error_fall(stages[-_STEPS_DRAWN:], is_numbered=True)
    noise = capitalised(figure.layout.title.subtitle.text)
    in_panel(figure, "fall", margin={"l": 10, "r": 40, "t": _ABOVE_PX, "b": _AXIS_PX})
    # In a narrow window Plotly's own legend takes a second line out of the bars.
    figure.update_layout(showlegend=False)
    # Plotly would write figures as small as bars are thin.
    figure.update_traces(constraintext="none", textfont_size=10, selector={"type": "bar"})
    # A bar's length is for the eye; its row must not be thinner than its text.
    height = f"calc({_AXIS_PX + _ABOVE_PX}px + {max(len(figure.data[0].y), _LEAST_MODELS)} * var(--bars))"
    return html.Div(
        [
            html.Div(
                [html.H2("How the error falls"), html.Span(noise, className="why")],
                className="headed",
            ),
            html.Div(
                [
                    *(_key(trace.marker.color, trace.name) for trace in reversed(figure.data)),
                    html.Span(session.beside.words),
                ],
                className="legend",
            ),
            dcc.Graph(figure=figure, config=WITHOUT_BUTTONS, responsive=True, style={"height": height}),
        ]
    )


def _key(color: str, text: str) -> Any:
    return html.Span([html.I(style={"background": color}), text])


def _mean(mean: float | None, spread: float | None) -> str:
    if mean is None:
        return "–"
    told = "" if spread is None or not np.isfinite(spread) else f" ± {spread:.1f}"
    return f"{signed(mean)}{told}"
