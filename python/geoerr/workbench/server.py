"""The workbench served: on loopback, on one port, until it is stopped."""

from __future__ import annotations

import logging
import socket
from collections.abc import Callable, Sequence
from pathlib import Path

from werkzeug.serving import make_server

from geoerr.errors import GeoerrError, InputFileError
from geoerr.workbench.actions import read_again, take_files
from geoerr.workbench.app import make_app
from geoerr.workbench.inputs import named
from geoerr.workbench.security import HOST, Guard
from geoerr.workbench.session import Session
from geoerr.workbench.store import restore, save


def begin_session(paths: Sequence[Path], saved_in: Path | None, *, threads: int = 0) -> Session:
    """Begin with files, or go on with a saved session; reading and comparing goes on in the background.

    Files that are named beside a saved session are those that it has: the same command line begins and goes on.

    Raises
    ------
    InputFileError
        for a file that cannot be read, a session whose data have changed or that has other files than those named,
        and a place for the session that holds something else.
    """
    session = Session(saved_in=saved_in, threads=threads, on_saved_change=save)
    if saved_in is not None and saved_in.exists():
        _refuse_input(saved_in, paths)
        restore(session, saved_in)
        _refuse_others(session, saved_in, paths)
        read_again(session, tuple(session.files), is_new_model=False, keeps=True)
    elif paths:
        take_files(session, named(paths))
    return session


def _refuse_input(saved_in: Path, paths: Sequence[Path]) -> None:
    """Refuse to keep the session where one of its files is."""
    if any(path.exists() and path.samefile(saved_in) for path in paths):
        raise InputFileError(saved_in, "is an input of this session", remedy="name another --session")


def _refuse_others(session: Session, saved_in: Path, paths: Sequence[Path]) -> None:
    """Refuse files that the saved session does not have: its work is never begun anew over it."""
    earlier = (one for chapter in session.earlier for one in chapter.files)
    known = {one.path.resolve() for one in (*session.files, *earlier)}
    others = [path for path in paths if path.resolve() not in known]
    if others:
        raise InputFileError(
            saved_in,
            f"holds a session without {', '.join(map(str, others))}",
            remedy="go on with it without naming files, and add others on the page, or name another --session",
        )


def serve(session: Session, port: int, on_ready: Callable[[str], None]) -> None:
    """Serve until the person stops it; `on_ready` is called with the address, token included.

    Raises
    ------
    GeoerrError
        where the port is taken.
    """
    try:
        listener = socket.create_server((HOST, port))
    except OSError as error:
        raise GeoerrError(f"port {port} cannot be had ({error.strerror})\nhint: leave --port out") from error
    with listener:
        guard = Guard(int(listener.getsockname()[1]))
        # One line for every request would drown the address.
        logging.getLogger("werkzeug").setLevel(logging.ERROR)
        server = make_server(HOST, guard.port, make_app(session, guard).server, threaded=True, fd=listener.fileno())
        try:
            on_ready(guard.url)
            server.serve_forever()
        except KeyboardInterrupt:
            session.stop()
