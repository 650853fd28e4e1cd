"""The path of a program before and after: figures by hand, pieces, refusals, the verb."""

from __future__ import annotations

import json

import numpy as np
import pytest
from typer.testing import CliRunner
from verify_machines import model, wavy

from geoerr.cli.main import app
from geoerr.compensate.program import CompensationOptions, compensate_program
from geoerr.error_functions import write_errors
from geoerr.errors import GcodeError, GeoerrError, InputFileError
from geoerr.machine import write_machine
from geoerr.verify.path import compare_paths
from geoerr.verify.path_trace import trace_paths

SMALL = {"EXX": lambda q: 1e-4 * q}
PROGRAM = """G28
G1 X20 Y20 Z5 F3000
;LAYER:1
G1 X300.5 E10 ; wall
G1 Y280.25 E20
M106 S128
G0 X20 Y20
G91
G1 Z.2
G90
G92 E0
G1 X200 Y150 E3.5
M84
"""


def written(folder, text, name="in.gcode"):
    path = folder / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


def test_before_is_the_error_of_the_model(tmp_path):
    # A scale error of 1 mm/m and nothing else: 0.3 mm at X 300, and its rms along X from 0 is 0.3 / √3.
    machine = model({"EXX": lambda q: 1e-3 * q})
    program = written(tmp_path, "G1 X0 Y0 Z0\nG1 X300\n")
    result = compare_paths(machine, program, program)
    assert result.max_error_um_before == pytest.approx(300.0, abs=1e-6)
    # Samples each 0.5 mm, trapezoid: the mean square is right to h²/(2 L²).
    assert result.rms_um_before == pytest.approx(300.0 / np.sqrt(3.0), rel=2e-6)
    assert result.path_mm == pytest.approx(300.0)
    assert (result.max_error_um_after, result.rms_um_after) == (result.max_error_um_before, result.rms_um_before)
    assert (result.moves_in, result.moves_compared, result.moves_not_compared) == (2, 1, 1)


def test_a_trace_has_the_error_where_it_is(tmp_path):
    """The same scale error: along X it grows with the distance travelled, and the picture shows it."""
    program = written(tmp_path, "G1 X0 Y0 Z0\nG1 X300\n")
    trace = trace_paths(model({"EXX": lambda q: 1e-3 * q}), program, program)
    assert trace.result.max_error_um_before == pytest.approx(300.0, abs=1e-6)
    assert trace.distance_mm[-1] == pytest.approx(300.0)
    np.testing.assert_allclose(trace.before_mm, 1e-3 * trace.distance_mm, atol=1e-3)
    np.testing.assert_array_equal(trace.before_mm, trace.after_mm)
    figure = trace.plot_error(0.005)
    assert figure.data[0].name.endswith("300.0 µm")
    assert "tolerance 5.00 µm" in figure.data[2].name
    np.testing.assert_allclose(trace.intended_mm[:, 0], trace.distance_mm, atol=1.0)
    assert [len(one.x) for one in trace.plot_places().data] == [len(trace.distance_mm)] * 2
    assert "largest error, µm" in trace._repr_html_()


def test_a_corrected_program_follows_its_path(tmp_path):
    machine = wavy()
    program, output = written(tmp_path, PROGRAM), tmp_path / "out.gcode"
    compensation = compensate_program(machine, program, output)
    result = compare_paths(machine, program, output)
    assert result.max_error_um_before > 500.0
    assert result.max_error_um_after < 5.0
    assert result.rms_um_after < result.max_error_um_after
    assert (result.moves_in, result.moves_out) == (compensation.moves_in, compensation.moves_out)
    assert result.moves_out > result.moves_in
    assert result.extrusion_in_mm == result.extrusion_out_mm == 23.5
    assert result.moves_with_other_extrusion == 0
    # Nothing but the first move, from an unknown place, is left out.
    assert result.moves_not_compared == 1


def test_figures_do_not_depend_on_threads_and_little_on_the_step(tmp_path):
    machine = wavy()
    program, output = written(tmp_path, PROGRAM), tmp_path / "out.gcode"
    compensate_program(machine, program, output)
    one = compare_paths(machine, program, output, threads=1)
    assert compare_paths(machine, program, output, threads=8) == one
    fine = compare_paths(machine, program, output, sample_step_mm=0.05)
    assert fine.max_error_um_after == pytest.approx(one.max_error_um_after, abs=0.05)
    assert fine.max_error_um_after < 5.0


def test_a_correction_for_another_machine_is_found_out(tmp_path):
    program, output = written(tmp_path, PROGRAM), tmp_path / "out.gcode"
    compensate_program(wavy(), program, output)
    result = compare_paths(wavy(scale=-1.0), program, output)
    assert result.max_error_um_after > 1.5 * result.max_error_um_before


def test_one_wrong_word_is_found_out(tmp_path):
    machine = wavy()
    program, output = written(tmp_path, PROGRAM), tmp_path / "out.gcode"
    compensate_program(machine, program, output)
    lines = output.read_text().splitlines()
    number = next(n for n, line in enumerate(lines) if line.endswith("; wall"))
    words = lines[number].split(" ")
    lines[number] = lines[number].replace(words[2], f"Y{float(words[2][1:]) + 1.0:.4f}")
    result = compare_paths(machine, program, written(tmp_path, "\n".join(lines) + "\n", "wrong.gcode"))
    assert result.max_error_um_after == pytest.approx(1000.0, abs=10.0)
    assert abs(result.max_error_line_after - (number + 1)) <= 1


def test_another_extrusion_is_found_out(tmp_path):
    machine = wavy()
    program, output = written(tmp_path, PROGRAM), tmp_path / "out.gcode"
    compensate_program(machine, program, output)
    wrong = written(tmp_path, output.read_text().replace("E3.5", "E3.50001"), "wrong.gcode")
    result = compare_paths(machine, program, wrong)
    assert result.moves_with_other_extrusion == 1
    assert result.extrusion_out_mm == pytest.approx(23.50001, abs=1e-9)


