"""`geoerr report`: all that is known of a machine's errors, on one page."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from geoerr.cli.options import (
    EffectFiles,
    JsonFlag,
    ModelFile,
    QuietFlag,
    RigFile,
    Threads,
    calibration,
    check_output,
    effects_of,
    examples,
    files_given,
    note,
    note_set_aside,
    print_result,
)
from geoerr.cli.program_options import At, followed_conditions
from geoerr.cli.progress import progress_bar
from geoerr.cli.text_tables import say

_EXAMPLES = (
    "geoerr report model.json observations.csv -o report.html",
    "geoerr report errors.json -o report.html",
    "geoerr report model.json points.csv circle.csv --at temp_bed=60 --no-search -o report.html",
)


def register(app: typer.Typer) -> None:
    """Add the verb."""
    app.command("report", epilog=examples(*_EXAMPLES))(report_verb)


def report_verb(
    model: ModelFile,
    observations: Annotated[
        list[Path] | None,
        typer.Argument(
            metavar="[OBS]...",
            help="Measured points, circular tests, lengths (.csv, .parquet; - is points on standard input).",
        ),
    ] = None,
    output: Annotated[Path | None, typer.Option("--output", "-o", help="HTML page to write.")] = None,
    at: At = None,
    search: Annotated[
        bool, typer.Option("--search/--no-search", help="Look for what the model lacks: the longest part.")
    ] = True,
    effects: EffectFiles = None,
    rig: RigFile = None,
    as_json: JsonFlag = False,
    quiet: QuietFlag = False,
    threads: Threads = 0,
) -> None:
    """All that is known of a machine's errors on one page: the 21 errors, circles, positioning, what is missing.

    MODEL alone gives what it predicts and how sure that is; with OBS also how far it is off, where, and why. What the
    two cannot support is left out, with what it would need. A temperature that --at does not state is the machine's
    reference temperature.
    """
    from geoerr.measurements import read_measurements
    from geoerr.model import load_model
    from geoerr.report.model_page import report_sentences, write_model_page
    from geoerr.report.model_report import model_report
    from geoerr.report.provenance import provenance_of_command
    from geoerr.verify.circle_motion import followed_on_circle

    inputs = files_given(model, observations, effects, rig)
    check_output(output, inputs)
    known = load_model(model)
    measured = None
    if observations:
        measured = read_measurements(observations, ranges_mm=known.machine.ranges_mm)
    tables = () if measured is None else measured.tables
    set_aside = () if measured is None else measured.set_aside
    sensitivity, covariance = calibration(rig, None if measured is None else measured.points)
    given = followed_conditions(at, followed_on_circle(known), quiet)
    with progress_bar("report", quiet, says_steps=True) as advance:
        gathered = model_report(
            known,
            *tables,
            at=given,
            search=search,
            effects=effects_of(effects),
            rig_sensitivity=sensitivity,
            rig_covariance=covariance,
            progress=advance,
            on_step=advance.say,
            threads=threads,
        )
    provenance = provenance_of_command(inputs)
    if output is not None:
        with progress_bar("write", quiet) as advance:
            write_model_page(output, gathered, provenance, advance)
    if as_json:
        print_result(gathered.to_document(), report=output, set_aside=set_aside, provenance=provenance)
        return
    for sentence in report_sentences(gathered):
        say(sentence)
    for why, sections in gathered.left_out_by_reason.items():
        note(f"left out: {'; '.join(sections)} ({why})", quiet)
    note_set_aside(set_aside, quiet)
    if output is not None:
        note(f"report: {output}", quiet)
