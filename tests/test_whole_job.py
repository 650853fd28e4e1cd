"""The whole job from the command line, on small pictures: every verb, its files, its JSON, its exit status."""

from __future__ import annotations

import contextlib
import io
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
import pytest

from geoerr.cli.main import run
from geoerr.demo.programs.make import grid_program, plate_program
from geoerr.error_functions import ALL_NAMES, read_errors
from geoerr.machine import write_machine
from geoerr.simulate.nine_lines import NineLines, nine_line_plan
from geoerr.simulate.plan import write_plan

SMALL = NineLines(
    seed=3,
    n_points=5,
    both_directions=False,
    image_size_px=(1224, 1024),
    board_views=6,
)
# The paper's way, from pictures to proof; the joint fit has tests of its own.
NINE_LINE = ("--method", "nine-line")


def program(*arguments: str | Path, status: int = 0) -> subprocess.CompletedProcess[str]:
    """Run geoerr as a program of its own."""
    command = [sys.executable, "-m", "geoerr", *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=240, check=False)
    assert done.returncode == status, done.stderr
    return done


def geoerr(*arguments: str | Path) -> str:
    """Run the same in this process, where libraries are loaded already; give standard output."""
    out, messages = io.StringIO(), io.StringIO()
    with (
        patch.object(sys, "argv", ["geoerr", *map(str, arguments)]),
        contextlib.redirect_stdout(out),
        contextlib.redirect_stderr(messages),
        pytest.raises(SystemExit) as ended,
    ):
        run()
    assert ended.value.code == 0, messages.getvalue()
    return out.getvalue()


def document(*arguments: str | Path) -> Any:
    return json.loads(geoerr(*arguments, "--json", "--quiet"))


