"""The circular test: known circles, Li's Eq. 23, measured runs, refusals."""

from __future__ import annotations

import json

import numpy as np
import polars as pl
import pytest
import typer
from scipy.optimize import least_squares
from typer.testing import CliRunner
from verify_machines import model, wavy

from geoerr.cli import verify_ballbar
from geoerr.error_functions import write_errors
from geoerr.errors import GeometryError, InputFileError, NotDeterminedError
from geoerr.machine import write_machine
from geoerr.model import Model
from geoerr.observations import read_circular_test
from geoerr.verify.ballbar import (
    LI_CENTER_MM,
    LI_RADIUS_MM,
    circle_of_first_run,
    circle_to_test,
    compare_with_measured,
    li_eq23_trace,
    predict_compensated_trace,
    predict_trace,
    run_circular_test,
)
from geoerr.verify.circle import CircleOfCommands


def test_squareness_alone_deviates_by_its_size_times_the_radius():
    squareness = -5.05e-3
    trace = predict_trace(skewed := model(squareness_rad={"EC0Y": squareness}), circle_to_test(skewed))
    # Exact unit directions: half axes R·√(1 ± sin S); their difference is |S|·R to S²/8 relative.
    half_axes = LI_RADIUS_MM * np.sqrt(1 + np.array([1, -1]) * np.sin(abs(squareness)))
    assert trace.circular_deviation_mm == pytest.approx(half_axes[0] - half_axes[1], rel=1e-4)
    assert trace.circular_deviation_mm == pytest.approx(abs(squareness) * LI_RADIUS_MM, rel=1e-4)
    # An ellipse at 45°: which diagonal is long says the sign (BALL BAR: D45 − D135 = 2 R a with a = −S_xy).
    at_45 = np.argmin(np.abs(trace.angle_rad - np.pi / 4))
    assert trace.radial_deviation_mm[at_45] == pytest.approx(-squareness * LI_RADIUS_MM / 2, rel=1e-2)


def test_scale_mismatch_makes_an_ellipse_along_the_axes():
    scaled = model({"EXX": lambda q: 1e-3 * q, "EYY": lambda q: -5e-4 * q})
    trace = predict_trace(scaled, circle_to_test(scaled))
    assert trace.circular_deviation_mm == pytest.approx(1.5e-3 * LI_RADIUS_MM, rel=1e-9)
    assert trace.fitted.radius_mm - LI_RADIUS_MM == pytest.approx(2.5e-4 * LI_RADIUS_MM, rel=1e-3)
    np.testing.assert_allclose(trace.fitted.center_mm, [1e-3 * 212, -5e-4 * 270], atol=1e-9)


@pytest.mark.parametrize("plane", ["XY", "YZ", "ZX"])
def test_both_senses_are_one_path(plane):
    machine = wavy()
    circle = circle_to_test(machine, plane)
    forward, backward = predict_trace(machine, circle), predict_trace(machine, circle, clockwise=True)
    assert forward.circular_deviation_mm == pytest.approx(backward.circular_deviation_mm, abs=1e-10)
    np.testing.assert_allclose(forward.radial_deviation_mm[1:], backward.radial_deviation_mm[1:][::-1], atol=1e-10)


def test_eq23_is_the_whole_model_without_squareness_z_and_second_order():
    whole = wavy(scale=0.1)
    circle = circle_to_test(whole)
    flat = whole.without(["squareness", "EXZ", "EYZ", "EZZ", "EAZ", "EBZ", "ECZ"])
    difference = li_eq23_trace(whole, circle).points_mm - predict_trace(flat, circle).points_mm
    # What is left is second order: angles of 4e-5 rad squared on arms of 400 mm, and angle times 5 µm.
    assert np.abs(difference).max() < (4e-5) ** 2 * 400 + 4e-5 * 0.01
    assert np.abs(li_eq23_trace(whole, circle).points_mm - predict_trace(whole, circle).points_mm).max() > 0.01


