"""`geoerr farm`: a line a machine, what failed and why, one document with `--json`, and a cluster by its address."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from contextlib import ExitStack
from pathlib import Path

import pytest
from small_farm import contents

OPTIONS = ("--do", "fit", "--do", "diagnose", "--do", "compensate", "--components", "none", "--add", "scale:x")


def geoerr_farm(farm: Path, *more: str, status: int = 0) -> str:
    command = [sys.executable, "-m", "geoerr", "farm", str(farm), "-o", str(farm.parent / "out"), *OPTIONS, *more]
    # Where pytest has a width to fit, the command would fit it too.
    environment = {**os.environ, "COLUMNS": ""}
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=120, env=environment)
    assert done.returncode == status, done.stdout + done.stderr
    assert "Traceback" not in done.stderr
    return done.stdout


def test_every_machine_has_a_line_and_every_failure_a_reason(farm: Path, right_bytes: dict[str, bytes]) -> None:
    (farm / "mill-1/programs/corner.gcode").write_text("G21\nG90\nG0 X10 Y10 Z20\nG1 X999\n")
    lines = geoerr_farm(farm, "--threads", "1", status=1).splitlines()
    assert lines[0] == "mill-0  missing: backlash:x; 1 of 1 programs corrected"
    assert lines[1] == "mill-1  missing: backlash:x; 0 of 1 programs corrected"
    assert lines[3].endswith("; 2 of 2 programs corrected")
    assert lines[5] == "failed:"
    assert lines[6].startswith(f"  mill-1: {farm}/mill-1/programs/corner.gcode:4: ")
    assert lines[7].startswith("  hint: ")
    assert lines[-1] == "4 machines, 1 of them with a failure"
    missing = {"mill-1/programs/corner.gcode"}
    assert contents(farm.parent / "out") == {k: v for k, v in right_bytes.items() if k not in missing}


def test_warnings_are_told_once_for_all_programs(farm: Path) -> None:
    for number in (0, 2):
        (farm / f"mill-{number}/programs/corner.gcode").write_text("G21\nG90\nG0 X10 Y10 Z20\nG2 X20 Y20 I10 J0\n")
    lines = geoerr_farm(farm, "--threads", "1", "--on-unsupported", "pass").splitlines()
    assert lines[5] == "warnings:"
    assert lines[6].startswith("  mill-0/programs/corner.gcode, mill-2/programs/corner.gcode: line 4: `G2 X20")
    assert lines[7:] == ["", "4 machines, 0 of them with a failure"]


def test_programs_without_a_corrected_move_are_told_apart(farm: Path) -> None:
    """Each by its name, however many: who runs one runs what nobody corrected."""
    programs = farm / "mill-0/programs"
    for number in range(4):
        (programs / f"note-{number}.txt").write_text("G21\nM5\n")
    (programs / "readme.txt").write_text("hello\n")
    (programs / "empty.gcode").write_text("")
    (farm / "mill-1/programs/corner.gcode").write_text("G21\nG91\nG1 X5 F1200\nG1 Y5\n")
    lines = geoerr_farm(farm, "--threads", "1").splitlines()
    assert lines[0].endswith("; 1 of 7 programs corrected")
    assert lines[1].endswith("; 0 of 1 programs corrected")
    assert lines[3].endswith("; 2 of 2 programs corrected")
    warned = lines[lines.index("warnings:") + 1 :]
    notes = ", ".join(f"mill-0/programs/note-{number}.txt" for number in range(4))
    for told in (
        f"  {notes}: no move was read in 2 lines: nothing was corrected; is it G-code?",
        "  mill-0/programs/readme.txt: no move was read in 1 line: nothing was corrected; is it G-code?",
        "  mill-0/programs/empty.gcode: the program is empty: nothing was corrected",
        "  mill-1/programs/corner.gcode: the position is nowhere known: nothing was corrected, 2 moves passed through"
        " untouched",
    ):
        assert told in warned
    assert lines[-1] == "4 machines, 0 of them with a failure"


@pytest.mark.parametrize("has_cluster", [False, True])
def test_programs_are_corrected_as_compensate_is_told_to(
    farm: Path, right_bytes: dict[str, bytes], has_cluster: bool
) -> None:
    """It knew five of ten options."""
    (farm / "mill-0/model.json").write_bytes(right_bytes["mill-0/model.json"])
    # Beyond what was measured: it is refused where it is not held.
    (farm / "mill-0/programs/corner.gcode").write_text("G21\nG90\nG0 X10 Y10 Z20\nG1 X199 Y10 F1200\nG1 Y150\n")
    told = ("--outside-measured", "hold", "--digits", "3", "--firmware-corrects", "squareness", "--keep-uncertain")
    told += ("--extrapolate", "--firmware", "marlin", "--tolerance", "0.01")
    command = [sys.executable, "-m", "geoerr", "compensate", "model.json", "programs/corner.gcode", "-o", "out.gcode"]
    done = subprocess.run([*command, *told], cwd=farm / "mill-0", capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    wanted = (farm / "mill-0/out.gcode").read_bytes()
    (farm / "mill-0/out.gcode").unlink()
    with ExitStack() as stack:
        more: tuple[str, ...] = ("--threads", "1")
        if has_cluster:
            distributed = pytest.importorskip("distributed")
            options = {"n_workers": 1, "threads_per_worker": 1, "dashboard_address": "127.0.0.1:0"}
            more = ("--scheduler", stack.enter_context(distributed.LocalCluster(**options)).scheduler_address)
        geoerr_farm(farm / "mill-0", *told, *more)
    assert (farm / "out/mill-0/programs/corner.gcode").read_bytes() == wanted
    assert b"tolerance 0.01 mm" in wanted


def test_a_cluster_is_given_by_its_address(farm: Path, right_bytes: dict[str, bytes]) -> None:
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(n_workers=1, threads_per_worker=1, dashboard_address="127.0.0.1:0") as cluster:
        document = json.loads(geoerr_farm(farm, "--scheduler", cluster.scheduler_address, "--json"))
    assert document["machines"] == 4
    assert document["machines_with_failures"] == 0
    first = document["outcomes"][0]
    assert first.pop("says").endswith(" µm, 90 rows")
    assert first == {
        "machine": "mill-0",
        "step": "fit",
        "program": None,
        "files": ["mill-0/model.json"],
        "error": None,
        "notes": [],
    }
    assert contents(farm.parent / "out") == right_bytes
