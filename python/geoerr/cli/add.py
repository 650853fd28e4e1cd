"""`geoerr add`: one more effect in a model."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from geoerr.cli.change_text import change_document, change_text
from geoerr.cli.effect_options import additions
from geoerr.cli.measurements import read_measurements
from geoerr.cli.options import JsonFlag, QuietFlag, Threads, check_output, note, null_for_nan, print_json
from geoerr.diagnose.change import add_terms
from geoerr.fit import sightings_of
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
    as_json: JsonFlag = False,
    quiet: QuietFlag = False,
    threads: Threads = 0,
) -> None:
    """Add an effect to a model, fit it again, and show how far the error falls."""
    paths, reference = observations_and_reference(arguments)
    inputs = [model, *paths, *(effects or [])]
    check_output(output, inputs)
    start = load_model(model)
    measured = read_measurements(paths)
    one = additions([reference], effects or [], start.machine, sightings_of(*measured.tables), "none")[0]
    change = add_terms(start, measured.tables, one.terms, one.reference, one.title, threads=threads)
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
