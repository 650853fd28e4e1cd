"""The reader that corrects and the reader that checks share no code: they must agree on any program."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import hypothesis.strategies as st
from gcode_machines import mill, nominal
from hypothesis import HealthCheck, given, settings

from geoerr.compensate.program import CompensationOptions, CompensationResult, compensate_bytes
from geoerr.errors import GcodeError
from geoerr.model import Model
from geoerr.model.arrays import Triple
from geoerr.verify.path import compare_paths

MILL = mill()
NOMINAL = nominal()
PASS = CompensationOptions(on_unsupported="pass")
HOME: Triple = (0.0, 0.0, 10.0)
# A program's zero that is told, and one that is not: G53 and G28 tell of it then, or do not.
offsets = st.sampled_from([None, (0.0, 0.0, 0.0), (0.0, 0.0, 2.5)])

numbers = st.floats(-300.0, 300.0).map(lambda value: f"{value:.3f}")
odd_numbers = st.sampled_from(["", "5", "[1+2]", "{depth}", "#1", "-.", ".5", "1E2"])
words = st.tuples(st.sampled_from("XYZXYZXYZEFIJRABPLSTH"), numbers | odd_numbers).map("".join)
MODES = "G0 G1 G1 G17 G20 G21 G40 G53 G54 G64 G80 G90 G91 G94 M8"
modes = st.sampled_from(MODES.split())
SPECIAL = """
    G2 G3 G4 G10 G28 G29 G41 G43 G49 G55 G61 G81 G92 G93 M6 M82 M83 M84 T1 / ; (a) *12 PARK L2 P1 N5 SET_SKEW M117
    G92.1 G68 G69 G38.2 G33 G5 M1 M29 M64 M92 G12.1 G13.1 G112 G113 G500 G505 G700 G107 M48
    G52 G28.1 G15 G70 G71 D1 D2 D0 M5
