"""`geoerr add`: one more effect in a model."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from geoerr.cli.effect_options import Form, Lag, Lagging, complete_effect, way_of
from geoerr.cli.options import (
    EffectFiles,
    JsonFlag,
    ModelFile,
    ModelOutput,
    QuietFlag,
    RigFile,
    Threads,
    calibration,
    check_result_output,
    effects_of,
    examples,
    files_given,
    note,
)
from geoerr.cli.progress import progress_bar

_EXAMPLES = (
    "geoerr add model.json observations.csv backlash:x -o model2.json",
    "geoerr add model.json observations.csv thermal-expansion:y@temp_bed --lag no",
    "geoerr add model.json observations.csv 'empirical:z@x*y' -o model2.json",
)


def register(app: typer.Typer) -> None:
    """Add the verb."""
    app.command("add", epilog=examples(*_EXAMPLES))(add)


def add(
    model: ModelFile,
    arguments: Annotated[
        list[str],
        typer.Argument(
            metavar="OBS... ID[:AXIS][@COVARIATE]",
            help="Measurements, and last the effect to add.",
            autocompletion=complete_effect,
        ),
    ],
    output: ModelOutput = None,
    effects: EffectFiles = None,
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
    from geoerr.cli.change_text import report_change
    from geoerr.diagnose.change import add_effect
    from geoerr.measurements import read_measurements
    from geoerr.model import load_model

    paths, reference = observations_and_reference(arguments)
    inputs = files_given(model, paths, effects, rig)
    check_result_output(output, inputs)
    start = load_model(model)
    own = effects_of(effects)
    with progress_bar("add", quiet, says_steps=True) as advance:
        advance.say("reading the measurements")
        measured = read_measurements(paths, ranges_mm=start.machine.ranges_mm)
        sensitivity, covariance = calibration(rig, measured.points)
        change = add_effect(
            start,
            *measured.tables,
            reference=reference,
            effects=own,
            way=way_of(lag, form),
            rig_sensitivity=sensitivity,
            rig_covariance=covariance,
            progress=advance,
            on_step=advance.say,
            threads=threads,
        )
    report_change(change, start, measured, output, inputs, has_rig=rig is not None, as_json=as_json, quiet=quiet)
    for sentence in change.sign_notes():
        note(f"note: {sentence}", quiet)


def observations_and_reference(arguments: list[str]) -> tuple[list[Path], str]:
    """Part the arguments: the effect is the last, all others are files."""
    if len(arguments) < 2:
        raise typer.BadParameter(
            "name at least one table of measurements, and last the effect", param_hint="OBS... ID"
        )
    return [Path(text) for text in arguments[:-1]], arguments[-1]
