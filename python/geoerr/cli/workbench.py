"""`geoerr workbench`: compare, see where, learn what, add, watch the error fall, on a page with a mouse."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from geoerr.cli.options import JsonFlag, QuietFlag, Threads, examples, install_command, note, print_json

_EXAMPLES = (
    "geoerr workbench machine.toml observations.csv",
    "geoerr workbench machine.toml circle.csv",
    "geoerr workbench model.json observations.csv rig.json own.toml --session work.json --no-open",
)


def register(app: typer.Typer) -> None:
    """Add the verb."""
    app.command("workbench", epilog=examples(*_EXAMPLES))(workbench)


def workbench(
    files: Annotated[
        list[Path] | None,
        typer.Argument(
            metavar="[FILE]...",
            help="machine.toml or model.json, measured points, circular tests, own effects, rig.json, in any order.",
        ),
    ] = None,
    session: Annotated[
        Path | None,
        typer.Option("--session", metavar="FILE", help="Keep the work in FILE, and go on with what is in it."),
    ] = None,
    port: Annotated[
        int, typer.Option("--port", min=0, max=65535, help="On this port of this computer; 0 = any free one.")
    ] = 0,
    opens: Annotated[bool, typer.Option("--open/--no-open", help="Open the page in the browser.")] = True,
    as_json: JsonFlag = False,
    quiet: QuietFlag = False,
    threads: Threads = 0,
) -> None:
    """See where a machine is off, learn why, and correct it: a page in the browser, without any network.

    Prints the page's address; only who has it gets in, and only from this computer. Ctrl-C ends it.
    `geoerr workbench machine.toml observations.csv` begins with a machine that was never fitted.
    """
    import signal
    import webbrowser
    from importlib.util import find_spec

    from geoerr.errors import GeoerrError

    if find_spec("dash") is None:
        raise GeoerrError(f"the workbench needs Dash\nhint: {install_command('workbench')}")
    from geoerr.workbench.server import begin_session, serve

    def ready(url: str) -> None:
        if as_json:
            print_json({"url": url})
            # Who reads it through a pipe needs it now: the page is served until it is ended.
            sys.stdout.flush()
        else:
            typer.echo(url)
        note("open this address in a browser on this computer; Ctrl-C ends it", quiet)
        if opens:
            webbrowser.open(url)

    # Being told to end, or a terminal that is closed, ends it in good order too; what `nohup` ignores stays ignored.
    names = sorted({"SIGINT", "SIGTERM", "SIGHUP"} & set(dir(signal)))
    usual = signal.SIG_DFL, signal.default_int_handler
    heard = [one for one in (getattr(signal, name) for name in names) if signal.getsignal(one) in usual]

    def end(*_: object) -> None:
        # Told twice, it must not break off taking the session's folder away.
        for one in heard:
            signal.signal(one, signal.SIG_IGN)
        raise KeyboardInterrupt

    for one in heard:
        signal.signal(one, end)
    serve(begin_session(files or [], session, threads=threads), port, ready)
