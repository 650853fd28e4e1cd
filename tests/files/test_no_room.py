"""A full disk is told with the file that there was no room for; an earlier output is left as it was."""

from __future__ import annotations

import errno
import os
import subprocess
import sys
from pathlib import Path

import pytest

from geoerr.errors import InputFileError
from geoerr.files import whole_or_absent

HINT = "hint: make room on its disk, or name an output on another"


def write_half(target: Path, number: int) -> None:
    """Write until the system says that something is wrong."""
    with whole_or_absent(target) as temporary:
        temporary.write_text("half")
        raise OSError(number, os.strerror(number))


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EFBIG, errno.EDQUOT])
def test_no_room_names_the_file_and_a_remedy(tmp_path: Path, number: int) -> None:
    target = tmp_path / "part.nc"
    target.write_text("earlier")
    with pytest.raises(InputFileError) as told:
        write_half(target, number)
    assert str(told.value) == f"{target}: cannot be written: {os.strerror(number)}\n{HINT}"
    assert {path.name: path.read_text() for path in tmp_path.iterdir()} == {"part.nc": "earlier"}


def test_another_failure_of_the_system_is_not_blamed_on_the_output(tmp_path: Path) -> None:
    with pytest.raises(OSError, match=os.strerror(errno.EIO)):
        write_half(tmp_path / "part.nc", errno.EIO)


def test_a_program_that_finds_no_room_is_named_by_the_command(tmp_path: Path, full_device: Path) -> None:
    """It said "standard output"."""
    (tmp_path / "machine.toml").write_text(
        '[machine]\nname = "mill"\nchain = "wbXYZt"\n' + "".join(f"[axes.{a}]\nrange = [0, 200]\n" for a in "xyz")
    )
    (tmp_path / "part.nc").write_text("G21\nG90\nG1 X1 Y1 Z1\n")
    done = subprocess.run(
        [sys.executable, "-m", "geoerr", "compensate", "machine.toml", "part.nc", "-o", str(full_device), "--quiet"],
        capture_output=True,
        text=True,
        check=False,
        cwd=tmp_path,
    )
    assert done.returncode == 1
    assert done.stderr == f"error: {full_device}: cannot be written: {os.strerror(errno.ENOSPC)}\n{HINT}\n"
