"""`geoerr measure`: a session's pictures to observations."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from geoerr.cli.options import (
    JsonFlag,
    QuietFlag,
    Threads,
    check_output,
    examples,
    files_given,
    note,
    print_json,
    session_files,
)
from geoerr.cli.progress import progress_bar
from geoerr.cli.text_tables import say

if TYPE_CHECKING:
    from geoerr.vision.measured import Measured
    from geoerr.vision.rig import Rig
    from geoerr.vision.session import Session

SessionFolder = Annotated[
    Path, typer.Argument(help="Session folder: session.toml with [[targets]], frames.csv and its pictures.")
]
RigFile = Annotated[
    Path | None,
    typer.Option("--rig", help="rig.json of the cameras; else SESSION/rig.json, else the session's board pictures."),
]
Table = Annotated[Path, typer.Option("--output", "-o", help="Observations to write (.csv, .parquet, - for CSV).")]

_MISSED_SHOWN = 10
# A name without a suffix is a pipe or a device, or - for standard output.
_TABLES = ("", ".csv", ".txt", ".parquet")

_EXAMPLES = (
    "geoerr measure SESSION --rig rig.json -o observations.csv",
    "geoerr measure SESSION --rig rig.json -o - | head",
)


def register(app: typer.Typer) -> None:
    """Add the verb."""
    app.command("measure", epilog=examples(*_EXAMPLES))(measure_session)


def measure_session(
    session_folder: SessionFolder,
    output: Table,
    rig_file: RigFile = None,
    threads: Threads = 0,
    json: JsonFlag = False,
    quiet: QuietFlag = False,
) -> None:
    """Measure every target in every frame: positions with covariances, and a reason for each that is missed."""
    if json and str(output) == "-":
        raise typer.BadParameter("standard output cannot hold both the table and --json", param_hint="--output")
    from geoerr.report.provenance import provenance_of_command
    from geoerr.vision.measure import measure
    from geoerr.vision.measured import write_measured
    from geoerr.vision.session import read_session

    session = read_session(session_folder)
    # What is missing is told before boards are searched for, which takes long.
    session.require_targets()
    session.require_frames()
    own_rig = session.directory / "rig.json"
    chosen = rig_file or (own_rig if own_rig.is_file() else None)
    if str(output) != "-":
        check_output(output, [*session_files(session), *files_given(chosen)])
        if output.suffix.lower() not in _TABLES:
            raise typer.BadParameter(f"{output} would hold CSV: name it .csv, or .parquet", param_hint="--output")
    rig = _rig(session, chosen, threads, quiet)
    with progress_bar("measuring", quiet) as advance:
        measured = measure(session, rig, threads, advance)
    write_measured(output, measured)
    for text in measured.notes:
        note(f"note: {text}", quiet)
    if json:
        inputs = [session.description_path, session.directory / "frames.csv", chosen]
        print_json({**measured.to_document(), "provenance": provenance_of_command(inputs).to_document()})
    elif str(output) != "-":
        say("\n".join(_report(measured, output)))


def _rig(session: Session, path: Path | None, threads: int, quiet: bool) -> Rig:
    from geoerr.vision.calibrate import calibrate
    from geoerr.vision.rig import read_rig

    if path is not None:
        return read_rig(path)
    note("note: no rig.json: calibrating from the session's board pictures", quiet)
    with progress_bar("looking for the board", quiet) as advance:
        calibration = calibrate(session, threads=threads, progress=advance)
    for text in calibration.notes:
        note(f"note: {text}", quiet)
    return calibration.rig


def _report(measured: Measured, output: Path) -> list[str]:
    lines = [f"{output}: {len(measured.observations)} observations from {measured.n_frames} frames"]
    for size in measured.sizes:
        lines.append(
            f"  target {size.target}: {size.n} observations, side {size.measured_mm:.4f} ± {size.std_mm:.4f} mm"
            f" ({size.given_mm:g} mm given)"
        )
    lines.append(f"corners scatter {measured.agreement.birge_ratio:.2f} times their stated uncertainty")
    if measured.missed:
        lines.append(f"missed: {len(measured.missed)}")
        lines += [
            f"  {item.frame}, {item.camera}: {item.target or 'all targets'}: {item.why}"
            for item in measured.missed[:_MISSED_SHOWN]
        ]
        if len(measured.missed) > _MISSED_SHOWN:
            reasons = Counter(item.why for item in measured.missed[_MISSED_SHOWN:])
            lines += [f"  ... {count} more: {why}" for why, count in reasons.most_common(3)]
    return lines
