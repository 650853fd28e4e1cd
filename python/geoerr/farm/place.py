"""Where a program stands and its result will: a worker that sees both works from file to file."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from uuid import uuid4

from geoerr.farm.folders import FarmFolder, refuse_dangling
from geoerr.files import refusing_unreadable


@dataclass(frozen=True)
class Place:
    """A program and its result, by paths that may be the same files where a worker is.

    Attributes
    ----------
    folder
        The machine's folder.
    program
        The program's name in it.
    n_bytes, modified_ns
        Of the program: what has the path on another computer may be another file.
    result
        Where the result will be; what is there already and is the same is not written again.
    told_as
        The result as the caller names it.
    staging
        Folder among the results, with a name that no other call has: who sees it sees the results.
    """

    folder: str
    program: str
    n_bytes: int
    modified_ns: int
    result: str
    told_as: str
    staging: str

    @property
    def source(self) -> Path:
        """The program."""
        return Path(self.folder, self.program)

    def is_seen(self) -> bool:
        """Whether the program can be read here, and the result written."""
        try:
            with self.source.open("rb") as stream:
                found = os.fstat(stream.fileno())
        except OSError:
            return False
        is_same = (found.st_size, found.st_mtime_ns) == (self.n_bytes, self.modified_ns)
        return is_same and os.access(self.staging, os.W_OK | os.X_OK)

    def new_part(self) -> Path:
        """Name a file that is not there yet: whoever does the job again meanwhile writes another."""
        return Path(self.staging, uuid4().hex)


def place_of(folder: FarmFolder, program: str, result: Path, staging: Path) -> Place:
    """Give where a program stands and its result will.

    Raises
    ------
    InputFileError
        for a program that cannot be read.
    """
    path = folder.path / program
    refuse_dangling(path)
    with refusing_unreadable(path), path.open("rb") as stream:
        found = os.fstat(stream.fileno())
    return Place(
        os.path.abspath(folder.path),
        program,
        found.st_size,
        found.st_mtime_ns,
        os.path.abspath(result),
        str(result),
        str(staging),
    )