def test_eq23_is_literal():
    machine = wavy()
    circle = circle_to_test(machine)
    f = machine.errors.functions
    q = circle.positions_mm(720)
    x = q[:, 0] + f["EXX"].at(q[:, 0]) + f["EXY"].at(q[:, 1]) - q[:, 1] * f["ECX"].at(q[:, 0])
    y = q[:, 1] + f["EYX"].at(q[:, 0]) + f["EYY"].at(q[:, 1])
    expected = np.column_stack([x - LI_CENTER_MM[0], y - LI_CENTER_MM[1]])
    np.testing.assert_allclose(li_eq23_trace(machine, circle).points_mm, expected, atol=1e-12)


def test_eq23_is_refused_where_it_does_not_hold():
    with pytest.raises(GeometryError, match="XY plane, not for YZ"):
        li_eq23_trace(wavy(), circle_to_test(wavy(), "YZ"))
    for chain in ("wZbYXt", "wXYbZt", "wXbYZt"):
        other = wavy(chain=chain)
        with pytest.raises(GeometryError, match=chain):
            li_eq23_trace(other, circle_to_test(other))
    unknown = model({"EXX": lambda q: 0.0}, not_determined=("ECX",))
    with pytest.raises(NotDeterminedError, match=r"ECX.*for the test"):
        li_eq23_trace(unknown, circle_to_test(unknown))


@pytest.mark.parametrize("chain", ["wZbXYt", "wbXYZt", "wXYbZt", "wYXZbt"])
@pytest.mark.parametrize("tool_offset_mm", [(0.0, 0.0, 0.0), (12.0, -7.0, 55.0)])
def test_compensated_commands_make_a_round_circle(chain, tool_offset_mm):
    machine = wavy(chain=chain, tool_offset_mm=tool_offset_mm)
    circle = circle_to_test(machine)
    assert predict_trace(machine, circle).circular_deviation_mm > 0.1
    # The iteration may stop within 1e-7 mm of each point.
    assert predict_compensated_trace(machine, circle).circular_deviation_mm < 4e-7


def test_a_truth_other_than_the_model_keeps_the_difference():
    believed = model({"EXX": lambda q: 1e-3 * q})
    truth = model({"EXX": lambda q: 1.2e-3 * q}, tool_offset_mm=(3.0, 4.0, 5.0))
    result = run_circular_test(believed, circle_to_test(believed), truth=truth)
    assert result.before[0].circular_deviation_mm == pytest.approx(1.2e-3 * LI_RADIUS_MM, rel=1e-9)
    # x is commanded as x/1.001 and driven to x·1.0012/1.001.
    assert result.after[0].circular_deviation_mm == pytest.approx((1.0012 / 1.001 - 1) * LI_RADIUS_MM, rel=1e-6)


def measured_file(path, truth, circle, *, runs=("ccw",), noise_mm=0.0, centre=(0.3, -0.2), constant=0.05, n=120):
    """What a bar measures on `truth`: distance in space from a base that stands beside the centre."""
    rng = np.random.default_rng(5)
    first, second, third = circle.axes
    frames = []
    for name in runs:
        commanded = circle.positions_mm(n, clockwise=name == "cw")
        actual = commanded + truth.error_mm(commanded)
        base = np.array(circle.center_mm)
        base[[first, second]] += centre
        base[third] = actual[:, third].mean()
        radius = np.linalg.norm(actual - base, axis=1) + constant + rng.normal(scale=noise_mm or 1e-12, size=n)
        frame = pl.DataFrame({"line": [name] * n, "r": radius}).with_columns(
            pl.Series(axis, commanded[:, index]) for index, axis in enumerate("xyz")
        )
        frames.append(frame)
    pl.concat(frames).write_csv(path)
    return path


