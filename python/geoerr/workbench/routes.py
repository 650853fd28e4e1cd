"""Pages beside the page: reports, and the model's file."""

from __future__ import annotations

import tempfile
from pathlib import Path

from flask import Flask, Response

from geoerr import __version__
from geoerr.diagnose import Diagnosis
from geoerr.diagnose.circles import CircleDiagnosis
from geoerr.errors import GeoerrError
from geoerr.files import digest, to_json
from geoerr.model.document import document_of
from geoerr.report.compare_page import write_comparison_page
from geoerr.report.diagnosis_page import write_circle_diagnosis_page, write_diagnosis_page
from geoerr.report.model_page import write_model_page
from geoerr.report.model_report import Stated, model_report
from geoerr.report.provenance import Provenance
from geoerr.workbench.program import conditions_of
from geoerr.workbench.session import Session


def add_routes(server: Flask, session: Session) -> None:
    """Serve them."""

    @server.get("/report/model")
    def _whole() -> Response:
        return _page(session, "model")

    @server.get("/report/comparison")
    def _comparison() -> Response:
        return _page(session, "comparison")

    @server.get("/report/diagnosis")
    def _diagnosis() -> Response:
        return _page(session, "diagnosis")

    @server.get("/model.json")
    def _model() -> Response:
        with session.lock:
            if session.step is None:
                return Response("there is no model yet\n", status=404, mimetype="text/plain")
            text = to_json(document_of(session.model))
        answer = Response(text, mimetype="application/json")
        answer.headers["Content-Disposition"] = "attachment; filename=model.json"
        return answer


def provenance_of(session: Session) -> Provenance:
    """Say where the session's results come from: the same files on the command line begin the same session."""
    names = " ".join(one.name for one in session.files)
    inputs = tuple((one.name, digest(one.path)) for one in session.files)
    return Provenance(__version__, f"geoerr workbench {names}", inputs)


def _page(session: Session, what: str) -> Response:
    try:
        return _made(session, what)
    except GeoerrError as error:
        return Response(f"{error}\n", status=409, mimetype="text/plain")


def _made(session: Session, what: str) -> Response:
    with session.lock:
        provenance = provenance_of(session)
        seen, diagnosis, step = session.seen, session.diagnosis, session.step
        tables = () if session.measured is None else (*session.measured.tables, *session.measured.lengths)
        conditions, calibration = dict(session.view.conditions), vars(session.calibration)
    # Seconds of work, of what never changes: the page beside it goes on meanwhile.
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "page.html"
        if what == "model" and step is not None:
            at: Stated = {**conditions_of(step.model, conditions)}
            gathered = model_report(
                step.model,
                *tables,
                at=at,
                search=False,
                diagnosis=diagnosis,
                threads=session.threads,
                **calibration,
            )
            write_model_page(path, gathered, provenance)
        elif what == "comparison" and seen is not None:
            write_comparison_page(path, seen.comparison, seen.comparison.to_document(), provenance)
        elif what == "diagnosis" and isinstance(diagnosis, Diagnosis):
            write_diagnosis_page(path, diagnosis, provenance)
        elif what == "diagnosis" and isinstance(diagnosis, CircleDiagnosis):
            write_circle_diagnosis_page(path, diagnosis, provenance)
        else:
            return Response("there is nothing to report yet\n", status=404, mimetype="text/plain")
        return Response(path.read_text(encoding="utf-8"), mimetype="text/html")
