"""The page as a Dash application: offline, guarded, with its session."""

from __future__ import annotations

import logging
from importlib import resources

from dash import Dash, set_props

from geoerr.workbench.actions import DATA
from geoerr.workbench.job import slip_words
from geoerr.workbench.layout import page
from geoerr.workbench.routes import add_routes
from geoerr.workbench.security import Guard
from geoerr.workbench.session import Session
from geoerr.workbench.wiring import wire


def make_app(session: Session, guard: Guard) -> Dash:
    """Make it; every script and style comes from this computer."""
    app = Dash(
        "geoerr.workbench",
        title="geoerr workbench",
        update_title="",
        assets_folder=str(resources.files("geoerr.workbench") / "assets"),
        serve_locally=True,
        suppress_callback_exceptions=True,
        on_error=lambda error: _tell(session, error),
    )
    guard.protect(app.server)
    add_routes(app.server, session)
    app.layout = lambda: page(session)
    wire(app, session)
    return app


def _tell(session: Session, error: Exception) -> None:
    """Show what went wrong while the page was answered, once, where it would only stand still."""
    logging.getLogger(__name__).error("the page could not be answered", exc_info=error)
    said = slip_words(error)
    if session.problems.get(DATA) != said:
        session.show_problem(DATA, said)
        session.changed()
        set_props("tick", {"data": session.version})
