"""Programs corrected by models with terms: conditions, direction of approach, play simulated by itself, refusals."""

from __future__ import annotations

import dataclasses
import itertools
import json
import re
from pathlib import Path

import numpy as np
import pytest
import typer
from gcode_machines import printer as table_printer
from term_models import machine, printer, term
from typer.testing import CliRunner

from geoerr.cli.main import app
from geoerr.cli.program_options import conditions
from geoerr.compensate.program import CompensationOptions, compensate_bytes, compensate_program
from geoerr.effects import catalogue, load_effects
from geoerr.error_functions import ErrorFunction, ErrorFunctions, NotDetermined, Squareness
from geoerr.errors import GeoerrError
from geoerr.model import FitRecord, Model, write_model
from geoerr.terms import Term
from geoerr.verify.path import compare_paths

HOT = {"temp_bed": 90.0}
# Half a printed digit on two axes beside the tolerance: what the program's own rounding adds.
TOLERANCE_MM = 0.005


def drawn_program(n_moves: int = 60, *, feed: bool = True) -> str:
    """Short and long moves in every direction, each behind a comment, as `M117 n`."""
    rng = np.random.default_rng(20)
    at = np.array([50.0, 60.0])
    lines = ["G90", "M83", f"G1 X50 Y60 Z5{' F3000' if feed else ''}", "M117 -1", "G1 X55 Y66 E.1"]
    at = np.array([55.0, 66.0])
    for number in range(n_moves):
        step = rng.choice([3.0, 30.0, 200.0]) * rng.uniform(-1.0, 1.0, 2) * (rng.random(2) < 0.8)
        at = np.round(np.clip(at + step, 20.0, 380.0), 3)
        lines += [f"M117 {number}", f"G1 X{at[0]:.3f} Y{at[1]:.3f} E.05"]
    return "\n".join(lines) + "\n"


def groups(text: str) -> list[np.ndarray]:
    """Read commands (n, 3) of each group behind an `M117`; the one before the first too."""
    at = np.full(3, np.nan)
    found: list[list[np.ndarray]] = [[]]
    for line in text.splitlines():
        if line.startswith("M117"):
            found.append([])
        elif line.startswith("G1"):
            at = at.copy()
            for letter, number in re.findall(r"([XYZ])(-?[\d.]+)", line):
                at["XYZ".index(letter)] = float(number)
            found[-1].append(at)
    return [np.array(group) for group in found]


class PlayMachine:
    """Axes with real play: a carriage follows its drive only when the drive has crossed the play.

    The rest is written down from the formulas: a belt tooth on X, growth of Y, and that Y leans.
    """

    def __init__(self, play_mm: tuple[float, float], temp_degc: float, lean_rad: float = 0.0) -> None:
        self.lean_rad = lean_rad
        self.half = np.array([*play_mm, 0.0]) / 2.0
        self.carriage = np.full(3, np.nan)
        self.growth = 1.7e-5 * (temp_degc - 20.0)

    def at(self, drive: np.ndarray) -> np.ndarray:
        start = np.where(np.isnan(self.carriage), drive, self.carriage)
        self.carriage = np.clip(start, drive - self.half, drive + self.half)
        x, y, _ = drive
        # Errors of Y are along the nominal axis, its travel along the real one.
        wave, growth = 0.02 * np.sin(2 * np.pi * x / 2.0), self.growth * (y - 200.0)
        leaning = y * np.array([np.sin(self.lean_rad), np.cos(self.lean_rad) - 1.0])
        return self.carriage + np.array([wave + leaning[0], growth + leaning[1], 0.0])


def off_segment(point: np.ndarray, begin: np.ndarray, end: np.ndarray) -> float:
    along = end - begin
    length2 = along @ along
    share = np.clip((point - begin) @ along / length2, 0.0, 1.0) if length2 > 0.0 else 0.0
    return float(np.linalg.norm(point - begin - share * along))


def straight_printer() -> Model:
    """The printer without its leaning axis: Y's moves do not move X by correction."""
    return printer("wbXYZt").without("squareness:xy")


@pytest.mark.parametrize(("model", "lean_rad"), [(straight_printer(), 0.0), (printer(), 5e-3)])
def test_a_machine_with_play_follows_the_program(model, lean_rad):
    """Where Y leans, corrections turn X in many of the moves that leave it at rest."""
    program = drawn_program(15)
    written, result = compensate_bytes(model, program.encode(), at=HOT)
    kinds = {warning.kind for warning in result.warnings}
    assert kinds - {"direction-unknown", "position-unknown"} == ({"turned-at-rest"} if lean_rad else set())
    ideal, commanded = groups(program), groups(written.decode())
    assert len(ideal) == len(commanded)
    for corrected, expected in ((commanded, TOLERANCE_MM), (ideal, None)):
        run = PlayMachine((0.05, 0.03), HOT["temp_bed"], lean_rad)
        drive, worst = corrected[0][-1], 0.0
        run.at(drive)
        for number, group in enumerate(corrected[1:]):
            begin, end = ideal[number][-1], ideal[number + 1][-1]
            for command in group:
                for share in np.linspace(0.0, 1.0, 40)[1:]:
                    actual = run.at(drive + share * (command - drive))
                    # The first move of all takes up play from an unknown side.
                    if number:
                        worst = max(worst, off_segment(actual, begin, end))
                drive = command
        if expected is None:
            assert worst > 0.1
        else:
            # The sampled play differs from the model's step only while it is taken up, on the way that is programmed.
            assert worst < expected + 1e-4, worst