def test_filament_that_comes_in_one_heap_is_found_out(tmp_path):
    """The whole move extrudes what it did: a piece too much of it, and the next so much less."""
    machine = wavy()
    program, output = written(tmp_path, "M82\nG1 X10 Y10 Z10 F1200\nG1 X300 Y40 E20\n"), tmp_path / "out.gcode"
    compensate_program(machine, program, output, CompensationOptions(firmware="marlin"))
    assert compare_paths(machine, program, output, firmware="marlin").moves_with_other_extrusion == 0
    lines = output.read_text().splitlines()
    places = [number for number, line in enumerate(lines) if " E" in line]
    assert len(places) > 2
    head, _, words = lines[places[0]].partition(" E")
    lines[places[0]] = f"{head} E{float(words.split()[0]) + 2.0:.5f}"
    heaped = written(tmp_path, "\n".join(lines) + "\n", "heaped.gcode")
    result = compare_paths(machine, program, heaped, firmware="marlin")
    assert result.moves_with_other_extrusion == 1
    assert result.extrusion_out_mm == result.extrusion_in_mm


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        (("M106 S128", "M106 S127"), "`M106 S127` stands where"),
        (("M84\n", ""), "the end stands where .*in.gcode:13 has `M84`"),
        ((";LAYER:1\n", ""), "stands where .*in.gcode:3 has `;LAYER:1`"),
        (("G92 E0\n", "G92 E0\nG4 P1\n"), "`G4 P1` stands where|moves are missing"),
    ],
)
def test_a_program_that_is_not_the_other_one_is_refused(tmp_path, change, problem):
    machine = wavy()
    program, output = written(tmp_path, PROGRAM), tmp_path / "out.gcode"
    compensate_program(machine, program, output)
    other = written(tmp_path, output.read_text().replace(*change), "other.gcode")
    with pytest.raises(GcodeError, match=problem):
        compare_paths(machine, program, other)


def test_missing_moves_and_files_are_refused(tmp_path):
    machine = wavy()
    program = written(tmp_path, "G1 X20 Y20 Z5\nG1 X30\nG1 X40\nM84\n")
    with pytest.raises(
        GcodeError, match=r"short.gcode:3: 1 moves are missing before this line, which is .*in.gcode:4"
    ):
        compare_paths(machine, program, written(tmp_path, "G1 X20 Y20 Z5\nG1 X40\nM84\n", "short.gcode"))
    with pytest.raises(GcodeError, match=r"cut.gcode:2: the end stands where .*in.gcode:4 has `M84`"):
        compare_paths(machine, program, written(tmp_path, "G1 X20 Y20 Z5\nG1 X30\n", "cut.gcode"))
    with pytest.raises(GcodeError, match=r"long.gcode:5: `M85` stands where .*in.gcode:4 has the end"):
        compare_paths(machine, program, written(tmp_path, program.read_text() + "M85\n", "long.gcode"))
    extra = written(tmp_path, "M84\nM85\nG1 X1 Y1 Z1\nM86\n", "extra.gcode")
    with pytest.raises(
        GcodeError, match=r"extra.gcode:4: moves stand before this line, and none before .*none.gcode:3"
    ):
        compare_paths(machine, written(tmp_path, "M84\nM85\nM86\n", "none.gcode"), extra)
    assert compare_paths(machine, tmp_path / "none.gcode", tmp_path / "none.gcode").moves_in == 0
    with pytest.raises(InputFileError, match="no such program"):
        compare_paths(machine, program, tmp_path / "nowhere.gcode")


def test_work_offset_home_and_inches(tmp_path):
    machine = wavy()
    text = "G28\nG20\nG0 Z1\nG0 X.5 Y.5\nG1 X8.25 Y6.125 F40\nG92 X0\nG1 X1\nG53 G0 Z12\n"
    program, output = written(tmp_path, text), tmp_path / "out.gcode"
    places = {"work_offset_mm": (12.5, 7.25, 3.0), "home_mm": (0.0, 0.0, 350.0)}
    compensate_program(machine, program, output, CompensationOptions(**places))
    result = compare_paths(machine, program, output, **places)
    assert result.moves_in == 5
    assert result.moves_compared == 4
    assert result.max_error_um_before > 500.0
    assert result.max_error_um_after < 5.0
    # With another offset it is another place, and the correction is wrong there.
    other = {**places, "work_offset_mm": (0.0, 0.0, 1.0)}
    assert compare_paths(machine, program, output, **other).max_error_um_after > 20.0
    # Without any, G53 tells nothing of where the program's words are.
    with pytest.raises(GcodeError) as refused:
        compare_paths(machine, program, output, home_mm=(0.0, 0.0, 350.0))
    assert str(refused.value.remedy).endswith("and --work-offset where it was given one")


def test_a_home_that_only_the_correction_was_told_is_named(tmp_path):
    """Without it no place behind G28 is known, and the moves of the corrected program are none of the other."""
    machine, home = wavy(), (10.0, 10.0, 10.0)
    program, output = written(tmp_path, "G28\nG1 X300 F1200\nG1 Y300\n"), tmp_path / "out.gcode"
    zero = (0.0, 0.0, 0.0)
    compensate_program(machine, program, output, CompensationOptions(home_mm=home, work_offset_mm=zero))
    with pytest.raises(GcodeError, match=r"hint: .*, and --home where it was given one"):
        compare_paths(machine, program, output, work_offset_mm=zero)
    assert compare_paths(machine, program, output, home_mm=home, work_offset_mm=zero).moves_compared == 1
    # Where the program's zero is not told, a place on the machine says nothing of its words.
    with pytest.raises(GcodeError, match=r"hint: .*, and --work-offset where it was given one"):
        compare_paths(machine, program, output, home_mm=home)
    other = written(tmp_path, "G1 X20 Y20 Z5\nM84\n", "other.gcode")
    with pytest.raises(GcodeError) as refused:
        compare_paths(machine, other, output)
    assert "--home" not in str(refused.value)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        *(("sample_step_mm", step) for step in (0.0, -1.0, np.nan, np.inf)),
        ("home_mm", (0.0, 0.0, np.nan)),
        ("work_offset_mm", (0.0, 0.0)),
        ("work_offset_mm", "1,2,3"),
        ("firmware", "Marlin"),
        ("threads", -1),
        ("threads", 1.5),
    ],
)
def test_an_argument_that_makes_no_sense_is_refused_by_name(tmp_path, name, value):
    program = written(tmp_path, PROGRAM)
    with pytest.raises(GeoerrError, match=rf"^{name} .*\nhint: "):
        compare_paths(wavy(), program, program, **{name: value})


