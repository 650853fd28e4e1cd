"""`geoerr budget`: how uncertain a model's predictions are, and a part that is compensated with it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from geoerr.cli.options import JsonFlag, QuietFlag, Threads, check_output, examples, note, print_json
from geoerr.cli.program_options import At, conditions, followed_conditions, triple
from geoerr.cli.text_tables import say

_EXAMPLES = (
    "geoerr budget model.json --at temp_bed=90 --at-std temp_bed=2",
    "geoerr budget model.json --place 200,150,80 --offset 0,0,-60 --report budget.html",
)


def register(app: typer.Typer) -> None:
    """Add the verb."""
    app.command("budget", epilog=examples(*_EXAMPLES))(budget)


def budget(
    model: Annotated[Path, typer.Argument(metavar="MODEL", help="model.json of a fit.")],
    at: At = None,
    at_std: Annotated[
        list[str] | None,
        typer.Option("--at-std", metavar="NAME=VALUE", help="Standard uncertainty of a condition."),
    ] = None,
    place: Annotated[
        list[str] | None,
        typer.Option("--place", metavar="X,Y,Z", help="A place, mm; without any the corners, the centre, the worst."),
    ] = None,
    offset: Annotated[
        str, typer.Option("--offset", metavar="X,Y,Z", help="From the tool point to the point that is meant, mm.")
    ] = "0,0,0",
    tolerance: Annotated[
        float, typer.Option("--tolerance", help="Tolerance with which programs are compensated, mm.")
    ] = 0.005,
    digits: Annotated[int, typer.Option("--digits", min=1, max=9, help="Digits of their axis words.")] = 4,
    controller_step: Annotated[
        float | None, typer.Option("--controller-step", help="Smallest step of an axis, mm.")
    ] = None,
    report: Annotated[
        Path | None, typer.Option("--report", help="Write tables and a map of the volume as an HTML page.")
    ] = None,
    as_json: JsonFlag = False,
    quiet: QuietFlag = False,
    # Every verb takes it; a budget is too small to share.
    threads: Threads = 0,
) -> None:
    """How uncertain the error is that MODEL predicts, and what is left of it in a compensated part, and why.

    By propagation (GUM): the parameters' covariance, conditions, and how corrections are carried out.
    """
    from geoerr.budget import Implementation, budget_text, uncertainty_budget, uncertainty_map
    from geoerr.files import null_for_nan
    from geoerr.model import load_model
    from geoerr.model.program_conditions import approach_conditions
    from geoerr.report.provenance import provenance_of_command

    check_output(report, [model])
    loaded = load_model(model)
    given, assumed = followed_conditions(at, loaded.conditions, quiet), approach_conditions(loaded)
    found = uncertainty_budget(
        loaded,
        None if place is None else {f"({text})": triple(text, "--place") for text in place},
        offset_mm=triple(offset, "--offset"),
        at={**assumed, **given},
        at_std=_uncertainties(at_std),
        implementation=Implementation(tolerance_mm=tolerance, digits=digits, controller_step_mm=controller_step),
    )
    told = [f"{name} = {value:g}" for name, value in assumed.items() if name not in given]
    if told:
        note(f"note: taken as {', '.join(told)}; --at states another", quiet)
    provenance = provenance_of_command([model])
    if report is not None:
        # Plotly comes with it: only a page pays for it.
        from geoerr.report.budget_page import write_budget_page

        write_budget_page(report, found, uncertainty_map(found), provenance)
    if as_json:
        print_json(null_for_nan({**found.to_document(), "provenance": provenance.to_document()}))
        return
    say(budget_text(found).rstrip())
    if report is not None:
        note(f"report: {report}", quiet)


def _uncertainties(given: list[str] | None) -> dict[str, float]:
    read = conditions(given)
    for name, value in read.items():
        if isinstance(value, str) or value < 0.0:
            raise typer.BadParameter(f"{name}={value} is no standard uncertainty", param_hint="--at-std")
    return {name: float(value) for name, value in read.items()}
