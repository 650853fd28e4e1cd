"""Options that every verb shares, spelled and explained once."""

from __future__ import annotations

import json
import sys
import textwrap
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from geoerr.cli.text_tables import say
from geoerr.errors import InputFileError

if TYPE_CHECKING:
    from geoerr.effects import Effect
    from geoerr.observations import Observations
    from geoerr.report.provenance import Provenance
    from geoerr.tables import RowProblem
    from geoerr.vision.session import Session

_MOST_ROWS_NAMED = 5
# With their indent and a backslash they fit a terminal of 80 columns.
_EXAMPLE_WIDTH = 72

JsonFlag = Annotated[bool, typer.Option("--json", help="Print one JSON document on standard output, nothing else.")]
QuietFlag = Annotated[bool, typer.Option("--quiet", "-q", help="No progress and no notes on standard error.")]
Threads = Annotated[
    int, typer.Option("--threads", min=0, help="Threads to use; 0 = all cores. Never changes a result.")
]
Seed = Annotated[int, typer.Option("--seed", min=0, help="Seed of everything random.")]
MachineFile = Annotated[Path, typer.Option("--machine", help="machine.toml: chain and ranges of the machine.")]
ModelFile = Annotated[
    Path, typer.Argument(metavar="MODEL", help="model.json, errors.json, or machine.toml (a machine without errors).")
]
ObservationFiles = Annotated[
    list[Path],
    typer.Argument(
        metavar="OBS...",
        help="Measured points, circular tests, lengths (.csv, .parquet; - is points on standard input).",
    ),
]
EffectFiles = Annotated[
    list[Path] | None, typer.Option("--effects", help="A .toml of your own effects; may be repeated.")
]
RigFile = Annotated[Path | None, typer.Option("--rig", help="rig.json: include the calibration's uncertainty.")]
Refit = Annotated[
    bool, typer.Option("--refit", help="Fit the model's numbers to these data, too, although they are not its own.")
]
ModelOutput = Annotated[Path | None, typer.Option("--output", "-o", help="model.json to write.")]
PageFile = Annotated[Path | None, typer.Option("--report", help="Write tables and pictures as an HTML page.")]


def install_command(extra: str = "") -> str:
    """Say how geoerr is installed with an extra: from its folder, for no registry has it."""
    what = f"'.[{extra}]'" if extra else "--force-reinstall ."
    return f"pip install {what}, in the folder that geoerr was installed from"


def examples(*commands: str) -> str:
    """Give what stands below the options of a verb: lines to copy; long ones go on behind a backslash."""
    split = (
        textwrap.wrap(command, _EXAMPLE_WIDTH, break_long_words=False, break_on_hyphens=False) for command in commands
    )
    # Click keeps the lines of a paragraph that begins with this sign.
    return "\n".join(["\b", "Examples:", *("  " + " \\\n    ".join(lines) for lines in split)])


def print_json(document: Any) -> None:
    """Print the one JSON document that `--json` promises."""
    sys.stdout.write(json.dumps(document, indent=2, ensure_ascii=False, allow_nan=False) + "\n")


def note(text: str, quiet: bool) -> None:
    """Say something to the person at the terminal: standard error, so that results can be piped."""
    if not quiet:
        say(text, is_talk=True)


def note_set_aside(problems: Sequence[RowProblem], quiet: bool) -> None:
    """Name the first rows that could not be used, and count the rest."""
    for problem in problems[:_MOST_ROWS_NAMED]:
        note(f"set aside: {problem}", quiet)
    if len(problems) > _MOST_ROWS_NAMED:
        from geoerr.summaries import counted

        n_rows = len({(problem.path, problem.row) for problem in problems})
        more = counted(len(problems) - _MOST_ROWS_NAMED, "more cell")
        note(f"set aside: {more}, {counted(n_rows, 'row')} in all", quiet)


def note_left_out(left_out: Mapping[str, int], quiet: bool) -> None:
    """Count the rows that took no part, by the reason."""
    from geoerr.summaries import counted

    for why, count in left_out.items():
        note(f"left out: {counted(count, 'row')} ({why})", quiet)


def print_result(
    document: dict[str, Any], *, report: Path | None, set_aside: Sequence[RowProblem], provenance: Provenance
) -> None:
    """Print a result with where it comes from and what it could not use."""
    from geoerr.files import null_for_nan

    sources = {
        "report": None if report is None else str(report),
        "set_aside": [str(problem) for problem in set_aside],
        "provenance": provenance.to_document(),
    }
    print_json(null_for_nan({**document, **sources}))


def files_given(*files: Path | Sequence[Path] | None) -> list[Path]:
    """Give all files of a command line in one list; what was not given is left out."""
    lists = [[one] if isinstance(one, Path) else list(one or []) for one in files]
    return [path for paths in lists for path in paths]


def effects_of(files: Sequence[Path] | None) -> list[Effect]:
    """Read the user's own effects."""
    from geoerr.effects import load_effects

    return [effect for path in files or [] for effect in load_effects(path)]


# What a name that ends so promises; results are written as JSON.
_NO_JSON = {
    ".csv": "a table",
    ".parquet": "a table",
    ".toml": "a description",
    ".html": "a page",
    ".gcode": "a program",
}


def check_result_output(output: Path | None, inputs: Sequence[Path]) -> None:
    """Refuse what `check_output` does, and a name that promises something else than JSON."""
    check_output(output, inputs)
    what = None if output is None else _NO_JSON.get(output.suffix.lower())
    if output is not None and what is not None:
        raise InputFileError(
            output,
            f"is the name of {what}, and what is written is JSON",
            remedy=f"name it {output.with_suffix('.json').name}",
        )


def check_output(output: Path | None, inputs: Sequence[Path], *others: Path | None) -> None:
    """Refuse an output that would replace an input or another output, under whatever name, or that can be no file."""
    if output is None:
        return
    from geoerr.files import refuse_no_file

    if str(output) == "-":
        raise InputFileError(output, "standard output has what is said of the result", remedy="name a file for it")
    refuse_no_file(output)
    if any(_is_same(output, path) for path in inputs):
        raise InputFileError(output, "is an input of this command", remedy="name another output")
    if any(_is_same(output, path) for path in others if path is not None):
        raise InputFileError(output, "is named for two results", remedy="name another file for one of them")


def _is_same(one: Path, other: Path) -> bool:
    return one.samefile(other) if one.exists() and other.exists() else one.resolve() == other.resolve()


def session_files(session: Session) -> list[Path]:
    """Give all files of a session that a verb may read."""
    files = [session.description_path, session.directory / "frames.csv", session.directory / "machine.toml"]
    files += [path for pair in session.calibration_pairs for path in (pair.left, pair.right)]
    if session.frames is not None:
        files += [session.directory / name for side in ("left", "right") for name in session.frames[side]]
    return files


def calibration(rig: Path | None, points: Observations | None) -> tuple[Any, Any]:
    """Give how the calibration moves the points (n, 3, p), and its covariance (p, p); None where no rig is given.

    Raises
    ------
    InputFileError
        for a rig whose file states no covariance.
    GeometryError
        where the points have no pixels.
    """
    if rig is None or points is None:
        return None, None
    # OpenCV comes with it: only a verb that was given a rig pays for it.
    from geoerr.vision.sensitivity import calibration_of_points

    return calibration_of_points(rig, points)


def note_without_rig(points: Observations | None, quiet: bool) -> None:
    """Say that cameras took part without what their calibration leaves open."""
    if points is not None and points.is_of_cameras:
        note("note: the calibration's uncertainty is not included (--rig)", quiet)
