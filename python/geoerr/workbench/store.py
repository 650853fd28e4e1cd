"""A session's file: everything that cannot be had again by a click, and what the page says of a diagnosis.

The diagnosis itself, with every number behind it, is not in it: pictures of what candidates explain, and a report,
come with the same search again, which takes seconds, where its numbers would take megabytes.
"""

from __future__ import annotations

import base64
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from geoerr.errors import InputFileError
from geoerr.files import read_json, write_json
from geoerr.model.document import document_of, model_from_document
from geoerr.workbench.history import Chapter, Step
from geoerr.workbench.inputs import from_document
from geoerr.workbench.session import Rows, Session
from geoerr.workbench.told import Told
from geoerr.workbench.view import View

SCHEMA = "geoerr-workbench/1"


def save(session: Session) -> None:
    """Write the session to its file, whole or not at all."""
    assert session.saved_in is not None
    write_json(session.saved_in, session_document(session))


def session_document(session: Session) -> dict[str, Any]:
    """Give plain values."""
    return {
        "schema": SCHEMA,
        **_chapter_document(session.chapter),
        "earlier": [_chapter_document(one) for one in session.earlier],
        "view": session.view.to_document(),
        "selected": None if session.selected is None else _packed(session.selected),
    }


def restore(session: Session, path: Path) -> None:
    """Take files, models and choices from a session's file; what follows from them is computed by whoever loads it.

    Raises
    ------
    InputFileError
        for a file that is none of a session, or that names data which have changed since.
    """
    document = _session_in(path)
    try:
        chapter = _chapter_from(document, session, path)
        session.files, session.steps = list(chapter.files), list(chapter.steps)
        session.current, session.reference, session.told = chapter.current, chapter.reference, chapter.told
        # Sessions from before it was kept have none.
        session.earlier = tuple(_chapter_from(one, session, path) for one in document.get("earlier", ()))
        session.view = View.from_document(document["view"])
        session.selected = None if document["selected"] is None else _unpacked(document["selected"])
    except (KeyError, TypeError, ValueError, IndexError, AttributeError) as error:
        if isinstance(error, InputFileError):
            raise
        raise InputFileError(path, f"is damaged ({error})", remedy="name another file") from error


def _chapter_document(chapter: Chapter) -> dict[str, Any]:
    return {
        "files": [one.to_document() for one in chapter.files],
        "steps": [
            {
                "name": step.name,
                "parent": step.parent,
                "figures": dict(step.figures),
                "rows": step.rows,
                "model": document_of(step.model),
            }
            for step in chapter.steps
        ],
        "current": chapter.current,
        "reference": chapter.reference,
        "diagnosis": None if chapter.told is None else chapter.told.to_document(),
    }


def _chapter_from(document: Mapping[str, Any], session: Session, path: Path) -> Chapter:
    steps = tuple(
        Step(
            str(one["name"]),
            model_from_document(one["model"], path),
            one["parent"],
            {name: value for name, value in one["figures"].items()},
            # Sessions from before it was kept have none: the models are compared again.
            str(one.get("rows", "")),
        )
        for one in document["steps"]
    )
    # Sessions from before it was kept have none.
    told = document.get("diagnosis")
    chapter = Chapter(
        tuple(from_document(one, session.folder, path) for one in document["files"]),
        steps,
        int(document["current"]),
        int(document["reference"]),
        None if told is None else Told.from_document(told),
    )
    if steps:
        _ = steps[chapter.current], steps[chapter.reference]
    return chapter


def _session_in(path: Path) -> dict[str, Any]:
    """Read a session's document; what is none may be measurements that a slip of the keyboard named."""
    try:
        document = read_json(path)
    except InputFileError as error:
        raise InputFileError(
            path, f"is no session of the workbench: {error.problem}", row=error.row, remedy="name another --session"
        ) from error
    if not isinstance(document, dict) or document.get("schema") != SCHEMA:
        raise InputFileError(path, f"is no session of the workbench ({SCHEMA})", remedy="name another --session")
    return document


def _packed(rows: Rows) -> dict[str, Any]:
    return {"n": len(rows), "bits": base64.b64encode(np.packbits(rows).tobytes()).decode("ascii")}


def _unpacked(document: dict[str, Any]) -> Rows:
    bits = np.frombuffer(base64.b64decode(document["bits"]), dtype=np.uint8)
    return np.unpackbits(bits, count=int(document["n"])).astype(bool)