"""
special = st.lists(st.sampled_from(SPECIAL.split()), max_size=1)
parts = st.tuples(st.lists(modes, max_size=2), special, st.lists(words, max_size=4, unique_by=lambda word: word[0]))
line = parts.flatmap(lambda part: st.permutations([*part[0], *part[1], *part[2]])).map(" ".join)
line |= st.sampled_from(["/1 G91", "N7 /G1 X5", "/ 2 N7 G55", "TRANS X5", "ROT RPL=30", "1 L X+5 R0"])
line |= st.sampled_from(
    [
        "D1",
        "D2",
        "T1 D0",
        "L100 P3",
        "#CS ON",
        "#Face mill",
        "#FACE [1]",
        "G70",
        "G71",
        "G54 P3",
        "G15 H1",
        "G43 H1",
        "G49",
    ]
)
line |= st.sampled_from(["G52 X0 Y0", "G0 G17 G80", "G53 G0 Z300", "G4 P1 X5", "G92.1", "G92 X5"])
line |= st.sampled_from(["G28", "M190 S60", "G92 E0", "G10 L2 P1 X5 Y5 Z5", "G10 L2 P2 X0 Y0 Z0", "G55", "G54"])
line |= st.sampled_from(["T1 D1", "T2 D1", "T2", "T1 M6", "T2 M6", "G17 D1", 'T="A" D1', "T1 G17 S9", "T2 G17 S9"])
line |= st.sampled_from(
    ["T=R1 D1", "T#1 D1", "T=R1 M6", "T=R1", "D=R2", "G43 H#3 Z6", "G43 H=R3", "H#3", "T#1 G17 S9"]
)
line |= st.sampled_from(["G43", "H1", "H2", "H0", "G49 H0", "G1 X=50", "X=50 Y=-7.5", "G1 X=IC(5) F50", "X=R1*(2)"])
line |= st.sampled_from(
    ["G1 FZ=0.1", "X1=5", "G115", "G113", "$P_UIFR[1]=5", "$A_OUT[1]=1", "CIP X5", "M101 X5", "M125", "G0 X5 M91"]
)
line |= st.sampled_from(["%", "M98 P1", "O1 sub", "while true", "M622 J1", "M623", "M01 G0 Z50", "G10 L2 P0 X5"])
move = st.tuples(st.sampled_from(["G1", "g0", "G01"]), numbers, numbers, numbers).map(
    lambda parts: f"{parts[0]} X{parts[1]} Y{parts[2]} Z{parts[3]} E1.5"
)
programs = st.lists(line | move, max_size=12).map("\n".join)


def attempt(
    model: Model, program: bytes, options: CompensationOptions
) -> tuple[bytes, CompensationResult] | GcodeError:
    try:
        return compensate_bytes(model, program, options)
    except GcodeError as error:
        return error


def check(
    model: Model, program: str, folder: Path, offset_mm: Triple | None, passed: bytes | None = None
) -> bytes | None:
    """Hold both readers against each other; a program that nothing is passed in is written as where it is passed.

    Parameters
    ----------
    passed
        What was written where unsupported lines are passed; None: pass them now.
    """
    options = replace(PASS if passed is None else CompensationOptions(), work_offset_mm=offset_mm, home_mm=HOME)
    outcome = attempt(model, program.encode(), options)
    if isinstance(outcome, GcodeError):
        assert 1 <= outcome.line <= program.count("\n") + 1
        return None
    written, result = outcome
    if passed is not None:
        assert written == passed
        return written
    (folder / "in.gcode").write_text(program)
    (folder / "out.gcode").write_bytes(written)
    programs = (folder / "in.gcode", folder / "out.gcode")
    path = compare_paths(model, *programs, work_offset_mm=offset_mm, home_mm=HOME, threads=1)
    if "not-split" not in {warning.kind for warning in result.warnings}:
        assert path.max_error_um_after <= 5.0
    assert path.moves_with_other_extrusion == 0
    assert path.max_feed_change_percent == 0.0
    assert result.extrusion_in_mm == result.extrusion_out_mm
    return written


@settings(max_examples=300, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(programs, offsets)
def test_programs_of_any_words(tmp_path, program, offset_mm):
    passed = check(MILL, program, tmp_path, offset_mm)
    if passed is None:
        options = CompensationOptions(work_offset_mm=offset_mm, home_mm=HOME)
        assert isinstance(attempt(MILL, program.encode(), options), GcodeError)
    else:
        check(MILL, program, tmp_path, offset_mm, passed)


@settings(max_examples=200)
@given(st.binary(max_size=200))
def test_any_bytes(data):
    for options in (PASS, CompensationOptions()):
        outcome = attempt(NOMINAL, data, options)
        if not isinstance(outcome, GcodeError):
            assert outcome[0] == data


# What Klipper reads otherwise than other controllers, and macros of which the last is said to be still.
KLIPPER = """
    T0|T1|G28|G28 Z|G28 X Y|SAVE_GCODE_STATE|SAVE_GCODE_STATE NAME=a|RESTORE_GCODE_STATE|RESTORE_GCODE_STATE NAME=a
    |RESTORE_GCODE_STATE MOVE=1|RESTORE_GCODE_STATE NAME=a MOVE=1 MOVE_SPEED=50|M82|M83|G90|G91|G92|G92 X5 E2|G92 Z1
    |SET_GCODE_OFFSET Z=0.2|SET_GCODE_OFFSET X=1 MOVE=1|M220 S50|M600|M1234|M0|M204 S500|SET_POSITION|SET_PIN PIN=a
    |PARK|STILL_ONE|G1 F900|G1 E2|G1 E-1.5|ACTIVATE_EXTRUDER EXTRUDER=e1
"""
klipper_line = st.sampled_from([line.strip() for line in KLIPPER.split("|")])
letters = st.lists(st.sampled_from("XYZ"), min_size=1, max_size=3, unique=True)
klipper_move = st.tuples(letters, numbers, st.sampled_from(["", " E1.5", " E7 F1200"])).map(
    lambda parts: "G1 " + " ".join(f"{letter}{parts[1]}" for letter in parts[0]) + parts[2]
)
klipper_programs = st.lists(klipper_line | klipper_move | move, max_size=14).map("\n".join)


@settings(max_examples=300, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(klipper_programs)
def test_programs_of_klipper(tmp_path, program):
    options = replace(PASS, home_mm=HOME, firmware="klipper", still=("still_one",))
    outcome = attempt(MILL, program.encode(), options)
    if isinstance(outcome, GcodeError):
        return
    written, result = outcome
    (tmp_path / "in.gcode").write_text(program)
    (tmp_path / "out.gcode").write_bytes(written)
    programs = (tmp_path / "in.gcode", tmp_path / "out.gcode")
    path = compare_paths(MILL, *programs, home_mm=HOME, firmware="klipper", still=options.still, threads=1)
    if "not-split" not in {warning.kind for warning in result.warnings}:
        assert path.max_error_um_after <= 5.0
    assert path.moves_with_other_extrusion == 0
    assert path.max_feed_change_percent == 0.0
    assert path.extrusion_in_mm == path.extrusion_out_mm
    # Each follows what the other does.
    assert result.lines_not_followed or path.moves_not_followed == result.moves_in - result.moves_corrected
