"""`geoerr compare`: how far a model is off, and where."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from geoerr.cli.options import (
    JsonFlag,
    ModelFile,
    PageFile,
    QuietFlag,
    Refit,
    RigFile,
    Threads,
    calibration,
    check_output,
    examples,
    files_given,
    note,
    print_result,
)
from geoerr.cli.progress import progress_bar
from geoerr.cli.text_tables import say

_EXAMPLES = (
    "geoerr compare model.json observations.csv",
    "geoerr compare errors.json new-session.csv --report comparison.html",
)


def register(app: typer.Typer) -> None:
    """Add the verb."""
    app.command("compare", epilog=examples(*_EXAMPLES))(compare_verb)


def compare_verb(
    model: ModelFile,
    observations: Annotated[
        list[Path],
        typer.Argument(
            metavar="OBS...",
            help="Measured points, circular tests, lengths (.csv, .parquet; - is points on standard input).",
        ),
    ],
    refit: Refit = False,
    report: PageFile = None,
    rig: RigFile = None,
    as_json: JsonFlag = False,
    quiet: QuietFlag = False,
    threads: Threads = 0,
) -> None:
    """How far and where a model fails on measurements.

    On data that the model was not fitted to its numbers stay as they are, and only the pose of each session's
    measuring frame is fitted.
    """
    from geoerr.cli.compare_text import comparison_lines, places_of, print_notes
    from geoerr.diagnose.comparison import compare
    from geoerr.measurements import read_measurements
    from geoerr.model import load_model
    from geoerr.report.provenance import provenance_of_command

    inputs = files_given(model, observations, rig)
    check_output(report, inputs)
    known = load_model(model)
    measured = read_measurements(observations, ranges_mm=known.machine.ranges_mm)
    with progress_bar("compare", quiet) as advance:
        n_steps = 3
        advance(0, n_steps)
        sensitivity, covariance = calibration(rig, measured.points)
        comparison = compare(
            known,
            *measured.tables,
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
            # Plotly comes with it: only a page pays for it.
            from geoerr.report.compare_page import write_comparison_page

            write_comparison_page(report, comparison, document, provenance)
        advance(3, n_steps)
    if as_json:
        print_result(document, report=report, set_aside=measured.set_aside, provenance=provenance)
        return
    for line in comparison_lines(comparison, document, places_of(comparison, measured)):
        say(line)
    print_notes(comparison, measured, quiet)
    if report is not None:
        note(f"report: {report}", quiet)
