"""Reports of the session: each is written in the background, and kept until what it tells has changed."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import TypeAlias

from geoerr import __version__
from geoerr.diagnose.circles import CircleDiagnosis
from geoerr.errors import GeoerrError
from geoerr.files import digest
from geoerr.report.compare_page import write_comparison_page
from geoerr.report.diagnosis_page import write_circle_diagnosis_page, write_diagnosis_page
from geoerr.report.model_page import write_model_page
from geoerr.report.model_report import Stated, model_report
from geoerr.report.provenance import Provenance
from geoerr.workbench.actions import REPORT
from geoerr.workbench.job import Advance
from geoerr.workbench.program import conditions_of
from geoerr.workbench.session import Session

# Report to what a person reads.
REPORTS = {
    "model": "All that is known of the machine",
    "comparison": "How far and where the model is off",
    "diagnosis": "What is missing, and how sure that is",
}
# Writes a report to a file.
Writer: TypeAlias = Callable[[Path, Advance], None]


def can_write(session: Session, name: str) -> bool:
    """Tell whether the session has what a report tells."""
    has = {
        "model": bool(session.steps),
        "comparison": session.seen is not None,
        "diagnosis": session.diagnosis is not None,
    }
    return has.get(name, False)


def write(session: Session, name: str) -> None:
    """Write a report, beside everything else: it can be opened when it is done.

    Raises
    ------
    GeoerrError
        where there is nothing to report, or other work is under way.
    """
    with session.lock:
        if not can_write(session, name):
            raise GeoerrError("there is nothing to report yet")
        writer, told_of = _WRITERS[name](session), _what_is_told(session)

    def work(advance: Advance) -> Callable[[], None]:
        advance(0, 1)
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "page.html"
            writer(path, advance)
            text = path.read_text(encoding="utf-8")

        def apply() -> None:
            with session.lock:
                if _what_is_told(session) == told_of:
                    session.reports[name] = text
                else:
                    session.show_problem(REPORT, "what the report tells has changed meanwhile\nhint: write it again")

        return apply

    session.begin("writing the report", REPORT, work)


def provenance_of(session: Session) -> Provenance:
    """Say where the session's results come from: the same files on the command line begin the same session."""
    names = " ".join(one.name for one in session.files)
    inputs = tuple((one.name, digest(one.path)) for one in session.files)
    return Provenance(__version__, f"geoerr workbench {names}", inputs)


def _what_is_told(session: Session) -> tuple[object, ...]:
    return session.step, session.seen, session.diagnosis, dict(session.view.conditions)


def _of_model(session: Session) -> Writer:
    model, diagnosis, threads = session.model, session.diagnosis, session.threads
    tables = () if session.measured is None else session.measured.tables
    at: Stated = {**conditions_of(model, session.view.conditions)}
    calibration, provenance = vars(session.calibration), provenance_of(session)

    def writer(path: Path, advance: Advance) -> None:
        # The numbers are one half of the work, the page the other.
        gathered = model_report(
            model,
            *tables,
            at=at,
            search=False,
            diagnosis=diagnosis,
            progress=lambda done, total: advance(done, 2 * total),
            on_step=advance.say,
            threads=threads,
            **calibration,
        )
        write_model_page(path, gathered, provenance, lambda done, total: advance(total + done, 2 * total))

    return writer


def _of_comparison(session: Session) -> Writer:
    assert session.seen is not None
    comparison, provenance = session.seen.comparison, provenance_of(session)
    return lambda path, advance: write_comparison_page(
        path, comparison, comparison.to_document(), provenance, advance
    )


def _of_diagnosis(session: Session) -> Writer:
    diagnosis, provenance = session.diagnosis, provenance_of(session)
    assert diagnosis is not None
    if isinstance(diagnosis, CircleDiagnosis):
        return lambda path, _: write_circle_diagnosis_page(path, diagnosis, provenance)
    return lambda path, _: write_diagnosis_page(path, diagnosis, provenance)


_WRITERS: dict[str, Callable[[Session], Writer]] = {
    "model": _of_model,
    "comparison": _of_comparison,
    "diagnosis": _of_diagnosis,
}
