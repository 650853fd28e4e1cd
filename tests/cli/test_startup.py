"""What starting costs: help loads no numerical library, and a verb only what it needs."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

from geoerr.cli.main import VERBS

HEAVY = ("numpy", "scipy", "polars", "cv2", "plotly", "reportlab")
# What the declarations of verbs are made of.
LIGHT = {"geoerr", "geoerr._core", "geoerr.errors", "geoerr.cli"}
CODE = """
import contextlib, io, json, sys
from geoerr.cli.main import app
printed = []
for words in json.loads(sys.argv[1]):
    sys.argv = ["geoerr", *words]
    with contextlib.redirect_stdout(io.StringIO()) as text, contextlib.suppress(SystemExit):
        app()
    printed.append(text.getvalue())
print(json.dumps([printed, sorted(sys.modules)]))
"""


def after(*commands: list[str]) -> tuple[list[str], set[str]]:
    """Run commands in one fresh interpreter; give what each printed, and what was loaded."""
    done = subprocess.run(
        [sys.executable, "-c", CODE, json.dumps(commands)], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    printed, loaded = json.loads(done.stdout)
    return printed, set(loaded)


def test_help_loads_no_numerical_library() -> None:
    asked = [[], *([verb] for verb in VERBS), *(["verify", name] for name in ("ballbar", "workpiece", "path"))]
    printed, loaded = after(*([*words, "--help"] for words in asked))
    for words, text in zip(asked, printed, strict=True):
        assert text.startswith(" ".join(["Usage: geoerr", *words, "[OPTIONS]"])), text
    assert not loaded & set(HEAVY)
    own = {name for name in loaded if name.startswith("geoerr") and not name.startswith("geoerr.cli.")}
    assert own == LIGHT


def test_a_reader_that_goes_away_is_no_failure() -> None:
    """`geoerr doctor | head -1`, as a script with `set -o pipefail` sees it."""
    with subprocess.Popen(
        [sys.executable, "-m", "geoerr", "doctor"], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        process.stdout.close()
        assert process.stderr.read() == ""
    assert process.returncode == 0


def test_a_full_disk_is_one_message(full_device: Path) -> None:
    with full_device.open("w") as full:
        done = subprocess.run(
            [sys.executable, "-m", "geoerr", "doctor"], stdout=full, stderr=subprocess.PIPE, text=True, check=False
        )
    assert (done.returncode, done.stderr) == (1, "error: standard output: No space left on device\n")


def test_the_list_of_verbs_loads_none_of_them() -> None:
    (text,), loaded = after(["--help"])
    for verb, words in VERBS.items():
        assert f"  {verb:<10}  {words}\n" in text
    assert not {name for name in loaded if name.startswith("geoerr.cli.")} - {"geoerr.cli.main"}


def test_who_reads_no_table_loads_no_library_for_tables() -> None:
    """It takes a third of the start of a verb that rewrites a program."""
    code = "import sys, geoerr.compensate.program, geoerr.verify.path; sys.exit('polars' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
