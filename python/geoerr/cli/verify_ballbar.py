"""`geoerr verify ballbar`: the circular test of a model."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from geoerr.cli.options import JsonFlag, QuietFlag, Threads, check_output, examples, files_given, note, print_json
from geoerr.cli.program_options import At, followed_conditions, positive
from geoerr.cli.text_tables import say
from geoerr.errors import InputFileError

if TYPE_CHECKING:
    from geoerr.observations import CircularTest
    from geoerr.verify.ballbar import CircularTestResult, Trace

_EXAMPLES = (
    "geoerr verify ballbar errors.json --center 200,200 --radius 100",
    "geoerr verify ballbar model.json --trace circle.csv --at temp_bed=90 --report circle.html",
)


def register(sub: typer.Typer) -> None:
    """Add the verb to the group `geoerr verify`."""
    sub.command("ballbar", epilog=examples(*_EXAMPLES))(ballbar)


def ballbar(
    model: Annotated[Path, typer.Argument(help="errors.json, model.json, or machine.toml (no errors).")],
    trace: Annotated[
        Path | None, typer.Option("--trace", help="Measured circular test (line,x,y,z,r) to compare with.")
    ] = None,
    center: Annotated[
        str | None,
        typer.Option("--center", help="Centre in the plane, mm, as A,B or A,B,LEVEL. Li's in XY: 212,270."),
    ] = None,
    radius: Annotated[
        float | None, typer.Option("--radius", callback=positive, help="Radius in mm. Li's: 100.")
    ] = None,
    plane: Annotated[
        str | None, typer.Option("--plane", help="XY, YZ or ZX; XY, or the trace's, where not given.")
    ] = None,
    eq23: Annotated[
        bool, typer.Option("--eq23", help="Beside it Li's Eq. 23 as printed: without squareness.")
    ] = False,
    truth: Annotated[
        Path | None,
        typer.Option("--truth", help="Machine that carries out the commands (truth.json of a simulation)."),
    ] = None,
    at: At = None,
    report: Annotated[Path | None, typer.Option("--report", help="Write the circle plot as an HTML page.")] = None,
    as_json: JsonFlag = False,
    quiet: QuietFlag = False,
    # Every verb takes it; a circle is too small to share.
    threads: Threads = 0,
) -> None:
    """Circular deviation (ISO 230-4) that MODEL predicts, before and after compensation."""
    from geoerr.model import load_model
    from geoerr.model.program_conditions import extrapolated_conditions
    from geoerr.observations import read_circular_test
    from geoerr.report.provenance import provenance_of_command
    from geoerr.verify.ballbar import circle_to_test, run_circular_test
    from geoerr.verify.circle_motion import followed_on_circle

    check_output(report, files_given(model, trace, truth))
    loaded = load_model(model)
    true_model = None if truth is None else load_model(truth)
    measured = None if trace is None else read_circular_test(trace)
    plane, center_mm, radius_mm = _circle_asked_for(plane, center, radius, trace, measured)
    circle = circle_to_test(loaded, plane, center_mm, radius_mm)
    given = followed_conditions(at, followed_on_circle(loaded, true_model or loaded), quiet)
    result = run_circular_test(loaded, circle, truth=true_model, with_eq23=eq23, measured=measured, at=given)
    provenance = provenance_of_command([model, trace, truth])
    if report is not None:
        # Plotly comes with it: only a page pays for it.
        from geoerr.report.ballbar import write_ballbar_report

        write_ballbar_report(report, result, provenance)
    if as_json:
        print_json({**result.to_document(), "provenance": provenance.to_document()})
        return
    _print_result(result, model)
    for problem in result.set_aside:
        note(f"set aside: {problem}", quiet)
    for one in extrapolated_conditions(loaded, given):
        note(f"note: {one}", quiet)
    for sentence in result.notes:
        note(f"note: {sentence}", quiet)
    if result.assumed_zero:
        note(f"note: not determined or not in the model, taken as 0 here: {', '.join(result.assumed_zero)}", quiet)
    if report is not None:
        note(f"report: {report}", quiet)


def _circle_asked_for(
    plane: str | None,
    center: str | None,
    radius: float | None,
    trace: Path | None,
    measured: CircularTest | None,
) -> tuple[str, list[float] | None, float | None]:
    from geoerr.verify.ballbar import circle_of_first_run
    from geoerr.verify.circle import PLANES

    if plane is not None and plane.upper() not in PLANES:
        raise typer.BadParameter(f"{plane!r} is not one of {', '.join(PLANES)}", param_hint="--plane")
    center_mm = None if center is None else _numbers(center)
    if measured is None:
        return (plane or "XY").upper(), center_mm, radius
    run = circle_of_first_run(measured)
    if plane is not None and plane.upper() != run.plane:
        raise InputFileError(
            str(trace),
            f"the circle lies in the {run.plane} plane, {plane.upper()} was asked for",
            remedy="leave --plane out",
        )
    of_run = [run.center_mm[index] for index in run.axes]
    return run.plane, of_run if center_mm is None else center_mm, run.radius_mm if radius is None else radius


def _numbers(text: str) -> list[float]:
    try:
        numbers = [float(part) for part in text.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) not in (2, 3) or not all(map(math.isfinite, numbers)):
        raise typer.BadParameter(f"{text!r} is not A,B or A,B,LEVEL in mm", param_hint="--center")
    return numbers


def _print_result(result: CircularTestResult, model: Path) -> None:
    circle = result.before[0].circle
    place = ", ".join(f"{value:g}" for value in circle.center_mm)
    say(f"circle in {circle.plane}, centre ({place}) mm, radius {circle.radius_mm:g} mm")
    say("")
    say(f"{'circular deviation G (ISO 230-4)':<40}{'before':>12}{'after':>12}")
    for number, sense in enumerate(("counter-clockwise", "clockwise")):
        say(f"  {sense:<38}{_um(result.before[number])}{_um(result.after[number])}")
    if result.eq23 is not None:
        say(f"  {'Li Eq. 23 as printed, no squareness':<38}{_um(result.eq23)}")
    if result.is_predicted:
        if result.runs:
            say("(before and after by the model itself; a measured circle is compared below)")
        else:
            say("(before and after by the model itself; a measured circle proves it)")
            say(f"  geoerr verify ballbar {model} --trace circle.csv")
    if result.runs:
        say("")
        say(f"{'measured run':<28}{'points':>8}{'measured G':>13}{'predicted G':>13}{'rms difference':>16}")
        for run in result.runs:
            say(
                f"  {run.label:<26}{len(run.measured.angle_rad):>8}"
                f"{run.measured.circular_deviation_mm * 1e3:>10.1f} µm"
                f"{run.predicted.circular_deviation_mm * 1e3:>10.1f} µm"
                f"{run.set_up.rms_mm * 1e3:>13.1f} µm"
            )


def _um(trace: Trace) -> str:
    return f"{trace.circular_deviation_mm * 1e3:>9.1f} µm"
