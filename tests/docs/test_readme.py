"""The commands of README that find what is missing run as they stand, from a clone's top folder."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]


def commands(name: str) -> str:
    """Give the lines under the mark of that name."""
    found = re.search(
        rf"<!-- command: {name} -->\n```sh\n(.*?)```", (ROOT / "README.md").read_text(encoding="utf-8"), re.DOTALL
    )
    assert found is not None
    return found.group(1)


def test_what_is_missing_is_found_added_and_corrected(tmp_path: Path) -> None:
    shutil.copytree(ROOT / "examples", tmp_path / "examples")
    programs = tmp_path / ".venv" / "bin"
    programs.mkdir(parents=True)
    (programs / "geoerr").write_text(f'#!/bin/sh\nexec "{sys.executable}" -m geoerr "$@"\n')
    (programs / "geoerr").chmod(0o755)
    (programs / "activate").write_text(f'PATH="{programs}:$PATH"\n')
    script = f"set -eu\n{commands('missing')}"
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(path for path in sys.path if path)}
    done = subprocess.run(
        ["bash", "-c", script], cwd=tmp_path, env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert "Effects are missing: backlash of the drive (backlash:x) and thermal expansion of" in done.stdout
    comment = re.search(r"# (nothing is missing.*)", commands("missing"))
    assert comment is not None
    assert comment.group(1) in " ".join(done.stdout.split()).lower()
    assert "what is left is noise, as far as can be told" in done.stdout
    left = {path.name for path in (tmp_path / "my-machine").iterdir()}
    assert {"board.pdf", "report.html", "budget.html", "part-corrected.gcode"} <= left
