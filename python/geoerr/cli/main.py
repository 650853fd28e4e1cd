"""The command line: one verb a file, one table of verbs here."""

from __future__ import annotations

import importlib
import os
import sys
from typing import Any

import typer
import typer.core

from geoerr import __version__
from geoerr.errors import GeoerrError

# Before NumPy is loaded: its matrices here are small, and a pool of threads for each would take the cores from the
# pictures, and might join sums in another order on another machine.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# Each module has `register(app: typer.Typer) -> None`; the order is that of `geoerr --help`.
VERBS = (
    "demo",
    "calibrate",
    "measure",
    "identify",
    "fit",
    "states",
    "compare",
    "diagnose",
    "add",
    "remove",
    "budget",
    "compensate",
    "verify",
    "simulate",
    "target",
)


class _Verbs(typer.core.TyperGroup):
    """Imports a verb when it is asked for: `compensate` needs neither OpenCV nor Polars, nor their memory."""

    def list_commands(self, ctx: Any) -> list[str]:
        """Give the names of all verbs."""
        return list(VERBS)

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """Give one verb; None where there is no such verb."""
        if cmd_name not in VERBS:
            return None
        holder = typer.Typer(add_completion=False)
        # With a callback it stays a group, even of one verb.
        holder.callback()(lambda: None)
        importlib.import_module(f"geoerr.cli.{cmd_name}").register(holder)
        return typer.main.get_group(holder).commands[cmd_name]


app = typer.Typer(
    name="geoerr",
    cls=_Verbs,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    help="Why a three-axis machine is not where it should be: measure, identify, compensate, prove.",
)


def _print_version(requested: bool) -> None:
    if requested:
        typer.echo(f"geoerr {__version__}")
        raise typer.Exit


@app.callback()
def _top(
    version: bool = typer.Option(
        False, "--version", callback=_print_version, is_eager=True, help="Print the version."
    ),
) -> None:
    """Hold the options that belong to no verb."""


def run() -> None:
    """Run the command line; a refusal is one clear message and exit status 1, never a traceback."""
    try:
        app()
    except GeoerrError as error:
        typer.echo(f"error: {error}", err=True)
        sys.exit(1)
    except BrokenPipeError:
        # The reader of a pipe has gone (`geoerr ... | head`): nothing is wrong.
        sys.stderr.close()
        sys.exit(0)