def run(*arguments):
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


@pytest.fixture
def files(tmp_path):
    machine = wavy()
    write_errors(tmp_path / "errors.json", machine.errors)
    write_machine(tmp_path / "machine.toml", machine.machine)
    written(tmp_path, PROGRAM)
    return tmp_path


def test_the_verbs(files):
    errors, program, output = files / "errors.json", files / "in.gcode", files / "out.gcode"
    done = run("compensate", errors, program, "-o", output, "--json")
    assert done.exit_code == 0, done.output
    document = json.loads(done.stdout)
    assert document["moves_out"] > document["moves_in"] == 6
    assert document["provenance"]["inputs"].keys() == {str(errors), str(program)}
    assert "warning: line 1" not in done.stdout

    path = json.loads(run("verify", "path", errors, program, output, "--json").stdout)
    for key in (
        *("max_error_um_before", "max_error_um_after", "rms_um_before", "rms_um_after"),
        *("moves_in", "moves_out", "extrusion_in_mm", "extrusion_out_mm"),
    ):
        assert key in path
    assert path["max_error_um_after"] < 5.0

    shown = run("verify", "path", errors, program, output, "--tolerance", "0.005")
    assert shown.exit_code == 0
    assert "moves compared" in shown.stdout
    far = run("verify", "path", errors, program, program, "--tolerance", "0.005")
    assert far.exit_code == 1

    again = run("compensate", errors, output, "-o", files / "twice.gcode")
    assert again.exit_code == 1
    assert isinstance(again.exception, GcodeError)
    assert not (files / "twice.gcode").exists()

    nominal = run("compensate", files / "machine.toml", program, "-o", files / "same.gcode")
    assert nominal.exit_code == 0
    assert (files / "same.gcode").read_bytes() == program.read_bytes()


@pytest.mark.parametrize(
    ("arguments", "exit_code"),
    [
        (["--work-offset", "1,2"], 2),
        (["--work-offset", "1,2,x"], 2),
        (["--home", "nan,0,0"], 2),
        (["--at", "temp"], 2),
        (["--at", "temp=warm"], 2),
        (["--firmware", "other"], 2),
        (["--on-unsupported", "ignore"], 2),
        (["--digits", "0"], 2),
        (["--tolerance", "0"], 2),
        (["--firmware-corrects", "mesh"], 1),
        (["--work-offset", "-30,0,0"], 1),
        # Tables of errors follow no temperature: the command line of a model that does serves them, too.
        (["--at", "temp=90"], 0),
        (["--at", "temp=reference"], 0),
        (["--firmware", "klipper", "--firmware-corrects", "squareness,EXX", "--work-offset", "1,-2,0.5"], 0),
    ],
)
def test_options_of_compensate(files, arguments, exit_code):
    done = run("compensate", files / "errors.json", files / "in.gcode", "-o", files / "out.gcode", *arguments)
    assert done.exit_code == exit_code, (done.output, done.exception)
    assert (files / "out.gcode").exists() == (exit_code == 0)
    said = "note: the model does not depend on temp: --at temp changes nothing" in done.stderr
    assert said == (exit_code == 0 and "--at" in arguments)


def test_standard_output_and_input(files):
    errors, program, output = files / "errors.json", files / "in.gcode", files / "out.gcode"
    run("compensate", errors, program, "-o", output)
    piped = CliRunner().invoke(
        app, ["compensate", str(errors), "-", "-o", "-", "--threads", "2"], input=program.read_bytes()
    )
    assert piped.exit_code == 0
    assert piped.stdout_bytes == output.read_bytes()
    assert run("compensate", errors, program, "-o", "-", "--json").exit_code == 2
    assert run("compensate", errors, program, "-o", errors).exit_code == 1
    assert run("compensate", errors, program, "-o", program).exit_code == 1


def test_what_was_not_compared_is_not_proved(tmp_path):
    errors = tmp_path / "errors.json"
    write_errors(errors, model(SMALL).errors)
    program = written(tmp_path, "G91\nG1 X50 Y50 Z10\n")
    failed = run("verify", "path", errors, program, program, "--tolerance", "0.001")
    assert failed.exit_code == 1
    assert "nothing is proved" in str(failed.exception)
    one = written(tmp_path, "G91\nG1 X50 Y50 Z10\n", "one.gcode")
    assert "1 move not compared" in run("verify", "path", errors, one, one).stdout
    # Who has said where homing leaves the machine is not asked for it again.
    homed = written(tmp_path, "G28\nG1 X50 Y50 Z10\n", "homed.gcode")
    failed = run("verify", "path", errors, homed, homed, "--home", "0,0,0", "--tolerance", "0.001")
    assert "say where the program's zero is: --work-offset" in str(failed.exception)
    assert "--home" not in str(failed.exception)
    told = ("--home", "0,0,0", "--firmware", "marlin")
    failed = run("verify", "path", errors, homed, homed, *told, "--tolerance", "0.001")
    assert "--home" not in str(failed.exception)
    assert "--work-offset" not in str(failed.exception)
    assert "of the first move behind G28 only the end is corrected" in str(failed.exception)
    assert "of the first move behind G28 only the end is corrected" in failed.stdout
    assert run("verify", "path", errors, program, program).exit_code == 0