def test_the_checker_agrees_and_finds_other_conditions_out(tmp_path):
    for model in (printer(), straight_printer()):
        source, target = tmp_path / "in.gcode", tmp_path / "out.gcode"
        source.write_text(drawn_program())
        result = compensate_program(model, source, target, at=HOT)
        path = compare_paths(model, source, target, at=HOT)
        assert path.max_error_um_after < 1e3 * TOLERANCE_MM
        assert path.max_error_um_before > 100.0
        assert path.moves_with_other_extrusion == 0
        assert path.max_feed_change_percent == 0.0
        assert path.extrusion_in_mm == path.extrusion_out_mm == result.extrusion_out_mm
        cold = compare_paths(model, source, target, at={"temp_bed": "reference"})
        # 70 K of 17e-6 over 180 mm from the fixed point.
        assert cold.max_error_um_after > 150.0
        no_play = Model(model.machine, None, tuple(t for t in model.terms if t.effect != "backlash"))
        assert compare_paths(no_play, source, target, at=HOT).max_error_um_after > 20.0


def test_a_reversal_begins_with_a_piece_that_extrudes_nothing():
    of = machine("wbXYZt")
    model = Model(of, None, (term(of, "backlash:x", b=0.05),))
    program = b"M83\nG1 X10 Y10 Z5\nG1 X100 E1\nG1 X50 E1 ; back\nG1 Y20 E1\nG1 X60 E1\n"
    written, result = compensate_bytes(model, program)
    lines = [line for line in written.decode().splitlines() if "geoerr" not in line]
    assert lines == [
        "M83",
        "G1 X10 Y10 Z5",
        # From here X is known to come from below, 25 µm behind its drive. The first corrected move names every axis.
        "G1 X10.0250 Y10.0000 Z5.0000 E0.00000",
        "G1 X100.0250 E1.00000",
        "G1 X99.9750 E0.00000 ; back",
        "G1 X49.9750 E1.00000",
        "G1 Y20 E1",
        "G1 X50.0250 E0.00000",
        "G1 X60.0250 E1.00000",
    ]
    assert result.extrusion_in_mm == result.extrusion_out_mm == 4.0
    assert [warning.kind for warning in result.warnings] == ["direction-unknown"]


SIDES = b"G1 X10 Y10 Z5\nG1 X100\nG1 Y100 ; up\nG1 Y200\nG1 Y300\nG1 X120\nG1 Y10\n"


def leaning(rise_mm: float, play_mm: float = 0.02) -> Model:
    """A machine with play of X, which the correction moves by that over 290 mm of Y, against the error."""
    of = machine("wbXYZt")
    lean = term(of, "squareness:xy", S=-rise_mm / 290.0)
    return Model(of, None, (term(of, "backlash:x", b=play_mm), lean))


def off_while_y_moves_um(rise_mm: float, commands: np.ndarray, play_mm: float = 0.02) -> float:
    """How far X is at most from 100 and from 120, where the program leaves it: followed across the play."""
    way = np.concatenate([np.linspace(begin, end, 400) for begin, end in itertools.pairwise(commands)])
    at, off_um = way[0, 0] - 0.5 * play_mm, 0.0
    for before, (x, y, _) in itertools.pairwise(way):
        at = float(np.clip(at, x - 0.5 * play_mm, x + 0.5 * play_mm))
        if abs(y - before[1]) > 0.0:
            meant = 100.0 if x < 110.0 else 120.0
            off_um = max(off_um, 1e3 * abs(at + rise_mm / 290.0 * y - meant))
    return off_um


@pytest.mark.parametrize(
    ("rise_mm", "play_mm", "line"),
    [
        (0.0015, 0.02, None),
        (-0.0015, 0.02, None),
        (0.06, 0.0015, None),
        (0.06, 0.02, 3),
        (-0.06, 0.02, 7),
        (1.0, 0.1, 3),
    ],
)
def test_a_correction_that_turns_an_axis_at_rest_takes_up_its_play(rise_mm, play_mm, line):
    """X came from below. On the way along Y, up or down, it is moved back: its play is crossed there."""
    written, result = compensate_bytes(leaning(rise_mm, play_mm), SIDES)
    told = [(one.line, one.count) for one in result.warnings if one.kind == "turned-at-rest"]
    # Less than two fifths of the tolerance are left to play.
    assert told == ([] if line is None else [(line, 1)])
    off_um = off_while_y_moves_um(rise_mm, groups(written.decode())[0], play_mm)
    assert off_um < (0.1 if line else 0.4e3 * TOLERANCE_MM)


def restless(seed: int, n_moves: int, play_mm: tuple[float, float]) -> tuple[Model, str]:
    """A machine whose corrections turn its axes, and a program in which these rest, creep and turn."""
    rng = np.random.default_rng(seed)
    places, at = [], np.array([200.0, 200.0])
    for _ in range(n_moves):
        # One axis moves by no less than 0.1 mm, the other may rest or creep.
        lengths_mm = np.array([rng.choice([0.0, 0.003, 0.3, 40.0]), rng.choice([1.0, 40.0])])
        step = rng.permutation(lengths_mm * rng.uniform(0.1, 1.0, 2) * rng.choice([-1.0, 1.0], 2))
        at = np.round(at + np.where(np.abs(at + step - 200.0) > 180.0, -step, step), 3)
        places.append(at)
    of = machine("wbXYZt")
    terms = tuple(term(of, f"backlash:{axis}", b=mm) for axis, mm in zip("xy", play_mm, strict=True))
    bow = ErrorFunction(np.array([0.0, 130.0, 400.0]), np.array([0.02, -0.05, 0.03]))
    lean = {"EC0Y": Squareness(rng.uniform(-1e-3, 1e-3))}
    model = Model(of, ErrorFunctions(of, {"EYX": bow}, lean, "joint"), terms)
    return model, "G1 X200 Y200 Z5 F600\nG1 X201 Y201\n" + "".join(f"G1 X{x:.3f} Y{y:.3f}\n" for x, y in places)