@pytest.mark.parametrize("plane", ["XY", "YZ", "ZX"])
def test_a_measured_trace_of_the_same_machine_leaves_only_its_noise(tmp_path, plane):
    machine = wavy()
    circle = circle_to_test(machine, plane)
    path = measured_file(tmp_path / "trace.csv", machine, circle, runs=("ccw", "cw"), noise_mm=2e-3)
    runs, set_aside = compare_with_measured(machine, read_circular_test(path))
    assert not set_aside
    assert [(run.name, run.direction) for run in runs] == [("ccw", 1), ("cw", -1)]
    for run in runs:
        # 120 values of 2 µm less three fitted: the rms has a standard deviation of 2/√240 = 0.13 µm.
        assert run.set_up.rms_mm == pytest.approx(2e-3 * np.sqrt(117 / 120), abs=4 * 0.13e-3)
        assert run.measured.circle.plane == plane
        assert run.measured.circular_deviation_mm == pytest.approx(
            run.predicted.circular_deviation_mm, abs=0.02 * run.predicted.circular_deviation_mm + 0.012
        )


def test_a_base_beside_the_centre_makes_no_lobes(tmp_path):
    """Laid at the commanded angle a perfect circle of 100 mm seen from 1 mm beside it is out of round by 10 µm."""
    machine = Model(wavy().machine)
    path = measured_file(tmp_path / "trace.csv", machine, circle_to_test(machine), centre=(0.8, -0.6))
    ((run,), _) = compare_with_measured(machine, read_circular_test(path))
    # The bar is 0.05 mm longer than it says, which points a little elsewhere from elsewhere.
    assert run.measured.circular_deviation_mm < 1e-5


@pytest.mark.parametrize("digits", [2, 3])
def test_positions_that_were_rounded_are_no_error_of_the_machine(tmp_path, digits):
    machine = Model(wavy().machine)
    path = measured_file(tmp_path / "trace.csv", machine, circle_to_test(machine), noise_mm=1e-4)
    pl.read_csv(path).with_columns(pl.col("x", "y").round(digits)).write_csv(path)
    ((run,), _) = compare_with_measured(machine, read_circular_test(path))
    assert run.predicted.circular_deviation_mm < 1e-9
    # The angle of a point is rounded, too: a hundredth of a millimetre along a circle that is 0.36 mm off centre.
    assert run.set_up.rms_mm < 1.3e-4


def test_one_mistaken_radius_is_set_aside(tmp_path):
    machine = wavy()
    path = measured_file(tmp_path / "trace.csv", machine, circle_to_test(machine))
    lines = path.read_text().splitlines()
    words = lines[12].split(",")
    lines[12] = ",".join([words[0], "1e9", *words[2:]])
    path.write_text("\n".join(lines) + "\n")
    ((run,), (problem,)) = compare_with_measured(machine, read_circular_test(path))
    assert (problem.row, problem.column) == (13, "r")
    assert run.set_up.rms_mm < 1e-6


@pytest.mark.parametrize("share", [0.2, 0.4998])
def test_a_radius_of_another_circle_loses_no_row_and_is_told(tmp_path, share):
    """Half of the rows were set aside where they happened to be above 1.5 times the radius, and G was half."""
    machine = wavy()
    circle = circle_to_test(machine)
    path = measured_file(tmp_path / "trace.csv", machine, circle, constant=share * circle.radius_mm)
    result = run_circular_test(machine, circle, measured=read_circular_test(path))
    assert not result.set_aside
    assert len(result.runs[0].measured.angle_rad) == 120
    (note,) = (note for note in result.notes if "measured radius" in note)
    assert "off by so much" in note
    measured_file(path, machine, circle)
    told = run_circular_test(machine, circle, measured=read_circular_test(path)).notes
    assert not any("measured radius" in note for note in told)


