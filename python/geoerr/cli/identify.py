"""`geoerr identify`: observations to the 21 errors."""

from __future__ import annotations

from collections.abc import Sequence
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer

from geoerr.cli.fit_text import (
    counted,
    error_rows,
    figure_rows,
    freedom_of,
    not_determined_rows,
    quality_in_words,
    scale_sentence,
    wrapped,
)
from geoerr.cli.options import (
    JsonFlag,
    MachineFile,
    QuietFlag,
    Threads,
    calibration,
    check_output,
    note,
    note_set_aside,
    null_for_nan,
    print_json,
)
from geoerr.cli.progress import progress_bar
from geoerr.error_functions import ALL_NAMES, LI_NAMES, write_errors
from geoerr.fit import figures_document
from geoerr.identify import NineLineResult, TangentVerdict, analyze_nine_lines
from geoerr.identify.joint import JointResult, identify_joint
from geoerr.machine import read_machine
from geoerr.observations import Observations, read_observations
from geoerr.report.provenance import provenance_of_command

_UM_PER_MM = 1e3
_TANGENT = "direct against integrated straightness (the same where a carriage follows its guideway's tangent):"


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


def register(app: typer.Typer) -> None:
    """Add the verb."""
    app.command("identify")(identify)


def identify(
    observations: Annotated[
        list[Path], typer.Argument(metavar="OBS...", help="Measured points (.csv, .parquet; - is standard input).")
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
    rig: Annotated[
        Path | None, typer.Option("--rig", help="rig.json: include the calibration's uncertainty.")
    ] = None,
    as_json: JsonFlag = False,
    quiet: QuietFlag = False,
    threads: Threads = 0,
) -> None:
    """Find the 21 geometric errors of a machine from measured points."""
    if method is Method.JOINT and roll is Roll.LI:
        raise typer.BadParameter(
            "Li's root takes roll from one pair of lines; the joint fit has no such step: add --method nine-line",
            param_hint="--roll",
        )
    inputs = [*observations, machine, *([rig] if rig is not None else [])]
    check_output(output, inputs)
    described = read_machine(machine)
    table = read_observations(*observations)
    sensitivity, covariance = calibration(rig, table)
    result: NineLineResult | JointResult
    if method is Method.NINE_LINE:
        result = analyze_nine_lines(
            table,
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
                table,
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
        print_json(_document(result, table, output, inputs))
        return
    for line in _text(result):
        typer.echo(line)
    _print_notes(result, table, quiet)
    if rig is None and isinstance(result, JointResult):
        note("note: the calibration's uncertainty is not included", quiet)
    if output is not None:
        note(f"errors: {output}", quiet)


def _document(
    result: NineLineResult | JointResult, table: Observations, output: Path | None, inputs: Sequence[Path]
) -> dict[str, Any]:
    document: dict[str, Any] = null_for_nan(result.to_document())
    return {
        "output": None if output is None else str(output),
        **result.errors.to_document(),
        **document,
        "set_aside": [str(problem) for problem in table.set_aside],
        "provenance": provenance_of_command(inputs).to_document(),
    }


def _text(result: NineLineResult | JointResult) -> list[str]:
    errors = result.errors
    freedom = freedom_of(result.result.fitted) if isinstance(result, JointResult) else {}
    lines = [
        f"{errors.machine.name} ({errors.machine.chain}): {len(errors.functions)} of 18 error functions and "
        f"{len(errors.squareness)} of 3 squarenesses, method {errors.method}",
        "",
        *error_rows(errors, ALL_NAMES, freedom, "fitted as" if freedom else "over"),
        "",
        *(_fit_in_words(result) if isinstance(result, JointResult) else _lines_in_words(result)),
    ]
    if result.tangent:
        lines += [
            "",
            "direct against integrated straightness (the same where a carriage follows its guideway's tangent):",
        ]
        lines += [_verdict(verdict) for verdict in result.tangent]
    if errors.not_determined:
        lines += ["", "not determined (unknown, not zero):", *not_determined_rows(errors.not_determined)]
    return lines


def _fit_in_words(result: JointResult) -> list[str]:
    """Say what was fitted, how far it is off, and what that means."""
    fitted = result.result.fitted
    sightings = fitted.sightings
    lines = wrapped(
        f"{counted(len(sightings), 'row')} in {counted(sightings.n_passes, 'pass')} and "
        f"{counted(len(sightings.sessions), 'session')}; {fitted.problem.n_columns} unknowns, of which "
        f"{fitted.solved.solution.rank} are determined",
        "",
    )
    lines += ["", *figure_rows({"": figures_document(fitted)}), ""]
    for sentence in quality_in_words(fitted):
        lines += wrapped(sentence, "")
    scales = scale_sentence(result.result.model.mean_scales())
    return lines + ([] if scales is None else wrapped(scales, ""))


def _lines_in_words(result: NineLineResult) -> list[str]:
    """Name the lines that were found, by axis, and their redundancy."""
    sentences = []
    scatter = {one.axis: one for one in result.scatter}
    for axis in dict.fromkeys(line.axis for line in result.lines):
        members = [line for line in result.lines if line.axis == axis]
        numbers = ", ".join(str(line.number) for line in members if line.number is not None)
        further = sum(line.number is None for line in members)
        text = f"{axis.upper()}: line{'s' if ',' in numbers else ''} {numbers}"
        text += f" and {further} more" if further else ""
        text += (
            f"; {sum(line.n_points for line in members)} points in {sum(line.n_passes for line in members)} passes"
        )
        one = scatter[axis]
        if one.rms_mm is not None:
            text += f"; residual {one.rms_mm * _UM_PER_MM:.1f} µm rms"
        if one.chi_squared_per_dof is not None:
            text += f", χ²/ν = {one.chi_squared_per_dof:.2f} (ν = {one.dof})"
        sentences.append(text)
    return sentences


def _verdict(verdict: TangentVerdict) -> str:
    head = f"  {verdict.name:<6}{LI_NAMES[verdict.name]:<8}{verdict.rms_mm * _UM_PER_MM:>8.1f} µm rms"
    if verdict.p_value is None:
        return f"{head}   cannot be judged without uncertainties"
    answer = "follows, as far as can be told" if verdict.follows else "does not follow"
    return f"{head}   p = {verdict.p_value:<8.2g} {answer}"


def _print_notes(result: NineLineResult | JointResult, table: Observations, quiet: bool) -> None:
    note_set_aside(table.set_aside, quiet)
    left_out = result.left_out if isinstance(result, NineLineResult) else result.result.fitted.sightings.left_out
    for why, count in left_out.items():
        note(f"left out: {count} rows ({why})", quiet)
    for sentence in result.errors.notes:
        note(f"note: {sentence}", quiet)
