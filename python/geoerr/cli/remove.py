"""`geoerr remove`: one effect less in a model."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from geoerr.cli.add import observations_and_reference
from geoerr.cli.change_text import change_document, change_text, note_missing_calibration
from geoerr.cli.measurements import read_measurements
from geoerr.cli.options import (
    JsonFlag,
    QuietFlag,
    RigFile,
    Threads,
    calibration,
    check_output,
    note,
    null_for_nan,
    print_json,
)
from geoerr.diagnose.change import remove_terms
from geoerr.model import load_model, write_model


def register(app: typer.Typer) -> None:
    """Add the verb."""
    app.command("remove")(remove)


def remove(
    model: Annotated[Path, typer.Argument(metavar="MODEL", help="model.json.")],
    arguments: Annotated[
        list[str],
        typer.Argument(metavar="OBS... ID[:AXIS][@COVARIATE]", help="Measurements, and last the effect."),
    ],
    output: Annotated[Path | None, typer.Option("--output", "-o", help="model.json to write.")] = None,
    rig: RigFile = None,
    as_json: JsonFlag = False,
    quiet: QuietFlag = False,
    threads: Threads = 0,
) -> None:
    """Take an effect out of a model, fit what is left again, and show how far the error rises."""
    paths, reference = observations_and_reference(arguments)
    inputs = [model, *paths, *([rig] if rig is not None else [])]
    check_output(output, inputs)
    start, measured = load_model(model), read_measurements(paths)
    sensitivity, covariance = calibration(rig, measured.points)
    change = remove_terms(
        start,
        measured.tables,
        reference,
        rig_sensitivity=sensitivity,
        rig_covariance=covariance,
        threads=threads,
    )
    note_missing_calibration(start, rig, quiet)
    if output is not None:
        write_model(output, change.result.model)
    if as_json:
        print_json(null_for_nan(change_document(change, output, inputs)))
        return
    for line in change_text(change):
        typer.echo(line)
    if output is not None:
        note(f"model: {output}", quiet)
