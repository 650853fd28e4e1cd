"""`geoerr diagnose`: which physical effect is missing."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from geoerr.cli.diagnose_circle_text import circle_diagnosis_lines
from geoerr.cli.diagnose_text import diagnosis_lines
from geoerr.cli.measurements import read_measurements
from geoerr.cli.options import (
    JsonFlag,
    QuietFlag,
    Threads,
    check_output,
    note,
    note_set_aside,
    null_for_nan,
    print_json,
)
from geoerr.cli.progress import progress_bar
from geoerr.diagnose.circles import CircleDiagnosis, diagnose_circles
from geoerr.diagnose.diagnosis import Diagnosis, diagnose
from geoerr.effects import load_effects
from geoerr.model import load_model
from geoerr.report.provenance import Provenance, provenance_of_command


def register(app: typer.Typer) -> None:
    """Add the verb."""
    app.command("diagnose")(diagnose_verb)


def diagnose_verb(
    model: Annotated[
        Path,
        typer.Argument(metavar="MODEL", help="model.json, errors.json, or machine.toml (a machine without errors)."),
    ],
    observations: Annotated[
        list[Path],
        typer.Argument(
            metavar="OBS...", help="Measured points, circular tests (.csv, .parquet; - is standard input)."
        ),
    ],
    effects: Annotated[
        list[Path] | None, typer.Option("--effects", help="A .toml of your own effects; may be repeated.")
    ] = None,
    refit: Annotated[
        bool,
        typer.Option("--refit", help="Fit the model's numbers to these data, too, although they are not its own."),
    ] = False,
    report: Annotated[
        Path | None, typer.Option("--report", help="Write tables and pictures of the diagnosis as an HTML page.")
    ] = None,
    verbose: Annotated[
        bool, typer.Option("--verbose", "-v", help="All candidates in full, and all that was not offered.")
    ] = False,
    as_json: JsonFlag = False,
    quiet: QuietFlag = False,
    threads: Threads = 0,
) -> None:
    """Which physical effect a model lacks, by measurements; or that none is missing, or none that is known.

    On data that the model was not fitted to its numbers stay as they are, and only the pose of each session's
    measuring frame is fitted. Circular tests alone are ranked as ball-bar software does.
    """
    inputs = [model, *observations, *(effects or [])]
    check_output(report, inputs)
    known = load_model(model)
    own = [effect for path in effects or [] for effect in load_effects(path)]
    measured = read_measurements(observations)
    diagnosis: Diagnosis | CircleDiagnosis
    with progress_bar("diagnose", quiet) as advance:
        if measured.points is None and not refit:
            advance(0, 1)
            diagnosis = diagnose_circles(known, *measured.circles, effects=own, threads=threads)
            advance(1, 1)
        else:
            diagnosis = diagnose(known, *measured.tables, effects=own, refit=refit, progress=advance, threads=threads)
        document = diagnosis.to_document()
        provenance = provenance_of_command(inputs)
        if report is not None:
            _write_report(report, diagnosis, provenance)
    if as_json:
        document |= {
            "report": None if report is None else str(report),
            "set_aside": [str(problem) for problem in measured.set_aside],
            "provenance": provenance.to_document(),
        }
        print_json(null_for_nan(document))
        return
    command = " ".join(["geoerr add", str(model), *map(str, observations)])
    own_files = "".join(f" --effects {path}" for path in effects or [])
    lines = (
        circle_diagnosis_lines(diagnosis, command, own_files, verbose=verbose)
        if isinstance(diagnosis, CircleDiagnosis)
        else diagnosis_lines(diagnosis, command, own_files, verbose=verbose)
    )
    for line in lines:
        typer.echo(line)
    note_set_aside(measured.set_aside, quiet)
    for why, count in diagnosis.fitted.sightings.left_out.items():
        note(f"left out: {count} rows ({why})", quiet)
    if report is not None:
        note(f"report: {report}", quiet)


def _write_report(report: Path, diagnosis: Diagnosis | CircleDiagnosis, provenance: Provenance) -> None:
    # Plotly comes with these: only a page pays for it.
    from geoerr.report.diagnosis_page import write_circle_diagnosis_page, write_diagnosis_page

    if isinstance(diagnosis, CircleDiagnosis):
        write_circle_diagnosis_page(report, diagnosis, provenance)
    else:
        write_diagnosis_page(report, diagnosis, provenance)
