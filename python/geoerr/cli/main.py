"""The command line: one verb a file, one table of verbs here."""

from __future__ import annotations

import importlib
import os
import signal
import sys
import threading
import time
from typing import Any

import typer
import typer.core

from geoerr import __version__
from geoerr.errors import GeoerrError

# Before NumPy is loaded: its matrices here are small, and a pool of threads for each would take the cores from the
# pictures, and might join sums in another order on another machine.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# What is told to end may take so long for it before it is ended at once.
_CLEAN_UP_S = 5.0

# Each has a module with `register(app: typer.Typer) -> None`. Order and words are those of `geoerr --help`, which
# loads none of them.
VERBS = {
    "demo": "The whole job on a virtual machine, with a report.",
    "calibrate": "Calibrate a pair of cameras from pictures of a board.",
    "measure": "Pictures of targets to points with covariances.",
    "identify": "The 21 geometric errors from measured points.",
    "fit": "The volumetric model: all errors, all effects, at once.",
    "states": "One machine at several temperatures: what differs.",
    "compare": "How far and where a model fails on measurements.",
    "diagnose": "Which physical effect a model lacks, if any.",
    "add": "Add an effect to a model, and see the error fall.",
    "remove": "Take an effect out, and see the error rise.",
    "report": "All that is known of a machine, on one page.",
    "workbench": "All of this on a local page, with a mouse.",
    "budget": "How uncertain a prediction is, and a compensated part.",
    "compensate": "Rewrite a program for the machine that runs it.",
    "farm": "Many machines in one call, here or on a cluster.",
    "verify": "Prove a correction: circle, workpiece, path.",
    "simulate": "Photograph a virtual machine into a session folder.",
    "target": "Plates and boards to print, true to scale.",
    "doctor": "Check the installation, and whether files can be read.",
}


class _ToldToEnd(KeyboardInterrupt):
    """A signal to end: what cleans up after Ctrl-C does so after it, too.

    Parameters
    ----------
    number
        Of the signal.
    """

    def __init__(self, number: int) -> None:
        super().__init__()
        self.status = 128 + number


class _Verbs(typer.core.TyperGroup):
    """Imports a verb when it is asked for: `compensate` needs neither OpenCV nor Polars, nor their memory."""

    def get_params(self, ctx: Any) -> list[Any]:
        """Give the options that belong to no verb: a switch that is not thrown is off.

        Typer leaves those for completion undefined, and loads Pydantic to make sure: another third of a second.
        """
        params: list[Any] = super().get_params(ctx)
        for param in params:
            if getattr(param, "is_flag", False) and param.default is None:
                param.default = False
        return params

    def invoke(self, ctx: Any) -> Any:
        """Run a verb; that nobody reads its output to the end (`geoerr ... | head`) is no failure.

        Typer would take it for one before `run` hears of it.
        """
        try:
            result = super().invoke(ctx)
            if sys.stdout is not None:
                sys.stdout.flush()
        except typer.BadParameter as error:
            # What checks the value says first that it is one who checks.
            error.message = error.message.removeprefix("Value error, ")
            raise
        except _ToldToEnd as told:
            raise typer.Exit(told.status) from None
        except BrokenPipeError:
            _stop_writing()
            raise typer.Exit from None
        except OSError as error:
            # A full disk, a device that fails: the system's words say enough.
            if error.strerror is None:
                raise
            _stop_writing()
            raise GeoerrError(f"{error.filename or 'standard output'}: {error.strerror}") from error
        return result

    def list_commands(self, ctx: Any) -> list[str]:
        """Give the names of all verbs."""
        return list(VERBS)

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """Give one verb; None where there is no such verb."""
        if cmd_name not in VERBS:
            return None
        holder = typer.Typer(add_completion=False, rich_markup_mode=None)
        # With a callback it stays a group, even of one verb.
        holder.callback()(lambda: None)
        importlib.import_module(f"geoerr.cli.{cmd_name}").register(holder)
        return typer.main.get_group(holder).commands[cmd_name]

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """Write the verbs into the help text."""
        with formatter.section("Commands"):
            formatter.write_dl(list(VERBS.items()))


app = typer.Typer(
    name="geoerr",
    cls=_Verbs,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    # Plain help: boxes would cost more than all the rest of it, and fit a pipe no better.
    rich_markup_mode=None,
    help="Why a three-axis machine is not where it should be: measure, identify, compensate, prove.",
)


def _stop_writing() -> None:
    """Give up what is left in the buffer, for which there is no room or no reader.

    Without this the interpreter tries once more as it ends.
    """
    if sys.stdout is not None:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


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


def _end_in_good_order() -> None:
    """Have SIGTERM, and SIGHUP where there is one, end a verb as Ctrl-C does; what `nohup` ignores stays ignored.

    Else a process that is ended so leaves its temporary files behind. Only a command line does this: signals of a
    program that uses geoerr are its own.
    """
    if threading.current_thread() is not threading.main_thread():
        return
    first_s: float | None = None

    def end(number: int, _frame: object) -> None:
        nonlocal first_s
        if first_s is None:
            first_s = time.monotonic()
            signal.signal(signal.SIGINT, signal.SIG_IGN)
            raise _ToldToEnd(number)
        # A terminal that is closed tells it twice and must not break off the clean-up; who tells it later has waited.
        if time.monotonic() - first_s > _CLEAN_UP_S:
            signal.signal(number, signal.SIG_DFL)
            signal.raise_signal(number)

    for one in (getattr(signal, name) for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name)):
        if signal.getsignal(one) == signal.SIG_DFL:
            signal.signal(one, end)


def run() -> None:
    """Run the command line; a refusal is one clear message and exit status 1, never a traceback."""
    _end_in_good_order()
    try:
        app()
    except GeoerrError as error:
        # The list of verbs does without it.
        from geoerr.cli.text_tables import say

        say(f"error: {error}", is_talk=True)
        sys.exit(1)
