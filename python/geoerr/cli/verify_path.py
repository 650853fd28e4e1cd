"""`geoerr verify path`: the paths of a program before and after compensation."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypeAlias

import typer

from geoerr.cli.options import JsonFlag, QuietFlag, Threads, examples, note, print_json
from geoerr.cli.program_options import (
    At,
    Firmware,
    FirmwareCorrects,
    FirmwareName,
    Home,
    KeepUncertain,
    Still,
    WorkOffset,
    followed_conditions,
    names,
    positive,
    told_triple,
)
from geoerr.cli.progress import progress_bar
from geoerr.cli.text_tables import say
from geoerr.errors import GeoerrError

if TYPE_CHECKING:
    from geoerr.model.conditions import Conditions
    from geoerr.verify.path import PathResult

_EXAMPLES = (
    "geoerr verify path model.json part.gcode part-corrected.gcode --at temp_bed=90",
    "geoerr verify path errors.json part.gcode part-corrected.gcode --tolerance 0.02 --json",
)
# Less of what play holds back says nothing.
_LEAST_HELD_UM = 0.05
_AS_COMPENSATE = (
    "give what compensate was given: the program as it was written, the model, --at, --home, --work-offset and the "
    "others, and no smaller tolerance"
)
_HELD_BACK = (
    "play holds back an axis that its correction moves back, and that is not turned there: correct the program "
    "again, or let its moves be split (compensate says which stay whole)"
)
_BEHIND_HOME = "of the first move behind G28 only the end is corrected"


def register(sub: typer.Typer) -> None:
    """Add the verb to the group `geoerr verify`."""
    sub.command("path", epilog=examples(*_EXAMPLES))(path)


def path(
    model: Annotated[Path, typer.Argument(help="model.json, errors.json, or machine.toml (no errors).")],
    before: Annotated[Path, typer.Argument(metavar="IN", help="The program as it was written.")],
    after: Annotated[Path, typer.Argument(metavar="OUT", help="The program that compensate made of it.")],
    at: At = None,
    work_offset: WorkOffset = None,
    home: Home = None,
    firmware: Firmware = None,
    firmware_corrects: FirmwareCorrects = None,
    still: Still = None,
    keep_uncertain: KeepUncertain = False,
    tolerance: Annotated[
        float | None,
        typer.Option(
            "--tolerance",
            callback=positive,
            help="Fail (exit status 1) where the path of OUT is further off, mm, extrudes another length, has"
            " another feed, or has moves that nobody can follow.",
        ),
    ] = None,
    allow_untouched: Annotated[
        int,
        typer.Option(
            "--allow-untouched",
            min=0,
            metavar="N",
            help="Moves that --tolerance lets pass though nobody can follow them: arcs, places that are not known.",
        ),
    ] = 0,
    as_json: JsonFlag = False,
    quiet: QuietFlag = False,
    threads: Threads = 0,
) -> None:
    """Path error of a program before and after compensation, from dense samples, by a reader of its own."""
    from geoerr.model import load_model
    from geoerr.model.program_conditions import extrapolated_conditions, program_conditions, without_waves_in_time
    from geoerr.model.worth import well_known
    from geoerr.report.provenance import provenance_of_command
    from geoerr.verify.path import compare_paths

    machine = without_waves_in_time(load_model(model).without(names(firmware_corrects)))
    given: Conditions = followed_conditions(at, machine.conditions, quiet)
    told = [str(one) for one in extrapolated_conditions(machine, given)]
    if not keep_uncertain:
        program_conditions(machine, given)
        machine, uncertain, given = well_known(machine, given, threads=threads)
        if uncertain:
            told.append(f"compensate leaves as it is, and so it is left out here: {', '.join(map(str, uncertain))}")
    for sentence in told:
        note(f"note: {sentence}", quiet)
    with progress_bar("verify path", quiet) as advance:
        result = compare_paths(
            machine,
            before,
            after,
            at=given,
            work_offset_mm=told_triple(work_offset, "--work-offset"),
            home_mm=told_triple(home, "--home"),
            firmware=None if firmware is None else firmware.value,
            still=names(still),
            threads=threads,
            on_progress=lambda n_lines: advance(n_lines, n_lines),
        )
    if as_json:
        provenance = provenance_of_command([model, before, after])
        print_json({**result.to_document(), "provenance": provenance.to_document()})
    else:
        say(_report(result, is_home_known=home is not None))
    if not result.moves_compared:
        note("note: no move of the program could be compared", quiet)
    begin = _unsaid(is_home_known=home is not None, lacks_zero=result.lacks_zero)
    _check(result, tolerance, allow_untouched, firmware, begin)


def _report(result: PathResult, *, is_home_known: bool) -> str:
    from geoerr.summaries import counted

    rows = [
        ("", "before", "after"),
        ("largest error, µm", f"{result.max_error_um_before:.3f}", f"{result.max_error_um_after:.3f}"),
        ("rms error, µm", f"{result.rms_um_before:.3f}", f"{result.rms_um_after:.3f}"),
        ("moves", str(result.moves_in), str(result.moves_out)),
        ("extrusion, mm", f"{result.extrusion_in_mm:.5f}", f"{result.extrusion_out_mm:.5f}"),
    ]
    lines = [f"{name:<20}{before:>16}{after:>16}" for name, before, after in rows]
    lines.append(f"{counted(result.moves_compared, 'move')} compared over {result.path_mm:.1f} mm of path")
    if result.moves_not_compared:
        not_compared = counted(result.moves_not_compared, "move")
        begins = f"{_BEHIND_HOME}; or position" if is_home_known else "position"
        lines.append(f"{not_compared} not compared ({begins} not known, or no straight move)")
    if result.held_back_um >= _LEAST_HELD_UM:
        lines.append(
            f"of this, play holds back up to {result.held_back_um:.3f} µm of an axis that its correction\n"
            f"  moves back (line {result.held_back_line})"
        )
    if result.moves_not_followed:
        lines.append(_not_followed(result))
    if result.moves_with_other_extrusion:
        lines.append(_other_extrusion(result))
    if result.max_feed_change_line:
        lines.append(_other_feed(result))
    return "\n".join(lines)


def _not_followed(result: PathResult) -> str:
    count = result.moves_not_followed
    if count == 1:
        return f"1 move cannot be followed and stays as it was written (line {result.not_followed_line})"
    first = f"the first: line {result.not_followed_line}"
    return f"{count} moves cannot be followed and stay as they were written ({first})"


def _other_extrusion(result: PathResult) -> str:
    count = result.moves_with_other_extrusion
    what = "1 move extrudes" if count == 1 else f"{count} moves extrude"
    first = f"line {result.other_extrusion_line}" if count == 1 else f"the first: line {result.other_extrusion_line}"
    return (
        f"{what} another length than before, or {'its' if count == 1 else 'their'} pieces not in proportion ({first})"
    )


def _other_feed(result: PathResult) -> str:
    from geoerr.summaries import counted

    largest = f"the feed differs by up to {result.max_feed_change_percent:.2f} %, line {result.max_feed_change_line}"
    count = result.moves_with_other_feed
    return f"{largest}; by more than 1 % in {counted(count, 'move')}" if count else largest


def _check(
    result: PathResult,
    tolerance_mm: float | None,
    most_untouched: int,
    firmware: FirmwareName | None,
    begin: str,
) -> None:
    if tolerance_mm is None:
        return
    if not result.moves_compared:
        raise GeoerrError(
            "no move of the program could be compared, so that nothing is proved\n"
            f"hint: {begin or f'{_BEHIND_HOME}: let others follow it'}, and write arcs as straight moves"
        )
    problems = [
        *_off_path(result, tolerance_mm),
        *_untouched(result, most_untouched, begin),
        *_other_than_path(result, firmware),
    ]
    if problems:
        # The remedy of the worst may be that of the others.
        raise GeoerrError(f"{'; '.join(problem for problem, _ in problems)}\nhint: {problems[0][1]}")


# What is not as it should be, each with its remedy.
_Problems: TypeAlias = "Iterator[tuple[str, str]]"


def _unsaid(*, is_home_known: bool, lacks_zero: bool) -> str:
    """Ask for what was not said of where a program begins; empty where all was."""
    if not is_home_known:
        return "say where homing leaves the machine, --home"
    # Without it, no place on the machine says what the program's words are there.
    zero = (
        "say where the program's zero is: --work-offset (0,0,0 where it is the machine's), or a printer's --firmware"
    )
    return zero if lacks_zero else ""


def _off_path(result: PathResult, tolerance_mm: float) -> _Problems:
    if not result.max_error_um_after <= tolerance_mm * 1e3:
        yield (
            f"the corrected path is up to {result.max_error_um_after:.3f} µm off"
            f" (line {result.max_error_line_after}), {tolerance_mm * 1e3:g} µm were asked for",
            _HELD_BACK if 2.0 * result.held_back_um >= result.max_error_um_after else _AS_COMPENSATE,
        )


def _untouched(result: PathResult, most: int, begin: str) -> _Problems:
    if result.moves_not_followed > most:
        yield (
            _not_followed(result),
            f"{begin}{begin and '; '}give X, Y and Z before the first cut, name the macros that do not move the"
            " machine (--still), write arcs and cycles as straight moves,"
            f" or allow what is left: --allow-untouched {result.moves_not_followed}",
        )


def _other_than_path(result: PathResult, firmware: FirmwareName | None) -> _Problems:
    if result.moves_with_other_extrusion:
        yield (
            _other_extrusion(result),
            "name the firmware, --firmware marlin, klipper or reprapfirmware: it decides how E is read"
            if firmware is None
            else f"compensate keeps what moves extrude: correct the program again, with --firmware {firmware.value}",
        )
    if result.moves_with_other_feed:
        yield (
            _other_feed(result),
            "compensate keeps every F; change it in the program as it was written, and correct that again",
        )