@pytest.mark.parametrize(
    ("begin", "lacks_zero"),
    [
        ("", True),
        ("M140 S60\n", False),
        ("G10 L2 P1 X0 Y0 Z0\n", False),
        ("G92 E0\n", False),
        ("G10 L2 P1 X0\n", True),
    ],
)
def test_a_zero_that_the_program_tells_is_not_asked_for(tmp_path, begin, lacks_zero):
    errors = tmp_path / "errors.json"
    write_errors(errors, model(SMALL).errors)
    program = written(tmp_path, f"{begin}G28\nG1 X50 Y50 Z10 F600\n")
    assert compare_paths(model(SMALL), program, program, home_mm=(0.0, 0.0, 0.0)).lacks_zero == lacks_zero
    failed = run("verify", "path", errors, program, program, "--home", "0,0,0", "--tolerance", "5")
    assert failed.exit_code == 1
    assert ("--work-offset" in str(failed.exception)) == lacks_zero


UNTOUCHED = """G90
G0 X10 Y10 Z10
G1 X60 F300
G2 X80 Y30 I20 J0
G1 X90 Y30
G81 X50 Y50 Z-5 R2
X60
G80
G0 X10 Y10 Z10
PARK
G1 X70
G65 P9000 X1
G0 X10 Y10 Z10
M98 P100
G1 X20
"""


def test_moves_that_stay_as_they_were_are_no_proof(tmp_path):
    """One move of many was compared, and the check passed: it is what `compensate` counts as untouched."""
    errors = tmp_path / "errors.json"
    write_errors(errors, wavy().errors)
    program, output = written(tmp_path, UNTOUCHED), tmp_path / "out.gcode"
    done = compensate_program(wavy(), program, output, CompensationOptions(on_unsupported="pass"))
    untouched = done.untouched_position_unknown + done.untouched_unsupported + done.lines_not_followed
    result = compare_paths(wavy(), program, output)
    assert result.max_error_um_after < 5.0
    assert (result.moves_not_followed, result.not_followed_line) == (untouched, 4) == (7, 4)
    failed = run("verify", "path", errors, program, output, "--tolerance", "0.005")
    assert failed.exit_code == 1
    told = "7 moves cannot be followed and stay as they were written (the first: line 4)"
    assert told in failed.stdout
    assert str(failed.exception).startswith(f"{told}\nhint: ")
    assert str(failed.exception).endswith("--allow-untouched 7")
    check = ("verify", "path", errors, program, output, "--tolerance", "0.005", "--allow-untouched")
    assert run(*check, "6").exit_code == 1
    assert run(*check, "7").exit_code == 0
    # Of the first move, from a place that is not known, the end is corrected: nothing is left out.
    whole = written(tmp_path, PROGRAM, "whole.gcode")
    assert compare_paths(wavy(), whole, whole).moves_not_followed == 0


def test_another_extrusion_is_no_proof(tmp_path):
    errors = tmp_path / "errors.json"
    write_errors(errors, model({}).errors)
    program = written(tmp_path, "G1 X0 Y0 Z0\nG1 X10 E10\n")
    other = written(tmp_path, "G1 X0 Y0 Z0\nG1 X10 E100\n", "other.gcode")
    failed = run("verify", "path", errors, program, other, "--tolerance", "0.001")
    assert failed.exit_code == 1
    assert "1 move extrudes another length" in str(failed.exception)
    assert "(line 2)" in str(failed.exception)
    assert "hint: name the firmware" in str(failed.exception)
    named = run("verify", "path", errors, program, other, "--tolerance", "0.001", "--firmware", "marlin")
    assert "name the firmware" not in str(named.exception)
    assert "correct the program again, with --firmware marlin" in str(named.exception)


def test_a_path_that_is_far_off_is_told_before_its_extrusion(files):
    """A piece goes a millimetre astray and extrudes two too much: the place is the news."""
    errors, program, output = files / "errors.json", files / "in.gcode", files / "out.gcode"
    run("compensate", errors, program, "-o", output, "--firmware", "marlin")
    lines = output.read_text().splitlines()
    number = next(n for n, line in enumerate(lines) if line.endswith("; wall"))
    y, extruded = (next(word for word in lines[number].split() if word[0] == letter) for letter in "YE")
    lines[number] = lines[number].replace(y, f"Y{float(y[1:]) + 1.0:.4f}")
    lines[number] = lines[number].replace(extruded, f"E{float(extruded[1:]) + 2.0:.5f}")
    astray = written(files, "\n".join(lines) + "\n", "astray.gcode")
    failed = run("verify", "path", errors, program, astray, "--firmware", "marlin", "--tolerance", "0.005")
    problem, _, hint = str(failed.exception).partition("\nhint: ")
    assert problem.startswith("the corrected path is up to ")
    assert "extrude" in problem.partition("; ")[2]
    assert f"(line {number + 1})" in problem.rpartition("; ")[2]
    assert "--home" in hint
    assert "name the firmware" not in hint


@pytest.mark.parametrize(
    ("lines", "length_mm"),
    [
        ("G20\nG1 X11.5 E1\n", 25.4),
        ("G20\nM83\nG1 X11.5 E.50001\nG1 E-.125\n", 0.37501 * 25.4),
        ("G20\nG92 E1\nG1 X11.5 E3\n", 2.0 * 25.4),
        # Where E stands is the same place in both units.
        ("G1 E50.8\nG20\nG1 X11.5 E3\nG21\nG1 X20 E80\n", 80.0),
    ],
)
def test_extrusion_in_inches_is_told_in_millimetres(tmp_path, lines, length_mm):
    program, output = written(tmp_path, f"G1 X20 Y20 Z5 F3000\n{lines}"), tmp_path / "out.gcode"
    compensation = compensate_program(wavy(), program, output)
    assert compensation.moves_out > compensation.moves_in
    result = compare_paths(wavy(), program, output)
    for one in (compensation, result):
        assert one.extrusion_in_mm == one.extrusion_out_mm == pytest.approx(length_mm, abs=1e-9)
    assert result.moves_with_other_extrusion == 0


FEEDS = """G1 X20 Y20 Z5 F3000
G1 X300.5 F1200
G0 X20
G1 Y280.25
G95
G1 X200 F.2
G94
G1 X20 F600
M84
"""


