"""`geoerr compare`: how far a model is off, and where."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from geoerr.cli.compare_text import MOST_NAMED, comparison_lines
from geoerr.cli.measurements import Measurements, read_measurements
from geoerr.cli.options import (
    JsonFlag,
    QuietFlag,
    RigFile,
    Threads,
    calibration,
    check_output,
    note,
    note_set_aside,
    null_for_nan,
    print_json,
)
from geoerr.cli.progress import progress_bar
from geoerr.diagnose import Comparison, compare
from geoerr.model import load_model
from geoerr.report.provenance import Provenance, provenance_of_command


def register(app: typer.Typer) -> None:
    """Add the verb."""
    app.command("compare")(compare_verb)


def compare_verb(
    model: Annotated[
        Path,
        typer.Argument(metavar="MODEL", help="model.json, errors.json, or machine.toml (a machine without errors)."),
    ],
    observations: Annotated[
        list[Path],
        typer.Argument(
            metavar="OBS...",
            help="Measured points, circular tests, lengths (.csv, .parquet; - is standard input).",
        ),
    ],
    refit: Annotated[
        bool,
        typer.Option("--refit", help="Fit the model's numbers to these data, too, although they are not its own."),
    ] = False,
    report: Annotated[
        Path | None, typer.Option("--report", help="Write tables and pictures of the residual as an HTML page.")
    ] = None,
    rig: RigFile = None,
    as_json: JsonFlag = False,
    quiet: QuietFlag = False,
    threads: Threads = 0,
) -> None:
    """How far and where a model fails on measurements.

    On data that the model was not fitted to its numbers stay as they are, and only the pose of each session's
    measuring frame is fitted.
    """
    inputs = [model, *observations, *([rig] if rig is not None else [])]
    check_output(report, inputs)
    known = load_model(model)
    measured = read_measurements(observations, with_lengths=True)
    with progress_bar("compare", quiet) as advance:
        n_steps = 3
        advance(0, n_steps)
        sensitivity, covariance = calibration(rig, measured.points)
        comparison = compare(
            known,
            *measured.tables,
            *measured.lengths,
            refit=refit,
            rig_sensitivity=sensitivity,
            rig_covariance=covariance,
            threads=threads,
        )
        advance(1, n_steps)
        document = comparison.to_document()
        advance(2, n_steps)
        provenance = provenance_of_command(inputs)
        if report is not None:
            _write_report(report, comparison, document, provenance)
        advance(3, n_steps)
    if as_json:
        document |= {
            "report": None if report is None else str(report),
            "set_aside": [str(problem) for problem in measured.set_aside],
            "provenance": provenance.to_document(),
        }
        print_json(null_for_nan(document))
        return
    for line in comparison_lines(comparison, document, _places(comparison, measured)):
        typer.echo(line)
    _print_notes(comparison, measured, quiet)
    if report is not None:
        note(f"report: {report}", quiet)


def _write_report(report: Path, comparison: Comparison, document: dict[str, Any], provenance: Provenance) -> None:
    # Plotly comes with these: only a page pays for it.
    from geoerr.report.compare_page import write_comparison_page

    write_comparison_page(report, comparison, document, provenance)


def _places(comparison: Comparison, measured: Measurements) -> dict[int, str]:
    """Say where the rows that are named stand: file and row, as an editor shows it."""
    if comparison.fitted is None:
        return {}
    sightings = comparison.fitted.sightings
    left_out = np.flatnonzero(~comparison.fitted.solved.used).tolist()
    file_rows = sightings.numbers("file_row")
    numbers = [sightings.numbers(name) for name in ("x", "y", "z", "mx", "my", "mz")]
    is_circle = [sightings.frames[number] == "circle" for number in sightings.session]
    return {
        row: f"row {int(file_rows[row])} of the circle"
        if is_circle[row]
        else measured.place(int(file_rows[row]), [values[row] for values in numbers])
        for row in (*comparison.worst[:MOST_NAMED].tolist(), *left_out[:MOST_NAMED])
    }


def _print_notes(comparison: Comparison, measured: Measurements, quiet: bool) -> None:
    note_set_aside(measured.set_aside, quiet)
    if comparison.fitted is not None:
        for why, count in comparison.fitted.sightings.left_out.items():
            note(f"left out: {count} rows ({why})", quiet)
        for sentence in comparison.fitted.sightings.notes:
            note(f"note: {sentence}", quiet)
    if comparison.lengths is not None and comparison.lengths.n_lacking:
        note(f"left out: {comparison.lengths.n_lacking} lengths (a covariate is empty)", quiet)
