"""`geoerr doctor`: what it says of an installation and of files, and its exit status."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import cv2
import numpy as np
import pytest
from typer.testing import CliRunner

import geoerr
from geoerr.cli import doctor_checks
from geoerr.cli.main import app
from geoerr.machine import write_machine
from geoerr.vision.images import write_png

MACHINE = geoerr.Machine.from_chain("wZbXYt", (400.0, 300.0, 250.0), name="printer 7")
PICTURE = np.arange(1200, dtype=np.uint16).reshape(30, 40).astype(np.uint8)
POINTS = "line,repeat,x,y,z,mx,my,mz\nx,0,0,0,0,1,2,3\nx,0,5,0,0,6,2,3\nx,0,five,0,0,6,2,3\n"
RIG = {
    "schema": 1,
    "K_left": [[2000.0, 0.0, 600.0], [0.0, 2000.0, 500.0], [0.0, 0.0, 1.0]],
    "dist_left": [0.0] * 5,
    "K_right": [[2000.0, 0.0, 600.0], [0.0, 2000.0, 500.0], [0.0, 0.0, 1.0]],
    "dist_right": [0.0] * 5,
    "right_from_left": {"R": [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], "t_mm": [-300.0, 0.0, 0.0]},
    "image_size": [1200, 1000],
    "covariance": None,
}


def doctor(*arguments: str | Path, status: int = 0) -> str:
    done = CliRunner().invoke(app, ["doctor", *map(str, arguments)])
    assert done.exit_code == status, done.output
    return done.stdout


def document(*arguments: str | Path, status: int = 0) -> Any:
    return json.loads(doctor(*arguments, "--json", status=status))


def test_this_installation_is_well_and_every_requirement_is_looked_at() -> None:
    found = document()
    states = {check["name"]: check["state"] for check in found["installation"]}
    assert found["ok"]
    assert "wrong" not in states.values()
    project = tomllib.loads((Path(__file__).parents[2] / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    required = {re.split("[<>=]", text)[0] for text in project["dependencies"]}
    assert required == set(doctor_checks.LIBRARIES)
    assert required < set(states)
    assert set(project["optional-dependencies"]) - {"docs", "test"} == set(doctor_checks.EXTRAS)


def test_each_kind_of_file_is_named_for_what_it_is(tmp_path: Path) -> None:
    machine, points, rig, model = (tmp_path / name for name in ("m.toml", "p.csv", "rig.json", "errors.json"))
    write_machine(machine, MACHINE)
    points.write_text(POINTS, encoding="utf-8")
    rig.write_text(json.dumps(RIG), encoding="utf-8")
    geoerr.write_errors(model, geoerr.ErrorFunctions(MACHINE, {}, {}, method="by hand"))
    own = tmp_path / "own.toml"
    own.write_text(
        '[[effect]]\nid = "my-gap"\nchannel = "along"\naxes = ["x"]\nexpression = "b*d"\n'
        '[effect.coefficients.b]\nunit = "mm"\n',
        encoding="utf-8",
    )
    texts = [check["text"] for check in document(machine, points, rig, model, own)["files"]]
    assert texts == [
        "machine 'printer 7': wZbXYt, x 0 to 400 mm, y 0 to 300 mm, z 0 to 250 mm",
        f"2 measured points, 1 row set aside: {points}:4: x: 'five' is not a number",
        "camera pair, 1200 × 1000 px, 300.0 mm apart, without covariance: --rig will refuse it",
        "the errors of 'printer 7'",
        "own effects: my-gap",
    ]


@pytest.fixture
def session(tmp_path: Path) -> Path:
    """Four pairs of board pictures and three frames, each of a few pixels."""
    folder = tmp_path / "session"
    for side in ("left", "right"):
        (folder / "calibration" / side).mkdir(parents=True)
        (folder / "frames" / side).mkdir(parents=True)
        for number in range(4):
            write_png(folder / "calibration" / side / f"{number}.png", PICTURE)
        for number in range(3):
            write_png(folder / "frames" / side / f"{number}.png", PICTURE)
    rows = [f"frames/left/{number}.png,frames/right/{number}.png,{number},0,0" for number in range(3)]
    (folder / "frames.csv").write_text("\n".join(["left,right,x,y,z", *rows, ""]), encoding="utf-8")
    board = '[board]\ntype = "chessboard"\nsquares = [6, 4]\nsquare_mm = 20.0\n'
    (folder / "session.toml").write_text(board, encoding="utf-8")
    return folder


def session_check(folder: Path, status: int = 0) -> Any:
    (check,) = document(folder, status=status)["files"]
    return check


def test_a_session_whose_pictures_are_all_there_is_well(session: Path) -> None:
    assert session_check(session) == {
        "name": str(session),
        "state": "ok",
        "text": "session: 4 calibration pairs, 0 targets, 3 frames",
        "hint": None,
    }


def cut_off(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:-8])


def as_floats(path: Path) -> None:
    path.write_bytes(cv2.imencode(".tif", PICTURE.astype(np.float32))[1].tobytes())


def smaller(path: Path) -> None:
    write_png(path, PICTURE[:-2])


@pytest.mark.parametrize(
    ("spoil", "why"),
    [
        (Path.unlink, "no such picture"),
        (cut_off, "the picture is truncated: its end is missing"),
        (smaller, "40 × 28 px, the others 40 × 30 px"),
        (as_floats, "its values are floating-point numbers of 32 bits"),
    ],
)
def test_a_session_with_a_picture_that_cannot_be_used_is_wrong(
    session: Path, spoil: Callable[[Path], None], why: str
) -> None:
    """It was called well, and `measure` missed the frame at home."""
    spoil(session / "frames" / "right" / "1.png")
    check = session_check(session, status=1)
    assert check["state"] == "wrong"
    name = "row 3 of frames.csv: frames/right/1.png"
    assert f"; 1 of 6 pictures of the machine cannot be used; the first, {name}: {why}" in check["text"]
    assert check["hint"]


def test_a_calibration_that_has_too_few_pairs_is_wrong(session: Path) -> None:
    boards = session / "calibration"
    smaller(boards / "left" / "0.png")
    check = session_check(session)
    assert check["state"] == "note"
    assert check["text"].endswith(
        "; 1 board picture cannot be used, the first: calibration/left/0.png: 40 × 28 px, the others 40 × 30 px"
    )
    (boards / "right" / "1.png").unlink()
    check = session_check(session, status=1)
    assert "3 calibration pairs" in check["text"]
    assert "; 2 pairs of board pictures can be used, 3 are needed to calibrate; 2 board pictures" in check["text"]
    assert check["hint"].startswith("take ten or more pairs")
    # A rig that was calibrated before needs none.
    (session / "rig.json").write_text("{}", encoding="utf-8")
    assert session_check(session)["state"] == "note"


def test_board_pictures_without_a_board_are_wrong(session: Path) -> None:
    (session / "session.toml").write_text("", encoding="utf-8")
    assert "there are board pictures and no [board]" in session_check(session, status=1)["text"]


def test_a_session_without_board_pictures_takes_its_rig_from_elsewhere(session: Path) -> None:
    shutil.rmtree(session / "calibration")
    assert session_check(session)["state"] == "ok"


def test_a_row_of_frames_that_cannot_be_used_is_a_note(session: Path) -> None:
    with (session / "frames.csv").open("a", encoding="utf-8") as table:
        table.write("frames/left/2.png,frames/left/2.png,3,0,0\n")
    check = session_check(session)
    assert check["state"] == "note"
    assert "1 row of frames.csv set aside, the first: " in check["text"]
    assert "left and right are the same picture" in check["text"]


def test_what_a_fit_would_not_read_of_a_table_is_a_note(tmp_path: Path) -> None:
    points, circle = tmp_path / "p.csv", tmp_path / "c.csv"
    points.write_text("x,y,z,mx,my,mz,d_x,sx,sy\n0,0,0,1,2,3,1,0.01,0.01\n", encoding="utf-8")
    circle.write_text("x,y,z,r,clock\n0,0,0,50,1\n", encoding="utf-8")
    found = document(points, circle)
    assert found["ok"]
    assert [check["state"] for check in found["files"]] == ["note", "note"]
    assert "1 measured points; " in found["files"][0]["text"]
    assert "the column d_x is not read: " in found["files"][0]["text"]
    assert "did you mean dir_x?" in found["files"][0]["text"]
    assert "sx and sy are stated and sz is not: none of them is used" in found["files"][0]["text"]
    assert "the column clock is not read: " in found["files"][1]["text"]


def test_a_file_that_cannot_be_used_is_wrong_with_its_remedy(tmp_path: Path) -> None:
    broken, program = tmp_path / "rig.json", tmp_path / "part.gcode"
    broken.write_text(json.dumps(RIG | {"image_size": [0, 0]}), encoding="utf-8")
    program.write_text("G1 X1\n", encoding="utf-8")
    said = doctor(broken, program, tmp_path / "absent.csv", "--quiet", status=1)
    assert said.startswith(f"WRONG  {broken}: image_size: ")
    assert f"WRONG  {program}: is of no kind that is known here\n       hint: " in said
    assert f"WRONG  {tmp_path / 'absent.csv'}: no such file" in said
    assert "numpy" not in said


def test_a_link_that_leads_round_is_wrong_and_the_rest_is_looked_at(tmp_path: Path) -> None:
    loop, machine = tmp_path / "loop", tmp_path / "machine.toml"
    loop.symlink_to(loop)
    write_machine(machine, MACHINE)
    found = document(loop, machine, status=1)["files"]
    assert [check["state"] for check in found] == ["wrong", "ok"]
    assert found[0]["text"].startswith("cannot be read: ")


def test_a_library_that_is_too_old_or_absent_is_wrong(monkeypatch: pytest.MonkeyPatch) -> None:
    old, absent = ModuleType("plotly"), None
    monkeypatch.setitem(sys.modules, "plotly", old)
    monkeypatch.setitem(sys.modules, "polars", absent)  # type: ignore[arg-type]  # how an import is made to fail
    monkeypatch.setattr(doctor_checks.metadata, "version", lambda name: "5.9.9" if name == "plotly" else "9.0")
    monkeypatch.setattr(doctor_checks.metadata, "requires", lambda name: ["plotly>=6.0", "polars>=1.30"])
    found = {check["name"]: check for check in document(status=1)["installation"]}
    assert found["plotly"]["text"] == "5.9.9, >=6.0 is needed"
    assert found["plotly"]["hint"] == "pip install --upgrade 'plotly>=6.0'"
    assert found["polars"]["state"] == "wrong"
    assert found["polars"]["hint"] == "pip install 'polars>=1.30'"
    assert found["numpy"]["state"] == "ok"


@pytest.mark.parametrize("absent", ["polars", "scipy"])
def test_without_a_library_the_rest_is_still_looked_at(absent: str, tmp_path: Path) -> None:
    """In an interpreter that has loaded nothing of it before: it ended with a traceback."""
    stub = tmp_path / absent / "__init__.py"
    stub.parent.mkdir()
    stub.write_text(f"raise ImportError('No module named {absent}')\n", encoding="utf-8")
    done = subprocess.run(
        [sys.executable, "-m", "geoerr", "doctor", "--json"],
        env={**os.environ, "PYTHONPATH": os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", "")])},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 1, done.stderr
    states = {check["name"]: check["state"] for check in json.loads(done.stdout)["installation"]}
    assert states[absent] == "wrong"
    assert {name for name, state in states.items() if state == "wrong"} <= {
        absent,
        "core",
        "scipy",
        "polars",
        "plotly",
    }
    assert states["typer"] == "ok"


def test_an_extra_that_is_not_there_is_a_note(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(doctor_checks.EXTRAS, "workbench", ("nodash", "no_such_module", "geoerr workbench"))
    (check,) = (one for one in document()["installation"] if one["name"] == "nodash")
    # What the README says: no registry has a package to take the extra of.
    hint = "pip install '.[workbench]', in the folder that geoerr was installed from"
    assert (check["state"], check["hint"]) == ("note", hint)
    assert hint.partition(",")[0] in (Path(__file__).parents[2] / "README.md").read_text(encoding="utf-8")


def test_a_core_that_computes_wrongly_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(geoerr.Model, "commands_for", lambda self, p_mm: p_mm)
    found = {check["name"]: check for check in document(status=1)["installation"]}
    assert found["core"]["state"] == "wrong"
