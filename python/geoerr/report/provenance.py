"""Where a result comes from: versions, command, and digests of the inputs. Never a date, never a machine's name."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from geoerr import __version__
from geoerr.files import digest
from geoerr.installation import versions


@dataclass(frozen=True)
class Provenance:
    """What has to be said so that somebody else gets the same result.

    Attributes
    ----------
    version
        Of geoerr.
    command
        The command line that gives the result.
    inputs
        File name and SHA-256 of each input.
    runs_on
        Versions of Python and of the libraries that numbers are made with, by name; for reports.
    """

    version: str
    command: str
    inputs: tuple[tuple[str, str], ...] = ()
    runs_on: tuple[tuple[str, str], ...] = field(default_factory=versions)

    def to_document(self) -> dict[str, Any]:
        """Give it as plain values, for `--json`."""
        return {"version": self.version, "command": self.command, "inputs": dict(self.inputs)}


def provenance_of_command(inputs: Iterable[str | Path | None]) -> Provenance:
    """Describe the command that is running; files that were not given (None) and standard input have no digest."""
    files = [path for path in inputs if path is not None and str(path) != "-" and Path(path).is_file()]
    return Provenance(
        version=__version__,
        command=shlex.join(["geoerr", *sys.argv[1:]]),
        inputs=tuple((str(path), digest(path)) for path in files),
    )


def provenance_of_call(name: str, sources: Iterable[str]) -> Provenance:
    """Describe a Python call by its name, and by the files that its tables were read from."""
    files = dict.fromkeys(source for source in sources if Path(source).is_file())
    return Provenance(__version__, f"{name}(...)", tuple((source, digest(source)) for source in files))
