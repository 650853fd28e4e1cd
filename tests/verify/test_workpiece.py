"""Relative positioning errors: hand-made workpieces with known errors, frames, bad rows, the command."""

from __future__ import annotations

import dataclasses
import json

import numpy as np
import polars as pl
import pytest
import typer
from scipy.spatial.transform import Rotation
from typer.testing import CliRunner
from verify_machines import model, wavy

from geoerr.cli import verify_workpiece
from geoerr.errors import InputFileError
from geoerr.observations import observations_from_columns, write_observations
from geoerr.verify.workpiece import (
    compare_workpieces,
    errors_of_points,
    li_pattern,
    predict_workpiece,
    read_relative_errors,
)

HEADER = "line,group,carrier,x,y,z,mx,my,mz"
# Two lines. Errors against their first points, by hand: a (0.3, 0.4), (0, 0.5); b (−1.2, 0.5).
PLANAR = f"""{HEADER}
a,horizontal,relative,10,10,0,10.1,10.2,
a,horizontal,relative,60,10,0,60.4,10.6,
a,horizontal,relative,110,10,0,110.1,10.7,
b,vertical,relative,10,10,0,5,5,
b,vertical,relative,10,90,0,3.8,85.5,
"""
LENGTHS = """feature,x1,y1,z1,x2,y2,z2,measured,group
w1,0,0,0,30,40,0,50.3,slots
w2,0,0,0,0,0,20,19.6,slots
w3,0,0,0,100,0,0,100.05,edges
"""


def write(path, text):
    path.write_text(text, encoding="utf-8")
    return path


def test_errors_are_against_the_first_point_of_the_line(tmp_path):
    errors = read_relative_errors(write(tmp_path / "part.csv", PLANAR))
    assert errors.group == ("horizontal", "horizontal", "vertical")
    np.testing.assert_allclose(errors.error_mm, [[0.3, 0.4], [0.0, 0.5], [-1.2, 0.5]], atol=1e-12)
    horizontal = errors.of_group("horizontal")
    assert (horizontal.n, horizontal.n_components) == (2, 2)
    # √(mean of squared lengths): both points are 0.5 mm off.
    assert horizontal.rmse_mm == pytest.approx(0.5, abs=1e-12)
    assert errors.of_group("vertical").rmse_mm == pytest.approx(1.3, abs=1e-12)
    assert errors.of_group("vertical").largest_mm == pytest.approx(1.3, abs=1e-12)
    assert errors.of_group("none") is None
    assert errors.first_points == {"a": (10.0, 10.0, 0.0), "b": (10.0, 10.0, 0.0)}


def test_lengths_are_measured_minus_nominal(tmp_path):
    errors = read_relative_errors(write(tmp_path / "part.csv", LENGTHS))
    np.testing.assert_allclose(errors.error_mm[:, 0], [0.3, -0.4, 0.05], atol=1e-12)
    assert errors.of_group("slots").rmse_mm == pytest.approx(np.sqrt((0.09 + 0.16) / 2), abs=1e-12)
    assert errors.of_group(None).n == 3


@pytest.mark.parametrize("turn", [[0, 0, 0], [0.3, -1.1, 2.0], [0, 0, np.pi]])
def test_any_rigid_pose_of_the_measuring_frame_gives_the_same_errors(turn):
    machine = wavy()
    pattern = li_pattern(machine)
    workpiece = predict_workpiece(machine, pattern, compensated=False)
    turned = workpiece.measured_mm @ Rotation.from_rotvec(turn).as_matrix().T + [7.0, -300.0, 900.0]
    frame = workpiece.frame.with_columns(
        pl.Series(name, turned[:, index]) for index, name in enumerate(("mx", "my", "mz"))
    )
    again = errors_of_points(type(workpiece)(frame, workpiece.sources))
    np.testing.assert_allclose(again.error_mm, errors_of_points(workpiece).error_mm, atol=1e-9)


def test_the_frame_is_the_one_that_scipy_finds():
    machine = wavy()
    workpiece = predict_workpiece(machine, li_pattern(machine), compensated=False)
    nominal, measured = workpiece.commanded_mm, workpiece.measured_mm
    rotation, _ = Rotation.align_vectors(nominal - nominal.mean(axis=0), measured - measured.mean(axis=0))
    error = rotation.apply(measured) - nominal
    lines = np.array(workpiece.texts("line"))
    expected = np.concatenate([error[lines == name][1:] - error[lines == name][0] for name in dict.fromkeys(lines)])
    np.testing.assert_allclose(errors_of_points(workpiece).error_mm, expected, atol=1e-9)