@pytest.mark.parametrize("runs", [("ccw", "cw"), ("cw", "ccw"), ("cw", "ccw", "cw")])
@pytest.mark.parametrize("plane", ["XY", "YZ", "ZX"])
def test_a_run_that_turns_round_is_two(tmp_path, plane, runs):
    """Nothing in the file names them: one line, no `dir`. The point at which it turns is the end of either."""
    machine = wavy()
    path = measured_file(tmp_path / "trace.csv", machine, circle_to_test(machine, plane), runs=runs, n=121)
    pl.read_csv(path).drop("line").write_csv(path)
    found, set_aside = compare_with_measured(machine, read_circular_test(path))
    assert not set_aside
    senses = [1 if name == "ccw" else -1 for name in runs]
    assert [run.direction for run in found] == senses
    assert [len(run.measured.angle_rad) for run in found] == pytest.approx([121] * len(runs), abs=1)


def test_two_turns_with_an_overlap_are_one_run(tmp_path):
    machine = wavy()
    circle = circle_to_test(machine)
    path = measured_file(tmp_path / "trace.csv", machine, circle, runs=("ccw", "ccw"))
    frame = pl.read_csv(path).drop("line")
    # Half a dozen points back before it goes on: the bar was looked at by hand.
    pl.concat([frame[:40], frame[34:]]).write_csv(path)
    (run,), _ = compare_with_measured(machine, read_circular_test(path))
    assert (run.direction, len(run.measured.angle_rad)) == (1, 246)


def test_the_set_up_is_the_one_that_scipy_finds(tmp_path):
    truth, believed = wavy(), wavy(scale=0.9)
    circle = circle_to_test(truth)
    measured = read_circular_test(measured_file(tmp_path / "trace.csv", truth, circle))
    (run,), _ = compare_with_measured(believed, measured)
    commanded = measured.frame.select("x", "y", "z").to_numpy()
    actual = commanded + believed.error_mm(commanded)
    points, height = actual[:, :2] - np.array(LI_CENTER_MM), actual[:, 2] - actual[:, 2].mean()
    radius = measured.frame["r"].to_numpy()

    def residual(p):
        return radius - np.sqrt((points[:, 0] - p[0]) ** 2 + (points[:, 1] - p[1]) ** 2 + height**2) - p[2]

    expected = least_squares(residual, [0, 0, 0], xtol=1e-14, ftol=1e-14, gtol=1e-14, jac="3-point")
    np.testing.assert_allclose([*run.set_up.center_mm, run.set_up.radius_offset_mm], expected.x, atol=1e-6)
    np.testing.assert_allclose(run.set_up.difference_mm, residual(expected.x), atol=1e-6)
    # A tenth of the skew is missing: an ellipse of 0.1·5.05e-3·100/2 mm amplitude, at least, stays.
    assert run.set_up.rms_mm > 0.5 * 0.1 * 5.05e-3 * 100 / 2 / np.sqrt(2)


def test_bad_rows_are_named_and_the_rest_goes_on(tmp_path):
    machine = wavy()
    path = measured_file(tmp_path / "trace.csv", machine, circle_to_test(machine))
    lines = path.read_text().splitlines()
    lines[4] = lines[4].rsplit(",", 3)[0] + ",nan,270,0"
    lines[9] = "ccw,100.0,212,270,0"
    lines[30] = "lonely," + lines[30].split(",", 1)[1]
    path.write_text("\n".join(lines) + "\n")
    runs, set_aside = compare_with_measured(machine, read_circular_test(path))
    assert [run.name for run in runs] == ["ccw"]
    assert len(runs[0].measured.angle_rad) == 117
    # Noise-free apart from the rows that went: nothing but the set-up is between bar and model.
    assert runs[0].set_up.rms_mm < 1e-6
    assert [problem.row for problem in set_aside] == [5, 10, 31]
    assert "not a finite number" in set_aside[0].problem
    assert "not on the run's circle" in set_aside[1].problem
    assert "1 points" in set_aside[2].problem


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda frame: frame.with_columns(r=pl.col("r") - 100.0), "not its deviation"),
        (lambda frame: frame.with_columns(r=pl.col("r") * 2.0), "not the diameter"),
        (lambda frame: frame.with_columns(z=pl.col("x")), "all three axes move"),
        (
            lambda frame: frame.with_columns(x=pl.col("x") + 150.0),
            "trace.csv:[0-9]+: .*x = [0-9.]+ mm is outside the machine's range",
        ),
        (lambda frame: frame.head(25), "covers 72° of the circle"),
        (lambda frame: frame.head(3), "3 points"),
        (lambda frame: frame.with_columns(y=pl.col("x") * 2.0), "straight line"),
    ],
)
def test_traces_that_cannot_be_compared_are_refused(tmp_path, change, words):
    machine = wavy()
    path = measured_file(tmp_path / "trace.csv", machine, circle_to_test(machine))
    change(pl.read_csv(path)).write_csv(path)
    with pytest.raises(InputFileError, match=words):
        compare_with_measured(machine, read_circular_test(path))


