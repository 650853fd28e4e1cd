"""Programs corrected from Python: files, options, refusals, memory."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from gcode_machines import leaning, nominal, printer

from geoerr.compensate.program import (
    CompensationOptions,
    CompensationResult,
    compensate_bytes,
    compensate_program,
)
from geoerr.error_functions import NotDetermined, write_errors
from geoerr.errors import GcodeError, GeoerrError, InputFileError
from geoerr.model import Model

SQUARE = b"G28\nG1 X10 Y10 Z10 F3000\nG1 X200 E1.5\nG1 Y200 E3\nG1 X10 E4.5\nG1 Y10 E6 ; closed\nM84\n"


def lines(program: bytes) -> list[bytes]:
    return [line for line in program.splitlines() if b"corrected by geoerr" not in line]


def test_a_leaning_axis_is_corrected_by_hand_arithmetic():
    # Y leans towards +X by 5 mrad: at Y 200 the tool is 1 mm too far in +X (to S²/2, 2.5 µm in Y).
    written, result = compensate_bytes(leaning(), SQUARE)
    assert lines(written)[1:6] == [
        b"G1 X9.9500 Y10.0001 Z10 F3000",
        b"G1 X199.9500 E1.5",
        b"G1 Y200.0025 X199.0000 E3",
        b"G1 X9.0000 E4.5",
        b"G1 Y10.0001 X9.9500 E6 ; closed",
    ]
    assert result.moves_in == result.moves_out == 5
    assert result.largest_correction_um == pytest.approx(1000.0, rel=1e-4)
    assert result.largest_correction_line == 4
    assert (result.extrusion_in_mm, result.extrusion_out_mm) == (6.0, 6.0)


def test_the_ideal_position_is_reached_whatever_the_tool_offset():
    model = printer()
    written, _ = compensate_bytes(model, b"G1 X100 Y150 Z50\n", CompensationOptions(digits=7))
    command = [float(word[1:]) for word in lines(written)[0].split(b" ")[1:]]
    wanted = model.nominal_mm([[100.0, 150.0, 50.0]])
    assert np.abs(model.tool_from_work([command]) - wanted).max() < 1e-6


def test_without_errors_the_file_comes_back(tmp_path):
    program = SQUARE + b"\xff\xfe garbage \xe9\r\nG91\nG1 X.00001\nG20\n  g1y.1 (a)\rN3 G90*20"
    source, target = tmp_path / "in.gcode", tmp_path / "out.gcode"
    source.write_bytes(program)
    result = compensate_program(nominal(), source, target)
    assert target.read_bytes() == program
    assert result.largest_correction_um == 0.0
    assert result.largest_correction_line == 0


def test_tables_say_what_they_lack():
    model = leaning()
    assert model.errors is not None
    lacking = replace(
        model.errors, not_determined=(NotDetermined("EXX", "no line"), NotDetermined("EA0Z", "no line"))
    )
    _, result = compensate_bytes(Model(model.machine, lacking), SQUARE)
    (told,) = (note for note in result.notes if "not determined" in note)
    assert "taken as 0: EXX, EA0Z" in told
    assert not any("not determined" in note for note in compensate_bytes(model, SQUARE)[1].notes)


def test_errors_that_the_firmware_corrects_are_left_to_it():
    program = b"SET_SKEW XY=1,2,3\n" + SQUARE
    options = CompensationOptions(firmware_corrects=("squareness",))
    written, result = compensate_bytes(leaning(), program, options)
    assert written == program
    assert not result.warnings or {warning.kind for warning in result.warnings} == {"position-unknown"}
    _, told = compensate_bytes(leaning(), program)
    assert [(w.kind, w.line, w.count) for w in told.warnings] == [("firmware-corrects", 1, 1)]
    assert "--firmware-corrects" in str(told.warnings[0])
    with pytest.raises(GeoerrError, match="neither one of the 21"):
        compensate_bytes(leaning(), program, CompensationOptions(firmware_corrects=("mesh",)))


@pytest.mark.parametrize("threads", [2, 8])
def test_any_number_of_threads_gives_the_same_bytes(threads):
    rng = np.random.default_rng(5)
    points = rng.uniform(20.0, 380.0, (3000, 3))
    program = b"M83\n" + b"".join(b"G1 X%.3f Y%.3f Z%.3f E.123\n" % tuple(point) for point in points)
    assert compensate_bytes(printer(), program, threads=threads) == compensate_bytes(printer(), program, threads=1)


def refused(program: bytes, options: CompensationOptions | None = None) -> GcodeError:
    with pytest.raises(GcodeError) as caught:
        compensate_bytes(printer(), program, options)
    return caught.value


@pytest.mark.parametrize(
    ("program", "line", "problem", "remedy"),
    [
        (b"G28\nG2 X10 Y0 I5\n", 2, "`G2 X10 Y0 I5`: an arc (G2) is not corrected yet", "--on-unsupported pass"),
        (b"GCDE\x01\x00\x00\x00", 1, "binary G-code", "plain text"),
        (b"G28\nG1 X1\x00\n", 2, "a NUL byte", "plain text"),
        (b"G28\n" + b"G1 " * 400_000, 2, "a line of more than 1048576 bytes", "one block a line"),
        (b"G1 X401 Y0 Z0\n", 1, "X 401 mm is outside the machine's range, -10 to 400 mm", "--work-offset"),
        (b"\nG1 X400 Y400 Z0.2\n", 2, "the correction asks for", "away from the end of the axis"),
        (b"G91\nG53 G0 X5 Y5 Z5\n", 2, "machine coordinates", "G90"),
        (b"N1 G1 X5 Y5 Z5*33\n", 1, "checksum", "strip line numbers"),
        (b"G55\n", 1, "coordinate system G55", "G10 L2"),
        (b"O100 sub\n", 1, "subprograms", "straight sequence"),
    ],
)
def test_what_is_refused_names_line_text_and_remedy(program, line, problem, remedy):
    error = refused(program)
    assert error.line == line
    assert problem in error.problem
    assert remedy in str(error.remedy)
    assert str(error).startswith(f"program:{line}: ")


def test_positions_that_were_not_measured_are_refused_or_held():
    model = printer(low_mm=(0.0, 0.0, 0.0), high_mm=390.0)
    model.machine.axes["x"] = type(model.machine.axes["x"])((-50.0, 450.0))
    program = b"G1 X-20 Y10 Z10\n"
    with pytest.raises(GcodeError, match="outside the measured range, 0 to 390 mm"):
        compensate_bytes(model, program)
    _, result = compensate_bytes(model, program, CompensationOptions(outside_measured="hold"))
    assert [warning.kind for warning in result.warnings] == ["outside-measured"]


def test_held_are_functions_of_an_axis_and_formulas_go_on():
    """What `--outside-measured hold` and the guides say of places beyond: an axis that leans leans there."""
    options = CompensationOptions(outside_measured="hold", digits=6)

    def corrected_mm(model: Model, y_mm: float) -> np.ndarray:
        model.machine.axes["y"] = type(model.machine.axes["y"])((-50.0, 450.0))
        written, _ = compensate_bytes(model, b"G1 X10 Y%g Z10\n" % y_mm, options)
        words = {word[:1]: float(word[1:]) for word in lines(written)[0].split()[1:]}
        return np.array([words[b"X"] - 10.0, words[b"Y"] - y_mm])

    curved = printer(low_mm=(0.0, 0.0, 0.0))
    assert curved.errors is not None
    without_angles = replace(curved.errors, functions={"EYY": curved.errors.functions["EYY"]}, squareness={})
    held = [corrected_mm(Model(curved.machine, without_angles), y_mm) for y_mm in (400.0, 440.0)]
    assert np.ptp(held, axis=0) == pytest.approx([0.0, 0.0], abs=2e-6)
    gone_on = [corrected_mm(leaning(), y_mm)[0] for y_mm in (400.0, 440.0)]
    assert gone_on[1] - gone_on[0] == pytest.approx(-5e-3 * 40.0, rel=1e-4)


def test_a_refused_program_leaves_an_earlier_output(tmp_path):
    source, target = tmp_path / "in.gcode", tmp_path / "out.gcode"
    target.write_text("earlier")
    source.write_bytes(SQUARE * 20 + b"G2 X1\n")
    with pytest.raises(GcodeError, match=r"in\.gcode:141: "):
        compensate_program(printer(), source, target)
    assert target.read_text() == "earlier"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["in.gcode", "out.gcode"]


def test_an_input_is_never_replaced(tmp_path):
    source = tmp_path / "in.gcode"
    source.write_bytes(SQUARE)
    (tmp_path / "link.gcode").symlink_to(source)
    (tmp_path / "folder").mkdir()
    for target, problem in [
        (source, "is the program that is read"),
        (tmp_path / "link.gcode", "is the program that is read"),
        (tmp_path / "folder", "is a folder"),
        (tmp_path / "nowhere" / "out.gcode", "does not exist"),
    ]:
        with pytest.raises(InputFileError, match=problem):
            compensate_program(printer(), source, target)
    for missing, problem in [(tmp_path / "no.gcode", "no such file"), (tmp_path / "folder", "is a folder")]:
        with pytest.raises(InputFileError, match=problem):
            compensate_program(printer(), missing, tmp_path / "out.gcode")
    assert source.read_bytes() == SQUARE


def test_corrected_programs_are_not_corrected_again():
    once, _ = compensate_bytes(printer(), SQUARE, model_name="0123456789ab")
    assert b"; corrected by geoerr: model 0123456789ab, tolerance 0.005 mm, do not correct again\n" in once
    assert once.count(b"geoerr") == 1
    assert "corrected this program already" in refused(once).problem


def test_the_result_as_a_document():
    _, result = compensate_bytes(printer(), SQUARE)
    document = result.to_document()
    assert isinstance(result, CompensationResult)
    assert {"moves_in", "moves_out", "lines", "largest_correction_um", "warnings", "extrusion_in_mm"} <= set(document)
    assert document["lines"] == 7


PASS = CompensationOptions(on_unsupported="pass")


@pytest.mark.parametrize(
    ("program", "why"),
    [
        (b"", "the program is empty: nothing was corrected"),
        (b"hello\n", "no move was read in 1 line: nothing was corrected; is it G-code?"),
        (b"G21\nM5\n", "no move was read in 2 lines: nothing was corrected; is it G-code?"),
        (b"G91\nG1 X5 F9\n", "the position is nowhere known: nothing was corrected, 1 move passed through untouched"),
        (b"G90\nG2 X5 Y5 I5 J0\n", "nothing was corrected; untouched: 1 lines that are not corrected"),
        (
            b"M98 P1\nG1 X5 Y5 Z5\n",
            "nothing was corrected; untouched: 1 lines that are not corrected, "
            "1 lines behind the part that can be followed",
        ),
        (b"G1 X5 Y5 Z5 F9\n", None),
    ],
)
def test_why_nothing_was_corrected(program, why):
    """An arc was said to have no known position, and a program without moves was passed over in silence."""
    assert compensate_bytes(leaning(), program, PASS)[1].why_nothing_corrected == why


def test_a_program_without_moves_is_a_warning(tmp_path):
    write_errors(tmp_path / "errors.json", leaning().errors)
    (tmp_path / "readme.txt").write_text("hello\n")
    command = ["compensate", tmp_path / "errors.json", tmp_path / "readme.txt", "-o", tmp_path / "out.gcode"]
    done = subprocess.run([sys.executable, "-m", "geoerr", *command], capture_output=True, text=True, check=True)
    assert "warning: no move was read in 1 line: nothing was corrected; is it G-code?\n" in done.stderr


def test_options_that_make_no_sense_are_refused():
    with pytest.raises(GeoerrError, match=r"is needed"):
        compensate_bytes(printer(), SQUARE, CompensationOptions(tolerance_mm=0.0))
    with pytest.raises(GeoerrError, match=r"^threads is -1\nhint: "):
        compensate_bytes(printer(), SQUARE, threads=-1)
    error = refused(SQUARE, CompensationOptions(digits=2))
    assert "too coarse" in error.problem
    assert "--digits" in str(error.remedy)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("work_offset_mm", (np.nan, 0.0, 0.0)),
        ("work_offset_mm", (1.0, 2.0)),
        ("home_mm", (0.0, np.inf, 0.0)),
        ("firmware", "foo"),
        ("on_unsupported", "Pass"),
        ("outside_measured", "Hold"),
        ("digits", 4.0),
        ("digits", -1),
    ],
)
def test_an_option_that_would_be_read_as_another_is_refused_by_name(name, value):
    with pytest.raises(GeoerrError, match=rf"^{name} .*\nhint: "):
        CompensationOptions(**{name: value})


@pytest.mark.parametrize("line", ["G2 X10 Y10 I5", "G81 X1 Y1 Z-1 R1", "G1 X5 A10", "#100 = 5", "G41 D1", "G92.3"])
def test_without_errors_nothing_is_refused_and_every_byte_comes_back(line):
    program = f"G1 X1 Y2 Z3\n{line}\nG1 X4 Y5 Z6\n".encode()
    written, result = compensate_bytes(nominal(), program)
    assert written == program
    assert result.warnings
    with pytest.raises(GcodeError):
        compensate_bytes(printer(), program)


def test_progress_counts_bytes(tmp_path):
    source = tmp_path / "in.gcode"
    source.write_bytes(b"; comment\n" * 300_000)
    seen: list[int] = []
    compensate_program(nominal(), source, tmp_path / "out.gcode", on_progress=seen.append)
    assert seen == [1 << 20, 2 << 20, 3_000_000]


MEMORY = """
import sys
from geoerr.cli.main import run
sys.argv = ["geoerr", "compensate", *sys.argv[1:]]
try:
    run()
