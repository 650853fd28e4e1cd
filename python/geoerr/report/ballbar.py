"""The circular test as a page."""

from __future__ import annotations

from pathlib import Path

from geoerr.report.figures import circular_test
from geoerr.report.figures.circle import is_of_no_errors
from geoerr.report.page import Block, Figure, Section, Table, as_sentence, write_report
from geoerr.report.provenance import Provenance
from geoerr.verify.ballbar import CircularTestResult, Trace

_UM_PER_MM = 1e3


def write_ballbar_report(path: str | Path, result: CircularTestResult, provenance: Provenance) -> None:
    """Write the circular test as one self-contained page, whole or not at all."""
    before, after = (trace.circular_deviation_mm * _UM_PER_MM for trace in (result.before[0], result.after[0]))
    commanded = result.before[0].circle
    by_whom = "By the model itself, on" if result.is_predicted else "On"
    summary = [
        f"{by_whom} a circle of radius {commanded.radius_mm:g} mm in the {commanded.plane} plane the machine "
        f"deviates from roundness by {before:.1f} µm (ISO 230-4), and by {after:.1f} µm with compensated commands.",
    ]
    if result.is_predicted and not result.runs:
        summary.append("That is a prediction; a measured circle proves the model (--trace).")
    for run in result.runs:
        summary.append(
            f"Measured run {run.label}: {run.measured.circular_deviation_mm * _UM_PER_MM:.1f} µm, predicted "
            f"{run.predicted.circular_deviation_mm * _UM_PER_MM:.1f} µm; the two differ by "
            f"{run.set_up.rms_mm * _UM_PER_MM:.1f} µm rms round the circle."
        )
    if result.assumed_zero:
        summary.append(f"Not determined or not in the model, and taken as 0 here: {', '.join(result.assumed_zero)}.")
    write_report(path, "Circular test", summary, [Section("Circular test", circular_test_blocks(result))], provenance)


def circular_test_blocks(result: CircularTestResult) -> tuple[Block, ...]:
    """Give figure and tables of a circular test, for a page of any kind."""
    blocks: list[Block] = [Figure(circular_test(result), _caption(result))]
    if not is_of_no_errors(result):
        blocks.append(Table("Circular deviation G, µm", ("path", "before", "after"), _deviations(result)))
    if result.runs:
        blocks.append(
            Table("Measured runs, µm", ("run", "points", "measured", "predicted", "rms difference"), _runs(result))
        )
    blocks += map(as_sentence, result.notes)
    if result.set_aside:
        rows = tuple((str(problem.row), problem.column, problem.problem) for problem in result.set_aside)
        blocks.append(Table("Rows set aside", ("row", "column", "reason"), rows))
    return tuple(blocks)


def _caption(result: CircularTestResult) -> str:
    if is_of_no_errors(result):
        return "Radial deviation of the measured runs, each from its own least-squares circle."
    return (
        "Radial deviation round the circle before and after compensation"
        + (", with the measured runs" if result.runs else "")
        + "; right: after compensation at its own scale."
    )


def _deviations(result: CircularTestResult) -> tuple[tuple[str, ...], ...]:
    rows = [
        (sense, _um(result.before[number]), _um(result.after[number]))
        for number, sense in enumerate(("counter-clockwise", "clockwise"))
    ]
    if result.eq23 is not None:
        rows.append(("Li Eq. 23 as printed, without squareness", _um(result.eq23), "–"))
    return tuple(rows)


def _runs(result: CircularTestResult) -> tuple[tuple[str, ...], ...]:
    return tuple(
        (
            run.label,
            str(len(run.measured.angle_rad)),
            _um(run.measured),
            _um(run.predicted),
            f"{run.set_up.rms_mm * _UM_PER_MM:.1f}",
        )
        for run in result.runs
    )


def _um(trace: Trace) -> str:
    return f"{trace.circular_deviation_mm * _UM_PER_MM:.1f}"