@pytest.mark.parametrize("firmware", [None, "marlin"])
def test_a_corrected_program_keeps_its_feeds(tmp_path, firmware):
    program, output = written(tmp_path, FEEDS), tmp_path / "out.gcode"
    compensate_program(wavy(), program, output, CompensationOptions(firmware=firmware))
    result = compare_paths(wavy(), program, output, firmware=firmware)
    assert result.moves_out > result.moves_in
    assert (result.max_feed_change_percent, result.max_feed_change_line, result.moves_with_other_feed) == (0.0, 0, 0)


@pytest.mark.parametrize(
    ("old", "new", "percent", "n_moves"),
    [
        # It holds for the moves behind it, also where a mill's rapid lies between.
        ("F1200", "F2400", 100.0, 3),
        ("F1200", "F1206", 0.5, 0),
        (" F1200", "", 150.0, 3),
        ("F600", "F480", 20.0, 1),
        ("F.2", "F2", 900.0, 1),
        # A mill's rapid through the part has no feed to compare.
        ("G1 Y", "G0 Y", 100.0, 1),
        ("G1 X20 Y20 Z5 F3000", "G1 X20 Y20 Z5", 100.0, 1),
    ],
)
def test_another_feed_is_found_out(tmp_path, old, new, percent, n_moves):
    machine = model({})
    program = written(tmp_path, FEEDS)
    other = written(tmp_path, FEEDS.replace(old, new), "other.gcode")
    result = compare_paths(machine, program, other)
    assert result.max_feed_change_percent == pytest.approx(percent)
    first = 1 + FEEDS[: FEEDS.index(old)].count("\n")
    assert result.max_feed_change_line == first
    assert result.moves_with_other_feed == n_moves
    assert result.max_error_um_after == result.max_error_um_before == 0.0


def test_a_feed_that_none_had_before_is_found_out(tmp_path):
    program = written(tmp_path, "G1 X20 Y20 Z5\nG1 X30\n")
    other = written(tmp_path, "G1 X20 Y20 Z5\nG1 X30 F600\n", "other.gcode")
    result = compare_paths(model({}), program, other)
    assert (result.max_feed_change_percent, result.max_feed_change_line, result.moves_with_other_feed) == (
        100.0,
        2,
        1,
    )


def test_another_feed_is_no_proof(tmp_path):
    errors = tmp_path / "errors.json"
    write_errors(errors, model({}).errors)
    program = written(tmp_path, FEEDS)
    other = written(tmp_path, FEEDS.replace("F600", "F480"), "other.gcode")
    told = run("verify", "path", errors, program, other)
    assert told.exit_code == 0
    assert "the feed differs by up to 20.00 %, line 8; by more than 1 % in 1 move" in told.stdout
    failed = run("verify", "path", errors, program, other, "--tolerance", "0.001")
    assert failed.exit_code == 1
    assert "by up to 20.00 %, line 8" in str(failed.exception)
    near = written(tmp_path, FEEDS.replace("F600", "F603"), "near.gcode")
    assert run("verify", "path", errors, program, near, "--tolerance", "0.001").exit_code == 0
    assert "feed" not in run("verify", "path", errors, program, program).stdout


LASER = "G90\nG0 X20 Y20 Z5\nM4 S0\nG1 X300.5 F1200 S300\nG1 Y280.25 S600 M8\nX20 T3 S.5\nX18\nM5\n"


def test_what_a_move_says_besides_goes_with_its_first_piece(tmp_path):
    program, output = written(tmp_path, LASER), tmp_path / "out.gcode"
    compensate_program(wavy(), program, output, CompensationOptions())
    result = compare_paths(wavy(), program, output)
    assert result.moves_out > 3 * result.moves_in
    assert result.moves_compared == 4
    said = output.read_text()
    assert all(said.count(word) == 1 for word in (" S300", " S600", " M8", " T3", " S.5"))
    # It holds until another: to say it once more is the same.
    once_more = written(tmp_path, said.replace("S300", "S300\nG1 X30 S300", 1), "again.gcode")
    assert compare_paths(wavy(), program, once_more).moves_compared == 4


@pytest.mark.parametrize(
    ("old", "new", "problem"),
    [
        ("S600", "S60", "says M8 S60 besides where to go, and its move says M8 S600"),
        (" S300", "", "says nothing besides where to go, and its move says S300"),
        (" M8", "", "says S600 besides where to go, and its move says M8 S600"),
        ("T3", "T4", "says S0.5 T4 besides where to go, and its move says S0.5 T3"),
        ("X18", "X18 S900", "says S900 besides where to go, and its move says nothing"),
    ],
)
def test_a_move_that_says_something_else_besides_is_refused(tmp_path, old, new, problem):
    """The power of a laser, coolant, a tool: it passed without a word."""
    program, other = written(tmp_path, LASER), written(tmp_path, LASER.replace(old, new), "other.gcode")
    with pytest.raises(GcodeError) as refused:
        compare_paths(model({}), program, other)
    assert problem in str(refused.value)
    assert f"other.gcode:{1 + LASER[: LASER.index(old)].count(chr(10))}:" in str(refused.value)


UNCLEAR = "G1 X20 Y20 Z5 F3000\nM83\nG90\nG1 X300.5 E10\n"


def test_what_compensate_asks_is_asked_here(tmp_path):
    """M83, then G90: for Marlin E is a position again, for the others an increment still."""
    program, output = written(tmp_path, UNCLEAR), tmp_path / "out.gcode"
    with pytest.raises(GcodeError) as asked_there:
        compensate_program(wavy(), program, output)
    for firmware in ("marlin", "klipper", "reprapfirmware"):
        compensate_program(wavy(), program, output, CompensationOptions(firmware=firmware))
        with pytest.raises(GcodeError) as asked:
            compare_paths(wavy(), program, output)
        assert asked.value.problem in asked_there.value.problem
        assert (
            (asked.value.path, asked.value.line)
            == (asked_there.value.path, asked_there.value.line)
            == (str(program), 4)
        )
        assert asked.value.remedy == asked_there.value.remedy
        result = compare_paths(wavy(), program, output, firmware=firmware)
        assert result.moves_with_other_extrusion == 0
        assert result.extrusion_out_mm == 10.0
        other = "marlin" if firmware != "marlin" else "klipper"
        assert compare_paths(wavy(), program, output, firmware=other).moves_with_other_extrusion == 1


