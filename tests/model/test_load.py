"""What a command takes as MODEL."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from model_machines import drawn_errors, machine

from geoerr.error_functions import write_errors
from geoerr.errors import InputFileError
from geoerr.machine import write_machine
from geoerr.model import Model, load_model
from geoerr.vision.rig import Rig, RightFromLeft, write_rig


def test_machine_toml_is_the_nominal_machine(tmp_path: Path) -> None:
    of = machine("wXbYZt", (1.0, 2.0, 3.0))
    write_machine(tmp_path / "machine.toml", of)
    model = load_model(tmp_path / "machine.toml")
    assert model.machine == of
    assert model.errors is None
    assert model.is_nominal


@pytest.mark.parametrize("name", ["errors.json", "ERRORS.JSON", "truth", "model.json"])
def test_errors_are_told_by_suffix_or_content(tmp_path: Path, name: str) -> None:
    of = machine("wXbYZt")
    errors = drawn_errors(of)
    write_errors(tmp_path / name, errors)
    q = np.random.default_rng(1).uniform(0.0, 400.0, (20, 3))
    # µm and µrad in the file: the last digit may differ.
    assert load_model(tmp_path / name).error_mm(q) == pytest.approx(Model(of, errors).error_mm(q), abs=1e-14)


def test_toml_without_its_suffix(tmp_path: Path) -> None:
    write_machine(tmp_path / "mine", machine())
    assert load_model(tmp_path / "mine").is_nominal


@pytest.mark.parametrize(
    ("name", "content", "problem"),
    [
        ("a.json", "{}", "the key 'errors' is missing"),
        ("a.json", "[1, 2]", "the key 'errors' is missing"),
        ("a.json", "{", "not valid JSON"),
        ("a.json", "", "not valid JSON"),
        ("a.toml", "x = 1", r"the table \[machine\] is missing"),
        ("a.toml", "{}", "not valid TOML"),
        ("a", "G1 X10", "not valid TOML"),
        ("a", "{", "not valid JSON"),
    ],
)
def test_neither(tmp_path: Path, name: str, content: str, problem: str) -> None:
    (tmp_path / name).write_text(content)
    with pytest.raises(InputFileError, match=problem):
        load_model(tmp_path / name)


@pytest.mark.parametrize("name", ["obs.csv", "obs.parquet"])
def test_measurements_are_told_from_a_model(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_text("x,y,z,mx,my,mz\n")
    with pytest.raises(InputFileError, match=r"is a table of measurements, .*\nhint: a model is a model\.json"):
        load_model(tmp_path / name)


def test_a_rig_is_told_where_it_belongs(tmp_path: Path) -> None:
    path, matrix = tmp_path / "rig.json", np.array([[2300.0, 0.0, 1224.0], [0.0, 2300.0, 1024.0], [0.0, 0.0, 1.0]])
    pose = RightFromLeft(np.eye(3), np.array([-300.0, 0.0, 0.0]))
    write_rig(path, Rig(matrix, np.zeros(5), matrix, np.zeros(5), pose, (2448, 2048), None))
    with pytest.raises(InputFileError, match="is a rig, two cameras, and no model") as refused:
        load_model(path)
    assert refused.value.remedy is not None
    assert f"as --rig {path}; a model is a model.json" in refused.value.remedy


@pytest.mark.parametrize("name", ["none.json", "none.toml", "none", "none.csv"])
def test_missing(tmp_path: Path, name: str) -> None:
    with pytest.raises(InputFileError, match="no such file"):
        load_model(tmp_path / name)
    with pytest.raises(InputFileError, match="is a folder"):
        load_model(tmp_path)