@pytest.mark.parametrize("seed", range(6))
def test_turns_are_followed_across_blocks_by_any_number_of_threads(seed, tmp_path):
    """9,000 lines; the checker follows them command by command."""
    model, program = restless(seed, 9000, (0.03, 0.011))
    source, target = tmp_path / "in.gcode", tmp_path / "out.gcode"
    source.write_text(program)
    result = compensate_program(model, source, target, threads=2)
    (turned,) = (one for one in result.warnings if one.kind == "turned-at-rest")
    assert turned.count > 100
    assert compare_paths(model, source, target).max_error_um_after < 1e3 * TOLERANCE_MM
    assert compensate_bytes(model, source.read_bytes(), threads=1)[0] == target.read_bytes()


@pytest.mark.parametrize("seed", range(6))
def test_the_certified_error_is_that_of_carriages_that_follow_their_drives(seed, tmp_path):
    play_mm = np.array([0.03, 0.011, 0.0])
    model, program = restless(seed, 300, (0.03, 0.011))
    source, target = tmp_path / "in.gcode", tmp_path / "out.gcode"
    source.write_text(program.replace("\nG1", "\nM117\nG1"))
    compensate_program(model, source, target)
    ideal, written = groups(source.read_text()), groups(target.read_text())
    stiff = Model(model.machine, model.errors, ())
    drive, carried, worst = written[1][-1], None, 0.0
    # The first move tells from where the axes come: behind it both have crossed their play.
    for number, group in enumerate(written[2:], start=2):
        for command in group:
            drives = drive + np.linspace(0.0, 1.0, 60)[1:, None] * (command - drive)
            start = drives[0] - 0.5 * play_mm if carried is None else carried
            carriages = np.clip(start, drives - 0.5 * play_mm, drives + 0.5 * play_mm)
            tool = carriages + stiff.error_mm(drives)
            begin, end = ideal[number - 1][-1], ideal[number][-1]
            worst = max(worst, *(off_segment(point, begin, end) for point in tool))
            drive, carried = command, carriages[-1]
    certified_um = compare_paths(model, source, target).max_error_um_after
    assert 1e3 * worst < certified_um + 0.05
    assert certified_um < 1e3 * TOLERANCE_MM


@pytest.mark.parametrize("seed", range(6))
def test_play_below_a_printed_step_has_no_line(seed, tmp_path):
    """Y has play of half a step: a piece that takes it up would say where the machine stands."""
    model, program = restless(seed, 400, (0.03, 0.0006))
    source, target = tmp_path / "in.gcode", tmp_path / "out.gcode"
    source.write_text(program)
    options = CompensationOptions(tolerance_mm=0.002, digits=3)
    result = compensate_program(model, source, target, options=options)
    lines = target.read_text().splitlines()
    assert all(re.search("[XYZ]", line) for line in lines if line.startswith("G1"))
    assert result.moves_out == sum(line.startswith("G1") for line in lines)
    assert compare_paths(model, source, target).max_error_um_after < 2.0


def test_play_is_taken_up_within_a_move_where_the_correction_turns():
    """X has to go up by 60 µm along the first half of a move in Y, and back along the other."""
    of = machine("wbXYZt")
    bow = ErrorFunction(np.array([0.0, 200.0, 400.0]), np.array([0.0, -0.06, 0.0]))
    model = Model(of, ErrorFunctions(of, {"EXY": bow}, {}, "joint"), (term(of, "backlash:x", b=0.02),))
    program = b"M83\nG1 X10 Y0 Z5\nG1 X100 E1\nG1 Y400 E4\nG1 X120 E1\n"
    written, result = compensate_bytes(model, program)
    lines = [line for line in written.decode().splitlines() if "geoerr" not in line]
    assert lines[3:] == [
        "G1 X100.0100 E1.00000",
        "G1 Y200.0000 X100.0700 E2.00000",
        # Behind its play X comes from above, and goes back until it moves up again.
        "G1 X100.0500 E0.00000",
        "G1 X99.9900 Y400.0000 E2.00000",
        "G1 X100.0100 E0.00000",
        "G1 X120.0100 E1.00000",
    ]
    assert [(one.kind, one.line) for one in result.warnings][1:] == [("turned-at-rest", 4)]
    assert result.extrusion_in_mm == result.extrusion_out_mm == 6.0


@pytest.mark.parametrize("rise_mm", [0.012, 0.06, -0.06])
def test_play_that_is_not_taken_up_is_in_the_path_that_is_verified(rise_mm, tmp_path):
    """Programs that are corrected for the program's directions alone, and for those of commands."""
    model, play_mm = leaning(rise_mm), 0.02
    source, target = tmp_path / "in.gcode", tmp_path / "out.gcode"
    source.write_bytes(SIDES)
    compensate_program(model, source, target)
    path = compare_paths(model, source, target)
    assert path.max_error_um_after == pytest.approx(
        off_while_y_moves_um(rise_mm, groups(target.read_text())[0]), abs=0.1
    )
    assert path.held_back_um < 0.1

    # X always comes from below: half of its play further.
    ways = [(10, 10), (100, 10), (100, 100), (100, 200), (100, 300), (120, 300), (120, 10)]
    commands = np.array([(x + 0.5 * play_mm - rise_mm / 290.0 * y, y, 5.0) for x, y in ways])
    target.write_text("".join(f"G1 X{x:.4f} Y{y:.4f} Z{z}\n" for x, y, z in commands))
    path = compare_paths(model, source, target)
    off_um = off_while_y_moves_um(rise_mm, commands)
    assert off_um > 9.0
    # Of the first move nothing says that X comes from below: its begin is not solved for.
    assert path.max_error_um_after == pytest.approx(max(off_um, 10.0), abs=0.6)
    assert path.held_back_um == pytest.approx(off_um, abs=0.6)


