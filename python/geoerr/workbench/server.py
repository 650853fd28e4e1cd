"""The workbench served: on loopback, on one port, until it is stopped."""

from __future__ import annotations

import logging
import socket
from collections.abc import Callable, Sequence
from pathlib import Path

from werkzeug.serving import make_server

from geoerr.errors import GeoerrError
from geoerr.workbench.actions import read_again, take_files
from geoerr.workbench.app import make_app
from geoerr.workbench.inputs import InputFile, kind_of_file
from geoerr.workbench.security import HOST, Guard
from geoerr.workbench.session import Session
from geoerr.workbench.store import restore, save


def begin_session(paths: Sequence[Path], saved_in: Path | None, *, threads: int = 0) -> Session:
    """Begin with files, or go on with a saved session; reading and comparing goes on in the background.

    Raises
    ------
    InputFileError
        for a file that cannot be read, or a session whose data have changed.
    """
    session = Session(saved_in=saved_in, threads=threads, on_saved_change=save)
    files = [InputFile(path.name, path, kind_of_file(path)) for path in paths]
    if saved_in is not None and saved_in.exists() and not files:
        restore(session, saved_in)
        read_again(session, tuple(session.files), is_new_model=False, keeps=True)
    elif files:
        take_files(session, files)
    return session


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
        on_ready(guard.url)
        try:
            server.serve_forever()
        except KeyboardInterrupt:
            session.stop()
