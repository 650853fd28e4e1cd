"""`geoerr verify workpiece`: relative positioning errors of two workpieces, as in Li's Table 4."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from geoerr.cli.options import JsonFlag, QuietFlag, Threads, examples, note, print_json
from geoerr.cli.text_tables import named_row, say

if TYPE_CHECKING:
    from geoerr.verify.workpiece import GroupComparison, GroupFigures, WorkpieceResult

_EXAMPLES = ("geoerr verify workpiece before.csv after.csv",)


def register(sub: typer.Typer) -> None:
    """Add the verb to the group `geoerr verify`."""
    sub.command("workpiece", epilog=examples(*_EXAMPLES))(workpiece)


def workpiece(
    before: Annotated[Path, typer.Argument(help="Workpiece made before compensation: points, or lengths.")],
    after: Annotated[Path, typer.Argument(help="The same workpiece made with the compensated program.")],
    as_json: JsonFlag = False,
    quiet: QuietFlag = False,
    # Every verb takes it; a table is too small to share.
    threads: Threads = 0,
) -> None:
    """RMSE of the relative positioning errors by group, before and after compensation (Li, Table 4)."""
    from geoerr.report.provenance import provenance_of_command
    from geoerr.verify.workpiece import compare_workpieces, read_relative_errors

    result = compare_workpieces(read_relative_errors(before), read_relative_errors(after))
    if as_json:
        document = result.to_document()
        document["provenance"] = provenance_of_command([before, after]).to_document()
        print_json(document)
        return
    _print_result(result)
    for problem in result.set_aside:
        note(f"set aside: {problem}", quiet)
    for sentence in result.notes:
        note(f"note: {sentence}", quiet)


def _print_result(result: WorkpieceResult) -> None:
    of_lengths = result.kind == "lengths"
    what = "measured minus nominal length" if of_lengths else "error against the first point of the line"
    say(f"relative positioning error: {what}")
    say("")
    say(f"{'group':<16}{'n':>10}{'RMSE before':>20}{'RMSE after':>20}{'after/before':>14}")
    for group in (*result.groups, result.total):
        figures = f"{_counts(group):>10}{_rmse(group.before)}{_rmse(group.after)}{_ratio(group):>14}"
        say("\n".join(named_row(group.name, 16, figures)))


def _counts(group: GroupComparison) -> str:
    before, after = (0 if figures is None else figures.n for figures in (group.before, group.after))
    return str(before) if before == after else f"{before} / {after}"


def _rmse(figures: GroupFigures | None) -> str:
    if figures is None:
        return f"{'–':>20}"
    return f" {figures.rmse_mm:>6.4f} mm {figures.rmse_mm * 1e3:>6.1f} µm"


def _ratio(group: GroupComparison) -> str:
    return "–" if group.ratio is None else f"{group.ratio:.3f}"
