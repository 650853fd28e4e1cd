"""`geoerr states`: one machine measured at several temperatures."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
import typer.core

from geoerr.cli.options import (
    JsonFlag,
    MachineFile,
    PageFile,
    QuietFlag,
    Threads,
    check_output,
    examples,
    note,
    note_set_aside,
    print_json,
)
from geoerr.cli.progress import progress_bar
from geoerr.cli.text_tables import say

if TYPE_CHECKING:
    from geoerr.observations import Observations

_EXAMPLES = (
    "geoerr states 20=cold.csv 60=warm.csv 90=hot.csv --machine machine.toml -o model.json",
    "geoerr states 20=cold.csv 90=hot.csv --machine machine.toml --report states.html",
    "geoerr states -20=winter.csv 20=lab.csv --machine machine.toml",
)
# Below zero: no option's name begins with a digit.
_COLD = re.compile(r"-\.?[0-9]")


class _States(typer.core.TyperCommand):
    """Takes a temperature below zero for what it is, and no option, wherever it stands."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Put such states where arguments only can be."""
        end = args.index("--") if "--" in args else len(args)
        cold = [one for one in args[:end] if _COLD.match(one)]
        if cold:
            args = [*(one for one in args[:end] if one not in cold), "--", *cold, *args[end + 1 :]]
        return super().parse_args(ctx, args)


def register(app: typer.Typer) -> None:
    """Add the verb."""
    app.command("states", cls=_States, epilog=examples(*_EXAMPLES))(states_verb)


def states_verb(
    states: Annotated[
        list[str],
        typer.Argument(metavar="DEGC=OBS...", help="Temperature in °C and measured points, as 120=hot.csv."),
    ],
    machine: MachineFile,
    covariate: Annotated[
        str, typer.Option("--covariate", help="Column of the temperature; filled with DEGC where it is absent.")
    ] = "temp",
    output: Annotated[Path | None, typer.Option("--output", "-o", help="model.json with temperature in it.")] = None,
    report: PageFile = None,
    as_json: JsonFlag = False,
    quiet: QuietFlag = False,
    threads: Threads = 0,
) -> None:
    """How a machine differs between temperatures, and one model for all of them."""
    from geoerr.files import null_for_nan
    from geoerr.machine import read_machine
    from geoerr.model import write_model
    from geoerr.observations import read_observations
    from geoerr.report.provenance import provenance_of_command
    from geoerr.states import identify_states

    paths = [(_temperature(state), Path(state.partition("=")[2])) for state in states]
    inputs = [machine, *(path for _, path in paths)]
    check_output(output, inputs)
    check_output(report, inputs, output)
    known = read_machine(machine)
    tables: dict[float, list[Observations]] = {}
    for temperature, path in paths:
        tables.setdefault(temperature, []).append(read_observations(path, ranges_mm=known.ranges_mm))
    with progress_bar("states", quiet) as advance:
        advance(0, 2)
        found = identify_states(tables, known, covariate=covariate, threads=threads)
        advance(1, 2)
        if output is not None:
            write_model(output, found.model.model)
        if report is not None:
            # Plotly comes with it: only who asks for pictures pays for it.
            from geoerr.report.states_page import write_states_page

            write_states_page(report, found, provenance_of_command(inputs))
        advance(2, 2)
    if as_json:
        document = {"output": None if output is None else str(output), **null_for_nan(found.to_document())}
        print_json({**document, "provenance": provenance_of_command(inputs).to_document()})
        return
    say(found.report().rstrip())
    _print_notes(list(tables.values()), [path for path in (output, report) if path is not None], quiet)


def _temperature(state: str) -> float:
    text, equals, path = state.partition("=")
    try:
        temperature = float(text)
    except ValueError:
        temperature = math.nan
    if not equals or not path or not math.isfinite(temperature):
        raise typer.BadParameter(f"{state!r} is not DEGC=OBS, as 120=hot.csv", param_hint="DEGC=OBS")
    return temperature


def _print_notes(tables: Sequence[list[Observations]], written: Sequence[Path], quiet: bool) -> None:
    for table in (table for group in tables for table in group):
        note_set_aside(table.set_aside, quiet)
    for path in written:
        note(f"written: {path}", quiet)
