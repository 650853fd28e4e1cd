"""`geoerr calibrate`: board pictures of both cameras to rig.json."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from geoerr.cli.options import (
    JsonFlag,
    QuietFlag,
    Threads,
    check_result_output,
    examples,
    note,
    print_json,
    session_files,
)
from geoerr.cli.progress import progress_bar
from geoerr.cli.text_tables import say

if TYPE_CHECKING:
    from geoerr.vision.calibrate import Calibration
    from geoerr.vision.stereo_solve import ViewResult

SessionFolder = Annotated[
    Path, typer.Argument(help="Session folder: session.toml with [board], calibration/left and calibration/right.")
]
RigFile = Annotated[Path, typer.Option("--output", "-o", help="Where to write the rig (rig.json).")]
_NAME_WIDTH = 24

_EXAMPLES = (
    "geoerr calibrate SESSION -o rig.json",
    "geoerr calibrate SESSION -o rig.json --json > calibration.json",
)


def register(app: typer.Typer) -> None:
    """Add the verb."""
    app.command("calibrate", epilog=examples(*_EXAMPLES))(calibrate_session)


def calibrate_session(
    session_folder: SessionFolder,
    output: RigFile,
    threads: Threads = 0,
    json: JsonFlag = False,
    quiet: QuietFlag = False,
) -> None:
    """Calibrate a pair of cameras from pictures of a board; every view judged, every number with its uncertainty."""
    from geoerr.report.provenance import provenance_of_command
    from geoerr.vision.calibrate import calibrate
    from geoerr.vision.rig import write_rig
    from geoerr.vision.session import read_session

    session = read_session(session_folder)
    check_result_output(output, session_files(session))
    with progress_bar("looking for the board", quiet) as advance:
        calibration = calibrate(session, threads=threads, progress=advance)
    write_rig(output, calibration.rig)
    for text in calibration.notes:
        note(f"note: {text}", quiet)
    if json:
        provenance = provenance_of_command([session.description_path])
        print_json({**calibration.to_document(), "provenance": provenance.to_document()})
    else:
        say("\n".join(_report(calibration)))


def _report(calibration: Calibration) -> list[str]:
    rig = calibration.rig
    lines = [f"{'pair':{_NAME_WIDTH}}  corners seen  set aside   left px  right px  held out"]
    lines += [_view_line(view) for view in calibration.per_view]
    lines += ["", *_summary(calibration)]
    deviations = rig.standard_uncertainties() or {}
    for side, camera in (("left", rig.left), ("right", rig.right)):
        (fx, fy), (cx, cy) = camera.focal_px, camera.principal_point_px
        u = [deviations[f"{side}_{name}_px"] for name in ("fx", "fy", "cx", "cy")]
        lines.append(f"{side:5}  f {fx:.3f} ± {u[0]:.3f}, {fy:.3f} ± {u[1]:.3f} px")
        lines.append(f"       centre {cx:.3f} ± {u[2]:.3f}, {cy:.3f} ± {u[3]:.3f} px")
    lines.append(f"cameras {rig.baseline_mm:.4f} ± {calibration.baseline_std_mm:.4f} mm apart")
    for bar in calibration.scale_bars:
        if bar.difference_um is not None:
            lines.append(
                f"scale bar {bar.targets[0]} to {bar.targets[1]}: seen {bar.seen_mm:.4f} ± {bar.seen_std_mm:.4f} mm"
            )
            lines.append(
                f"  given {bar.length_mm:.4f} ± {bar.std_mm:.4f} mm: {bar.difference_um:+.1f} µm, "
                f"{bar.difference_ppm:+.0f} ppm, {bar.sigmas:+.1f} standard uncertainties"
            )
    if calibration.pairs_dropped:
        lines.append("not used:")
        lines += [f"  {item.name}: {item.why}" for item in calibration.pairs_dropped]
    return lines


def _view_line(view: ViewResult) -> str:
    held_out = "–" if view.held_out_rms_px is None else f"{view.held_out_rms_px:.4f}"
    return (
        f"{_shortened(view.name):{_NAME_WIDTH}}  {view.n_left:5d} {view.n_right:5d}  {view.n_set_aside:10d}"
        f"  {view.left_rms_px:8.4f}  {view.right_rms_px:8.4f}  {held_out:>8}"
    )


def _shortened(name: str) -> str:
    return name if len(name) <= _NAME_WIDTH else "…" + name[1 - _NAME_WIDTH :]


def _summary(calibration: Calibration) -> list[str]:
    n_all = calibration.pairs_used + sum("/" not in item.name for item in calibration.pairs_dropped)
    held_out = "–" if calibration.held_out_rms_px is None else f"{calibration.held_out_rms_px:.4f} px"
    return [
        f"{calibration.pairs_used} of {n_all} pairs used",
        f"each camera alone {calibration.left_rms_px:.4f} and {calibration.right_rms_px:.4f} px, "
        f"both together {calibration.stereo_rms_px:.4f} px,",
        f"views held out {held_out}",
    ]