except SystemExit as ended:
    assert not ended.code
# Not ru_maxrss: a child starts with the size of the process that made it.
status = open("/proc/self/status").read()
print(status.split("VmHWM:")[1].split()[0], file=sys.stderr)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="/proc is Linux's")
@pytest.mark.parametrize("kind", ["ordinary", "every move split into a hundred"])
def test_memory_does_not_grow_with_the_program(tmp_path, kind):
    model = printer()
    assert model.errors is not None
    write_errors(tmp_path / "errors.json", model.errors)
    source = tmp_path / "in.gcode"
    if kind == "ordinary":
        layer = b"".join(b"G1 X%d.5 Y%d.25 E.02\n" % (20 + i % 350, 30 + (7 * i) % 340) for i in range(1000))
        source.write_bytes(b"M83\nG1 X20 Y20 Z5\n" + layer * 500)
    else:
        source.write_bytes(b"G1 X20 Y20 Z5\n" + b"G0X385Y380Z370\nG0X5Y5Z2\n" * 10_000)
    command = [sys.executable, "-c", MEMORY, tmp_path / "errors.json", source, "-o", tmp_path / "out.gcode", "-q"]
    done = subprocess.run(list(map(str, command)), capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert int(done.stderr.split()[-1]) < 100 * 1024
    assert Path(tmp_path / "out.gcode").stat().st_size > source.stat().st_size


def test_macros_that_may_move_are_named_and_counted():
    names = [f"MACRO_{number}" for number in range(25)]
    program = "\n".join([SQUARE.decode(), *names, "macro_3", "G1 X20 Y20", "G1 X30", "G1 X40", "G1 X50"]).encode()
    told = compensate_bytes(leaning(), program)[1]
    assert [(one.name, one.count) for one in told.may_move[2:5]] == [("MACRO_2", 1), ("MACRO_3", 2), ("MACRO_4", 1)]
    assert len(told.may_move) == len(told.to_document()["may_move"]) == 25
    (warning,) = (one for one in told.warnings if one.kind == "may-move")
    assert "MACRO_3 (2 times), MACRO_4" in str(warning)
    assert "MACRO_19 and 5 more" in str(warning)
    assert "--still" in str(warning)
    assert told.mostly_untouched is None
    still = CompensationOptions(still=tuple(names))
    assert compensate_bytes(leaning(), program, still)[1].may_move == ()
    with pytest.raises(GeoerrError, match="still cannot be 'G28'"):
        CompensationOptions(still=("G28",))


def test_a_program_of_which_most_is_as_it_was_says_so_first():
    program = b"M83\nG1 X10 Y10 Z10 F3000\n_LAYER\n" + b"G1 X20 Y20 E1\n" * 3
    told = compensate_bytes(leaning(), program)[1]
    assert told.mostly_untouched == "3 of 4 moves are NOT corrected"
    behind = b"G1 X10 Y10 Z10 F3000\nM98 P1\n" + b"G1 X20 Y20 E1\n" * 3
    lost = compensate_bytes(leaning(), behind, CompensationOptions(on_unsupported="pass"))[1]
    assert lost.mostly_untouched == "3 of 5 lines cannot be followed and are NOT corrected"
