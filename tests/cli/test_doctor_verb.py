"""`geoerr doctor`: what it says of an installation and of files, and its exit status."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
from typer.testing import CliRunner

import geoerr
from geoerr.cli import doctor_checks
from geoerr.cli.main import app
from geoerr.machine import write_machine

MACHINE = geoerr.Machine.from_chain("wZbXYt", (400.0, 300.0, 250.0), name="printer 7")
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
