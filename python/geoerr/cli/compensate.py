"""`geoerr compensate`: a program corrected for the machine that runs it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from geoerr.cli.options import JsonFlag, QuietFlag, Threads, examples, note, print_json
from geoerr.cli.program_options import (
    At,
    Digits,
    Extrapolate,
    Firmware,
    FirmwareCorrects,
    Home,
    KeepUncertain,
    OnUnsupported,
    OutsideMeasured,
    OutsideMeasuredChoice,
    Still,
    Tolerance,
    UnsupportedChoice,
    WorkOffset,
    compensation_options,
    followed_conditions,
)
from geoerr.cli.progress import progress_bar
from geoerr.cli.text_tables import say
from geoerr.errors import InputFileError

if TYPE_CHECKING:
    from geoerr.compensate.program import CompensationResult


_EXAMPLES = (
    "geoerr compensate errors.json part.gcode -o part-corrected.gcode",
    "geoerr compensate model.json part.gcode -o part-90.gcode --at temp_bed=90 --work-offset 50,50,0",
    "geoerr compensate model.json - -o - < part.gcode > part-corrected.gcode",
)


def register(app: typer.Typer) -> None:
    """Add the verb."""
    app.command("compensate", epilog=examples(*_EXAMPLES))(compensate)


def compensate(
    model: Annotated[Path, typer.Argument(help="model.json, errors.json, or machine.toml (no errors).")],
    program: Annotated[Path, typer.Argument(metavar="IN", help="The program; - is standard input.")],
    output: Annotated[
        Path, typer.Option("-o", "--output", metavar="OUT", help="The corrected program; - is standard output.")
    ],
    at: At = None,
    work_offset: WorkOffset = None,
    tolerance: Tolerance = 0.005,
    on_unsupported: OnUnsupported = UnsupportedChoice.REFUSE,
    outside_measured: OutsideMeasured = OutsideMeasuredChoice.REFUSE,
    digits: Digits = 4,
    home: Home = None,
    firmware: Firmware = None,
    firmware_corrects: FirmwareCorrects = None,
    still: Still = None,
    keep_uncertain: KeepUncertain = False,
    extrapolate: Extrapolate = False,
    as_json: JsonFlag = False,
    quiet: QuietFlag = False,
    threads: Threads = 0,
) -> None:
    """Rewrite the program IN so that the machine of MODEL follows the path that IN means."""
    if as_json and str(output) == "-":
        raise typer.BadParameter("--json has standard output for itself", param_hint="-o -")
    from geoerr.compensate.mark import name_of_model
    from geoerr.compensate.program import compensate_program
    from geoerr.model import load_model
    from geoerr.report.provenance import provenance_of_command

    options = compensation_options(
        work_offset=work_offset,
        tolerance=tolerance,
        on_unsupported=on_unsupported,
        outside_measured=outside_measured,
        digits=digits,
        home=home,
        firmware=firmware,
        firmware_corrects=firmware_corrects,
        still=still,
        keep_uncertain=keep_uncertain,
        extrapolate=extrapolate,
    )
    loaded = load_model(model)
    if output.exists() and output.samefile(model):
        raise InputFileError(output, "is the model that is read", remedy="name another output")
    given = followed_conditions(at, loaded.conditions, quiet)
    size = program.stat().st_size if program.is_file() else 0
    with progress_bar("compensate", quiet) as advance:
        result = compensate_program(
            loaded,
            program,
            output,
            options,
            at=given,
            model_name=name_of_model(model),
            threads=threads,
            on_progress=lambda n_bytes: advance(n_bytes, max(size, n_bytes)),
        )
    for warning in result.warnings:
        note(f"warning: {warning}", quiet)
    for sentence in result.notes:
        note(f"note: {sentence}", quiet)
    if result.why_nothing_corrected:
        note(f"warning: {result.why_nothing_corrected}", quiet)
    if result.mostly_untouched and (as_json or str(output) == "-"):
        # Elsewhere it is the first line of the result; such a program must not pass for a corrected one.
        note(f"warning: {result.mostly_untouched}", quiet=False)
    if as_json:
        provenance = provenance_of_command([model, program])
        print_json({**result.to_document(), "provenance": provenance.to_document()})
    elif str(output) == "-":
        note(_report(result), quiet)
    else:
        say(_report(result))


def _report(result: CompensationResult) -> str:
    lines = [
        *([result.mostly_untouched] if result.mostly_untouched else []),
        f"{result.moves_in} moves in {result.lines} lines, {result.moves_out} moves written",
        f"largest correction {result.largest_correction_um:.1f} µm"
        + (f", line {result.largest_correction_line}" if result.largest_correction_line else ""),
    ]
    if result.correction_rms_um is not None:
        std = result.correction_std_um
        size = f"typically {result.correction_rms_um:.1f}" + ("" if std is None else f" ± {std:.1f}")
        unknown = "; not determined there" if std is None else ""
        lines.append(f"{size} µm over the box of the program's moves{unknown}")
        if result.not_in_model:
            lines.append("errors that are not in the model are not counted in that")
    if result.untouched:
        lines.append(f"untouched: {result.untouched}")
    if result.extrusion_in_mm or result.extrusion_out_mm:
        lines.append(f"extrusion {result.extrusion_in_mm:.5f} mm in, {result.extrusion_out_mm:.5f} mm out")
    return "\n".join(lines)
