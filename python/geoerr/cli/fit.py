"""`geoerr fit`: observations to the volumetric model."""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated

import typer

from geoerr.cli.effect_options import Form, Lag, Lagging, complete_effect, way_of
from geoerr.cli.options import (
    EffectFiles,
    JsonFlag,
    MachineFile,
    ModelOutput,
    ObservationFiles,
    QuietFlag,
    RigFile,
    Threads,
    calibration,
    check_result_output,
    examples,
    files_given,
    note,
    print_json,
)
from geoerr.cli.progress import progress_bar
from geoerr.cli.text_tables import say


class ComponentsChoice(StrEnum):
    """Classic errors of the model."""

    LI = "21"
    DOBARIYA = "12"
    NONE = "none"


_EXAMPLES = (
    "geoerr fit observations.csv --machine machine.toml -o model.json",
    "geoerr fit points.csv circle.csv --machine machine.toml --add backlash:x --add warm-up:z -o model.json",
    "geoerr fit observations.csv --machine machine.toml --components 12 --effects own.toml --add my-effect:x",
)


def register(app: typer.Typer) -> None:
    """Add the verb."""
    app.command("fit", epilog=examples(*_EXAMPLES))(fit)


def fit(
    observations: ObservationFiles,
    machine: MachineFile,
    output: ModelOutput = None,
    components: Annotated[
        ComponentsChoice,
        typer.Option("--components", help="Classic errors: Li's 21, Dobariya's 12 (no angles), or none."),
    ] = ComponentsChoice.LI,
    effects: EffectFiles = None,
    add: Annotated[
        list[str] | None,
        typer.Option(
            "--add",
            metavar="ID[:AXIS][@COVARIATE]",
            help="An effect to fit along; may be repeated.",
            autocompletion=complete_effect,
        ),
    ] = None,
    lag: Lag = Lagging.AUTO,
    form: Form = None,
    tangent: Annotated[
        bool, typer.Option("--tangent", help="Straightness is the integral of the angle (Li Eq. 19).")
    ] = False,
    rig: RigFile = None,
    as_json: JsonFlag = False,
    quiet: QuietFlag = False,
    threads: Threads = 0,
) -> None:
    """Fit the volumetric model: all observations, all errors and any effects at once."""
    if tangent and components is not ComponentsChoice.LI:
        raise typer.BadParameter("follows from the angles, which only --components 21 has", param_hint="--tangent")
    from geoerr.cli.fit_document import fit_document
    from geoerr.cli.fit_outcome import FitOutcome, outcome_lines, outlier_places, print_notes
    from geoerr.effects import load_catalogue
    from geoerr.files import null_for_nan
    from geoerr.fit import FitOptions, fit_model
    from geoerr.machine import read_machine
    from geoerr.measurements import read_measurements
    from geoerr.model import write_model

    effect_files = effects or []
    inputs = files_given(observations, machine, effect_files, rig)
    check_result_output(output, inputs)
    described = read_machine(machine)
    measured = read_measurements(observations, ranges_mm=described.ranges_mm)
    sensitivity, covariance = calibration(rig, measured.points)
    added = add or []
    with progress_bar("fit", quiet) as advance:
        result = fit_model(
            described,
            *measured.tables,
            effects=added,
            known=load_catalogue(effect_files),
            way=way_of(lag, form),
            options=FitOptions(components=components.value, follows_tangent=tangent, threads=threads),
            rig_sensitivity=sensitivity,
            rig_covariance=covariance,
            on_progress=advance,
        )
    if output is not None:
        write_model(output, result.model)
    outcome = FitOutcome(result, measured, len(added))
    if as_json:
        document = fit_document(result, result.before, output, inputs, measured.set_aside)
        for entry, place in zip(document["outliers"], outlier_places(outcome), strict=True):
            entry["place"] = place
        print_json(null_for_nan(document))
        return
    for line in outcome_lines(outcome, components.value):
        say(line)
    print_notes(outcome, rig, quiet)
    if output is not None:
        note(f"model: {output}", quiet)