def test_a_straight_workpiece_keeps_its_lengths_of_error():
    n = 6
    columns = {"x": np.linspace(0, 100, n), "y": np.zeros(n), "z": np.zeros(n)}
    error = np.array([0.0, 0.1, 0.3, 0.2, 0.4, 0.7])
    text = {"line": ["a"] * n, "group": ["g"] * n, "carrier": ["relative"] * n}
    # Measured along the frame's Z instead of X; all of the error lies along the line.
    measured = {"mx": np.zeros(n), "my": np.zeros(n), "mz": columns["x"] + error}
    errors = errors_of_points(observations_from_columns({**text, **columns, **measured}))
    assert errors.of_group("g").rmse_mm == pytest.approx(np.sqrt(np.mean(error[1:] ** 2)), abs=1e-9)


def test_target_offsets_and_repeats_count():
    text = {"line": ["a"] * 4, "group": ["g"] * 4, "carrier": ["relative"] * 4}
    columns = {"x": [0.0, 10.0] * 2, "y": [0.0] * 4, "z": [0.0] * 4, "repeat": [0, 0, 1, 1]}
    columns["tx"] = [1.0, 2.0] * 2
    measured = {"mx": [1.0, 12.5, 3.0, 14.25], "my": [0.0] * 4}
    errors = errors_of_points(observations_from_columns({**text, **columns, **measured}))
    np.testing.assert_allclose(errors.error_mm, [[0.5, 0.0], [0.25, 0.0]], atol=1e-12)


def test_compensation_brings_the_error_to_the_tolerance():
    machine = wavy(tool_offset_mm=(5.0, 0.0, 40.0))
    pattern = li_pattern(machine)
    before = errors_of_points(predict_workpiece(machine, pattern, compensated=False))
    after = errors_of_points(predict_workpiece(machine, pattern, compensated=True))
    result = compare_workpieces(before, after)
    assert [group.name for group in result.groups] == ["horizontal", "vertical"]
    for group in result.groups:
        assert group.before.n == group.after.n == 5 * 8
        assert group.before.rmse_mm > 0.05
        # The iteration stops within 1e-7 mm of each point; an error is the difference of two, in three components.
        assert group.after.rmse_mm < 4e-7
    assert not result.notes


def test_a_scale_error_is_seen_where_it_acts():
    stretched = model({"EXX": lambda q: 1e-3 * q})
    pattern = li_pattern(stretched, n_points=5)
    result = errors_of_points(predict_workpiece(stretched, pattern, compensated=False))
    # Points at 1/4 ... 4/4 of 360 mm; vertical lines do not feel a scale of X.
    shares = np.array([0.25, 0.5, 0.75, 1.0])
    assert result.of_group("horizontal").rmse_mm == pytest.approx(0.36 * np.sqrt(np.mean(shares**2)), rel=1e-9)
    assert result.of_group("vertical").rmse_mm < 1e-9


def test_bad_rows_are_named_and_the_rest_goes_on(tmp_path):
    rows = (
        PLANAR
        + "b,vertical,relative,10,170,0,three,5,\nb,vertical,relative,10,180,0,,5,\nc,vertical,tool,1,1,0,1,1,\n"
    )
    errors = read_relative_errors(write(tmp_path / "part.csv", rows))
    assert [(problem.row, problem.column) for problem in errors.set_aside] == [
        (7, "mx"),
        (8, "mx my"),
        (9, "carrier"),
    ]
    assert len(errors.group) == 3