@pytest.mark.parametrize(
    "lines",
    [
        # As positions, or from nowhere on: where it stands they do not agree.
        "G1 E5\nG91\nG1 E-2\nG90\nG1 X300.5 E10\n",
        "M83\nG1 E2\nM82\nG91\nG90\nM83\nG91\nG90\nG1 X300.5 E10\n",
    ],
)
def test_readings_of_extrusion_that_differ_are_asked_for(tmp_path, lines):
    program, output = written(tmp_path, f"G1 X20 Y20 Z5 F3000\n{lines}"), tmp_path / "out.gcode"
    with pytest.raises(GcodeError, match="firmwares differ"):
        compensate_program(wavy(), program, output)
    compensate_program(wavy(), program, output, CompensationOptions(firmware="klipper"))
    with pytest.raises(GcodeError, match="firmwares differ"):
        compare_paths(wavy(), program, output)


def test_a_move_in_one_piece_asks_for_no_firmware(tmp_path):
    """Passed whole by `compensate`, or with a zero set since: nobody has to be asked."""
    program, output = written(tmp_path, UNCLEAR), tmp_path / "out.gcode"
    result = compensate_program(wavy(), program, output, CompensationOptions(on_unsupported="pass"))
    assert "not-split" in {warning.kind for warning in result.warnings}
    assert compare_paths(wavy(), program, output).moves_with_other_extrusion == 0
    text = "G1 X20 Y20 Z5 F3000\nG91\nG1 Z1 E-2\nG90\nG92 E0\nG1 X300.5 E10\n"
    program = written(tmp_path, text, "set.gcode")
    compensate_program(wavy(), program, output)
    assert compare_paths(wavy(), program, output).moves_with_other_extrusion == 0


def test_a_code_for_the_end_of_a_move_is_not_at_the_end_of_its_first_piece(tmp_path):
    """What `compensate` once wrote: the spindle stops in the middle of the cut."""
    text = "G1 X20 Y20 Z5 F3000\nG1 X300.5 M5\n"
    program, output = written(tmp_path, text), tmp_path / "out.gcode"
    with pytest.raises(GcodeError, match="M5 on its line is or may be meant for its end"):
        compensate_program(wavy(), program, output)
    compensate_program(wavy(), written(tmp_path, text.replace(" M5", " M3"), "other.gcode"), output)
    early = written(tmp_path, output.read_text().replace("M3", "M5"), "early.gcode")
    with pytest.raises(GcodeError, match="says M5 at the end of the first of"):
        compare_paths(wavy(), program, early)


def test_a_tool_length_that_ends_is_no_matter_until_something_moves(tmp_path):
    lines = "G0 X0 Y0 Z2\nG43 H1 Z5\nG1 X50\nG1 X60\nG49\n"
    offset_mm = (0.0, 0.0, 1.0)
    ended = written(tmp_path, f"{lines}M30\n")
    assert compare_paths(model(SMALL), ended, ended, work_offset_mm=offset_mm).moves_compared == 2
    # The machine's own coordinates have no tool length in them, the program's have.
    moved = written(tmp_path, f"{lines}G53 G1 X70\nG1 X80\nG43 H1\nG1 X5 Y5 Z5\nG1 X6\n", "moved.gcode")
    assert compare_paths(model(SMALL), moved, moved, work_offset_mm=offset_mm).moves_compared == 3


@pytest.mark.parametrize(
    ("lines", "n_compared"),
    [
        ("T1 D1\nG1 X1 Y1 Z1\nG1 Z5\nT1 D1\nG1 Z6\n", 2),
        ("T1 D1\nG1 X1 Y1 Z1\nG1 Z5\nT2 D1\nG1 X1 Y1 Z1\nG1 Z6\n", 1),
        ("T1 D1\nG1 X1 Y1 Z1\nG1 Z5\nT2\nG1 X1 Y1 Z1\nG1 Z6\n", 1),
        ("T1 M6\nD1\nG1 X1 Y1 Z1\nG1 Z5\nT2\nD1\nG1 Z6\nM6\nD1\nG1 X1 Y1 Z1\nG1 Z6\n", 2),
        ('T="A" D1\nG1 X1 Y1 Z1\nG1 Z5\nT="B" D1\nG1 X1 Y1 Z1\nG1 Z6\n', 1),
        ("G17 D1\nG1 X1 Y1 Z1\nG1 Z5 D1\nG90 D2\nG1 X1 Y1 Z1\nG1 Z6\n", 1),
        ("T1 G17 S500\nG1 X1 Y1 Z1\nG1 Z5\nT2 G17 S500\nG1 X1 Y1 Z1\nG1 Z6\n", 1),
        ("T1 M6 G43\nG1 X1 Y1 Z1\nG1 Z5\nT2 M6 G43\nG1 X1 Y1 Z1\nG1 Z6\n", 1),
        ("T1 M6 G43\nG1 X1 Y1 Z1\nG1 Z5\nT2\nG43\nG1 Z6\n", 2),
        ("G43 H1\nG1 X1 Y1 Z1\nG1 Z5\nH2\nG1 X1 Y1 Z1\nG1 Z6\n", 1),
        ("G43 H1\nG1 X1 Y1 Z1\nG1 Z5\nH0\nG1 X1 Y1 Z1\nG1 Z6\n", 1),
        # Where the program has G43, D is a radius.
        ("G43 H1\nT1 D1\nG1 X1 Y1 Z1\nG1 Z5\nT2 D1\nG1 X1 Y1 Z1\nG1 Z6\n", 3),
    ],
)
def test_behind_the_length_of_another_tool_nothing_is_compared(tmp_path, lines, n_compared):
    program = written(tmp_path, lines)
    offset_mm = (0.0, 0.0, 1.0)
    assert compare_paths(model(SMALL), program, program, work_offset_mm=offset_mm).moves_compared == n_compared


