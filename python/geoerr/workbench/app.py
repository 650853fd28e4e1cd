"""The page as a Dash application: offline, guarded, with its session."""

from __future__ import annotations

from importlib import resources

from dash import Dash

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
    )
    guard.protect(app.server)
    add_routes(app.server, session)
    app.layout = lambda: page(session)
    wire(app, session)
    return app