def test_a_lost_first_point_is_said(tmp_path):
    rows = PLANAR.replace("10.1,10.2,", "10.1,,", 1)
    errors = read_relative_errors(write(tmp_path / "part.csv", rows))
    assert errors.first_points["a"] == (60.0, 10.0, 0.0)
    assert "refer to the next point" in errors.notes[0]
    both = compare_workpieces(read_relative_errors(write(tmp_path / "whole.csv", PLANAR)), errors)
    assert any("'a' starts from different points" in note for note in both.notes)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (PLANAR.replace("relative", "tool"), r"part.csv:2: carrier: no row is measured on a workpiece"),
        (PLANAR.replace("b,", "c,").replace("a,", "a1,", 1), None),
        (f"{HEADER}\na,h,relative,1,1,0,1,1,1\n", "no line has a second point"),
        (f"{HEADER}\na,h,relative,1,1,0,,,\n", "mx my mz: no row has a measured position"),
        ("line,x,y,z,r\na,1,2,3,4\n", "circular test"),
        ("", "empty"),
        ("feature,x1,y1,z1,x2,y2,z2\n1,0,0,0,1,1,1\n", "measured: the column is missing"),
    ],
)
def test_what_is_no_workpiece_is_refused(tmp_path, text, words):
    path = write(tmp_path / "part.csv", text)
    if words is None:
        assert len(read_relative_errors(path).group) == 2
        return
    with pytest.raises(InputFileError, match=words):
        read_relative_errors(path)


def test_points_and_lengths_do_not_compare(tmp_path):
    points = read_relative_errors(write(tmp_path / "points.csv", PLANAR))
    lengths = read_relative_errors(write(tmp_path / "lengths.csv", LENGTHS))
    with pytest.raises(InputFileError, match=r"lengths.csv: holds lengths, and .*points.csv holds points"):
        compare_workpieces(points, lengths)


def test_groups_of_one_file_only_have_no_ratio(tmp_path):
    before = read_relative_errors(write(tmp_path / "before.csv", LENGTHS))
    after = read_relative_errors(write(tmp_path / "after.csv", LENGTHS.replace("edges", "rims")))
    result = compare_workpieces(before, after)
    assert [(group.name, group.ratio) for group in result.groups] == [("slots", 1.0), ("edges", None), ("rims", None)]
    assert len(result.notes) == 2


MORE_LENGTHS = """feature,x1,y1,z1,x2,y2,z2,measured,group
a,0,0,0,100,0,0,100.10,h
b,0,0,0,0,100,0,100.05,h
c,0,0,0,0,0,50,50.02,v
"""


@pytest.mark.parametrize(
    ("after", "groups", "of_all"),
    [
        # One of three, in no group: the ratio of all was that of 1 error to 3.
        ("feature,x1,y1,z1,x2,y2,z2,measured\na,0,0,0,100,0,0,100.01\n", {"h": None, "v": None}, 0.1),
        # The other way round, in another group.
        ("feature,x1,y1,z1,x2,y2,z2,measured,group\nb,0,100,0,0,0,0,100.01,v\n", {"h": None, "v": None}, 0.2),
        ("feature,x1,y1,z1,x2,y2,z2,measured,group\nb,0,0,0,0,100,0,100.01,h\n", {"h": 0.2, "v": None}, 0.2),
        ("feature,x1,y1,z1,x2,y2,z2,measured,group\nd,0,0,0,70,0,0,70.01,h\n", {"h": None, "v": None}, None),
    ],
)
def test_a_ratio_is_that_of_what_both_files_measured(tmp_path, after, groups, of_all):
    paths = write(tmp_path / "before.csv", MORE_LENGTHS), write(tmp_path / "after.csv", after)
    result = compare_workpieces(*map(read_relative_errors, paths))
    found = {group.name: group.ratio for group in result.groups}
    assert {name: found[name] for name in groups} == pytest.approx(groups, nan_ok=True)
    assert result.total.ratio == pytest.approx(of_all)
    assert result.total.before.n == 3
    said = "there is no ratio" if of_all is None else "what both files have, 1 error before and 1 after"
    assert any(note.startswith("the whole has other nominal lengths") and said in note for note in result.notes)
    assert run_command(*paths).stdout.split()[-1] == ("–" if of_all is None else f"{of_all:.3f}")


def test_a_point_on_two_lines_is_one_of_each(tmp_path):
    """A group that only one file has takes no part in the ratio of all, wherever its points are."""
    before = read_relative_errors(write(tmp_path / "before.csv", PLANAR))
    without = "\n".join(line for line in PLANAR.splitlines() if "vertical" not in line) + "\n"
    after = read_relative_errors(write(tmp_path / "after.csv", without))
    result = compare_workpieces(before, after)
    assert result.total.ratio == pytest.approx(1.0)
    assert result.total.before.n > result.total.after.n


