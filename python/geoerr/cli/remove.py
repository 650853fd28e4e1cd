"""`geoerr remove`: one effect less in a model."""

from __future__ import annotations

from typing import Annotated

import typer

from geoerr.cli.add import observations_and_reference
from geoerr.cli.effect_options import complete_effect
from geoerr.cli.options import (
    JsonFlag,
    ModelFile,
    ModelOutput,
    QuietFlag,
    RigFile,
    Threads,
    calibration,
    check_result_output,
    examples,
    files_given,
)
from geoerr.cli.progress import progress_bar

_EXAMPLES = ("geoerr remove model2.json observations.csv backlash:x -o model.json",)


def register(app: typer.Typer) -> None:
    """Add the verb."""
    app.command("remove", epilog=examples(*_EXAMPLES))(remove)


def remove(
    model: ModelFile,
    arguments: Annotated[
        list[str],
        typer.Argument(
            metavar="OBS... ID[:AXIS][@COVARIATE]",
            help="Measurements, and last the effect.",
            autocompletion=complete_effect,
        ),
    ],
    output: ModelOutput = None,
    rig: RigFile = None,
    as_json: JsonFlag = False,
    quiet: QuietFlag = False,
    threads: Threads = 0,
) -> None:
    """Take an effect out of a model, fit what is left again, and show how far the error rises."""
    from geoerr.cli.change_text import report_change
    from geoerr.diagnose.change import remove_terms
    from geoerr.measurements import read_measurements
    from geoerr.model import load_model

    paths, reference = observations_and_reference(arguments)
    inputs = files_given(model, paths, rig)
    check_result_output(output, inputs)
    start = load_model(model)
    with progress_bar("remove", quiet, says_steps=True) as advance:
        advance.say("reading the measurements")
        measured = read_measurements(paths, ranges_mm=start.machine.ranges_mm)
        sensitivity, covariance = calibration(rig, measured.points)
        change = remove_terms(
            start,
            measured.tables,
            reference,
            rig_sensitivity=sensitivity,
            rig_covariance=covariance,
            progress=advance,
            on_step=advance.say,
            threads=threads,
        )
    report_change(change, start, measured, output, inputs, has_rig=rig is not None, as_json=as_json, quiet=quiet)