@pytest.fixture(scope="module")
def job(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder in which every verb has run once, with two threads; `calibrate` and `measure` as JSON."""
    folder = tmp_path_factory.mktemp("job")
    write_plan(folder / "plan.toml", nine_line_plan(SMALL))
    (folder / "grid.gcode").write_text(grid_program())
    share = ("--threads", "2")
    session, observations = folder / "session", folder / "observations.csv"
    program("simulate", folder / "plan.toml", "-o", session, *share, "--quiet")
    done = program("calibrate", session, "-o", folder / "rig.json", *share, "--quiet", "--json")
    (folder / "calibrate.json").write_text(done.stdout)
    rig = ("--rig", folder / "rig.json")
    done = program("measure", session, *rig, "-o", observations, *share, "--quiet", "--json")
    (folder / "measure.json").write_text(done.stdout)
    machine = ("--machine", session / "machine.toml")
    program("identify", observations, *machine, *rig, *NINE_LINE, "-o", folder / "errors.json", *share)
    program("compensate", folder / "errors.json", folder / "grid.gcode", "-o", folder / "corrected.gcode", *share)
    return folder


def test_the_errors_are_found_within_their_uncertainty(job: Path) -> None:
    found, truth = read_errors(job / "errors.json"), read_errors(job / "session" / "truth.json")
    assert {*found.functions, *found.squareness} == set(ALL_NAMES)
    sigmas = []
    for name, function in found.functions.items():
        assert function.std is not None
        counts = function.std > 0
        difference = function.value - truth.functions[name].at(function.position_mm)
        sigmas += (np.abs(difference[counts]) / function.std[counts]).tolist()
    # 72 values, correlated in groups; 3 of 100 seeds would leave fewer than this inside if the intervals are right.
    assert np.mean(np.array(sigmas) < 1.96) > 0.8
    assert max(sigmas) < 5.0


def test_the_correction_is_proven_on_the_true_machine(job: Path) -> None:
    truth = job / "session" / "truth.json"
    path = document("verify", "path", truth, job / "grid.gcode", job / "corrected.gcode")
    assert path["max_error_um_before"] > 500.0
    assert path["max_error_um_after"] < 0.05 * path["max_error_um_before"]
    assert path["extrusion_in_mm"] == pytest.approx(path["extrusion_out_mm"], abs=1e-9)
    own = document("verify", "path", job / "errors.json", job / "grid.gcode", job / "corrected.gcode")
    # The tolerance, and half a digit of four decimals in three axes.
    assert own["max_error_um_after"] <= 5.0 + 0.1
    circle = document("verify", "ballbar", job / "errors.json", "--truth", truth)
    assert circle["after"]["ccw"]["circular_deviation_um"] < 0.05 * circle["before"]["ccw"]["circular_deviation_um"]


def test_json_has_the_contracts_keys(job: Path) -> None:
    calibrated, measured = (json.loads((job / f"{verb}.json").read_text()) for verb in ("calibrate", "measure"))
    assert {
        "pairs_used",
        "pairs_dropped",
        "left_rms_px",
        "right_rms_px",
        "stereo_rms_px",
        "held_out_rms_px",
        "baseline_mm",
        "per_view",
    } <= set(calibrated)
    assert {"frames", "observations", "missed"} <= set(measured)
    assert measured["frames"] == 15


@pytest.mark.parametrize("threads", ["1", "8"])
def test_threads_change_no_byte(job: Path, tmp_path: Path, threads: str) -> None:
    session, share = job / "session", ("--threads", threads, "--quiet")
    rig, observations = tmp_path / "rig.json", tmp_path / "observations.csv"
    geoerr("calibrate", session, "-o", rig, *share)
    assert rig.read_bytes() == (job / "rig.json").read_bytes()
    geoerr("measure", session, "--rig", rig, "-o", observations, *share)
    assert observations.read_bytes() == (job / "observations.csv").read_bytes()
    errors = tmp_path / "errors.json"
    machine = ("--machine", session / "machine.toml")
    geoerr("identify", observations, *machine, "--rig", rig, *NINE_LINE, "-o", errors, *share)
    assert errors.read_bytes() == (job / "errors.json").read_bytes()
    corrected = tmp_path / "corrected.gcode"
    geoerr("compensate", errors, job / "grid.gcode", "-o", corrected, *share)
    assert corrected.read_bytes() == (job / "corrected.gcode").read_bytes()


def test_measure_calibrates_where_there_is_no_rig(job: Path, tmp_path: Path) -> None:
    geoerr("measure", job / "session", "-o", tmp_path / "observations.csv", "--quiet")
    assert (tmp_path / "observations.csv").read_bytes() == (job / "observations.csv").read_bytes()


def test_a_nominal_machine_returns_programs_byte_for_byte(tmp_path: Path) -> None:
    write_machine(tmp_path / "machine.toml", nine_line_plan(NineLines(n_points=2)).machine)
    for name, text in (("grid.gcode", grid_program()), ("plate.ngc", plate_program())):
        (tmp_path / name).write_text(text)
        geoerr("compensate", tmp_path / "machine.toml", tmp_path / name, "-o", tmp_path / "out", "--quiet")
        assert (tmp_path / "out").read_text() == text


def test_exit_status_and_where_messages_go(job: Path, tmp_path: Path) -> None:
    refused = program("identify", tmp_path / "absent.csv", "--machine", job / "session" / "machine.toml", status=1)
    assert refused.stdout == ""
    assert "absent.csv: no such file" in refused.stderr
    assert "Traceback" not in refused.stderr
    program("identify", status=2)
    program("no-such-verb", status=2)
    assert "geoerr" in program("--version").stdout


@pytest.mark.skipif(os.name == "nt", reason="signals work otherwise there")
def test_an_interrupt_ends_with_130_and_leaves_nothing_half_written(tmp_path: Path) -> None:
    write_plan(tmp_path / "plan.toml", nine_line_plan(SMALL))
    command = [
        sys.executable,
        "-m",
        "geoerr",
        "simulate",
        str(tmp_path / "plan.toml"),
        "-o",
        str(tmp_path / "session"),
    ]
    running = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    deadline = time.monotonic() + 60
    while not list(tmp_path.glob(".session*")) and time.monotonic() < deadline:
        time.sleep(0.05)
    running.send_signal(signal.SIGINT)
    assert running.wait(timeout=60) == 130
    assert [path.name for path in tmp_path.iterdir()] == ["plan.toml"]
