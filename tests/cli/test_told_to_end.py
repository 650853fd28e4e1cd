"""A verb that is told to end (SIGTERM, SIGHUP) cleans up as after Ctrl-C: no half-written file stays behind."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="Windows cannot tell another process to end")

MACHINE = '[machine]\nname = "mill"\nchain = "wbXYZt"\n' + "".join(
    f"[axes.{axis}]\nrange = [0.0, 200.0]\n" for axis in "xyz"
)
PROGRAM = b"G21\nG90\nG0 X10 Y10 Z20\n"
# Who runs the tests may ignore a signal, and what is ignored stays so in what is started.
HEARS_SIGNALS = """
import runpy, signal, sys
for name in ("SIGTERM", "SIGHUP"):
    signal.signal(getattr(signal, name), signal.{how})
{more}
runpy.run_module("geoerr", run_name="__main__")
"""
# The second signal comes in the midst of the clean-up, as where a terminal is closed.
HEARS_ONE_MORE = """
import os, pathlib
unlink = pathlib.Path.unlink
def twice(*args, **choices):
    os.kill(os.getpid(), signal.SIGHUP)
    unlink(*args, **choices)
pathlib.Path.unlink = twice
"""


@contextmanager
def writing(folder: Path, how: str = "SIG_DFL", more: str = "") -> Iterator[subprocess.Popen[bytes]]:
    """Give a verb that has begun its output, and waits for a program."""
    (folder / "machine.toml").write_text(MACHINE)
    code = HEARS_SIGNALS.format(how=how, more=more)
    words = ["compensate", str(folder / "machine.toml"), "-", "-o", str(folder / "out.gcode")]
    command = [sys.executable, "-c", code, *words]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        try:
            deadline_s = time.monotonic() + 60.0
            while not list(folder.glob(".out.gcode.*.part")) and time.monotonic() < deadline_s:
                time.sleep(0.02)
            yield process
        finally:
            process.kill()


@pytest.mark.parametrize(
    ("name", "more"), [("SIGTERM", ""), ("SIGHUP", ""), ("SIGTERM", HEARS_ONE_MORE)], ids=["term", "hup", "twice"]
)
def test_nothing_half_written_stays_behind(tmp_path: Path, name: str, more: str) -> None:
    number = getattr(signal, name)
    (tmp_path / "out.gcode").write_text("earlier\n")
    with writing(tmp_path, more=more) as process:
        process.send_signal(number)
        assert process.wait(timeout=60) == 128 + number
        assert process.stderr is not None
        assert process.stderr.read() == b""
    assert sorted(path.name for path in tmp_path.iterdir()) == ["machine.toml", "out.gcode"]
    assert (tmp_path / "out.gcode").read_text() == "earlier\n"


def test_what_is_ignored_stays_ignored(tmp_path: Path) -> None:
    """`nohup geoerr ...` goes on where the terminal is closed."""
    with writing(tmp_path, how="SIG_IGN") as process:
        process.send_signal(signal.SIGHUP)
        process.communicate(PROGRAM, timeout=60)
        assert process.returncode == 0
    assert (tmp_path / "out.gcode").read_bytes() == PROGRAM


def test_who_says_so_again_later_does_not_wait(tmp_path: Path) -> None:
    """A clean-up that takes too long can be broken off without SIGKILL."""
    slow = "import pathlib, time\nimport geoerr.cli.main as main\nmain._CLEAN_UP_S = 0.0\n"
    slow += "pathlib.Path.unlink = lambda *_, **__: (print('cleaning', flush=True), time.sleep(60))\n"
    with writing(tmp_path, more=slow) as process:
        process.send_signal(signal.SIGTERM)
        assert process.stdout is not None
        assert process.stdout.readline() == b"cleaning\n"
        process.send_signal(signal.SIGTERM)
        assert process.wait(timeout=30) == -signal.SIGTERM


def test_signals_of_a_program_that_uses_geoerr_are_its_own() -> None:
    code = "import signal, geoerr, geoerr.cli.main; print(signal.getsignal(signal.SIGTERM) is signal.SIG_DFL)"
    code = "import signal; signal.signal(signal.SIGTERM, signal.SIG_DFL); " + code
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "True\n"