@pytest.mark.parametrize(("rise_mm", "play_mm"), [(0.03, 0.05), (0.06, 0.05), (0.1, 0.05), (0.06, 0.02)])
def test_play_that_is_crossed_on_the_way_of_a_whole_move_is_in_its_path(rise_mm, play_mm, tmp_path):
    """M5 is meant for the end of its move, which stays whole: X comes off one side of its play on the way."""
    model = leaning(rise_mm, play_mm)
    source, target = tmp_path / "in.gcode", tmp_path / "out.gcode"
    source.write_text("G1 X10 Y10 Z5\nG1 X100\nG1 Y300 M5\nG1 X120\n")
    options = CompensationOptions(on_unsupported="pass")
    result = compensate_program(model, source, target, options=options)
    assert [warning.kind for warning in result.warnings] == ["direction-unknown", "not-split"]
    off_um = off_while_y_moves_um(rise_mm, groups(target.read_text())[0], play_mm)
    assert off_um > 14.0
    assert compare_paths(model, source, target).max_error_um_after == pytest.approx(off_um, abs=0.1)


@pytest.mark.parametrize("length_mm", [0.05, 0.2, 1.0, 4.0])
def test_wind_up_within_a_long_move_is_followed(length_mm, tmp_path):
    """It is over within a few lengths of its begin, which the middle of the move knows nothing of."""
    of = machine("wbXYZt")
    model = Model(of, None, (term(of, "reversal-windup:x", b=0.03, **{"lambda": length_mm}),))
    source, target = tmp_path / "in.gcode", tmp_path / "out.gcode"
    for first_mm, stroke_mm in itertools.product((0.05, 0.2, 0.8), (2.0, 36.0, 150.0)):
        back = 190.0 + first_mm
        source.write_text(f"G1 X200 Y200 Z5\nG1 X190 Y201\nG1 X{back} Y202\nG1 X{back - stroke_mm} Y203\n")
        compensate_program(model, source, target)
        assert compare_paths(model, source, target, sample_step_mm=0.02).max_error_um_after < 1e3 * TOLERANCE_MM


def test_wind_up_is_followed_along_the_move(tmp_path):
    of = machine()
    model = Model(of, None, (term(of, "reversal-windup:x", b=0.06, **{"lambda": 4.0}),))
    source, target = tmp_path / "in.gcode", tmp_path / "out.gcode"
    source.write_text("G1 X10 Y10 Z5\nG1 X200\nG1 X20\nG1 X22\nG1 X21\nG1 X300 Y40\n")
    compensate_program(model, source, target)
    path = compare_paths(model, source, target)
    assert path.max_error_um_before == pytest.approx(30.0, abs=0.5)
    assert path.max_error_um_after < 5.0


@pytest.mark.parametrize("length_mm", [0.5, 4.0, 40.0])
def test_wind_up_is_carried_from_stroke_to_stroke(length_mm, tmp_path):
    """Strokes of any length: behind short ones the drive is wound half-way, and corrections knew long ones only."""
    of = machine("wbXYZt")
    play_mm = 0.06
    model = Model(of, None, (term(of, "reversal-windup:x", b=play_mm, **{"lambda": length_mm}),))
    strokes = np.random.default_rng(5).uniform(0.2, 12.0, 60) * np.resize([1.0, -1.0], 60)
    places = np.round(150.0 + np.cumsum(strokes), 3)
    source, target = tmp_path / "in.gcode", tmp_path / "out.gcode"
    source.write_text("G1 X150 Y10 Z5\n" + "".join(f"G1 X{x:.3f}\nM117\n" for x in places))
    result = compensate_program(model, source, target, options=CompensationOptions(tolerance_mm=0.002))
    path = compare_paths(model, source, target)
    assert path.max_error_um_after < 2.1
    assert path.max_error_um_before > 20.0
    assert not result.notes

    # Played by hand: where each move ends; -d/2 of the play until the first reversal.
    stretches = target.read_text().split("M117\n")[:-1]
    ends = [float(re.findall(r"X([\d.]+)", pieces)[-1]) for pieces in stretches]
    d, travel_mm, wound_at_reversal, wound, before = 1.0, 0.0, -0.5, -0.5, 150.0
    for place, end in zip(places, ends, strict=True):
        if np.sign(place - before) != d:
            d, travel_mm, wound_at_reversal = -d, 0.0, wound
        travel_mm += abs(place - before)
        wound = -0.5 * d + (wound_at_reversal + 0.5 * d) * np.exp(-travel_mm / length_mm)
        assert end + play_mm * wound == pytest.approx(place, abs=1.1e-4)
        before = place


def test_following_error_takes_its_speed_from_the_feed(tmp_path):
    of = machine("wbXYZt")
    model = Model(of, None, (term(of, "lag:x", tau=1e-3),))
    written, result = compensate_bytes(model, b"G1 X10 Y10 Z5 F6000\nG1 X110\nG1 F600 X210\nG0 X10\n")
    lines = [line for line in written.decode().splitlines() if "geoerr" not in line]
    # 100 mm/s for 1 ms is 0.1 mm, 10 mm/s 0.01 mm; a rapid's speed is not told.
    assert lines[1:] == [
        "G1 X10.1000 Y10.0000 Z5.0000",
        "G1 X110.1000",
        "G1 F600 X110.0100",
        "G1 X210.0100",
        "G0 X210.0000",
        "G0 X10.0000",
    ]
    kinds = {warning.kind: warning.count for warning in result.warnings}
    assert kinds == {"speed-from-feed": 3, "speed-unknown": 1}
    still, _ = compensate_bytes(model, b"G1 X10 Y10 Z5 F6000\nG1 X110\n", at={"v_x": 0.0})
    assert still == b"G1 X10 Y10 Z5 F6000\nG1 X110\n"