def test_the_circle_of_a_trace_is_found_from_its_commands(tmp_path):
    machine = wavy()
    circle = CircleOfCommands("ZX", (30.0, 120.0, 140.0), 25.0)
    path = measured_file(tmp_path / "trace.csv", machine, circle, n=60)
    assert circle_of_first_run(read_circular_test(path)) == circle


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (
            {"radius_mm": 200.0},
            "needs x from 12 to 412 mm.*machine's range is 0 to 400.*\n.*--center 212,270 --radius 130",
        ),
        ({"center_mm": (212.0, 270.0, -1.0)}, "stands at z = -1 mm.*\n.*--center 212,270,0 --radius 100"),
        ({"plane": "XZ"}, "not a plane.*\n.*XY, YZ, ZX"),
        ({"radius_mm": 0.0}, "radius 0 mm cannot be run"),
        ({"radius_mm": float("nan")}, "cannot be run"),
    ],
)
def test_a_circle_that_does_not_fit_is_refused_with_one_that_does(options, words):
    with pytest.raises(GeometryError, match=f"(?s){words}"):
        circle_to_test(wavy(), **options)


def test_a_circle_outside_the_measured_range_is_refused():
    narrow = model({"EXX": lambda q: 1e-4 * q}, position_mm=np.linspace(50.0, 300.0, 11))
    with pytest.raises(
        GeometryError, match=r"(?s)errors were measured is 50 to 300 mm.*--center 212,270 --radius 88"
    ):
        circle_to_test(narrow)


def test_a_constant_bounds_no_circle():
    constant = model({"EXX": lambda q: 0.01}, position_mm=np.array([0.0]))
    assert predict_trace(constant, circle_to_test(constant)).circular_deviation_mm < 1e-12


def test_the_level_is_the_low_end_where_zero_is_outside():
    raised = model({"EXZ": lambda q: 1e-4 * q}, position_mm=np.linspace(20.0, 380.0, 10))
    assert circle_to_test(raised).center_mm == (212.0, 270.0, 20.0)


def test_the_nominal_machine_draws_a_perfect_circle():
    nominal = Model(wavy().machine)
    result = run_circular_test(nominal, circle_to_test(nominal), with_eq23=True)
    for trace in (*result.before, *result.after, result.eq23):
        assert trace.circular_deviation_mm < 1e-12


def test_what_is_not_determined_is_said():
    unknown = model({"EXX": lambda q: 1e-4 * q}, not_determined=("EAX",))
    assert run_circular_test(unknown, circle_to_test(unknown)).assumed_zero == ("EAX",)


def run_command(*arguments):
    app = typer.Typer()
    verify_ballbar.register(app)
    # A second command keeps the group a group, as it is in geoerr.
    app.command("other")(lambda: None)
    return CliRunner().invoke(app, ["ballbar", *[str(argument) for argument in arguments]], catch_exceptions=True)


