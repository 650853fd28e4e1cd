"""A folder among the results for what workers write there themselves: it is no result before it is moved away."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from shutil import rmtree
from tempfile import mkdtemp
from typing import IO

_PREFIX = ".geoerr-farm-"
# The caller holds it as long as the folder is in use: a process that is killed lets it go.
_HELD = "held"


@contextmanager
def staging_in(results: Path) -> Iterator[Path | None]:
    """Give a new folder in that of the results, for this call alone, and remove it; None where none can be made.

    Those of calls that were killed are removed first.
    """
    with suppress(OSError):
        results.mkdir(parents=True, exist_ok=True)
        _remove_left(results)
    try:
        folder = Path(mkdtemp(prefix=_PREFIX, dir=results))
        held = (folder / _HELD).open("wb")
    except OSError:
        yield None
        return
    try:
        with held:
            _hold(held)
            # Workers may be elsewhere: they are told a path that does not depend on where the caller stands.
            yield folder.absolute()
    finally:
        rmtree(folder, ignore_errors=True)


def _remove_left(results: Path) -> None:
    for folder in results.glob(f"{_PREFIX}*"):
        if not _is_held(folder / _HELD):
            rmtree(folder, ignore_errors=True)


def _is_held(path: Path) -> bool:
    """Say whether a call is at work that holds this file; where that cannot be told it is taken to be."""
    if sys.platform == "win32":
        # What a process has open cannot be removed there.
        with suppress(FileNotFoundError):
            try:
                path.unlink()
            except OSError:
                return True
        return False
    try:
        # Network disks lock only what is open for writing.
        with path.open("r+b") as stream:
            return not _hold(stream)
    except FileNotFoundError:
        return False
    except OSError:
        return True


def _hold(stream: IO[bytes]) -> bool:
    """Lock a file; say whether that was possible."""
    if sys.platform == "win32":
        return True
    import fcntl

    try:
        fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return False
    return True