def test_the_feed_is_what_a_printer_makes_of_it(tmp_path):
    """`M220` multiplies all feeds, `F0` is none: both were passed over, and a lag corrected for another speed."""
    of = machine("wbXYZt")
    model = Model(of, None, (term(of, "lag:x", tau=1e-3),))
    source, target = tmp_path / "in.gcode", tmp_path / "out.gcode"
    source.write_text(
        "G1 X10 Y10 Z5 F6000\nG1 X110\nM220 S50\nG1 X20\nM220 B\nM220 S200\nG1 F0 X110\nM220 R\nG1 X30\n"
        "M220 S{speed}\nG1 X120\nM220 S100\nG1 X40 F3000\n"
    )
    result = compensate_program(model, source, target)
    ends = [float(re.findall(r"X([-\d.]+)", line)[-1]) for line in target.read_text().splitlines() if " X" in line]
    # By 1 ms of 100 mm/s, of half, of twice as much, of half again, of a speed that nobody tells, and of 50 mm/s.
    want = [10.0, 110.1, 19.95, 110.2, 29.95, 120.0, 39.95]
    assert [end for end in ends if any(abs(end - one) < 1e-6 for one in want)] == want
    assert "speed-unknown" in {warning.kind for warning in result.warnings}
    assert compare_paths(model, source, target).max_error_um_after < 5.0


@pytest.mark.parametrize("threads", [2, 5])
def test_the_same_bytes_from_any_number_of_threads(threads):
    program = drawn_program(400).encode()
    one, _ = compensate_bytes(printer(), program, at=HOT, threads=1)
    assert compensate_bytes(printer(), program, at=HOT, threads=threads)[0] == one


def test_tables_as_terms_give_the_bytes_of_tables():
    tables = table_printer()
    terms = Model(tables.machine, None, tables.all_machine_terms)
    program = drawn_program(200).encode()
    written, result = compensate_bytes(terms, program)
    assert written == compensate_bytes(tables, program)[0]
    assert not result.notes


def test_conditions_are_refused_by_name():
    of = machine()
    acceleration = term(of, "acceleration:y", c=1e-5)
    model = Model(of, None, (*printer().terms, acceleration))
    with pytest.raises(GeoerrError, match=r"temp_bed .*°C.*a_y .*acceleration.*0 leaves") as refused:
        compensate_bytes(model, b"G1 X1 Y1 Z1\n")
    assert "d_x" not in str(refused.value)
    assert compensate_bytes(model, b"G1 X1 Y1 Z1\n", at={**HOT, "a_y": 0.0})[1].moves_corrected == 1
    with pytest.raises(GeoerrError, match="does not depend on 'temp'"):
        compensate_bytes(printer(), b"G1 X1\n", at={**HOT, "temp": 3.0})
    with pytest.raises(GeoerrError, match="only temperatures have a 'reference'"):
        compensate_bytes(model, b"G1 X1\n", at={**HOT, "a_y": "reference"})
    with pytest.raises(GeoerrError, match="b: no value yet"):
        compensate_bytes(Model(of) + "backlash:x", b"G1 X1\n")


def test_the_rig_is_left_out_and_said_or_refused():
    of = machine()
    rig = term(of, "rig-scale", k=1e-4)
    both = Model(of, None, (term(of, "backlash:x", b=0.05), rig))
    program = b"G1 X10 Y10 Z5\nG1 X20\nG1 X15\n"
    written, result = compensate_bytes(both, program)
    assert result.left_out == ("rig-scale",)
    assert "rig-scale" in result.notes[0]
    assert written == compensate_bytes(Model(of, None, both.terms[:1]), program)[0]
    with pytest.raises(GeoerrError, match=r"nothing to compensate: rig-scale .* machine does not have them"):
        compensate_bytes(Model(of, None, (rig,)), program)


OWN = """
[[effect]]
id = "my-growth"
title = "Growth of the bed, as I write it"
channel = "along"
axes = ["y"]
expression = "growth*(temp_bed - 20)*(q - zero)"
covariates = ["temp_bed"]
[effect.coefficients.growth]
unit = "1/K"
[effect.inner.zero]
unit = "mm"
range = "axis"
[[effect]]
id = "my-play"
title = "Play, as I write it"
channel = "along"
axes = ["x"]
expression = "-0.5*play*d_x"
[effect.coefficients.play]
unit = "mm"
"""


def test_a_users_own_effect_is_compensated_as_a_built_in_one(tmp_path):
    (tmp_path / "own.toml").write_text(OWN)
    of = machine()
    own = {effect.id: effect for effect in load_effects(tmp_path / "own.toml")}
    growth, play = own["my-growth"].term("y", "temp_bed", of), own["my-play"].term("x", None, of)
    written = Model(of, None, (growth.with_values([1.7e-5], [200.0]), play.with_values([0.05])))
    built_in = Model(
        of,
        None,
        (
            term(of, "thermal-expansion:y@temp_bed", alpha=1.7e-5, q_fixed=200.0),
            term(of, "backlash:x", b=0.05),
        ),
    )
    program = drawn_program().encode()
    assert compensate_bytes(written, program, at=HOT)[0] == compensate_bytes(built_in, program, at=HOT)[0]


def own_term(folder: Path, expression: str, covariates: tuple[str, ...] = (), value: float = 1e-3) -> Term:
    path = folder / "own.toml"
    path.write_text(
        f'[[effect]]\nid = "mine"\ntitle = "Mine"\nchannel = "joint"\ndirection = "Z"\naxes = ["x"]\n'
        f'expression = "{expression}"\ncovariates = {list(covariates)}\n[effect.coefficients.c]\nunit = "mm"\n'
    )
    return next(iter(load_effects(path))).term("x", None, machine()).with_values([value])


