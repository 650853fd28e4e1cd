"""Options that every verb shares, spelled and explained once."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Annotated, Any

import typer

JsonFlag = Annotated[bool, typer.Option("--json", help="Print one JSON document on standard output, nothing else.")]
QuietFlag = Annotated[bool, typer.Option("--quiet", "-q", help="No progress and no notes on standard error.")]
Threads = Annotated[
    int, typer.Option("--threads", min=0, help="Threads to use; 0 = all cores. Never changes a result.")
]
Seed = Annotated[int, typer.Option("--seed", min=0, help="Seed of everything random.")]
MachineFile = Annotated[Path, typer.Option("--machine", help="machine.toml: chain and ranges of the machine.")]


def print_json(document: Any) -> None:
    """Print the one JSON document that `--json` promises."""
    sys.stdout.write(json.dumps(document, indent=2, ensure_ascii=False, allow_nan=False) + "\n")


def note(text: str, quiet: bool) -> None:
    """Say something to the person at the terminal: standard error, so that results can be piped."""
    if not quiet:
        typer.echo(text, err=True)
