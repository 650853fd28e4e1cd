"""`geoerr identify`: observations to the 21 errors."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from geoerr.cli.options import JsonFlag, MachineFile, QuietFlag, Threads, note, print_json
from geoerr.error_functions import (
    ALL_NAMES,
    LI_NAMES,
    ErrorFunction,
    ErrorFunctions,
    Squareness,
    is_angular,
    write_errors,
)
from geoerr.errors import InputFileError
from geoerr.identify import NineLineResult, TangentVerdict, analyze_nine_lines
from geoerr.machine import read_machine
from geoerr.observations import Observations, read_observations
from geoerr.report.provenance import provenance_of_command
from geoerr.vision.rig import read_rig
from geoerr.vision.sensitivity import rig_sensitivity

_WIDTH = 96
_MICRO = 1e6
_UM_PER_MM = 1e3
_MOST_ROWS_NAMED = 5


class Method(StrEnum):
    """Ways to identify."""

    NINE_LINE = "nine-line"
    JOINT = "joint"


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
    method: Annotated[Method, typer.Option("--method", help="Li's nine lines.")] = Method.NINE_LINE,
    straightness: Annotated[
        Straightness, typer.Option("--straightness", help="From the points, or from the angles (Li Eq. 19).")
    ] = Straightness.DIRECT,
    roll: Annotated[
        Roll, typer.Option("--roll", help="Linear in the points, or Li's root (Eqs. 20-22).")
    ] = Roll.LINEAR,
    rig: Annotated[
        Path | None, typer.Option("--rig", help="rig.json: include the calibration's uncertainty.")
    ] = None,
    as_json: JsonFlag = False,
    quiet: QuietFlag = False,
    # Every verb takes it; what is computed here is too small to share.
    threads: Threads = 0,
) -> None:
    """Find the 21 geometric errors from points measured while one axis moved at a time."""
    if method is Method.JOINT:
        raise typer.BadParameter(
            "the joint estimate is not part of this version; use nine-line", param_hint="--method"
        )
    inputs = [*observations, machine, *([rig] if rig is not None else [])]
    _check_output(output, inputs)
    described = read_machine(machine)
    table = read_observations(*observations)
    sensitivity, covariance = _calibration(rig, table)
    result = analyze_nine_lines(
        table,
        described,
        straightness=straightness.value,
        roll=roll.value,
        rig_sensitivity=sensitivity,
        rig_covariance=covariance,
    )
    if output is not None:
        write_errors(output, result.errors)
    if as_json:
        print_json(_document(result, table, output, inputs))
        return
    _print_result(result)
    _print_notes(result, table, quiet)
    if output is not None:
        note(f"errors: {output}", quiet)


def _check_output(output: Path | None, inputs: Sequence[Path]) -> None:
    if output is not None and any(output.resolve() == path.resolve() for path in inputs):
        raise InputFileError(output, "is an input of this command", remedy="name another output")


def _calibration(rig: Path | None, table: Observations) -> tuple[Any, Any]:
    if rig is None:
        return None, None
    described = read_rig(rig)
    if described.covariance is None:
        raise InputFileError(
            rig,
            "states no covariance, which --rig is for",
            column="covariance",
            remedy="calibrate again with `geoerr calibrate`, or leave --rig out",
        )
    return rig_sensitivity(described, table), described.covariance


def _document(
    result: NineLineResult, table: Observations, output: Path | None, inputs: Sequence[Path]
) -> dict[str, Any]:
    return {
        "output": None if output is None else str(output),
        **result.errors.to_document(),
        **result.to_document(),
        "set_aside": [str(problem) for problem in table.set_aside],
        "provenance": provenance_of_command(inputs).to_document(),
    }


def _print_result(result: NineLineResult) -> None:
    errors = result.errors
    typer.echo(
        f"{errors.machine.name} ({errors.machine.chain}): {len(errors.functions)} of 18 error functions and ",
        nl=False,
    )
    typer.echo(f"{len(errors.squareness)} of 3 squarenesses, method {errors.method}")
    typer.echo("")
    typer.echo(f"{'ISO':<6}{'Li':<8}{'from':>10}{'to':>10}{'peak-to-peak':>15}{'typical ±':>14}   over")
    for name in ALL_NAMES:
        typer.echo(_row(errors, name).rstrip())
    typer.echo("")
    for line in _lines_in_words(result):
        typer.echo(line)
    if result.tangent:
        typer.echo("")
        typer.echo(
            "direct against integrated straightness (the same where a carriage follows its guideway's tangent):"
        )
        for verdict in result.tangent:
            typer.echo(_verdict(verdict))
    if errors.not_determined:
        typer.echo("")
        typer.echo("not determined (unknown, not zero):")
        for why, names in _by_reason(errors).items():
            _echo_wrapped(f"{', '.join(names)}: {why}", "  ")


def _row(errors: ErrorFunctions, name: str) -> str:
    head = f"{name:<6}{LI_NAMES[name]:<8}"
    unit, factor = ("µrad", _MICRO) if is_angular(name) else ("µm", _UM_PER_MM)
    table = errors.functions.get(name)
    if table is not None:
        value = table.value * factor
        low, high = float(value.min()), float(value.max())
        place = f"{name[2].lower()} {table.position_mm[0]:g} to {table.position_mm[-1]:g} mm, {len(value)} points"
        peak = f"{high - low:.1f} {unit}"
        return f"{head}{low:>10.1f}{high:>10.1f}{peak:>15}{_typical(table, factor, unit):>14}   {place}"
    one = errors.squareness.get(name)
    if one is not None:
        return f"{head}{one.value_rad * factor:>10.1f}{'':>10}{unit:>15}{_uncertainty(one, factor, unit):>14}"
    return f"{head}{'–':>10}{'–':>10}{'not determined':>15}"


def _typical(table: ErrorFunction, factor: float, unit: str) -> str:
    """Root mean square of the standard uncertainties (the first point, 0 by convention, left out)."""
    if table.std is None or len(table.std) < 2:
        return "–"
    return f"{float(np.sqrt(np.mean(table.std[1:] ** 2))) * factor:.1f} {unit}"


def _uncertainty(one: Squareness, factor: float, unit: str) -> str:
    return "–" if one.std_rad is None else f"{one.std_rad * factor:.1f} {unit}"


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


def _by_reason(errors: ErrorFunctions) -> dict[str, list[str]]:
    reasons: dict[str, list[str]] = {}
    for item in errors.not_determined:
        reasons.setdefault(item.why, []).append(f"{item.name} ({LI_NAMES[item.name]})")
    return reasons


def _print_notes(result: NineLineResult, table: Observations, quiet: bool) -> None:
    for problem in table.set_aside[:_MOST_ROWS_NAMED]:
        note(f"set aside: {problem}", quiet)
    if len(table.set_aside) > _MOST_ROWS_NAMED:
        note(f"set aside: {len(table.set_aside) - _MOST_ROWS_NAMED} more rows", quiet)
    for why, count in result.left_out.items():
        note(f"left out: {count} rows ({why})", quiet)
    for sentence in result.errors.notes:
        note(f"note: {sentence}", quiet)


def _echo_wrapped(text: str, indent: str) -> None:
    for line in textwrap.wrap(text, _WIDTH, initial_indent=indent, subsequent_indent=indent + "  "):
        typer.echo(line)
