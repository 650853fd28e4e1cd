"""The files that a session has: given on the command line, or dropped on the page."""

from __future__ import annotations

import base64
import gzip
import re
import tempfile
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from geoerr.errors import InputFileError
from geoerr.files import digest, refusing_unreadable

Kind = Literal["model", "measurements", "effects", "rig"]
# Of these the newest stands for the earlier ones.
ONE_OF_A_KIND: tuple[Kind, ...] = ("model", "rig")
_TABLES = (".csv", ".parquet")
_DOCUMENTS = (".toml", ".json")
_TAKEN = (
    "measurements are .csv or .parquet (save a spreadsheet as CSV), machines and own effects .toml, models and rigs "
    ".json; a program is corrected further down the page"
)
# Each dropped file has a folder of its own.
_DROPPED = "dropped-"


@dataclass(frozen=True)
class InputFile:
    """One file.

    Attributes
    ----------
    name
        As people know it.
    path
        Where it can be read.
    kind
        What it holds.
    is_dropped
        Whether it came through the page: then its content belongs to the session.
    """

    name: str
    path: Path
    kind: Kind
    is_dropped: bool = False

    def to_document(self) -> dict[str, Any]:
        """Give it for a session's file: what was dropped with its content, the rest by path and digest."""
        document: dict[str, Any] = {"name": self.name, "kind": self.kind}
        if self.is_dropped:
            packed = gzip.compress(self.path.read_bytes(), mtime=0)
            return document | {"content": base64.b64encode(packed).decode("ascii")}
        return document | {"path": str(self.path.resolve()), "sha256": digest(self.path)}


def kind_of_file(path: Path) -> Kind:
    """Tell by its content what a file is.

    A table is measurements, a `.toml` with effects effects, a `.json` with two cameras a rig; others are models.

    Raises
    ------
    InputFileError
        for a file that cannot be read, or of another kind.
    """
    suffix = path.suffix.lower()
    if suffix in _TABLES:
        return "measurements"
    if suffix not in _DOCUMENTS:
        raise InputFileError(path, "is of no kind that is taken here", remedy=_TAKEN)
    with refusing_unreadable(path):
        content = path.read_bytes()
    if suffix == ".json" and b'"K_left"' in content:
        return "rig"
    return "effects" if suffix == ".toml" and b"[[effect]]" in content else "model"


def named(paths: Sequence[Path]) -> list[InputFile]:
    """Take files as a command line names them, each once; of one name they are told apart by their folders.

    Raises
    ------
    InputFileError
        for a file that cannot be read.
    """
    places = {path.resolve(): path for path in paths}
    return [InputFile(_short_name(place, places), path, kind_of_file(path)) for place, path in places.items()]


def _short_name(place: Path, places: Collection[Path]) -> str:
    """Give the last parts of a path, as many as no other path ends with."""
    others = [other.parts for other in places if other != place and other.name == place.name]
    n_parts = 1
    while any(other[-n_parts:] == place.parts[-n_parts:] for other in others):
        n_parts += 1
    return "/".join(place.parts[-n_parts:])


def dropped(folder: Path, name: str, content: bytes) -> InputFile:
    """Keep a file that was dropped on the page in the session's own folder, beside an earlier one of its name.

    Whether it can be used shows when it is read: until then the earlier one has to stay as it is.
    """
    known = Path(name).name
    if not known or known.startswith("."):
        raise InputFileError(name or "the file", "has no name that can be used", remedy="rename it")
    path = Path(tempfile.mkdtemp(prefix=_DROPPED, dir=folder)) / known
    path.write_bytes(content)
    return InputFile(known, path, kind_of_file(path), is_dropped=True)


def as_known(text: str, folder: Path) -> str:
    """Name dropped files in a text as the person knows them, not where they were put."""
    return re.sub(rf"{re.escape(str(folder))}/(?:{_DROPPED}[^/]*/)?", "", text)


def from_document(document: Mapping[str, Any], folder: Path, source: Path) -> InputFile:
    """Give a file of a saved session again.

    Raises
    ------
    InputFileError
        where a file that the session names is gone, or is another one by now.
    """
    if "content" in document:
        content = gzip.decompress(base64.b64decode(document["content"]))
        return dropped(folder, str(document["name"]), content)
    path = Path(document["path"])
    if digest(path) != document["sha256"]:
        raise InputFileError(
            path,
            f"has changed since the session {source} was saved",
            remedy="name the files on the command line, and another --session, to begin anew",
        )
    return InputFile(str(document["name"]), path, document["kind"])
