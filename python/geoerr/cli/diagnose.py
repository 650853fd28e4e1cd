"""`geoerr diagnose`: which physical effect is missing."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from geoerr.cli.options import (
    EffectFiles,
    JsonFlag,
    ModelFile,
    ObservationFiles,
    PageFile,
    QuietFlag,
    Refit,
    RigFile,
    Threads,
    calibration,
    check_output,
    effects_of,
    examples,
    files_given,
    note,
    note_left_out,
    note_set_aside,
    print_result,
)
from geoerr.cli.progress import progress_bar
from geoerr.cli.text_tables import say

if TYPE_CHECKING:
    from geoerr.diagnose.circles import CircleDiagnosis
    from geoerr.diagnose.diagnosis import Diagnosis
    from geoerr.report.provenance import Provenance

_EXAMPLES = (
    "geoerr diagnose model.json observations.csv",
    "geoerr diagnose machine.toml circle.csv",
    "geoerr diagnose model.json observations.csv --effects own.toml --plan next.csv --report diagnosis.html",
)


def register(app: typer.Typer) -> None:
    """Add the verb."""
    app.command("diagnose", epilog=examples(*_EXAMPLES))(diagnose_verb)


def diagnose_verb(
    model: ModelFile,
    observations: ObservationFiles,
    effects: EffectFiles = None,
    refit: Refit = False,
    report: PageFile = None,
    plan: Annotated[
        Path | None,
        typer.Option(
            "--plan",
            help="Write the measurement that would tell tied effects apart, a row for each picture (.csv, .parquet).",
        ),
    ] = None,
    rig: RigFile = None,
    verbose: Annotated[
        bool, typer.Option("--verbose", "-v", help="All candidates in full, and all that was not offered.")
    ] = False,
    as_json: JsonFlag = False,
    quiet: QuietFlag = False,
    threads: Threads = 0,
) -> None:
    """Which physical effect a model lacks, by measurements; or that none is missing, or none that is known.

    On data that the model was not fitted to its numbers stay as they are, and only the pose of each session's
    measuring frame is fitted; what is off by no more than the model may be is not missing. Where what is left so has
    no name, they are fitted, too: a cause that acted on the model's own data may be seen only so. Circular tests
    alone are ranked as ball-bar software does.
    """
    from geoerr.cli.diagnose_circle_text import circle_diagnosis_lines
    from geoerr.cli.diagnose_text import diagnosis_lines
    from geoerr.diagnose.asked import diagnose
    from geoerr.diagnose.circles import CircleDiagnosis, diagnose_circles
    from geoerr.measurements import read_measurements
    from geoerr.model import load_model
    from geoerr.report.provenance import provenance_of_command

    inputs = files_given(model, observations, effects, rig)
    check_output(report, inputs)
    check_output(plan, inputs, report)
    known = load_model(model)
    own = effects_of(effects)
    measured = read_measurements(observations, ranges_mm=known.machine.ranges_mm)
    sensitivity, covariance = calibration(rig, measured.points)
    diagnosis: Diagnosis | CircleDiagnosis
    with progress_bar("diagnose", quiet, says_steps=True) as advance:
        if measured.has_circles_only and not refit:
            diagnosis = diagnose_circles(
                known, *measured.circles, effects=own, progress=advance, on_step=advance.say, threads=threads
            )
        else:
            diagnosis = diagnose(
                known,
                *measured.tables,
                effects=own,
                refit=refit,
                rig_sensitivity=sensitivity,
                rig_covariance=covariance,
                progress=advance,
                on_step=advance.say,
                threads=threads,
            )
        document = diagnosis.to_document()
        provenance = provenance_of_command(inputs)
        if report is not None:
            _write_report(report, diagnosis, provenance)
    unwritten = None if plan is None else _write_plan(plan, diagnosis)
    if as_json:
        written = None if plan is None or unwritten is not None else str(plan)
        document |= {"plan": written}
        print_result(document, report=report, set_aside=measured.set_aside, provenance=provenance)
        return
    tables = " ".join(map(str, observations))
    command = f"geoerr add {model} {tables}"
    options = "".join(f" --effects {path}" for path in effects or []) + ("" if rig is None else f" --rig {rig}")
    if isinstance(diagnosis, CircleDiagnosis):
        lines = circle_diagnosis_lines(diagnosis, command, options, verbose=verbose)
    else:
        fit_first = None
        if diagnosis.is_without_errors and model.suffix == ".toml":
            fit_first = f"geoerr fit {tables} --machine {model}{options} -o model.json"
        lines = diagnosis_lines(diagnosis, command, options, fit_first=fit_first, verbose=verbose)
    for line in lines:
        say(line)
    note_set_aside(measured.set_aside, quiet)
    note_left_out(diagnosis.fitted.sightings.left_out, quiet)
    if report is not None:
        note(f"report: {report}", quiet)
    if plan is not None:
        note(f"plan: {plan}" if unwritten is None else f"note: no plan was written: {unwritten}", quiet)


def _write_plan(plan: Path, diagnosis: Diagnosis | CircleDiagnosis) -> str | None:
    """Write the advised measurement; say why where there is none to write."""
    from geoerr.diagnose.advice import Advice, write_plan
    from geoerr.diagnose.circles import CircleDiagnosis

    if isinstance(diagnosis, CircleDiagnosis):
        return "what to run next on a circle is said in words"
    # What the first is tied with is asked about first.
    advice = next((one.separate_by for one in diagnosis.found if diagnosis.tied_with(one)), None)
    if diagnosis.verdict != "ambiguous":
        return "nothing is tied"
    if not isinstance(advice, Advice) or not advice.measurements:
        return "what would tell the tied effects apart is known in words at most"
    write_plan(plan, advice.measurements)
    return None


def _write_report(report: Path, diagnosis: Diagnosis | CircleDiagnosis, provenance: Provenance) -> None:
    # Plotly comes with these: only a page pays for it.
    from geoerr.diagnose.circles import CircleDiagnosis
    from geoerr.report.diagnosis_page import write_circle_diagnosis_page, write_diagnosis_page

    if isinstance(diagnosis, CircleDiagnosis):
        write_circle_diagnosis_page(report, diagnosis, provenance)
    else:
        write_diagnosis_page(report, diagnosis, provenance)