TOOLS = "T0\nG1 X20 Y20 Z5 F3000\nG1 X21 E5\n{change}\nG1 X21 Y300.5 E{first}\nG1 X300.5 E{second}\n"


@pytest.mark.parametrize(
    ("change", "first", "second", "length_mm"),
    [
        ("T1\nG92 E0\nG1 X21 Y20 Z5", 2, 6, 11.0),
        ("T1\nM83\nG1 X21 Y20 Z5", 2, 6, 13.0),
        ("ACTIVATE_EXTRUDER EXTRUDER=extruder1\nG92 E0\nG1 X21 Y20 Z5", 2, 6, 11.0),
        ("SAVE_GCODE_STATE NAME=a\nG1 E1\nRESTORE_GCODE_STATE NAME=a", 7, 9, 5.0),
        ("SAVE_GCODE_STATE\nM83\nG91\nG1 E-4\nRESTORE_GCODE_STATE MOVE=1", 7, 9, 5.0),
    ],
)
def test_what_several_tools_extrude_is_compared(tmp_path, change, first, second, length_mm):
    program = written(tmp_path, TOOLS.format(change=change, first=first, second=second))
    output, firmware = tmp_path / "out.gcode", "klipper"
    compensation = compensate_program(wavy(), program, output, CompensationOptions(firmware=firmware))
    result = compare_paths(wavy(), program, output, firmware=firmware)
    assert result.moves_out > result.moves_in
    assert result.moves_with_other_extrusion == 0
    for one in (compensation, result):
        assert one.extrusion_in_mm == one.extrusion_out_mm == pytest.approx(length_mm, abs=1e-9)


def test_where_the_e_of_another_tool_begins_nobody_has_said(tmp_path):
    """What the first word extrudes is not told, and such a move is not split; the next one counts from it."""
    text = TOOLS.format(change="T1\nG1 X21 Y20 Z5", first=7, second=9)
    program, output = written(tmp_path, text), tmp_path / "out.gcode"
    with pytest.raises(GcodeError, match="where its E begins nobody has said since the tool was changed"):
        compensate_program(wavy(), program, output)
    compensation = compensate_program(wavy(), program, output, CompensationOptions(on_unsupported="pass"))
    result = compare_paths(wavy(), program, output)
    assert result.moves_with_other_extrusion == 0
    assert result.extrusion_in_mm == compensation.extrusion_in_mm == 7.0
    # Another word is another length, though nobody knows which.
    other = written(tmp_path, output.read_text().replace("E7\n", "E8\n"), "other.gcode")
    assert compare_paths(wavy(), program, other).moves_with_other_extrusion > 0
    # What compensate refuses to split is not passed when another did.
    split = output.read_text().replace(" E7\n", " E6\nG1 X19.4125 Y300.5052 E7\n").replace("Y300.5052 Z", "Y200 Z")
    with pytest.raises(GcodeError, match="where its E begins nobody has said"):
        compare_paths(wavy(), program, written(tmp_path, split, "split.gcode"))


def test_a_rapid_to_the_end_of_an_axis_is_not_compared(tmp_path):
    end_mm = model(SMALL).machine.axes["x"].range_mm[1]
    program = written(tmp_path, f"G0 X0 Y0 Z0\nG53 G0 X{end_mm}\nG0 Y5\nG0 X10\nG0 X20\n")
    assert compare_paths(model(SMALL), program, program, work_offset_mm=(0.0, 0.0, 1.0)).moves_compared == 1


