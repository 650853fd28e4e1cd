"""`geoerr add`: one more effect in a model."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from geoerr.cli.change_text import change_document, change_text, note_missing_calibration
from geoerr.cli.effect_options import Form, Lag, Lagging, way_of
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
from geoerr.cli.progress import progress_bar
from geoerr.diagnose.change import add_effect
from geoerr.effects import load_effects
from geoerr.model import load_model, write_model


def register(app: typer.Typer) -> None:
    """Add the verb."""
    app.command("add")(add)


def add(
    model: Annotated[Path, typer.Argument(metavar="MODEL", help="model.json, errors.json or machine.toml.")],
    arguments: Annotated[
        list[str],
        typer.Argument(metavar="OBS... ID[:AXIS][@COVARIATE]", help="Measurements, and last the effect to add."),
    ],
    output: Annotated[Path | None, typer.Option("--output", "-o", help="model.json to write.")] = None,
    effects: Annotated[
        list[Path] | None, typer.Option("--effects", help="A .toml of your own effects; may be repeated.")
    ] = None,
    lag: Lag = Lagging.AUTO,
    form: Form = None,
    rig: RigFile = None,
    as_json: JsonFlag = False,
    quiet: QuietFlag = False,
    threads: Threads = 0,
) -> None:
    """Add an effect to a model, fit it again, and show how far the error falls.

    `empirical:x@feed` (or `empirical:z@x*y`, `empirical:work-z@t`) adds a curve that no cause is known of.
    """
    paths, reference = observations_and_reference(arguments)
    inputs = [model, *paths, *(effects or []), *([rig] if rig is not None else [])]
    check_output(output, inputs)
    start = load_model(model)
    own = [effect for path in effects or [] for effect in load_effects(path)]
    with progress_bar("add", quiet) as advance:
        advance(0, 2)
        measured = read_measurements(paths)
        advance(1, 2)
        sensitivity, covariance = calibration(rig, measured.points)
        change = add_effect(
            start,
            *measured.tables,
            reference=reference,
            effects=own,
            way=way_of(lag, form),
            rig_sensitivity=sensitivity,
            rig_covariance=covariance,
            threads=threads,
        )
        advance(2, 2)
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


def observations_and_reference(arguments: list[str]) -> tuple[list[Path], str]:
    """Part the arguments: the effect is the last, all others are files."""
    if len(arguments) < 2:
        raise typer.BadParameter(
            "name at least one table of measurements, and last the effect", param_hint="OBS... ID"
        )
    return [Path(text) for text in arguments[:-1]], arguments[-1]
