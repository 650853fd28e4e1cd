"""`geoerr identify`: what it prints, writes and refuses."""

from __future__ import annotations

import itertools
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import polars as pl
import pytest
import typer
from typer.testing import CliRunner
from virtual_machine import Camera, camera, draw_truth, li_nine_lines, machine_of, nine_lines, observe

from geoerr.cli import identify as verb
from geoerr.error_functions import ALL_NAMES, read_errors
from geoerr.errors import GeoerrError, GeometryError, InputFileError
from geoerr.identify import identify_nine_line
from geoerr.identify.joint import identify_joint
from geoerr.machine import write_machine
from geoerr.observations import Observations, read_observations, write_observations
from geoerr.vision.rig import Rig, RightFromLeft, write_rig
from geoerr.vision.sensitivity import project_to_both

MACHINE = machine_of("wZbXYt")
NINE_LINE = ("--method", "nine-line")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """machine.toml and noisy nine lines, each twice."""
    rng = np.random.default_rng(60)
    moves = [replace(move, repeat=repeat) for repeat in range(2) for move in nine_lines(MACHINE)]
    truth = draw_truth(rng, "wZbXYt")
    observations = observe(
        MACHINE, truth, moves, {"0": camera(rng)}, covariance_mm2=np.diag([1e-4, 1e-4, 9e-4]), rng=rng
    )
    write_machine(tmp_path / "machine.toml", MACHINE)
    write_observations(tmp_path / "observations.csv", observations)
    return tmp_path


def run(folder: Path, *arguments: str, observations: str = "observations.csv"):  # type: ignore[no-untyped-def]
    app = typer.Typer()
    verb.register(app)
    app.command("other")(lambda: None)
    fixed = ["identify", str(folder / observations), "--machine", str(folder / "machine.toml")]
    return CliRunner().invoke(app, [*fixed, *arguments], catch_exceptions=True)


def test_table_of_the_21_fits_and_errors_are_written(folder: Path) -> None:
    result = run(folder, *NINE_LINE, "-o", str(folder / "errors.json"))
    assert result.exit_code == 0
    lines = result.stdout.splitlines()
    assert max(map(len, lines)) <= 80
    head, table, _ = "\n".join(lines).split("\n\n", 2)
    assert [line.split()[0] for line in table.splitlines()[1:]] == list(ALL_NAMES)
    said = "test (wZbXYt): 18 of 18 error functions and 3 of 3 squarenesses, method nine-line"
    assert " ".join(head.split()) == said
    assert sum("follows, as far as can be told" in line for line in lines) == 6
    assert any(line.startswith("X: lines 1, 4, 5; 54 points in 6 passes; residual ") for line in lines)
    assert "calibration" not in result.stderr, "no camera took part"
    written = read_errors(folder / "errors.json")
    expected = identify_nine_line(read_observations(folder / "observations.csv"), MACHINE)
    for name, table in expected.functions.items():
        assert np.allclose(written.functions[name].value, table.value, rtol=1e-12, atol=1e-15)


def test_quiet_says_nothing_beside_the_result(folder: Path) -> None:
    assert run(folder, "--quiet").stderr == ""


def test_json_is_one_document(folder: Path) -> None:
    result = run(folder, *NINE_LINE, "--json", "--straightness", "integrated", "--roll", "li")
    document = json.loads(result.stdout)
    assert set(document["alternatives"]) == {"straightness-direct", "roll-linear"}
    assert [line["number"] for line in document["lines"]] == [1, 4, 5, 2, 6, 7, 3, 8, 9]
    assert {item["name"] for item in document["straightness"]} == {"EYX", "EZX", "EXY", "EZY", "EXZ", "EYZ"}
    assert document["scatter"][0]["birge_ratio"] == 1.0
    assert document["missing_lines"] == []
    assert str(folder / "observations.csv") in document["provenance"]["inputs"]


def test_missing_line_is_named_with_its_cost(folder: Path) -> None:
    rng = np.random.default_rng(61)
    moves = [move for move in li_nine_lines(MACHINE) if move.line != "line 5"]
    observations = observe(MACHINE, draw_truth(rng, "wZbXYt"), moves, {"0": camera(rng)})
    write_observations(folder / "eight.csv", observations)
    result = run(folder, *NINE_LINE, observations="eight.csv")
    assert result.exit_code == 0
    assert "  ECX (ε_zx): line 5 (X, target offset along y) is missing" in result.stdout.splitlines()
    assert "note: of Li's nine lines the data lack 5" in result.stderr
    assert "cannot be judged without uncertainties" in result.stdout