def test_a_formula_that_divides_by_zero_under_the_conditions_is_named_with_them(tmp_path):
    model = Model(machine(), None, (own_term(tmp_path, "c*q/(hum-50)", ("hum",)),))
    program = b"G1 X10 Y10 Z5\nG1 X20\n"
    for recorded in (model, with_record(model, 1e-5)):
        with pytest.raises(GeoerrError, match=r"^mine:x gives no finite number at hum = 50\nhint: .*divides by zero"):
            compensate_bytes(recorded, program, at={"hum": 50.0})
        told = compensate_bytes(recorded, program, at={"hum": 45.0})[1].notes
        assert not [note for note in told if "not in the model" not in note]
    (tmp_path / "a.gcode").write_bytes(program)
    with pytest.raises(GeoerrError, match="mine:x gives no finite number at hum = 50"):
        compare_paths(model, tmp_path / "a.gcode", tmp_path / "a.gcode", at={"hum": 50.0})


@pytest.mark.parametrize("expression", ["c/(q-59.765625)", "c/(q-59.765625)^2"])
def test_a_pole_in_the_volume_is_told_and_named_where_a_program_fails_on_it(tmp_path, expression):
    model = Model(machine(), None, (own_term(tmp_path, expression),))
    _, result = compensate_bytes(model, b"G1 X200 Y10 Z5\nG1 X220\n")
    assert "mine:x has no finite number at x = 59.7656 mm" in result.notes[0]
    with pytest.raises(GeoerrError, match=r"hint: mine:x has no finite number at x = 59\.7656 mm"):
        compensate_bytes(model, b"G1 X10 Y10 Z5\nG1 X220 F600\n")


def test_a_formula_without_a_number_in_a_part_of_the_volume_says_where(tmp_path):
    model = Model(machine(), None, (own_term(tmp_path, "c*sqrt(q-100)"),))
    _, result = compensate_bytes(model, b"G1 X200 Y10 Z5\nG1 X220\n")
    assert "mine:x gives no finite number in 25% of the measured volume" in result.notes[0]


@pytest.mark.parametrize("expression", ["c*q/(q+500)", "c*tan(q/1000)", "c*step(q-100)/2", "c*log(q+1)"])
def test_a_formula_that_is_finite_everywhere_has_no_note(tmp_path, expression):
    model = Model(machine(), None, (own_term(tmp_path, expression),))
    assert compensate_bytes(model, b"G1 X200 Y10 Z5\nG1 X220\n")[1].notes == ()


def test_a_condition_that_is_stated_twice_is_wrong_usage():
    assert conditions(["hum=50", "temp_bed=reference"]) == {"hum": 50.0, "temp_bed": "reference"}
    with pytest.raises(typer.BadParameter, match=r"hum is stated twice: 50\.0 and 60\.0"):
        conditions(["hum=50", "hum=60"])


@pytest.mark.parametrize("told", ["temp_bed=refrence", "temp_bed=", "temp_bed", "=20", "temp_bed=nan"])
def test_what_a_condition_may_be_is_said_where_it_is_none(told):
    with pytest.raises(typer.BadParameter, match="is not NAME=VALUE, VALUE a number or reference"):
        conditions([told])


def with_record(model: Model, std: float) -> Model:
    n = sum(len(t.coefficients) + len(t.inner) for t in model.terms)
    record = FitRecord(std**2 * np.eye(n), np.zeros((n, 0)), covariate_spans={"temp_bed": (20.0, 80.0)})
    return dataclasses.replace(model, record=record)


def test_a_correction_is_shown_beside_its_uncertainty():
    of = machine("wbXYZt")
    model = Model(of, None, (term(of, "thermal-drift:z@temp_bed", k=1e-3),))
    program = b"G1 X10 Y10 Z5\nG1 X20\n"
    _, sure = compensate_bytes(with_record(model, 1e-4), program, at={"temp_bed": 70.0})
    # 50 K of 1 µm/K, to 0.1 µm/K.
    assert (sure.correction_rms_um, sure.correction_std_um) == pytest.approx((50.0, 5.0))
    # Ten times as large as its uncertainty, which is that of all there is in the model: and no more.
    assert sure.notes == ("not in the model, taken as 0: all of the 21 errors: nothing of them is corrected",)
    assert len(sure.to_document()["not_in_model"]) == 21
    with pytest.raises(GeoerrError, match="the data had temp_bed 20 to 80"):
        compensate_bytes(with_record(model, 1e-4), program)


def test_a_correction_that_is_determined_nowhere_has_no_uncertainty():
    """The machine was measured at z = 0 only, and the program runs 5 mm above."""
    model = Model(machine("wbXYZt"), None, (term(machine("wbXYZt"), "thermal-drift:z@temp_bed", k=1e-3),))
    open_above = tuple(NotDetermined(f"E{error}Z", "the z axis never moved") for error in "XYZ")
    record = FitRecord(1e-8 * np.eye(1), np.zeros((1, 0)), open_above, stood_mm={"z": 0.0})
    _, result = compensate_bytes(
        dataclasses.replace(model, record=record), b"G1 X10 Y10 Z5\nG1 X20\n", at={"temp_bed": 70.0}
    )
    assert result.correction_rms_um == pytest.approx(50.0)
    assert result.correction_std_um is None
    assert "not determine the correction in 100%" in result.notes[0]


