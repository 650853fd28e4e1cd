"""Programs of real slicers, CAM systems and controllers: nothing lost, nothing wrong without a word."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from gcode_machines import mill, printer

from geoerr.compensate.program import CompensationOptions, CompensationResult, compensate_program
from geoerr.errors import GcodeError
from geoerr.model import Model
from geoerr.verify.path import compare_paths

pytestmark = pytest.mark.real_data

SLICED = (
    "bee",
    "cubhelix",
    "curaengine413_ender3_spiralize_relE",
    "prusaslicer250_klipper_macros_relE",
    "prusaslicer250_marlin2_absE",
    "prusaslicer250_rrf_fwretract_G10G11",
    "prusaslicer250_vase",
    "superslicer_voron_expansion_test",
    "triangle",
)
TOLERANCE_UM = 5.0
_WHOLE_BYTES, _LAST_BYTES = 1_500_000, 2_000
_AXIS_MOVE = re.compile(rb"\s*G[01]\b[^;]*[XYZ]")


def lines_without_moves(program: bytes) -> list[bytes]:
    lines = program.splitlines(keepends=True)
    return [line for line in lines if not _AXIS_MOVE.match(line) and b"corrected by geoerr" not in line]


@pytest.mark.parametrize("name", SLICED)
def test_sliced_programs(real_data, tmp_path, name):
    source, target = real_data / "gcode" / "slicers" / f"{name}.gcode", tmp_path / "out.gcode"
    model = printer()
    result = compensate_program(model, source, target)
    before, after = source.read_bytes(), target.read_bytes()
    assert lines_without_moves(after) == lines_without_moves(before)
    assert after.count(b"corrected by geoerr") == 1
    assert result.extrusion_out_mm == result.extrusion_in_mm
    if len(before) > _WHOLE_BYTES:
        # The checker is written to be plain, not quick: of a long program it follows the beginning.
        end = before.rindex(b"\n", 0, _WHOLE_BYTES) + 1
        source = tmp_path / "in.gcode"
        source.write_bytes(before[:end])
        result = compensate_program(model, source, target)
        part = target.read_bytes()
        # But for the last move, whose end nothing shows, the whole program begins in the same way.
        assert after.startswith(part[: part.rindex(b"\n", 0, len(part) - _LAST_BYTES)])
    path = compare_paths(model, source, target)
    assert path.max_error_um_after < TOLERANCE_UM
    assert path.max_error_um_before > 2000.0
    assert path.moves_with_other_extrusion == 0
    assert path.max_feed_change_percent == 0.0
    assert path.extrusion_in_mm == path.extrusion_out_mm == pytest.approx(result.extrusion_in_mm, abs=1e-9)
    assert (path.moves_in, path.moves_out) == (result.moves_in, result.moves_out)
    # What is not compared: before the first known position, and one placeholder.
    assert path.moves_not_compared <= 4


def attempt(
    model: Model, source: Path, target: Path, options: CompensationOptions
) -> CompensationResult | GcodeError:
    try:
        return compensate_program(model, source, target, options)
    except GcodeError as error:
        return error


# With the fewest moves to be compared: the interpreter's own tests are nearly all of what is not corrected.
@pytest.mark.parametrize(("folder", "fewest"), [("klipper", 5), ("linuxcnc", 75_000), ("linuxcnc/interp", 0)])
def test_other_programs_are_refused_or_passed_by_line(real_data, tmp_path, folder, fewest):
    model = mill()
    target = tmp_path / "out.gcode"
    home = zero = (0.0, 0.0, 0.0)
    compared = 0
    for source in sorted(path for path in Path(real_data / "gcode" / folder).iterdir() if path.is_file()):
        n_lines = len(re.findall(rb"\r\n|\n|\r", source.read_bytes())) + 1
        written = None
        for mode in ("refuse", "pass"):
            options = CompensationOptions(on_unsupported=mode, home_mm=home, work_offset_mm=zero)
            result = attempt(model, source, target, options)
            if isinstance(result, GcodeError):
                assert 1 <= result.line <= n_lines
                assert result.remedy
                continue
            assert result.extrusion_out_mm == result.extrusion_in_mm
            if written is not None:
                # Nothing had to be passed: the path that was compared already.
                assert target.read_bytes() == written
                continue
            if mode == "refuse":
                assert result.untouched_unsupported == 0
                written = target.read_bytes()
            path = compare_paths(model, source, target, home_mm=home, work_offset_mm=zero)
            assert path.max_error_um_after < TOLERANCE_UM
            assert path.moves_with_other_extrusion == 0
            assert path.max_feed_change_percent == 0.0
            compared += path.moves_compared
    assert compared >= fewest