def test_rows_that_cannot_be_used_are_named(folder: Path) -> None:
    text = (folder / "observations.csv").read_text().splitlines()
    cells = text[3].split(",")
    cells[text[0].split(",").index("mx")] = "broken"
    (folder / "broken.csv").write_text("\n".join([*text[:3], ",".join(cells), *text[4:]]) + "\n")
    result = run(folder, observations="broken.csv")
    assert result.exit_code == 0
    assert "broken.csv:4: mx:" in result.stderr


def test_joint_is_the_default_and_says_what_it_fitted(folder: Path) -> None:
    result = run(folder, "-o", str(folder / "errors.json"))
    assert result.exit_code == 0, result.exception
    lines = result.stdout.splitlines()
    assert max(map(len, lines)) <= 80
    assert lines[0].endswith("18 of 18 error functions and 3 of 3 squarenesses, method joint")
    assert [line.split()[0] for line in lines[3:24]] == list(ALL_NAMES)
    assert all(line.endswith(" free") for line in lines[3:21])
    assert sum("follows, as far as can be told" in line for line in lines) == 6
    assert any(line.startswith("what is left is noise, as far as can be told") for line in lines)
    assert "not determined" not in result.stdout
    assert "calibration" not in result.stderr, "no camera took part"
    written, expected = (
        read_errors(folder / "errors.json"),
        identify_joint(read_observations(folder / "observations.csv"), MACHINE),
    )
    assert written.method == "joint"
    for name, table in expected.errors.functions.items():
        assert np.allclose(written.functions[name].value, table.value, rtol=1e-12, atol=1e-15)
        assert np.allclose(written.functions[name].std, table.std, rtol=1e-12, atol=1e-15)


def test_json_of_joint_is_one_document(folder: Path) -> None:
    result = run(folder, "--json", "--straightness", "integrated")
    document = json.loads(result.stdout)
    assert document["method"] == "joint"
    assert set(document["alternatives"]) == {"straightness-direct"}
    assert {item["name"] for item in document["straightness"]} == {"EYX", "EZX", "EXY", "EZY", "EXZ", "EYZ"}
    assert document["fit"]["converged"] is True
    assert document["fit"]["not_determined"] == document["not_determined"] == []
    assert set(document["fit"]["bases"]) == set(ALL_NAMES[:18]) - {"EYX", "EZX", "EXY", "EZY", "EXZ", "EYZ"}
    assert str(folder / "observations.csv") in document["provenance"]["inputs"]


def test_joint_has_no_root_for_roll(folder: Path) -> None:
    result = run(folder, "--roll", "li")
    assert result.exit_code == 2
    assert "--method nine-line" in " ".join(result.stderr.replace("│", " ").split())


def test_too_few_lines_for_anything_are_still_answered(folder: Path) -> None:
    """One line along X with one target: its positioning; nothing about the other axes, and that is said."""
    rng = np.random.default_rng(63)
    moves, covariance_mm2 = li_nine_lines(MACHINE)[:1], np.eye(3) * 1e-6
    view, truth = {"0": camera(rng)}, draw_truth(rng, "wZbXYt")
    observations = observe(MACHINE, truth, moves, view, covariance_mm2=covariance_mm2, rng=rng)
    write_observations(folder / "one.csv", observations)
    result = run(folder, "--json", observations="one.csv")
    assert result.exit_code == 0, result.exception
    document = json.loads(result.stdout)
    lost = {item["name"] for item in document["not_determined"]}
    assert set(document["errors"]) == {"EXX", "EYX", "EZX"}
    assert lost == set(ALL_NAMES) - {"EXX", "EYX", "EZX"}


def test_an_input_is_never_replaced(folder: Path) -> None:
    before = (folder / "observations.csv").read_bytes()
    result = run(folder, "-o", str(folder / "observations.csv"))
    assert isinstance(result.exception, InputFileError)
    assert "is an input of this command" in str(result.exception)
    assert (folder / "observations.csv").read_bytes() == before


def stereo_rig(covariance: np.ndarray | None) -> Rig:
    matrix = np.array([[2300.0, 0.0, 1224.0], [0.0, 2300.0, 1024.0], [0.0, 0.0, 1.0]])
    pose = RightFromLeft(np.eye(3), np.array([-300.0, 0.0, 0.0]))
    return Rig(matrix, np.zeros(5), matrix, np.zeros(5), pose, (2448, 2048), covariance)