@pytest.mark.parametrize(
    ("line", "firmware", "is_compared"),
    [
        ("M01 G0 X60", None, True),
        ("M01 G0 X60", "reprapfirmware", True),
        ("M64 P1 X60", None, False),
        ("M64 P1 X[30*2]", None, False),
        ("M0 Click to eXit", None, True),
        ("M64 P1 X60", "klipper", False),
        ("M201 X60", "klipper", True),
        ("M622 J1", None, False),
        ("G10 L2 P0 X60", None, False),
        ("G28 O", "marlin", False),
        ("G80", "marlin", False),
        ("G91 G1 Z5", "klipper", False),
        ("G20", "klipper", False),
        ("G20", "marlin", True),
        ("G21", "klipper", True),
        ("G1 X40 G4 P1", None, False),
        ("G4 X40", None, True),
        ("#CS ON [0,0,0,0,0,30]", None, False),
        ("#Face mill 50", None, True),
        ("#CS ON [0,0,0,0,0,30]", "marlin", True),
        ("#Layer", None, True),
        ("L100 P3", None, False),
        ("G54 P3", None, False),
        ("G54 G64 P.1", None, True),
        ("G15 H1", None, False),
        ("D1", None, False),
        ("D0", None, True),
        ("G70", None, False),
        ("G53 G0 X60", None, False),
        ("G0 G17 G80", None, True),
        ("G52 X0", None, True),
        ("G92.1", None, True),
        ("G92 X0\nG92.1", None, False),
        ("G28", None, False),
        ("M190 S60\nG28", None, True),
        ("G92 E0\nG28", None, True),
        ("G10 L2 P1 X0 Y0 Z0\nG28", None, True),
        ("M104 S1500\nG28", None, False),
        ("G10 L2 P1 X0 Y0 Z0", None, False),
        ("G10 L2 P2 X0 Y0 Z0\nG55", None, False),
        ("M83\nG1 E1\nG10 L2 P2 X0 Y0 Z0\nG55", None, True),
        ("G1 X=60", None, True),
        ("G1 X=60", "marlin", False),
        ("G1 X=IC(60)", None, False),
        ("G1 X=R1", None, False),
        ("G1 Y5 FZ=0.1", None, False),
        ('T="MILL 10"', None, True),
        ("G115", None, False),
        ("G113", None, False),
        ("G154 P2", None, False),
        ("$P_UIFR[1,X,TR]=50", None, False),
        ("$TC_DP3[1,1]=80", None, False),
        ("BSPLINE X5 Y5", None, False),
        ("GOTOF ENDE", None, False),
        ("M101 X5", None, False),
        ("M101 P5", None, True),
        ("G0 G52 X0", None, False),
        ("G0 X5 M91", None, False),
        ("M140 MB50", None, False),
        ("VZOFX[1]=50", None, False),
        ("M206 Y5", "marlin", False),
        ("M206", "marlin", True),
        ("SET_GCODE_OFFSET Z_ADJUST=5", "klipper", False),
        ("SET_GCODE_OFFSET Z=5 MOVE=1", "klipper", True),
        ("SET_VELOCITY_LIMIT X=5", "klipper", True),
        ("T1", "klipper", False),
        ("T0 ; again", "klipper", False),
        ("T1", "marlin", False),
        ("T1", None, True),
        ("G92 E0\nT1", None, False),
        ("M1234", "klipper", False),
        ("M1234", None, True),
        ("M600", None, False),
        ("M25", "marlin", False),
        ("M0", "klipper", False),
        ("M0", "marlin", True),
        ("M204 S500", "klipper", True),
        ("SET_POSITION", "klipper", False),
        ("SET_PIN PIN=a", "klipper", True),
        ("SAVE_GCODE_STATE\nG91\nRESTORE_GCODE_STATE", "klipper", True),
        ("SAVE_GCODE_STATE\nG92 X7\nRESTORE_GCODE_STATE ; MOVE=1", "klipper", True),
        ("SAVE_GCODE_STATE\nRESTORE_GCODE_STATE MOVE=1", "klipper", False),
        ("SAVE_GCODE_STATE\nSET_GCODE_OFFSET Z=1 MOVE=1\nRESTORE_GCODE_STATE", "klipper", False),
        ("SAVE_GCODE_STATE NAME=a\nRESTORE_GCODE_STATE NAME=A", "klipper", False),
        ("G92", "klipper", True),
        ("G92", "marlin", False),
    ],
)
def test_what_a_controller_may_do_is_not_known(tmp_path, line, firmware, is_compared):
    """Behind such a line one move begins at a place that is known, or none does."""
    program = written(tmp_path, f"G1 X0 Y0 Z0\n{line}\nG1 F100 X50\n")
    homed = "G28" in line and is_compared
    home_mm = (0.0, 0.0, 0.0) if "G28" in line else None
    result = compare_paths(model(SMALL), program, program, firmware=firmware, home_mm=home_mm)
    end = line in ("M01 G0 X60", "G1 X=60") and firmware is None
    # Of the first move behind a home only the end is corrected: it is followed all the same.
    assert result.moves_compared == is_compared + end - homed
    if "G28" in line:
        assert (result.moves_not_followed == 0) == is_compared
    if end:
        assert result.path_mm == pytest.approx(60.0 + 10.0)


@pytest.mark.parametrize("begin", ["G28 Z", "G28 X Y", "G28 X0"])
@pytest.mark.parametrize("firmware", ["klipper", "marlin", "reprapfirmware"])
def test_a_printer_that_homes_one_axis_moves_the_others(tmp_path, begin, firmware):
    program = written(tmp_path, f"G1 X0 Y0 Z0\n{begin}\nG1 X50 Z5\nG1 Z6\nG1 Y1\nG1 X40\n")
    result = compare_paths(model(SMALL), program, program, firmware=firmware, home_mm=(0.0, 0.0, 0.0))
    assert result.moves_not_followed == 2
    assert result.moves_compared == 1
    whole = written(tmp_path, f"G1 X0 Y0 Z0\n{begin}\nG28\nG1 X50 Z5\nG1 Z6\n", "whole.gcode")
    assert compare_paths(model(SMALL), whole, whole, firmware=firmware, home_mm=(0.0, 0.0, 0.0)).moves_compared == 1


def test_what_the_user_says_is_still_moves_nothing(tmp_path):
    program = written(tmp_path, "G1 X0 Y0 Z0\n_on_layer_change Z=1\nM600\nT1\nG1 X50\n")
    still = ("_ON_LAYER_CHANGE", "m600", "T1")
    assert compare_paths(model(SMALL), program, program, firmware="klipper", still=still).moves_compared == 1
    for lacking in still:
        others = [name for name in still if name != lacking]
        assert compare_paths(model(SMALL), program, program, firmware="klipper", still=others).moves_compared == 0
    for wrong in ("G28", "A B", ""):
        with pytest.raises(GeoerrError, match="still cannot be"):
            compare_paths(model(SMALL), program, program, still=[wrong])


def test_on_the_command_line_macros_are_said_to_be_still(tmp_path):
    errors = tmp_path / "errors.json"
    write_errors(errors, wavy().errors)
    lines = "M83\nG1 X20 Y20 Z5 F3000\n_LAYER\n" + "G1 X30 Y20 E1\nG1 X20 Y20 E1\n" * 2
    program, output = written(tmp_path, lines), tmp_path / "out.gcode"
    command = ("compensate", errors, program, "-o", output, "--firmware", "klipper", "--quiet")
    bare = run(*command)
    # The program is written, and says of itself that it is none to be trusted with; also where no line of it is read.
    assert (bare.exit_code, bare.stdout.splitlines()[0]) == (0, "4 of 5 moves are NOT corrected")
    as_json = run(*command, "--json")
    assert "4 of 5 moves are NOT corrected" in as_json.stderr
    assert json.loads(as_json.stdout)["may_move"] == [{"name": "_LAYER", "count": 1}]
    told = run(*command, "--still", "_layer,BEEP")
    assert (told.exit_code, "NOT" in told.output) == (0, False)
    proof = ("verify", "path", errors, program, output, "--firmware", "klipper", "--tolerance", "0.005")
    assert run(*proof, "--still", "_layer").exit_code == 0
    assert run(*proof).exit_code == 1
    assert run(*command, "--still", "G28").exit_code == 1
