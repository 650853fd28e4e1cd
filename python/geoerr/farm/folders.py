"""A machine's folder: what in it is the machine, its measurements, its model, its programs."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from geoerr.errors import InputFileError
from geoerr.files import refusing_unreadable

TABLES = (".csv", ".parquet")
PROGRAMS = (".gcode", ".gco", ".g", ".nc", ".ngc", ".tap", ".cnc")
# Best first: what a model is read from.
MODELS = ("model.json", "errors.json")
# What belongs to the pictures of a session, and is no measurement.
_OF_SESSION = ("frames.csv",)
INPUTS = ("machine.toml", "rig.json", "effects.toml")
# A program as bytes takes its worker three times as much, and the caller six times.
MOST_SENT_BYTES = 1 << 29


@dataclass(frozen=True)
class FarmFolder:
    """What a machine's folder holds, by names relative to it.

    Attributes
    ----------
    path
        The folder.
    inputs
        machine.toml, rig.json, effects.toml (effects of the user's own), where they are.
    model
        model.json or errors.json that was given; None where it is to be made.
    tables
        Measured points and circular tests, in the order of their names.
    programs
        In the folder by their suffix; everything below its folder `programs`, behind links as well.
    is_session
        Whether it has pictures to be measured: session.toml, and no measurements yet.
    """

    path: Path
    inputs: tuple[str, ...]
    model: str | None
    tables: tuple[str, ...]
    programs: tuple[str, ...]
    is_session: bool

    @property
    def name(self) -> str:
        """The machine's name in results."""
        return name_of(self.path)

    def carried(self, names: Sequence[str]) -> dict[str, bytes]:
        """Give files as bytes.

        Raises
        ------
        InputFileError
            for a file that cannot be read.
        """
        return bytes_of({name: self.path / name for name in names})


def name_of(path: Path) -> str:
    """Name a machine as its folder is listed: a link is a machine of its own, whose name is the link's."""
    # Without following links, as `resolve` does.
    return Path(os.path.abspath(path)).name


def resolved(path: Path) -> Path:
    """Give a path with its links followed; links that lead round to each other are left, and end nothing."""
    # `Path.resolve` refuses those, some versions of Python with a RuntimeError.
    return Path(os.path.realpath(path))


def refuse_named_twice(path: Path, tables: Iterable[str]) -> None:
    """Refuse tables whose names differ in capitals alone: most often they are one, which would count twice.

    Raises
    ------
    InputFileError
        naming both.
    """
    named: dict[str, str] = {}
    for name in tables:
        other = named.setdefault(name.lower(), name)
        if other != name:
            raise InputFileError(
                path / name,
                f"has the name of {path / other} but for capitals: one table that is there twice would count twice",
                remedy="remove one of them, or give it another name",
            )


def refuse_to_send(path: Path) -> None:
    """Refuse a program that is too large to travel as bytes, of which a worker has several copies in its memory.

    Raises
    ------
    InputFileError
        where it has more than `MOST_SENT_BYTES`.
    """
    # One that cannot be read is told as it is read.
    n_bytes = path.stat().st_size if path.is_file() else 0
    if n_bytes > MOST_SENT_BYTES:
        raise InputFileError(
            path,
            f"has {n_bytes / 1e6:.0f} MB, and more than {MOST_SENT_BYTES / 1e6:.0f} are not sent to a worker that"
            " does not see the machine's folder and that of the results, or cannot write there",
            remedy="share both with the workers under the paths that they have here, or use `geoerr compensate`",
        )


def bytes_of(files: Mapping[str, Path]) -> dict[str, bytes]:
    """Give the bytes of files; refuse one that cannot be read by its name."""
    carried = {}
    for name, path in files.items():
        refuse_dangling(path)
        with refusing_unreadable(path):
            carried[name] = path.read_bytes()
    return carried


def read_folder(path: Path) -> FarmFolder:
    """Look into a machine's folder.

    Raises
    ------
    InputFileError
        for a folder that is none, or has nothing of a machine.
    """
    files = sorted(one.name for one in _listed(path) if _is_file(one) and not one.name.startswith("."))
    tables = tuple(name for name in files if name.lower().endswith(TABLES) and name not in _OF_SESSION)
    folder = FarmFolder(
        path,
        tuple(name for name in INPUTS if name in files),
        next((name for name in MODELS if name in files), None),
        tables,
        programs_in(path),
        is_session="session.toml" in files and not tables,
    )
    if folder.model is None and not folder.tables and not folder.is_session:
        raise InputFileError(
            path,
            "holds neither measurements nor a model",
            remedy="put machine.toml and measurements (.csv, .parquet), session.toml, or model.json there",
        )
    return folder


def programs_in(path: Path) -> tuple[str, ...]:
    """Give the programs of a machine's folder: those in it by their suffix, and all below its folder `programs`.

    Raises
    ------
    InputFileError
        for a folder that cannot be listed.
    """
    own = sorted(one.name for one in _listed(path) if _is_file(one) and one.name.lower().endswith(PROGRAMS))
    beneath = path / "programs"
    if beneath.is_dir():
        below = [one.relative_to(path) for one in _files_below(beneath)]
    else:
        # A link may lead nowhere: that is told as it is read.
        below = [Path(beneath.name)] if _is_dangling(beneath) else []
    return (
        *(name for name in own if not name.startswith(".")),
        *sorted(one.as_posix() for one in below if not any(name.startswith(".") for name in one.parts)),
    )


def _files_below(path: Path, around: tuple[Path, ...] = ()) -> Iterator[Path]:
    """Give the files in a folder and in those in it; a link that leads back, to a folder around it, has no others."""
    around = (*around, resolved(path))
    for one in _listed(path):
        if _is_file(one):
            yield one
        elif one.is_dir() and not any(outer.is_relative_to(resolved(one)) for outer in around):
            yield from _files_below(one, around)


def _is_file(path: Path) -> bool:
    """Say whether this is a file, or a link that leads nowhere: to be named, not passed over, as it is read."""
    return path.is_file() or _is_dangling(path)


def _is_dangling(path: Path) -> bool:
    return path.is_symlink() and not path.exists()


def refuse_dangling(path: Path) -> None:
    """Refuse a link that leads nowhere, by where it leads."""
    if _is_dangling(path):
        raise InputFileError(
            path, f"is a link to {path.readlink()}, which is not there", remedy="bring it there, or remove the link"
        )


def machine_paths(farm: Path, results: Path) -> list[Path]:
    """Give the machines' folders: those in `farm`, by name; or `farm`, where it is the folder of one machine.

    Results of an earlier run that stand there are no machine: a folder of folders.

    Raises
    ------
    InputFileError
        where there is no folder.
    """
    files = {one.name for one in _listed(farm)}
    if files & {"machine.toml", "session.toml", *MODELS}:
        return [farm]
    there = (one for one in _listed(farm) if one.is_dir() or _is_dangling(one))
    found = sorted(one for one in there if not one.name.startswith("."))
    found = [one for one in found if resolved(one) != resolved(results) or any(own.is_file() for own in _listed(one))]
    if not found:
        raise InputFileError(farm, "holds no folders of machines", remedy="make one for each machine")
    return found


def _listed(path: Path) -> list[Path]:
    refuse_dangling(path)
    try:
        return list(path.iterdir())
    except FileNotFoundError as error:
        raise InputFileError(path, "no such folder", remedy="check the name") from error
    except NotADirectoryError as error:
        raise InputFileError(path, "is a file, a folder is needed") from error
    except PermissionError as error:
        raise InputFileError(path, "cannot be read: permission denied") from error