def test_a_harmful_correction_is_told_by_what_is_determined_of_it():
    """Of a growth of x by 1 mm in 20 nobody knows anything; along z there are 50 ± 55 µm, kept on request."""
    of = machine("wbXYZt")
    drift = term(of, "thermal-drift:z@temp_bed", k=1e-3)
    growth = term(of, "thermal-expansion:x@temp_bed", alpha=1e-3, q_fixed=0.0)
    covariance, free = np.diag([1.1e-3, 0.0, 0.0]) ** 2, np.array([[0.0], [1.0], [0.0]])
    record = FitRecord(covariance, free, covariate_spans={"temp_bed": (20.0, 80.0)})
    model = Model(of, None, (drift, growth), record=record)
    options = CompensationOptions(keeps_uncertain=True)
    _, result = compensate_bytes(model, b"G1 X10 Y10 Z5\nG1 X20\n", options, at={"temp_bed": 70.0})
    told = next(note for note in result.notes if "harm" in note)
    assert "typically 50 µm where the data determine it, with a standard uncertainty of 55 µm" in told


def test_what_is_hardly_known_is_left_as_it_is():
    """Of two drifts the one that is known to a tenth is corrected, the one that is not known at all is named."""
    of = machine("wbXYZt")
    drifts = (term(of, "thermal-drift:z@temp_bed", k=1e-3), term(of, "thermal-drift:x@temp_bed", k=1e-3))
    model = Model(of, None, drifts)
    record = FitRecord(np.diag([1e-4, 1.1e-3]) ** 2, np.zeros((2, 0)), covariate_spans={"temp_bed": (20.0, 80.0)})
    program, at = b"G1 X10 Y10 Z5\nG1 X20\n", {"temp_bed": 70.0}
    unsure = dataclasses.replace(model, record=record)
    corrected, result = compensate_bytes(unsure, program, at=at)
    assert [one.id for one in result.uncertain_left_out] == ["thermal-drift:x@temp_bed"]
    assert (result.uncertain_left_out[0].rms_um, result.uncertain_left_out[0].std_um) == pytest.approx((50.0, 55.0))
    assert "thermal-drift:x@temp_bed (50 ± 55 µm)" in result.notes[0]
    assert result.to_document()["uncertain_left_out"][0]["id"] == "thermal-drift:x@temp_bed"
    alone, _ = compensate_bytes(Model(of, None, drifts[:1]), program, at=at)
    assert corrected == alone
    kept, whole = compensate_bytes(unsure, program, CompensationOptions(keeps_uncertain=True), at=at)
    assert not whole.uncertain_left_out
    assert kept == compensate_bytes(model, program, at=at)[0]
    # Nothing is known well enough: the program comes back as it was.
    same, nothing = compensate_bytes(with_record(model, 2e-3), program, at=at)
    assert same == program
    assert len(nothing.uncertain_left_out) == 2


def test_a_machine_that_changed_is_corrected_as_it_was_in_a_session_that_was_measured():
    of = machine("wbXYZt")
    change = catalogue()["scale-change"].term("x", None, of, sessions=("0", "1", "2")).with_values([0.0, 1e-3])
    record = FitRecord(1e-12 * np.eye(2), np.zeros((2, 0)), covariate_spans={"session": (0.0, 2.0)})
    model = Model(of, None, (change,), record)
    program = b"G1 X10 Y10 Z5\nG1 X20\n"
    assert b"X19.98" in compensate_bytes(model, program, at={"session": 2})[0]
    assert compensate_bytes(model, program, at={"session": 1})[0] == program
    with pytest.raises(GeoerrError, match=r"session \(which of the measured sessions .* the data had session 0 to 2"):
        compensate_bytes(model, program)
    with pytest.raises(GeoerrError, match="session 3 is none that was measured: the model's are 0 to 2"):
        compensate_bytes(model, program, at={"session": 3})
    for number in (1.5, -1.0, np.nan):
        with pytest.raises(GeoerrError, match="no number of a session"):
            compensate_bytes(model, program, at={"session": number})


def test_conditions_far_from_the_data_are_refused_unless_asked_for():
    of = machine("wbXYZt")
    model = with_record(Model(of, None, (term(of, "thermal-drift:z@temp_bed", k=1e-3),)), 1e-4)
    program = b"G1 X10 Y10 Z5\nG1 X20\n"
    _, near = compensate_bytes(model, program, at={"temp_bed": 95.0})
    told = "15 °C above what the model was fitted to (20 to 80 °C), 0.25 of that span's width"
    assert near.notes[0] == f"temp_bed = 95 is extrapolated: {told}"
    assert near.to_document()["extrapolated"] == [
        {"name": "temp_bed", "value": 95.0, "low": 20.0, "high": 80.0, "beyond": 15.0}
    ]
    with pytest.raises(GeoerrError, match=r"temp_bed = 120 .* 40 °C above .*\n.*--extrapolate"):
        compensate_bytes(model, program, at={"temp_bed": 120.0})
    with pytest.raises(GeoerrError, match="45 °C below"):
        compensate_bytes(model, program, at={"temp_bed": -25.0})
    _, far = compensate_bytes(model, program, CompensationOptions(extrapolates=True), at={"temp_bed": 120.0})
    assert "40 °C above" in far.notes[0]
    hot = dataclasses.replace(
        model, record=dataclasses.replace(model.record, covariate_spans={"temp_bed": (80.0, 85.0)})
    )
    # Where what follows the temperature is 0 by definition, a program may run.
    _, cold = compensate_bytes(hot, program, at={"temp_bed": "reference"})
    assert "60 °C below" in cold.notes[0]
    with pytest.raises(GeoerrError, match="is extrapolated"):
        compensate_bytes(hot, program, at={"temp_bed": 20.0})
    # A temperature that stood still in the data is known within a few degrees.
    still = dataclasses.replace(
        model, record=dataclasses.replace(model.record, covariate_spans={"temp_bed": (60.0, 60.0)})
    )
    assert "nothing but 60 °C" in compensate_bytes(still, program, at={"temp_bed": 61.5})[1].notes[0]
    with pytest.raises(GeoerrError, match=r"2\.5 °C above"):
        compensate_bytes(still, program, at={"temp_bed": 62.5})