def test_the_command_prints_what_it_computes(tmp_path):
    machine = wavy()
    write_errors(tmp_path / "errors.json", machine.errors)
    trace = measured_file(tmp_path / "trace.csv", machine, circle_to_test(machine), noise_mm=1e-3)
    json_run = run_command(tmp_path / "errors.json", "--trace", trace, "--eq23", "--json")
    assert json_run.exit_code == 0, json_run.output
    document = json.loads(json_run.stdout)
    expected = predict_trace(machine, circle_to_test(machine)).circular_deviation_mm * 1e3
    assert document["before"]["ccw"]["circular_deviation_um"] == pytest.approx(expected, rel=1e-9)
    assert document["measured"][0]["n"] == 120
    assert document["eq23"]["circular_deviation_um"] < expected
    assert set(document["provenance"]["inputs"]) == {str(tmp_path / "errors.json"), str(trace)}
    text = run_command(tmp_path / "errors.json", "--trace", trace, "--eq23", "--report", tmp_path / "page.html")
    assert text.exit_code == 0, text.output
    assert f"{expected:.1f} µm" in text.stdout
    assert "no squareness" in text.stdout
    assert "Circular test" in (tmp_path / "page.html").read_text(encoding="utf-8")


def test_what_the_model_says_of_itself_is_no_proof(tmp_path):
    machine, errors, page = wavy(), tmp_path / "errors.json", tmp_path / "page.html"
    write_errors(errors, machine.errors)
    trace = measured_file(tmp_path / "trace.csv", machine, circle_to_test(machine))
    said = "(before and after by the model itself; a measured circle "
    alone = run_command(errors, "--report", page).stdout
    # A line to copy stands by itself.
    assert f"{said}proves it)\n  geoerr verify ballbar {errors} --trace circle.csv\n" in alone
    assert "By the model itself, on a circle" in page.read_text(encoding="utf-8")
    assert "a measured circle proves the model" in page.read_text(encoding="utf-8")
    assert f"{said}is compared below)" in run_command(errors, "--trace", trace).stdout
    assert "by the model itself" not in run_command(errors, "--truth", errors, "--report", page).stdout
    assert "By the model itself" not in page.read_text(encoding="utf-8")


def test_a_page_never_replaces_what_was_read(tmp_path):
    machine = wavy()
    write_errors(tmp_path / "errors.json", machine.errors)
    trace = measured_file(tmp_path / "trace.csv", machine, circle_to_test(machine))
    for read in (tmp_path / "errors.json", trace):
        before = read.read_bytes()
        refused = run_command(tmp_path / "errors.json", "--trace", trace, "--report", read)
        assert isinstance(refused.exception, InputFileError)
        assert read.read_bytes() == before


def test_the_command_takes_circle_and_plane_from_the_trace(tmp_path):
    machine = wavy()
    write_errors(tmp_path / "errors.json", machine.errors)
    circle = CircleOfCommands("YZ", (10.0, 200.0, 210.0), 50.0)
    trace = measured_file(tmp_path / "trace.csv", machine, circle)
    document = json.loads(run_command(tmp_path / "errors.json", "--trace", trace, "--json").stdout)
    assert (document["plane"], document["center_mm"], document["radius_mm"]) == ("YZ", [10.0, 200.0, 210.0], 50.0)
    wrong = run_command(tmp_path / "errors.json", "--trace", trace, "--plane", "XY")
    assert isinstance(wrong.exception, InputFileError)


@pytest.mark.parametrize("option", [("--center", "1"), ("--center", "a,b"), ("--plane", "XZ"), ("--center", "1,nan")])
def test_wrong_usage_is_status_2(tmp_path, option):
    write_machine(tmp_path / "machine.toml", wavy().machine)
    assert run_command(tmp_path / "machine.toml", *option).exit_code == 2
