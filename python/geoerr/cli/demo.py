"""`geoerr demo`: the whole job on the embedded example."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from geoerr.cli.options import JsonFlag, QuietFlag, Seed, Threads, examples, note, print_json
from geoerr.cli.progress import Advance, progress_bar

if TYPE_CHECKING:
    from geoerr.demo.job import DemoResult

Folder = Annotated[Path, typer.Argument(help="Folder for every file and the report; made if absent.")]

_EXAMPLES = (
    "geoerr demo",
    "geoerr demo my-folder --seed 7 --threads 2",
)


def register(app: typer.Typer) -> None:
    """Add the verb."""
    app.command("demo", epilog=examples(*_EXAMPLES))(demo)


def demo(
    directory: Folder = Path("geoerr-demo"),
    seed: Seed = 1,
    threads: Threads = 0,
    as_json: JsonFlag = False,
    quiet: QuietFlag = False,
) -> None:
    """Find a virtual machine's 21 errors from pictures, correct a program for them, and prove the correction.

    Leaves plan, pictures, rig.json, observations.csv, errors.json, both programs and report.html in DIRECTORY.
    """
    from geoerr.cli.text_tables import print_table, say
    from geoerr.demo.job import run_demo
    from geoerr.demo.summary import sentences, write_demo_report
    from geoerr.report.error_tables import error_function_table, squareness_table
    from geoerr.report.provenance import provenance_of_command

    @contextmanager
    def stage(title: str) -> Iterator[Advance]:
        started = time.monotonic()
        with progress_bar(title, quiet) as advance:
            yield advance
        note(f"{title}: {time.monotonic() - started:.1f} s", quiet)

    result = run_demo(directory, stage, seed=seed, threads=threads)
    report = directory / "report.html"
    with stage("writing the report"):
        provenance = provenance_of_command([directory / "plan.toml"])
        write_demo_report(report, result, provenance)
    if as_json:
        print_json({**_document(result, report), "provenance": provenance.to_document()})
        return
    for table in (
        error_function_table(result.errors, result.truth.errors),
        squareness_table(result.errors, result.truth.errors),
    ):
        say("")
        print_table(table.header, table.rows, n_text_columns=3)
    say("")
    for sentence in sentences(result):
        say(f"- {sentence}")
    say(f"\nReport: {report}")


def _document(result: DemoResult, report: Path) -> dict[str, object]:
    from geoerr.demo.summary import truth_inside

    inside, total = truth_inside(result.errors, result.truth.errors)
    return {
        "report": str(report),
        "calibration": result.calibration.to_document(),
        "observations": len(result.measured.observations),
        "missed": len(result.measured.missed),
        "values_within_95": inside,
        "values": total,
        "path": result.path.to_document(),
        "ballbar": result.circle.to_document(),
        "workpiece": result.workpiece.to_document(),
    }
