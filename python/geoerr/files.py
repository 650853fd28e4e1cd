"""Files that are whole or absent: atomic writing, one form of JSON and TOML, digests."""

from __future__ import annotations

import contextlib
import errno
import hashlib
import json
import math
import os
import shutil
import tempfile
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any, TypeGuard

from geoerr.errors import InputFileError, ShapeError

# What only writing meets, and of which the system does not say with which file: a full disk, a limit of a file's
# size, a user's share of a disk.
_NO_ROOM = (errno.ENOSPC, errno.EFBIG, errno.EDQUOT)
_MAKE_ROOM = "make room on its disk, or name an output on another"
_IS_JSON = "this is JSON, as models and tables of errors are: name the .toml file"
_TOML_REMEDY = "correct that line: tables are written as [name], keys as name = value; or name the .toml file"
_UNUSABLE = "write the file again: it is of another kind, or was changed"
MAKE_ROOM_FOR_COPIES = "make room there, or set TMPDIR to a folder on another disk"


@contextlib.contextmanager
def whole_or_absent(path: str | Path) -> Iterator[Path]:
    """Give a temporary path beside `path`; move it to `path` only when the block ends well.

    An interrupted or failed block leaves an earlier file at `path` as it was. A link stays one. What is no file, such
    as /dev/null or a pipe, is given what was written.
    """
    target = Path(path)
    refuse_no_file(target)
    if target.exists() and not target.is_file():
        with tempfile.TemporaryDirectory() as folder:
            temporary = Path(folder) / target.name
            with refusing_full(folder, MAKE_ROOM_FOR_COPIES):
                yield temporary
            with refusing_full(path), temporary.open("rb") as written, target.open("wb") as stream:
                shutil.copyfileobj(written, stream)
        return
    target = target.resolve()
    try:
        handle, name = tempfile.mkstemp(dir=target.parent, prefix=f".{target.name}.", suffix=".part")
    except OSError as error:
        remedy = _MAKE_ROOM if is_full(error) else "name an output in a folder that can be written to"
        raise InputFileError(path, f"cannot be written: {error.strerror}", remedy=remedy) from error
    os.close(handle)
    temporary = Path(name)
    try:
        with refusing_full(path):
            yield temporary
        umask = os.umask(0)
        os.umask(umask)
        temporary.chmod(0o666 & ~umask)
        temporary.replace(target)
    finally:
        temporary.unlink(missing_ok=True)


def is_full(error: BaseException | None) -> TypeGuard[OSError]:
    """Say whether there was no room for what was written."""
    return isinstance(error, OSError) and error.errno in _NO_ROOM


@contextlib.contextmanager
def refusing_full(path: str | Path, remedy: str = _MAKE_ROOM) -> Iterator[None]:
    """Turn what the system says of a full disk into a refusal that names what the block writes.

    Parameters
    ----------
    path
        What the block writes.
    remedy
        What to do.
    """
    try:
        yield
    except OSError as error:
        if not is_full(error):
            raise
        raise InputFileError(path, f"cannot be written: {error.strerror}", remedy=remedy) from error


def refuse_no_file(output: Path) -> None:
    """Refuse an output that cannot be a file: its folder does not exist, or it is one itself.

    Raises
    ------
    InputFileError
        naming it.
    """
    if not output.parent.is_dir():
        raise InputFileError(
            output,
            f"the folder {output.parent} does not exist",
            remedy="create it first or name another output",
        )
    if output.is_dir():
        raise InputFileError(output, "is a folder, a file is needed", remedy="name a file in it")


def check_written(path: object, value: object, kind: type, call: str) -> None:
    """Refuse arguments of a function that writes which are not what it takes; most often they are swapped.

    Parameters
    ----------
    path, value
        What was given.
    kind
        Class of what is written.
    call
        How the function is called.

    Raises
    ------
    ShapeError
        with the argument, what was given, and the call.
    """
    name = call.partition(", ")[2].rstrip(")")
    if not isinstance(path, str | os.PathLike):
        raise ShapeError(f"path: a value of type {type(path).__name__} was given where a file is named\nhint: {call}")
    if not isinstance(value, kind):
        raise ShapeError(
            f"{name}: a value of type {type(value).__name__} was given where {kind.__name__} is needed\nhint: {call}"
        )


