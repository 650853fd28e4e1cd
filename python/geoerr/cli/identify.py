"""`geoerr identify`: observations to the 21 errors."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from geoerr.cli.options import (
    JsonFlag,
    MachineFile,
    QuietFlag,
    RigFile,
    Threads,
    calibration,
    check_result_output,
    examples,
    files_given,
    note,
    note_without_rig,
    print_json,
)
from geoerr.cli.progress import progress_bar
from geoerr.cli.text_tables import say


class Method(StrEnum):
    """Ways to identify; the first is the default."""

    JOINT = "joint"
    NINE_LINE = "nine-line"


class Straightness(StrEnum):
    """Straightness that errors.json holds; the other is an alternative there."""

    DIRECT = "direct"
    INTEGRATED = "integrated"


class Roll(StrEnum):
    """Roll that errors.json holds; the other is an alternative there."""

    LINEAR = "linear"
    LI = "li"


_EXAMPLES = (
    "geoerr identify observations.csv --machine machine.toml --rig rig.json -o errors.json",
    "geoerr identify observations.csv --machine machine.toml --method nine-line",
)


def register(app: typer.Typer) -> None:
    """Add the verb."""
    app.command("identify", epilog=examples(*_EXAMPLES))(identify)


def identify(
    observations: Annotated[
        list[Path],
        typer.Argument(
            metavar="OBS...",
            help="Measured points, circular tests, lengths (.csv, .parquet; - is points on standard input).",
        ),
    ],
    machine: MachineFile,
    output: Annotated[Path | None, typer.Option("--output", "-o", help="errors.json to write.")] = None,
    method: Annotated[
        Method, typer.Option("--method", help="All observations in one fit, or the arithmetic of Li's nine lines.")
    ] = Method.JOINT,
    straightness: Annotated[
        Straightness, typer.Option("--straightness", help="From the points, or from the angles (Li Eq. 19).")
    ] = Straightness.DIRECT,
    roll: Annotated[
        Roll, typer.Option("--roll", help="Linear in the points, or Li's root (Eqs. 20-22; nine-line only).")
    ] = Roll.LINEAR,
    rig: RigFile = None,
    as_json: JsonFlag = False,
    quiet: QuietFlag = False,
    threads: Threads = 0,
) -> None:
    """Find the 21 geometric errors of a machine from what was measured."""
    if method is Method.JOINT and roll is Roll.LI:
        raise typer.BadParameter(
            "Li's root takes roll from one pair of lines; the joint fit has no such step: add --method nine-line",
            param_hint="--roll",
        )
    from geoerr.cli.identify_text import identification_lines, print_notes
    from geoerr.error_functions import write_errors
    from geoerr.files import null_for_nan
    from geoerr.identify import NineLineResult, analyze_nine_lines
    from geoerr.identify.joint import JointResult, identify_joint
    from geoerr.machine import read_machine
    from geoerr.measurements import read_measurements
    from geoerr.report.provenance import provenance_of_command

    inputs = files_given(observations, machine, rig)
    check_result_output(output, inputs)
    described = read_machine(machine)
    measured = read_measurements(observations, ranges_mm=described.ranges_mm)
    sensitivity, covariance = calibration(rig, measured.points)
    result: NineLineResult | JointResult
    if method is Method.NINE_LINE:
        result = analyze_nine_lines(
            measured.points_alone(
                "the arithmetic of nine lines takes", "leave --method out: the joint fit takes all"
            ),
            described,
            straightness=straightness.value,
            roll=roll.value,
            rig_sensitivity=sensitivity,
            rig_covariance=covariance,
        )
    else:
        with progress_bar("identify", quiet) as advance:
            advance(0, 1)
            result = identify_joint(
                measured.tables,
                described,
                straightness=straightness.value,
                rig_sensitivity=sensitivity,
                rig_covariance=covariance,
                threads=threads,
            )
            advance(1, 1)
    if output is not None:
        write_errors(output, result.errors)
    if as_json:
        print_json(
            {
                "output": None if output is None else str(output),
                **result.errors.to_document(),
                **null_for_nan(result.to_document()),
                "set_aside": [str(problem) for problem in measured.set_aside],
                "provenance": provenance_of_command(inputs).to_document(),
            }
        )
        return
    for line in identification_lines(result):
        say(line)
    print_notes(result, measured.set_aside, quiet)
    if rig is None and isinstance(result, JointResult):
        note_without_rig(measured.points, quiet)
    if output is not None:
        note(f"errors: {output}", quiet)