@pytest.mark.parametrize("method", ["nine-line", "joint"])
def test_rig_adds_the_calibrations_uncertainty(folder: Path, method: str) -> None:
    """A baseline known to 1 in 10⁴ makes every length uncertain by 1 in 10⁴."""
    rng = np.random.default_rng(62)
    plain = stereo_rig(None)
    variance = np.zeros(len(plain.parameter_names))
    variance[plain.parameter_names.index("t_x_mm")] = 0.03**2
    rig = stereo_rig(np.diag(variance))
    view = {"0": Camera(np.array([[1.0, 0, 0], [0, 0, -1.0], [0, 1.0, 0]]), np.array([-200.0, 100.0, 900.0]))}
    observations = observe(
        MACHINE, draw_truth(rng, "wZbXYt"), li_nine_lines(MACHINE), view, covariance_mm2=np.eye(3) * 1e-8, rng=rng
    )
    pixels = project_to_both(rig, observations.measured_mm).pixel
    names = ("u_left", "v_left", "u_right", "v_right")
    frame = observations.frame.with_columns(**{name: pl.Series(pixels[:, i]) for i, name in enumerate(names)})
    write_observations(folder / "pixels.csv", Observations(frame, observations.sources))
    write_rig(folder / "rig.json", rig)
    without = run(folder, "--method", method, observations="pixels.csv")
    assert "the calibration's uncertainty is not included" in without.stderr
    arguments = ("--method", method, "--rig", str(folder / "rig.json"), "-o", str(folder / "e.json"))
    result = run(folder, *arguments, observations="pixels.csv")
    assert result.exit_code == 0, result.exception
    assert "the calibration's uncertainty is not included" not in result.stderr
    table = read_errors(folder / "e.json").functions["EXX"]
    assert table.std is not None
    assert np.allclose(table.std[1:], 1e-4 * table.position_mm[1:], rtol=0.02)


@pytest.mark.parametrize("method", ["nine-line", "joint"])
def test_rig_without_covariance_or_pixels_is_refused(folder: Path, method: str) -> None:
    write_rig(folder / "rig.json", stereo_rig(None))
    result = run(folder, "--method", method, "--rig", str(folder / "rig.json"))
    assert isinstance(result.exception, InputFileError)
    assert "states no covariance" in str(result.exception)
    n_parameters = len(stereo_rig(None).parameter_names)
    write_rig(folder / "rig.json", stereo_rig(np.eye(n_parameters) * 1e-8))
    result = run(folder, "--method", method, "--rig", str(folder / "rig.json"))
    assert isinstance(result.exception, GeometryError)
    assert "no pixels" in str(result.exception)


def test_radii_and_lengths_tell_what_they_can(folder: Path) -> None:
    """Sides and diagonals of 3 x 3 marks whose columns lean by 1 mrad; a circle of it alone tells none of the 21."""
    angle, skew = np.linspace(0.0, 2.0 * np.pi, 90), 1e-3
    places = {"x": 200.0 + 80.0 * np.cos(angle), "y": 200.0 + 80.0 * np.sin(angle), "z": np.full(90, 50.0)}
    radii = {"line": "c", **places, "r": 80.0 - 40.0 * skew * np.sin(2.0 * angle), "sr": 1e-3}
    pl.DataFrame(radii).write_csv(folder / "circle.csv")
    marks = [np.array([x, y, 50.0]) for x in (50.0, 200.0, 350.0) for y in (50.0, 200.0, 350.0)]
    table = ["feature,x1,y1,z1,x2,y2,z2,measured,s_measured"]
    for one, two in itertools.combinations(marks, 2):
        made = two - one - skew * (two - one)[1] * np.array([1.0, 0.0, 0.0])
        table.append(",".join(map(str, ["f", *one, *two, np.linalg.norm(made), 0.001])))
    (folder / "lengths.csv").write_text("\n".join(table) + "\n")
    for files in (("circle.csv",), ("lengths.csv",), ("lengths.csv", "circle.csv")):
        first, *others = files
        more = [str(folder / name) for name in others]
        result = run(folder, *more, "--json", observations=first)
        assert result.exit_code == 0, result.exception
        errors = json.loads(result.stdout)["errors"]
        assert ("EC0Y" in errors) == ("lengths.csv" in files)
        if "EC0Y" in errors:
            # A lean shortens its axis by half its square.
            assert errors["EC0Y"]["value_urad"] == pytest.approx(1e6 * skew, abs=4.0 * errors["EC0Y"]["std_urad"])
            assert errors["EC0Y"]["std_urad"] < 10.0
        refused = run(folder, *more, *NINE_LINE, observations=first)
        assert isinstance(refused.exception, GeoerrError)
        assert "measured points alone" in str(refused.exception)