def test_tables_that_are_hardly_known_are_named():
    position_mm = np.array([0.0, 200.0, 400.0])
    functions = {
        "EXX": ErrorFunction(position_mm, np.array([0.0, 0.02, 0.03]), np.array([0.0, 1e-3, 1e-3])),
        "EAX": ErrorFunction(position_mm, np.array([0.0, 1e-5, 1e-5]), np.array([0.0, 9e-6, 9e-6])),
    }
    lean = {"EC0Y": Squareness(1e-5, 1e-5), "EB0Z": Squareness(1e-4, 1e-5)}
    errors = ErrorFunctions(machine(), functions, lean, "joint")
    _, result = compensate_bytes(Model(machine(), errors), b"G1 X10 Y10 Z5\n")
    assert not result.uncertain_left_out
    assert "corrected all the same: EAX, EC0Y;" in result.notes[0]


def test_the_verbs_leave_the_same_out(tmp_path):
    model, source, target = tmp_path / "model.json", tmp_path / "in.gcode", tmp_path / "out.gcode"
    of = machine()
    terms = (term(of, "backlash:x", b=0.05), term(of, "thermal-drift:z@temp_bed", k=1e-3))
    record = FitRecord(np.diag([1e-3, 1.2e-3]) ** 2, np.zeros((2, 0)), covariate_spans={"temp_bed": (20.0, 80.0)})
    write_model(model, Model(of, None, terms, record))
    source.write_text(drawn_program())
    at = ["--at", "temp_bed=80", "--json"]

    def run(*arguments: str) -> dict:
        done = CliRunner().invoke(app, [*arguments, *at])
        assert done.exit_code == 0, done.output
        return json.loads(done.stdout)

    left_out = run("compensate", str(model), str(source), "-o", str(target))["uncertain_left_out"]
    assert [one["id"] for one in left_out] == ["thermal-drift:z@temp_bed"]
    assert run("verify", "path", str(model), str(source), str(target))["max_error_um_after"] < 5.0
    with_all = ("verify", "path", str(model), str(source), str(target), "--keep-uncertain")
    assert run(*with_all)["max_error_um_after"] == pytest.approx(60.0, abs=6.0)
    run("compensate", str(model), str(source), "-o", str(target), "--keep-uncertain")
    assert run(*with_all)["max_error_um_after"] < 5.0


def test_the_verbs(tmp_path):
    model, source, target = tmp_path / "model.json", tmp_path / "in.gcode", tmp_path / "out.gcode"
    write_model(model, printer())
    source.write_text(drawn_program())
    files = [str(model), str(source)]
    refused = CliRunner().invoke(app, ["compensate", *files, "-o", str(target)])
    assert refused.exit_code == 1
    assert not target.exists()
    at = ["--at", "temp_bed=90", "--at", "spool=2"]
    done = CliRunner().invoke(app, ["compensate", *files, "-o", str(target), *at, "--json"])
    assert done.exit_code == 0, done.output
    document = json.loads(done.stdout)
    assert document["left_out"] == []
    assert document["correction_std_um"] is None
    # X and Y have play of 50 and 30 µm, and are turned by corrections in moves that leave them at rest.
    verify = ["verify", "path", *files, str(target), *at]
    checked = CliRunner().invoke(app, [*verify, "--tolerance", "0.005", "--json"])
    assert checked.exit_code == 0, checked.output
    for verb in (done, checked):
        assert "note: the model does not depend on spool: --at spool changes nothing" in verb.stderr
    assert json.loads(checked.stdout)["max_error_um_after"] < 5.0
    cold = [*files, str(target), "--at", "temp_bed=reference", "--tolerance", "0.005"]
    assert CliRunner().invoke(app, ["verify", "path", *cold]).exit_code == 1


def test_options_do_not_change_what_is_taken_up():
    of = machine("wbXYZt")
    model = Model(of, None, (term(of, "backlash:x", b=0.002),))
    program = b"G1 X10 Y10 Z5\nG1 X100\nG1 X50\n"
    coarse, _ = compensate_bytes(model, program)
    assert coarse.count(b"\n") == 4, "a jump below half of the tolerance is taken up along the move"
    fine, _ = compensate_bytes(model, program, CompensationOptions(tolerance_mm=0.001))
    assert fine.count(b"\n") == 6


def test_a_fit_that_has_not_settled_corrects_no_program():
    of = machine("wbXYZt")
    model = with_record(Model(of, None, (term(of, "thermal-drift:z@temp_bed", k=1e-3),)), 1e-4)
    assert model.record is not None
    unsettled = dataclasses.replace(model, record=dataclasses.replace(model.record, has_settled=False))
    with pytest.raises(GeoerrError, match=r"the fit has not settled: .*\nhint: look for a mistyped row"):
        compensate_bytes(unsettled, b"G1 X10 Y10 Z5\nG1 X20\n", at={"temp_bed": 70.0})


def test_a_size_says_that_it_does_not_count_what_is_not_in_the_model(tmp_path):
    model, source, target = tmp_path / "model.json", tmp_path / "in.gcode", tmp_path / "out.gcode"
    of = machine("wbXYZt")
    write_model(model, with_record(Model(of, None, (term(of, "thermal-drift:z@temp_bed", k=1e-3),)), 1e-4))
    source.write_text("G1 X10 Y10 Z5\nG1 X20\n")
    done = CliRunner().invoke(app, ["compensate", str(model), str(source), "-o", str(target), "--at", "temp_bed=70"])
    assert "typically 50.0 ± 5.0 µm over the box of the program's moves\nerrors that are not in" in done.stdout
    assert "note: not in the model, taken as 0: all of the 21 errors" in done.stderr
