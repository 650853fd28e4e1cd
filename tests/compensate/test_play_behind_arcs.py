"""Arcs pass as they are: on which side of its play each axis is behind one, by carriages that follow their drives."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from term_models import machine, term
from test_term_programs import off_segment

from geoerr.compensate.program import CompensationOptions, compensate_bytes, compensate_program
from geoerr.error_functions import ErrorFunction, ErrorFunctions, Squareness
from geoerr.errors import GcodeError
from geoerr.model import Model
from geoerr.verify.path import compare_paths

PLAY_MM = np.array([0.05, 0.03, 0.0])
PASS = CompensationOptions(on_unsupported="pass")
TOLERANCE_UM = 5.0


def loose_machine(seed: int | None = None) -> Model:
    """A machine with play in X and Y; one of a seed has other errors, too."""
    of = machine("wbXYZt")
    terms = tuple(term(of, f"backlash:{axis}", b=mm) for axis, mm in zip("xy", PLAY_MM, strict=False))
    if seed is None:
        return Model(of, None, terms)
    rng = np.random.default_rng(seed)
    bows = {
        name: ErrorFunction(np.array([0.0, 130.0, 280.0, 400.0]), rng.uniform(-0.05, 0.05, 4))
        for name in ("EXX", "EXY", "EYX")
    }
    lean = {"EC0Y": Squareness(rng.uniform(-1e-3, 1e-3))}
    return Model(of, ErrorFunctions(of, bows, lean, "joint"), terms)


def arc_line(rng: np.random.Generator, at: np.ndarray, *, is_relative: bool) -> tuple[str, np.ndarray]:
    """Draw an arc in XY, many from and to quadrants of their circles; or a straight move with another axis."""
    if rng.random() < 0.2:
        end = np.round(at + np.array([rng.choice([0.0, 0.02, 30.0]) * rng.choice([-1.0, 1.0]), 0.0, 0.0]), 3)
        return f"G1 X{(end - at if is_relative else end)[0]:.3f} A5", end
    radius = rng.choice([0.8, 5.0, 30.0]) * rng.uniform(0.5, 1.0)
    quarters = rng.random() < 0.4
    begin, way = rng.uniform(0.0, 2.0 * np.pi), rng.uniform(0.1, 1.9) * np.pi
    if quarters:
        begin, way = (0.5 * np.pi * rng.integers(1, 5) for _ in range(2))
    sense = rng.choice([-1.0, 1.0])
    is_whole = way > 1.99 * np.pi
    offset = np.round(-radius * np.array([np.cos(begin), np.sin(begin)]), 3)
    end = at[:2] + offset + radius * np.array([np.cos(begin + sense * way), np.sin(begin + sense * way)])
    end = at.copy() if is_whole else np.append(np.round(end, 3), at[2])
    words = end[:2] - at[:2] if is_relative else end[:2]
    code = "G3" if sense > 0.0 else "G2"
    centre = f"I{offset[0]:.3f} J{offset[1]:.3f}"
    if not quarters and rng.random() < 0.3:
        # The longer way round has a radius below 0.
        centre = f"R{radius if way < np.pi else -radius:.3f}"
    if is_whole:
        # With or without the place where it ends.
        words_of_end = rng.choice([f"X{words[0]:.3f} Y{words[1]:.3f} ", ""])
        return f"{code} {words_of_end}{centre} ; whole", end
    return f"{code} X{words[0]:.3f} Y{words[1]:.3f} {centre}", end


def drawn_program(seed: int, n_arcs: int = 25) -> str:
    """Arcs; behind each of them steps that are shorter than the play, there and back, and a longer one."""
    rng = np.random.default_rng(seed)
    is_relative = seed % 3 == 2
    lines, at = ["G90", "M117", "G1 X200 Y200 Z5 F600", "M117", "G1 X201 Y201"], np.array([201.0, 201.0, 5.0])
    lines += ["G91"] if is_relative else []

    def step(by: np.ndarray) -> None:
        nonlocal at
        end = np.round(at + np.append(by, 0.0), 3)
        words = end - at if is_relative else end
        lines.extend(["M117", f"G1 X{words[0]:.3f} Y{words[1]:.3f}"])
        at = end

    for _ in range(n_arcs):
        line, at = arc_line(rng, at, is_relative=is_relative)
        lines += ["M117", line]
        for _ in range(rng.integers(1, 6)):
            step(PLAY_MM[:2] * rng.uniform(0.05, 0.9, 2) * rng.choice([-1.0, 0.0, 1.0], 2))
        to_middle = np.where(np.abs(at[:2] - 200.0) > 60.0, np.sign(200.0 - at[:2]), rng.choice([-1.0, 1.0], 2))
        step(to_middle * rng.choice([0.0, 0.2, 20.0], 2))
    return "\n".join(lines) + "\n"


def arc_of_drives(begin: np.ndarray, end: np.ndarray, line: str) -> np.ndarray:
    """Give places (n, 3) along an arc in XY; where its radii differ, from one to the other."""
    words = {letter: float(number) for letter, number in re.findall(r"([IJR])(-?[\d.]+)", line)}
    sense = 1.0 if line.startswith("G3") else -1.0
    if "R" in words:
        half = 0.5 * (end - begin)[:2]
        rise = np.sqrt(max(words["R"] ** 2 - half @ half, 0.0)) * np.sign(words["R"]) * sense
        centre = begin[:2] + half + rise * np.array([-half[1], half[0]]) / np.linalg.norm(half)
    else:
        centre = begin[:2] + np.array([words.get("I", 0.0), words.get("J", 0.0)])
    (from_x, from_y), (to_x, to_y) = begin[:2] - centre, end[:2] - centre
    way = sense * (np.arctan2(to_y, to_x) - np.arctan2(from_y, from_x)) % (2.0 * np.pi)
    if "whole" in line and way < np.pi:
        way += 2.0 * np.pi
    share = np.linspace(0.0, 1.0, 4000)[1:]
    angle = np.arctan2(from_y, from_x) + sense * way * share
    radius = np.hypot(from_x, from_y) * (1.0 - share) + np.hypot(to_x, to_y) * share
    places = np.column_stack([centre[0] + radius * np.cos(angle), centre[1] + radius * np.sin(angle)])
    return np.column_stack([places, np.full(len(places), begin[2])])


def ways(text: str) -> list[list[np.ndarray]]:
    """Give the ways of the drives, (n, 3) each, of the lines behind each `M117`."""
    at, is_relative = np.full(3, np.nan), False
    found: list[list[np.ndarray]] = []
    for line in text.splitlines():
        if line.startswith("M117"):
            found.append([])
        elif line in ("G90", "G91"):
            is_relative = line == "G91"
        elif re.match("G[123] ", line):
            end = at.copy()
            for letter, number in re.findall(r"([XYZ])(-?[\d.]+)", line):
                axis = "XYZ".index(letter)
                end[axis] = float(number) + (at[axis] if is_relative else 0.0)
            begin = np.where(np.isnan(at), end, at)
            straight = begin + np.linspace(0.0, 1.0, 60)[1:, None] * (end - begin)
            found[-1].append(straight if line.startswith("G1") else arc_of_drives(at, end, line))
            at = end
    return found


def worst_um(model: Model, program: str, written: str) -> tuple[float, float]:
    """Give how far the tool is off the paths of moves that begin where a corrected one ended, and off all ends."""
    stiff = Model(model.machine, model.errors, ())
    lines = re.findall("^G[123] .*", program, re.MULTILINE)
    # The first move tells from where the axes come: behind it both have crossed their play.
    (_, *meant), ((first,), *runs) = ways(program), ways(written)
    begin = carriage = first[-1]
    off_path, off_end, is_first = 0.0, 0.0, True
    for line, (ideal,), run in zip(lines[1:], meant, runs, strict=True):
        tools = []
        for drive in (drives := np.concatenate(run)):
            carriage = np.clip(carriage, drive - 0.5 * PLAY_MM, drive + 0.5 * PLAY_MM)
            tools.append(carriage)
        is_corrected = line.startswith("G1") and "A" not in line
        if is_corrected:
            off = [off_segment(point, begin, ideal[-1]) for point in np.array(tools) + stiff.error_mm(drives)]
            off_path = off_path if is_first else max(off_path, *off)
            off_end = max(off_end, float(np.linalg.norm(tools[-1] + stiff.error_mm(drives[-1:])[0] - ideal[-1])))
        is_first = not is_corrected
        begin = ideal[-1]
    return 1e3 * off_path, 1e3 * off_end


def without_marks(text: str) -> str:
    return text.replace("M117\n", "")


def compensated(model: Model, program: str, folder: Path) -> tuple[Path, Path, str]:
    """Compensate a program without its marks; give it with them, too: they change nothing else."""
    source, target = folder / "in.gcode", folder / "out.gcode"
    source.write_text(without_marks(program))
    compensate_program(model, source, target, options=PASS)
    marked = compensate_bytes(model, program.encode(), options=PASS)[0].decode()
    assert without_marks(marked) == target.read_text()
    return source, target, marked


@pytest.mark.parametrize("seed", range(12))
def test_behind_an_arc_the_tool_is_where_it_should_be(seed, tmp_path):
    program = drawn_program(seed)
    model = loose_machine(seed if seed % 2 else None)
    source, target, marked = compensated(model, program, tmp_path)
    off_path_um, off_end_um = worst_um(model, program, marked)
    certified_um = compare_paths(model, source, target).max_error_um_after
    assert off_path_um < certified_um + 0.1
    assert off_end_um < TOLERANCE_UM
    assert certified_um < TOLERANCE_UM


def commands(program: str) -> list[str]:
    """Give the lines of a program with play in X and Y alone, as they are written."""
    written, _ = compensate_bytes(loose_machine(), program.encode(), options=PASS)
    return [line for line in written.decode().splitlines() if "geoerr" not in line]


@pytest.mark.parametrize(
    ("arc", "step", "written"),
    [
        # Half a circle over the highest Y, from X 100 to 110: X comes from below, Y from above, half of its play on.
        ("G2 X110 Y100 I5 J0", "X110.01 Y99.99", "X110.0350 Y99.9750"),
        # A step back that is shorter than the way to the middle of the play is one of the other side still.
        ("G2 X110 Y100 I5 J0", "X109.99 Y100.01", "X110.0150 Y99.9950"),
        ("G2 X110 Y100 I5 J0", "X109.96 Y100.03", "X109.9350 Y100.0450"),
        # By the lowest Y.
        ("G3 X110 Y100 I5 J0", "X109.99 Y99.99", "X110.0150 Y100.0050"),
        ("G90.1\nG3 X110 Y100 I105 J100", "X109.99 Y99.99", "X110.0150 Y100.0050"),
        ("G3 X110 Y100 R5", "X109.99 Y99.99", "X110.0150 Y100.0050"),
        # A straight move that passes for its axis of which nothing is known.
        ("G1 X110 Y90 A5", "X109.99 Y90.01", "X110.0150 Y89.9950"),
        # An arc in Z and X leaves Y where it was corrected.
        ("G18\nG2 X110 Z5 I5 K0", "X109.99 Y99.99", "X110.0150 Y99.9750"),
        # Of a spline nothing is known.
        ("G5 X110 Y100 I5 J0 P5 Q0", "X109.99 Y100.01", "X109.9650 Y100.0250"),
    ],
)
def test_the_last_stroke_of_what_passes_says_on_which_side_an_axis_is(arc, step, written):
    lines = commands(f"G1 X90 Y90 Z5\nG1 X100 Y100\n{arc}\nG1 {step}\n")
    # Behind an arc all axes are given.
    assert lines[-1].removesuffix(" Z5.0000") == f"G1 {written}"


def test_what_is_commanded_for_the_wrong_side_is_certified_as_that(tmp_path):
    """X comes from below behind the arc; its step back is commanded as if it came from above, and does not happen."""
    source, target = tmp_path / "in.gcode", tmp_path / "out.gcode"
    arc = "G2 X110 Y100 I5 J0"
    source.write_text(f"G1 X90 Y90 Z5\nG1 X100 Y100\n{arc}\nG1 X109.99\nG1 X109.98\nG1 X109.9\n")
    begin = "G1 X90 Y90 Z5\nG1 X90.025 Y90.015\nG1 X100.025 Y100.015"
    target.write_text(f"{begin}\n{arc}\nG1 X109.965 Y99.985\nG1 X109.955\nG1 X109.875\n")
    path = compare_paths(loose_machine(), source, target)
    # The carriage is 25 µm below X 110, where the drive has left it.
    assert path.max_error_um_after == pytest.approx(15.0, abs=0.1)
    assert path.held_back_um == pytest.approx(15.0, abs=0.1)


@pytest.mark.parametrize("centre", ["R", "I0 J"])
def test_of_an_arc_that_no_machine_has_nothing_is_known(centre, tmp_path):
    """The square of its radius is no number."""
    program = tmp_path / "in.gcode"
    program.write_text(f"G1 X90 Y90 Z5\nG1 X100 Y100\nG2 X110 Y100 {centre}{'9' * 200}\nG1 X109.99\n")
    assert compare_paths(loose_machine(), program, program).moves_not_compared >= 1


def test_words_that_are_too_coarse_for_the_tolerance_are_refused_as_ever():
    """Nothing is left to play then."""
    options = CompensationOptions(digits=2, tolerance_mm=0.005)
    with pytest.raises(GcodeError, match="too coarse"):
        compensate_bytes(loose_machine(0), b"G1 X10 Y10 Z5\nG1 X300 Y200\n", options=options)
