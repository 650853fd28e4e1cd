"""The demo in words and on one page."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from geoerr.demo.job import PROGRAM, TOLERANCE_MM, DemoResult
from geoerr.error_functions import LI_NAMES, ErrorFunctions
from geoerr.machine import AXES
from geoerr.report import figures
from geoerr.report.ballbar import circular_test_blocks
from geoerr.report.error_tables import error_function_table, not_determined, share_within_95, squareness_table
from geoerr.report.page import Block, Figure, Paragraph, Section, Table, as_sentence, write_report
from geoerr.report.provenance import Provenance

_UM_PER_MM = 1e3
_COVERAGE_95 = 1.96
# Places this near to each other are one.
_HERE_MM = 0.5


def sentences(result: DemoResult) -> list[str]:
    """Say what happened, one sentence a step."""
    calibration, path, circle = result.calibration, result.path, result.circle
    held_out = calibration.held_out_rms_px
    inside, total = truth_inside(result.errors, result.truth.errors)
    before, after = (trace.circular_deviation_mm * _UM_PER_MM for trace in (circle.before[0], circle.after[0]))
    lines = [
        f"{result.truth.n_frames} stereo pictures of a virtual printer ({result.errors.machine.chain}) and "
        f"{result.truth.n_board_views} of a calibration board were taken with errors that geoerr did not know.",
        f"Calibration: {calibration.pairs_used} pairs, reprojection {calibration.stereo_rms_px:.4f} px"
        + ("." if held_out is None else f", held out {held_out:.4f} px."),
        f"Measuring: {len(result.measured.observations)} target positions, {len(result.measured.missed)} missed.",
        f"The true error lies within the stated 95 % interval at {inside} of {total} values of the 21 errors.",
        f"Program {PROGRAM}: the true machine leaves the wanted path by at most {path.max_error_um_before:.1f} µm "
        f"before and {path.max_error_um_after:.1f} µm after correction (rms {path.rms_um_before:.1f} and "
        f"{path.rms_um_after:.1f} µm).",
        f"Circle of 100 mm radius: circular deviation {before:.1f} µm before, {after:.1f} µm after.",
    ]
    lines += [
        f"Workpiece, {name} points: relative positioning error {rmse_before} µm RMSE before, {rmse_after} µm after."
        for name, _, rmse_before, rmse_after in _workpiece_rows(result)
    ]
    return lines


def truth_inside(errors: ErrorFunctions, truth: ErrorFunctions) -> tuple[int, int]:
    """Count the values whose stated 95 % interval holds the truth, and all values that have an interval."""
    inside = total = 0
    for name, function in errors.functions.items():
        share = share_within_95(function, truth.functions[name])
        if share is not None and function.std is not None:
            counted = int(np.count_nonzero(function.std > 0.0))
            inside += round(share * counted)
            total += counted
    for name, squareness in errors.squareness.items():
        if squareness.std_rad is not None:
            difference = abs(squareness.value_rad - truth.squareness[name].value_rad)
            inside += difference <= _COVERAGE_95 * squareness.std_rad
            total += 1
    return inside, total


def write_demo_report(path: str | Path, result: DemoResult, provenance: Provenance) -> None:
    """Write report.html: the 21 errors with truth, the nine lines, the error field, circle, path and workpiece."""
    errors, truth = result.errors, result.truth.errors
    sections = [
        Section(
            "The 21 errors",
            (
                Figure(
                    figures.error_curves(errors, truth),
                    "Identified error functions with their 95 % intervals, and the truth",
                ),
                Figure(
                    figures.error_curves(_found_minus_truth(errors, truth), title="Found minus truth"),
                    "Identified minus true errors with their 95 % intervals: an interval that holds 0 is right",
                ),
                error_function_table(errors, truth),
                squareness_table(errors, truth),
                *not_determined(errors),
                *map(as_sentence, errors.notes),
            ),
        ),
        Section(
            "The nine lines",
            (
                Figure(figures.nine_lines(_line_curves(result)), "Measured ΔL along the nine lines (Li, Fig. 9)"),
                _lines_table(result),
                _tangent_table(result),
            ),
        ),
        Section(
            "Error field",
            (
                Figure(
                    figures.error_field(result.true_machine, result.error_after_mm),
                    "The true machine's error over its volume before and after correction",
                ),
            ),
        ),
        Section("Circular test", circular_test_blocks(result.circle)),
        Section("Program and workpiece", _program_blocks(result)),
        Section("Cameras and measurement", _camera_blocks(result)),
    ]
    write_report(path, "geoerr: from pictures to a proven correction", sentences(result), sections, provenance)


def _found_minus_truth(errors: ErrorFunctions, truth: ErrorFunctions) -> ErrorFunctions:
    functions = {
        name: replace(found, value=found.value - truth.functions[name].at(found.position_mm))
        for name, found in errors.functions.items()
    }
    squareness = {
        name: replace(found, value_rad=found.value_rad - truth.squareness[name].value_rad)
        for name, found in errors.squareness.items()
    }
    return replace(errors, functions=functions, squareness=squareness)


def _line_curves(result: DemoResult) -> list[figures.LineCurve]:
    return [
        figures.LineCurve(
            line.number,
            line.axis,
            f"{line.number}: {_arm(line.place_mm)}",
            line.position_mm,
            line.deviation_mm,
        )
        for line in result.identified.lines
        if line.number is not None
    ]


def _arm(place_mm: tuple[float, float, float]) -> str:
    arms = [f"{axis} = {length:g} mm" for axis, length in zip(AXES, place_mm, strict=True) if abs(length) > _HERE_MM]
    return ", ".join(arms) or "through the origin"


def _tangent_table(result: DemoResult) -> Table:
    rows = tuple(
        (
            verdict.name,
            LI_NAMES[verdict.name],
            f"{verdict.rms_mm * _UM_PER_MM:.2f}",
            "–" if verdict.p_value is None else f"{verdict.p_value:.2f}",
            {True: "yes, as far as can be told", False: "no", None: "cannot be told"}[verdict.follows],
        )
        for verdict in result.identified.tangent
    )
    header = ("error", "Li", "direct − integrated, µm rms", "p", "carriage follows its guideway's tangent")
    return Table("Straightness seen directly and integrated from the angles (Li, Eq. 19)", header, rows)


def _lines_table(result: DemoResult) -> Table:
    rows = tuple(
        (
            "–" if line.number is None else str(line.number),
            line.axis.upper(),
            "({:.0f}, {:.0f}, {:.0f})".format(*line.place_mm),
            ", ".join(line.carriers),
            str(line.n_points),
            f"{line.rms_mm * _UM_PER_MM:.1f}",
        )
        for line in result.identified.lines
    )
    header = ("Li's number", "axis", "offset, mm", "carrier", "points", "rms from the line, µm")
    return Table("Lines as they were recognised", header, rows)


def _program_blocks(result: DemoResult) -> tuple[Block, ...]:
    path = result.path
    rows = (
        (
            "largest distance from the wanted path, µm",
            f"{path.max_error_um_before:.1f}",
            f"{path.max_error_um_after:.1f}",
        ),
        ("rms distance, µm", f"{path.rms_um_before:.1f}", f"{path.rms_um_after:.1f}"),
        ("moves", str(path.moves_in), str(path.moves_out)),
        ("extrusion, mm", f"{path.extrusion_in_mm:.5f}", f"{path.extrusion_out_mm:.5f}"),
    )
    return (
        Paragraph(
            f"{PROGRAM} was corrected with the identified errors to a tolerance of {TOLERANCE_MM * _UM_PER_MM:g} µm, "
            "and both programs were carried out by the true machine. What is left is the tolerance and the "
            "measurement's own uncertainty."
        ),
        Table("The program's path on the true machine", ("", "before", "after"), rows),
        Table(
            "Relative positioning error of a workpiece, RMSE in µm (Li, Table 4)",
            ("group", "points", "before", "after"),
            _workpiece_rows(result),
        ),
    )


def _workpiece_rows(result: DemoResult) -> tuple[tuple[str, str, str, str], ...]:
    return tuple(
        (
            group.name,
            str(group.before.n),
            f"{group.before.rmse_mm * _UM_PER_MM:.1f}",
            f"{group.after.rmse_mm * _UM_PER_MM:.1f}",
        )
        for group in result.workpiece.groups
        if group.before is not None and group.after is not None
    )


def _camera_blocks(result: DemoResult) -> tuple[Block, ...]:
    return (
        Figure(figures.calibration_quality(result.calibration), "Reprojection error of each board view"),
        *map(as_sentence, (*result.calibration.notes, *result.measured.notes)),
        Figure(
            figures.measurement_residuals(result.measured.observations),
            "Stated uncertainty of the measured points, noise of the pictures alone",
        ),
    )
