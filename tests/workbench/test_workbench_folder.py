"""The session's own folder: measurements that were dropped on the page are not left behind."""

from __future__ import annotations

import gc
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("dash")

from geoerr.workbench.session import Session

# Who runs the tests may ignore a signal, and what is ignored stays so in what is started.
HEARS_SIGNALS = """
import runpy, signal
for name in ("SIGTERM", "SIGHUP"):
    signal.signal(getattr(signal, name), signal.SIG_DFL)
signal.signal(signal.SIGINT, signal.default_int_handler)
{more}
runpy.run_module("geoerr", run_name="__main__")
"""

# The second signal comes in the midst of the clean-up.
HEARS_ONE_MORE = """
import os, shutil
take_away = shutil.rmtree
def rmtree(*args, **choices):
    os.kill(os.getpid(), signal.SIGINT)
    take_away(*args, **choices)
shutil.rmtree = rmtree
"""


def test_it_goes_with_the_session() -> None:
    session = Session()
    folder = session.folder
    (folder / "observations.csv").write_text("x,y,z,mx,my,mz\n")
    del session
    gc.collect()
    assert not folder.exists()


@pytest.mark.skipif(sys.platform == "win32", reason="Windows cannot tell another process to end in good order")
@pytest.mark.parametrize(
    ("name", "more"),
    [("SIGINT", ""), ("SIGTERM", ""), ("SIGHUP", ""), ("SIGINT", HEARS_ONE_MORE), ("SIGTERM", HEARS_ONE_MORE)],
)
def test_it_goes_when_the_server_is_told_to_end(name: str, more: str, tmp_path: Path) -> None:
    with subprocess.Popen(
        [sys.executable, "-c", HEARS_SIGNALS.format(more=more), "workbench", "--no-open", "--quiet"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        env={**os.environ, "TMPDIR": str(tmp_path), "PYTHONUNBUFFERED": "1"},
        text=True,
    ) as process:
        try:
            assert process.stdout is not None
            assert process.stdout.readline().startswith("http://127.0.0.1:")
            assert len(list(tmp_path.glob("geoerr-workbench-*"))) == 1
            process.send_signal(getattr(signal, name))
            assert process.wait(timeout=60) == 0
            assert process.stderr is not None
            assert process.stderr.read() == ""
        finally:
            process.kill()
    assert not list(tmp_path.glob("geoerr-workbench-*"))