def write_text(path: str | Path, text: str) -> None:
    """Write a text file as UTF-8 with Unix line ends, whole or not at all."""
    with whole_or_absent(path) as temporary:
        temporary.write_bytes(text.encode("utf-8"))


def to_json(document: Any) -> str:
    """Turn a document into geoerr's one form of JSON: two spaces, keys as given, no NaN, a final newline."""
    return json.dumps(document, indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def null_for_nan(document: Any) -> Any:
    """Give a document with null where a number is not computable."""
    if isinstance(document, dict):
        return {key: null_for_nan(value) for key, value in document.items()}
    if isinstance(document, list | tuple):
        return [null_for_nan(value) for value in document]
    return None if isinstance(document, float) and not math.isfinite(document) else document


def write_json(path: str | Path, document: Any) -> None:
    """Write `to_json(document)`, whole or not at all."""
    write_text(path, to_json(document))


def read_json(path: str | Path) -> Any:
    """Read a JSON file; refuse a missing or malformed one by name, row and column."""
    text = _read_utf8(path)
    try:
        return json.loads(text)
    except json.JSONDecodeError as error:
        raise InputFileError(
            path,
            f"not valid JSON: {error.msg} (character {error.colno})",
            row=error.lineno,
            remedy="write the file again: it was cut short, changed, or is of another kind",
        ) from error
    except (ValueError, RecursionError) as error:
        # A number of thousands of digits, or lists within lists without end.
        raise InputFileError(path, f"not usable JSON: {error}", remedy=_UNUSABLE) from error


def read_toml(path: str | Path) -> dict[str, Any]:
    """Read a TOML file; refuse a missing or malformed one by name and place."""
    text = _read_utf8(path)
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        remedy = _IS_JSON if text.lstrip().startswith("{") else _TOML_REMEDY
        raise InputFileError(path, f"not valid TOML: {error}", remedy=remedy) from error
    except (ValueError, RecursionError) as error:
        # A number of thousands of digits, or tables within tables without end.
        raise InputFileError(path, f"not usable TOML: {error}", remedy=_UNUSABLE) from error


def digest(path: str | Path) -> str:
    """SHA-256 of a file's bytes, in hexadecimal."""
    with Path(path).open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


@contextlib.contextmanager
def refusing_unreadable(path: str | Path, kind: str = "file") -> Iterator[None]:
    """Turn what the system says of a file that cannot be opened into a refusal that names it.

    Parameters
    ----------
    path
        The file that the block opens.
    kind
        What it should be: `file`, `picture`, `table` ...
    """
    try:
        yield
    except FileNotFoundError as error:
        raise InputFileError(path, f"no such {kind}", remedy="check the name and the folder") from error
    except IsADirectoryError as error:
        raise InputFileError(
            path, f"is a folder, a {kind} is needed", remedy=_remedy_for_folder(Path(path))
        ) from error
    except OSError as error:
        raise InputFileError(path, f"cannot be read: {(error.strerror or str(error)).lower()}") from error


def _remedy_for_folder(folder: Path) -> str:
    """Say what to name in place of a folder; a session's is often named for what is made of it."""
    if not (folder / "session.toml").is_file():
        return "name a file in it"
    return "it is a session: name one of its files, or the observations that `geoerr measure` makes of it"


def _read_utf8(path: str | Path) -> str:
    with refusing_unreadable(path):
        content = Path(path).read_bytes()
    try:
        # Some editors begin a file with a mark of its encoding.
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputFileError(
            path, f"not a text file: byte {error.start} is not UTF-8", remedy="save it as UTF-8 text"
        ) from error
