"""Results in their places: each whole or absent, and what is there already as it should be is not written again."""

from __future__ import annotations

import errno
import shutil
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import IO

from geoerr.errors import InputFileError
from geoerr.farm.folders import resolved
from geoerr.files import refuse_no_file, refusing_full, whole_or_absent

_BLOCK_BYTES = 1 << 20


def write_result(path: Path, content: bytes) -> None:
    """Write what a worker sent."""
    _make_folder(path)
    if not _holds(path, content):
        with whole_or_absent(path) as temporary:
            temporary.write_bytes(content)


def move_result(part: Path, path: Path) -> None:
    """Move what a worker wrote; to another disk, and to what is no file, it is copied."""
    _make_folder(path)
    refuse_no_file(path)
    # A link stays one.
    target = resolved(path)
    if target.is_file() or not target.exists():
        try:
            part.replace(target)
            return
        except OSError as error:
            if error.errno != errno.EXDEV:
                raise
    with whole_or_absent(path) as temporary:
        shutil.copyfile(part, temporary)
    part.unlink()


def _make_folder(path: Path) -> None:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputFileError(
            path.parent,
            f"no folder for results can be made: {error.strerror}",
            remedy="name another folder for the results, or remove the file in its place",
        ) from error


def _holds(path: Path, content: bytes) -> bool:
    """Say whether a file is there already as it should be: what is not written needs no room on a full disk."""
    blocks = (content[start : start + _BLOCK_BYTES] for start in range(0, len(content), _BLOCK_BYTES))
    with suppress(OSError):
        if path.is_file() and path.stat().st_size == len(content):
            with path.open("rb") as stream:
                return all(stream.read(len(block)) == block for block in blocks) and not stream.read(1)
    return False


class Successor:
    """A file that is written only as far as it is not there already: from the first byte that differs.

    Parameters
    ----------
    opened
        What closes its files.
    there
        What it may be the same as.
    part
        Where it is written otherwise.
    """

    def __init__(self, opened: ExitStack, there: Path, part: Path) -> None:
        self._opened, self._part = opened, part
        self._there: IO[bytes] | None = None
        self._written: IO[bytes] | None = None
        self._n_same = 0
        # One that cannot be read is to be replaced.
        with suppress(OSError):
            self._there = opened.enter_context(there.open("rb")) if there.is_file() else None

    @property
    def is_written(self) -> bool:
        """Whether it differs from what is there, as far as it came."""
        return self._written is not None

    def write(self, block: bytes, /) -> int:
        """Take a block; give its length."""
        if self._written is None:
            if self._there is not None and self._there.read(len(block)) == block:
                self._n_same += len(block)
                return len(block)
            self._written = self._begun()
        return self._written.write(block)

    def end(self) -> None:
        """Have all of it on the disk; what is there may be longer, or nothing is."""
        if self._written is None and (self._there is None or self._there.read(1)):
            self._written = self._begun()
        if self._written is not None:
            self._written.close()

    def _begun(self) -> IO[bytes]:
        """Begin the file with what was the same."""
        stream = self._opened.enter_context(self._part.open("xb"))
        if self._there is not None:
            self._there.seek(0)
            for start in range(0, self._n_same, _BLOCK_BYTES):
                stream.write(self._there.read(min(_BLOCK_BYTES, self._n_same - start)))
        return stream


@contextmanager
def successor_of(there: Path, part: Path, told_as: str) -> Iterator[Successor]:
    """Give what is written to `part` where it is not what is there; a block that fails leaves nothing.

    Parameters
    ----------
    there
        The result of an earlier call, or nothing.
    part
        A file that is not there yet.
    told_as
        What a refusal names where there is no room.
    """
    with refusing_full(told_as), ExitStack() as opened:
        try:
            successor = Successor(opened, there, part)
            yield successor
            successor.end()
        except BaseException:
            # What could not be written cannot be when the file is closed either.
            with suppress(OSError):
                opened.close()
            part.unlink(missing_ok=True)
            raise
