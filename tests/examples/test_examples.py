"""Every example runs as it stands, writes only where it is told, and prints what it is there to show."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from geoerr.cli.options import install_command

EXAMPLES = Path(__file__).parents[2] / "examples"
# One that hangs is stopped; how long one takes is for a quiet machine to say, not for a test.
SECONDS = 240
# What the others share.
SHARED = "virtual_machines.py"
ON_DASK = {"farm_on_a_cluster.py"}
# Example to what it has to say: what was put in is found, and what has to be refused is refused.
SAYS = {
    "circle_diagnosed.py": ["(servo-mismatch:xy)", "(squareness:xy)", "(backlash:x)", "\n    none above 0.8"],
    "farm_on_a_cluster.py": [
        "a worker is killed when 3 printers have a model",
        "20 files, the same bytes",
        "printer-6  missing: backlash:x",
        "printer-4/observations.csv:1: ",
    ],
    "folder_of_programs.sh": ["corner.gcode  ", "inches.ngc  ", "refused: programs/too-far.gcode:4: "],
    "how_sure.py": ["passes that were left out", "condition temp_bed                        3 °C"],
    "laser_run.py": ["(5 was put in)", "EXY: the y axis never moved"],
    "own_effect.py": ["depends on spool and x", "an effect is missing: the gantry bends under the spool"],
    "pictures_to_program.sh": ["18 of 18 error functions and 3 of 3 squarenesses", "largest error, µm"],
    "program_at_temperature.py": ["(steel has 11.5)", "120 °C: temp_bed = 120 is extrapolated"],
    "program_verified.sh": ["exit status 1: it is not let through"],
}


def scripts() -> list[str]:
    found = (path for path in EXAMPLES.iterdir() if path.suffix in (".py", ".sh") and path.name != SHARED)
    return sorted(path.name for path in found)


def test_every_example_has_something_to_say_and_a_line_in_the_table() -> None:
    assert scripts() == sorted(SAYS)
    table = (EXAMPLES / "README.md").read_text(encoding="utf-8")
    for name in scripts():
        assert f"| [{name}]({name}) |" in table


def test_an_example_that_needs_an_extra_says_how_to_have_it(tmp_path: Path) -> None:
    hidden = f"import runpy, sys; sys.modules['distributed'] = None; sys.path.insert(0, {str(EXAMPLES)!r})"
    code = f"{hidden}; runpy.run_path({str(EXAMPLES / 'farm_on_a_cluster.py')!r}, run_name='__main__')"
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 1
    hint = install_command("cluster")
    assert done.stderr == f"this example needs Dask: {hint}\n"


def left_there() -> set[Path]:
    """Give what lies beside the examples, but for what Python compiles of them where a worker imports one."""
    return {path for path in EXAMPLES.iterdir() if path.name != "__pycache__"}


@pytest.mark.parametrize("name", scripts())
def test_it_runs_and_says_so(name: str, tmp_path: Path) -> None:
    if name in ON_DASK:
        pytest.importorskip("distributed")
    programs = tmp_path / "bin"
    programs.mkdir()
    for program, arguments in (("geoerr", " -m geoerr"), ("python", "")):
        (programs / program).write_text(f'#!/bin/sh\nexec "{sys.executable}"{arguments} "$@"\n')
        (programs / program).chmod(0o755)
    environment = os.environ | {
        "PATH": f"{programs}{os.pathsep}{os.environ['PATH']}",
        "PYTHONDONTWRITEBYTECODE": "1",
        "TMPDIR": str(tmp_path),
    }
    command = ["bash" if name.endswith(".sh") else sys.executable, str(EXAMPLES / name), str(tmp_path / "out")]
    there = left_there()
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    done = subprocess.run(
        command, env=environment, cwd=elsewhere, capture_output=True, text=True, timeout=SECONDS, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert "Traceback" not in done.stderr
    for words in SAYS[name]:
        assert words in done.stdout
    assert not list(elsewhere.iterdir())
    assert left_there() == there
    assert list((tmp_path / "out").iterdir())
