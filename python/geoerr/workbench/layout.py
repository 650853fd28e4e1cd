"""The page: three columns, and what is done with the result below them."""

from __future__ import annotations

from typing import Any

from dash import dcc, html

from geoerr.workbench.clicks import button_id
from geoerr.workbench.panel_given import upload
from geoerr.workbench.panel_missing import own_panel
from geoerr.workbench.panel_use import use_panel
from geoerr.workbench.panel_where import where_panel
from geoerr.workbench.session import Session

# How often the page asks for news: while work is under way, and otherwise, for another page may have begun some.
BEAT_MS, RESTING_BEAT_MS = 600, 3000
# What a first glance does not see: part of the page to its heading.
_BELOW = {"program": "Correct a program", "report": "Report"}


def page(session: Session) -> Any:
    """Make the page as the session stands: after a reload it is as it was."""
    return html.Div(
        [
            html.A("To the pictures", href="#where", className="skip"),
            html.Header(
                [
                    html.H1([html.Span("geoerr"), " workbench"]),
                    html.P("Why is this machine not where it should be?", className="why"),
                    html.Nav(
                        [html.A(text, href=f"#{name}-heading") for name, text in _BELOW.items()],
                        **{"aria-label": "Below on this page"},
                    ),
                    html.Div([html.Div(id="under-way"), html.Div(id="stop")], id="status", role="status"),
                ]
            ),
            html.Aside([upload(), html.Div(id="given")], className="left"),
            html.Main([*where_panel(session), html.Div(id="fall")], id="where"),
            html.Aside([html.Div(id="missing"), own_panel(session)], className="right"),
            html.Div(use_panel(), className="below"),
            dcc.Store(id="tick", data=session.version),
            dcc.Store(id="sight", data=session.sight),
            dcc.Store(id="shown", data={}),
            dcc.Store(id="hovered", data=""),
            dcc.Store(id="limited", data=session.view.variable),
            dcc.Store(id="box"),
            dcc.Store(id="view-box"),
            dcc.Store(id="marks", data=0.0),
            dcc.Store(id="drawn"),
            dcc.Store(id="pinned", data=""),
            dcc.Store(id="webgl"),
            dcc.Interval(id="beat", interval=RESTING_BEAT_MS),
        ],
        className="page",
    )


def status(session: Session) -> list[Any]:
    """Say what is under way, and how far it is."""
    job = session.job
    if job is None:
        return [html.Span("ready", className="why")]
    done, total = job.progress
    # One that runs to and fro is drawn sixty times a second, without a graphics card by what should be computing.
    bar = [html.Progress(value=str(done), max=str(total))] if total else []
    step = f": {job.step}" if job.step else ""
    return [
        html.Span(f"{job.title}{step}", className="step", title=job.step),
        html.Span(f"{job.elapsed_s:.0f} s"),
        *bar,
    ]


def stop(session: Session) -> list[Any]:
    """Offer to stop what is under way."""
    if not session.is_busy:
        return []
    return [html.Button("Stop", id=button_id("stop"), n_clicks=0, type="button")]
