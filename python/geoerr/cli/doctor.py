"""`geoerr doctor`: whether what is installed, and what a verb would be given, is as it should be."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from geoerr.cli.options import JsonFlag, QuietFlag, Threads, examples, print_json
from geoerr.cli.text_tables import say

if TYPE_CHECKING:
    from geoerr.cli.doctor_checks import Check

_MARKS = {"ok": "ok   ", "note": "note ", "wrong": "WRONG"}

_EXAMPLES = (
    "geoerr doctor",
    "geoerr doctor machine.toml rig.json observations.csv",
    "geoerr doctor --json SESSION",
)


def register(app: typer.Typer) -> None:
    """Add the verb."""
    app.command("doctor", epilog=examples(*_EXAMPLES))(doctor)


def doctor(
    files: Annotated[
        list[Path] | None,
        typer.Argument(
            metavar="[FILE]...",
            help="What another verb would be given: machine.toml, model.json, errors.json, rig.json, own effects,"
            " measurements, a session folder.",
        ),
    ] = None,
    as_json: JsonFlag = False,
    quiet: QuietFlag = False,
    # Every verb takes it; there is nothing to share here.
    threads: Threads = 0,
) -> None:
    """Check the installation, and that files can be read; exit status 1 where something is wrong.

    With --quiet only what is not as it should be.
    """
    from geoerr.cli.doctor_checks import file_check, installation_checks

    installed = list(installation_checks())
    read = [file_check(path) for path in files or []]
    wrong = [check for check in (*installed, *read) if check.state == "wrong"]
    if as_json:
        document = {"installation": installed, "files": read}
        print_json(
            {"ok": not wrong, **{key: [one.to_document() for one in checks] for key, checks in document.items()}}
        )
    else:
        for check in (*installed, *read):
            if check.state != "ok" or not quiet:
                say("\n".join(_lines(check)))
        if not quiet:
            say(f"\nwrong: {len(wrong)}" if wrong else "\nnothing is wrong")
    if wrong:
        raise typer.Exit(1)


def _lines(check: Check) -> list[str]:
    lines = [f"{_MARKS[check.state]}  {check.name}: {check.text}"]
    return lines if check.hint is None else [*lines, f"       hint: {check.hint}"]
