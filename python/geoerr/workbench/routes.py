"""Pages beside the page: reports that were written, and the model's file."""

from __future__ import annotations

from flask import Flask, Response

from geoerr.files import to_json
from geoerr.model.document import document_of
from geoerr.workbench.session import Session


def add_routes(server: Flask, session: Session) -> None:
    """Serve them."""

    @server.get("/report/<name>")
    def _report(name: str) -> Response:
        text = session.reports.get(name)
        if text is None:
            said = "this report is not written, or what it told has changed: write it on the page\n"
            return Response(said, status=404, mimetype="text/plain")
        return Response(text, mimetype="text/html")

    @server.get("/model.json")
    def _model() -> Response:
        with session.lock:
            if session.step is None:
                return Response("there is no model yet\n", status=404, mimetype="text/plain")
            text = to_json(document_of(session.model))
        answer = Response(text, mimetype="application/json")
        answer.headers["Content-Disposition"] = "attachment; filename=model.json"
        return answer
