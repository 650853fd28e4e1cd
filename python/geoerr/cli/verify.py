"""`geoerr verify`: proof by circular test, by workpiece, by path."""

from __future__ import annotations

import typer

from geoerr.cli import verify_ballbar, verify_path, verify_workpiece


def register(app: typer.Typer) -> None:
    """Add the group with its verbs."""
    sub = typer.Typer(
        no_args_is_help=True,
        rich_markup_mode=None,
        help="Prove a correction: circular test, workpiece, path of a program.",
    )
    for verb in (verify_ballbar, verify_workpiece, verify_path):
        verb.register(sub)
    app.add_typer(sub, name="verify")
