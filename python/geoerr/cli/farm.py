"""`geoerr farm`: many machines in one call, on the cores of this computer or on a cluster."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import ExitStack, contextmanager
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from geoerr.cli.fit import ComponentsChoice
from geoerr.cli.options import JsonFlag, QuietFlag, Threads, examples, install_command, note, print_json
from geoerr.cli.program_options import (
    At,
    Digits,
    Extrapolate,
    Firmware,
    FirmwareCorrects,
    Home,
    KeepUncertain,
    OnUnsupported,
    OutsideMeasured,
    OutsideMeasuredChoice,
    Still,
    Tolerance,
    UnsupportedChoice,
    WorkOffset,
    compensation_options,
    conditions,
)
from geoerr.cli.progress import progress_bar
from geoerr.cli.text_tables import say
from geoerr.errors import GeoerrError

if TYPE_CHECKING:
    from geoerr.farm import Farm, Outcome
    from geoerr.farm.engine import FarmExecutor


class StepChoice(StrEnum):
    """Steps of a farm."""

    MEASURE = "measure"
    IDENTIFY = "identify"
    FIT = "fit"
    DIAGNOSE = "diagnose"
    COMPENSATE = "compensate"


_CONNECTION_S = 30

# Of those that failed for one reason.
_MACHINES_SHOWN = 3
_EXAMPLES = (
    "geoerr farm FARM -o RESULTS",
    "geoerr farm FARM -o RESULTS --do fit --do compensate --components 12 --add backlash:x",
    "geoerr farm FARM -o RESULTS --scheduler tcp://farm:8786 --json > results.json",
)


def register(app: typer.Typer) -> None:
    """Add the verb."""
    app.command("farm", epilog=examples(*_EXAMPLES))(farm)


def farm(
    folder: Annotated[
        Path,
        typer.Argument(
            metavar="FARM",
            help="Folder of machines' folders, or of one machine: machine.toml, measurements or a session, model.json"
            " where there is one, programs.",
        ),
    ],
    output: Annotated[Path, typer.Option("-o", "--output", help="Folder for the results, a folder a machine.")],
    do: Annotated[
        list[StepChoice] | None,
        typer.Option("--do", help="A step; may be repeated. Else all that a machine's folder has something for."),
    ] = None,
    components: Annotated[
        ComponentsChoice, typer.Option("--components", help="Classic errors to fit: 21, 12 (no angles), or none.")
    ] = ComponentsChoice.LI,
    add: Annotated[
        list[str] | None,
        typer.Option("--add", metavar="ID[:AXIS][@COVARIATE]", help="An effect to fit along; may be repeated."),
    ] = None,
    at: At = None,
    work_offset: WorkOffset = None,
    tolerance: Tolerance = 0.005,
    on_unsupported: OnUnsupported = UnsupportedChoice.REFUSE,
    outside_measured: OutsideMeasured = OutsideMeasuredChoice.REFUSE,
    digits: Digits = 4,
    home: Home = None,
    firmware: Firmware = None,
    firmware_corrects: FirmwareCorrects = None,
    still: Still = None,
    keep_uncertain: KeepUncertain = False,
    extrapolate: Extrapolate = False,
    scheduler: Annotated[
        str | None, typer.Option("--scheduler", help="Address of a Dask scheduler, whose workers do the work.")
    ] = None,
    as_json: JsonFlag = False,
    quiet: QuietFlag = False,
    threads: Threads = 0,
) -> None:
    """Identify, diagnose and compensate many machines at once; one failure never stops the rest.

    Exit status 1 where something failed; all the rest is done. --threads is the number of processes, of one thread
    each.
    """
    from geoerr.farm import STEPS, Recipe, run_farm
    from geoerr.report.provenance import provenance_of_command

    recipe = Recipe(
        steps=tuple(step for step in STEPS if not do or step in do),
        components=components.value,
        effects=tuple(add or ()),
        at=conditions(at),
        options=compensation_options(
            work_offset=work_offset,
            tolerance=tolerance,
            on_unsupported=on_unsupported,
            outside_measured=outside_measured,
            digits=digits,
            home=home,
            firmware=firmware,
            firmware_corrects=firmware_corrects,
            still=still,
            keep_uncertain=keep_uncertain,
            extrapolate=extrapolate,
        ),
    )
    with ExitStack() as stack:
        executor = None if scheduler is None else stack.enter_context(_connected(scheduler))
        advance = stack.enter_context(progress_bar("farm", quiet))
        done = run_farm(folder, output, recipe, executor=executor, workers=threads, on_progress=advance)
    if as_json:
        provenance = provenance_of_command([])
        print_json({"output": str(output), **done.to_document(), "provenance": provenance.to_document()})
    else:
        for line in _lines(done):
            say(line)
        note(f"results: {output}", quiet)
    if done.failures:
        raise typer.Exit(1)


@contextmanager
def _connected(scheduler: str) -> Iterator[FarmExecutor]:
    """Give the workers of a Dask scheduler as an executor."""
    try:
        from distributed import Client
    except ModuleNotFoundError as error:
        raise GeoerrError(f"a cluster needs Dask\nhint: {install_command('cluster')}") from error
    try:
        client = Client(scheduler, timeout=_CONNECTION_S)
    except (OSError, ValueError) as error:
        raise GeoerrError(
            f"{scheduler}: no Dask scheduler answers: {error}\nhint: start one with `dask scheduler`, and workers"
        ) from error
    with client:
        yield client.get_executor()


def _some_of(names: list[str], most: int) -> str:
    shown = ", ".join(names[:most])
    return shown if len(names) <= most else f"{shown} and {len(names) - most} more"


def _lines(done: Farm) -> list[str]:
    """Say of each machine what it lacks and how many programs were corrected; then warnings; what failed, and why."""
    by_machine = done.by_machine
    width = max(map(len, by_machine), default=0)
    lines = [f"{name:<{width}}  {_machine_words(outcomes)}" for name, outcomes in by_machine.items()]
    uncorrected = [one for one in done.outcomes if one.has_nothing_corrected]
    warned = [
        # Each by its name: a program among them that is run is one that nobody corrected.
        *_told(_warnings(uncorrected), most=len(uncorrected)),
        *_told(_warnings(one for one in done.outcomes if not one.has_nothing_corrected)),
    ]
    failed = _told((one.machine, str(one.error)) for one in done.failures)
    lines += [*(["", "warnings:", *warned] if warned else []), *(["", "failed:", *failed] if failed else [])]
    n_failed = len({one.machine for one in done.failures})
    return [*lines, "", f"{len(by_machine)} machines, {n_failed} of them with a failure"]


def _warnings(outcomes: Iterable[Outcome]) -> Iterator[tuple[str, str]]:
    """Give each warning behind the program that it is about."""
    from geoerr.farm.outcome import WARNING

    for one in outcomes:
        for said in one.notes:
            if said.startswith(WARNING):
                yield f"{one.machine}/{one.program}", said.removeprefix(WARNING)


def _told(said: Iterable[tuple[str, str]], most: int = _MACHINES_SHOWN) -> list[str]:
    """Give what is said of names, once for all of which it is: of one bad table two steps say the same."""
    from geoerr.summaries import by_reason

    lines = []
    for text, names in by_reason(dict.fromkeys(said)).items():
        first, *more = text.splitlines()
        lines += [f"  {_some_of(list(names), most)}: {first}", *(f"  {line}" for line in more)]
    return lines


def _machine_words(outcomes: tuple[Outcome, ...]) -> str:
    programs = [one for one in outcomes if one.step == "compensate"]
    steps = [one for one in outcomes if one.step != "compensate"]
    parts = []
    if steps:
        parts.append(f"{steps[-1].step} failed" if steps[-1].error else steps[-1].says)
    if programs:
        corrected = sum(one.error is None and not one.has_nothing_corrected for one in programs)
        parts.append(f"{corrected} of {len(programs)} programs corrected")
    return "; ".join(parts)
