"""`geoerr simulate`: a virtual machine and camera pair, into a session folder with the truth beside it."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from geoerr.cli.options import JsonFlag, QuietFlag, Threads, examples, note, print_json
from geoerr.cli.progress import progress_bar
from geoerr.cli.text_tables import say

PlanFile = Annotated[Path, typer.Argument(help="The plan (.toml): machine, cameras, targets, errors, passes.")]
SessionFolder = Annotated[
    Path, typer.Option("--output", "-o", help="Session folder to make; an earlier simulated one is replaced.")
]
OwnSeed = Annotated[
    int | None, typer.Option("--seed", min=0, help="Seed of everything random, in place of the plan's own.")
]

_EXAMPLES = (
    "geoerr simulate plan.toml -o SESSION",
    "geoerr simulate plan.toml -o SESSION --seed 7 --json",
)


def register(app: typer.Typer) -> None:
    """Add the verb."""
    app.command("simulate", epilog=examples(*_EXAMPLES))(simulate)


def simulate(
    plan_file: PlanFile,
    output: SessionFolder,
    seed: OwnSeed = None,
    threads: Threads = 0,
    json: JsonFlag = False,
    quiet: QuietFlag = False,
) -> None:
    """Photograph a virtual machine with known errors into a session folder, the truth beside it."""
    from geoerr.files import read_toml
    from geoerr.report.provenance import provenance_of_command
    from geoerr.simulate.plan import plan_from_document
    from geoerr.simulate.session import simulate_session

    document = read_toml(plan_file)
    if seed is not None:
        document["seed"] = seed
    plan = plan_from_document(document, plan_file)
    with progress_bar("photographing", quiet) as advance:
        truth = simulate_session(plan, output, threads, advance)
    for item in truth.not_seen[:5]:
        note(f"frame {item.row + 1}, {item.camera}: {item.target} {item.why}", quiet)
    if len(truth.not_seen) > 5:
        note(f"... and {len(truth.not_seen) - 5} more", quiet)
    if json:
        print_json(
            {
                "session": str(output),
                "seed": plan.seed,
                "frames": truth.n_frames,
                "board_views": truth.n_board_views,
                "targets": len(plan.targets),
                "hidden": [asdict(item) for item in plan.hidden],
                "not_seen": [
                    {"frame": item.row + 1, "camera": item.camera, "target": item.target, "why": item.why}
                    for item in truth.not_seen
                ],
                "provenance": provenance_of_command([plan_file]).to_document(),
            }
        )
        return
    say(
        f"{output}: {truth.n_frames} stereo frames of {len(plan.targets)} targets, "
        f"{truth.n_board_views} board views, truth.json"
    )