def test_other_points_or_components_are_told_to_prove_nothing(tmp_path):
    before = read_relative_errors(write(tmp_path / "before.csv", PLANAR))
    shorter = "\n".join(line.replace(",110,10,", ",30,10,") for line in PLANAR.splitlines()) + "\n"
    assert shorter != PLANAR
    other = compare_workpieces(before, read_relative_errors(write(tmp_path / "shorter.csv", shorter)))
    assert any("other nominal points before than after" in note for note in other.notes)
    whole = dataclasses.replace(before, components=("mx", "my", "mz"))
    turned = compare_workpieces(before, whole)
    assert any("mx my were measured before, mx my mz after" in note for note in turned.notes)
    assert not compare_workpieces(before, before).notes


def test_a_length_has_no_direction(tmp_path):
    header, *rows = (line.split(",") for line in LENGTHS.splitlines())
    swapped = [header, *([*row[:1], *row[4:7], *row[1:4], *row[7:]] for row in rows)]
    before = read_relative_errors(write(tmp_path / "before.csv", LENGTHS))
    other = "\n".join(map(",".join, swapped)) + "\n"
    assert not compare_workpieces(before, read_relative_errors(write(tmp_path / "after.csv", other))).notes
    moved = write(tmp_path / "moved.csv", other.replace("30,40,0", "40,30,0"))
    assert any(
        "other nominal lengths" in one for one in compare_workpieces(before, read_relative_errors(moved)).notes
    )


def run_command(*arguments):
    app = typer.Typer()
    verify_workpiece.register(app)
    # A second command keeps the group a group, as it is in geoerr.
    app.command("other")(lambda: None)
    return CliRunner().invoke(app, ["workpiece", *[str(argument) for argument in arguments]])


def test_the_command_prints_table_4(tmp_path):
    machine = wavy()
    believed = wavy(scale=0.95)
    pattern = li_pattern(machine)
    for name, compensated in (("before.csv", False), ("after.csv", True)):
        workpiece = predict_workpiece(believed, pattern, compensated=compensated, truth=machine)
        write_observations(tmp_path / name, workpiece)
    paths = (tmp_path / "before.csv", tmp_path / "after.csv")
    text = run_command(*paths)
    assert text.exit_code == 0, text.output
    document = json.loads(run_command(*paths, "--json").stdout)
    for group in document["groups"]:
        # A twentieth of the error is not known to the model; the rest goes.
        assert group["ratio"] == pytest.approx(0.05, abs=5e-3)
        assert f"{group['before']['rmse_um']:.1f} µm" in text.stdout
        assert group["before"]["rmse_um"] == pytest.approx(group["before"]["rmse_mm"] * 1e3)
    assert document["all"]["before"]["n"] == 80


def two_components(turn_rad: float, factor: float = 1.0):
    """Give a part of a machine with a scale of X of 1e-4, measured in X and Y, as it lay on the table."""
    x, y = (one.ravel() for one in np.meshgrid(np.linspace(0.0, 200.0, 6), np.linspace(0.0, 150.0, 6)))
    seen_x, seen_y = x * (1.0 + 1e-4), y
    turned = (
        seen_x * np.cos(turn_rad) - seen_y * np.sin(turn_rad),
        seen_x * np.sin(turn_rad) + seen_y * np.cos(turn_rad),
    )
    text = {"line": [f"h{number // 6}" for number in range(36)], "carrier": ["relative"] * 36}
    return observations_from_columns(
        {**text, "x": x, "y": y, "z": np.zeros(36), "mx": factor * turned[0], "my": factor * turned[1]}
    )


def test_a_part_that_lay_turned_is_told_as_that():
    straight, turned = errors_of_points(two_components(0.0)), errors_of_points(two_components(1e-3))
    assert not straight.notes
    assert np.abs(straight.error_mm[:, 1]).max() < 1e-12
    (note,) = turned.notes
    assert "turned by +1 mrad" in note


def test_what_is_in_another_unit_or_of_other_axes_is_refused():
    with pytest.raises(InputFileError, match=r"do not follow the nominal ones.*\n?.*in mm"):
        errors_of_points(two_components(0.0, factor=1.0 / 25.4))
    good = two_components(0.0)
    swapped = good.frame.rename({"mx": "my", "my": "mx"})
    with pytest.raises(InputFileError, match="do not follow the nominal ones"):
        errors_of_points(dataclasses.replace(good, frame=swapped))
