"""Help that can be copied: every verb shows commands of its own, and what they say is understood; completion."""

from __future__ import annotations

import inspect
import os
import shlex
import subprocess
import sys
from typing import Any

import pytest
import typer.main
from typer.testing import CliRunner

from geoerr.cli import effect_options
from geoerr.cli.main import VERBS, app

PROVEN = ("ballbar", "workpiece", "path")
ASKED = [(verb,) for verb in VERBS if verb != "verify"] + [("verify", name) for name in PROVEN]


def verb_of(words: tuple[str, ...]) -> Any:
    command: Any = typer.main.get_command(app)
    for word in words:
        command = command.get_command(typer.Context(command), word)
    return command


def commands_of(verb: Any) -> list[list[str]]:
    text = inspect.cleandoc(verb.epilog).replace("\\\n", " ")
    return [shlex.split(line) for line in text.splitlines() if line.strip().startswith("geoerr ")]


@pytest.mark.parametrize("words", ASKED, ids=" ".join)
def test_examples_are_understood(words: tuple[str, ...]) -> None:
    verb = verb_of(words)
    shown = commands_of(verb)
    assert shown
    for command in shown:
        until = next((i for i, word in enumerate(command) if word in ("|", ">", "<")), len(command))
        head, arguments = command[: len(words) + 1], command[len(words) + 1 : until]
        assert head == ["geoerr", *words]
        verb.make_context(words[-1], arguments).close()


@pytest.mark.parametrize("words", ASKED, ids=" ".join)
def test_every_verb_has_json_quiet_threads_and_fits_the_terminal(words: tuple[str, ...]) -> None:
    verb = verb_of(words)
    options = {option for parameter in verb.params for option in parameter.opts}
    assert {"--json", "--quiet", "--threads"} <= options
    # A paragraph that is kept as it is cannot be wrapped.
    assert max(map(len, verb.epilog.splitlines())) <= 78


def test_what_is_held_beyond_the_measured_range_is_said() -> None:
    """Of a formula nothing is held: a squareness goes on (tests/compensate/test_program.py)."""
    for verb in ("compensate", "farm"):
        (held,) = [one for one in verb_of((verb,)).params if "--outside-measured" in one.opts]
        assert "last value of each function of an axis; formulas go on" in held.help


def complete(shell: str, *words: str) -> list[str]:
    environment = {"_GEOERR_COMPLETE": f"complete_{shell}", "COMP_WORDS": " ".join(["geoerr", *words])}
    environment |= {"COMP_CWORD": str(len(words)), "_TYPER_COMPLETE_ARGS": " ".join(["geoerr", *words])}
    code = "import sys; sys.argv = ['geoerr']; from geoerr.cli.main import app; app(prog_name='geoerr')"
    done = subprocess.run(
        [sys.executable, "-c", code], env=os.environ | environment, capture_output=True, text=True, check=False
    )
    assert not done.stderr
    return done.stdout.splitlines()


def test_a_shell_completes_verbs_options_and_effects() -> None:
    assert complete("bash", "com") == ["compare", "compensate"]
    assert complete("bash", "fit", "--components", "") == ["21", "12", "none"]
    assert complete("bash", "add", "model.json", "points.csv", "backlash") == ["backlash", "backlash-position"]


def test_effects_are_completed_with_their_axes_and_do_not_hide_files() -> None:
    assert effect_options.complete_effect("squareness:") == ["squareness:xy", "squareness:xz", "squareness:yz"]
    assert effect_options.complete_effect("nothing-like-it:") == []
    assert effect_options.complete_effect("") == []


def test_a_wrong_choice_names_the_choices() -> None:
    result = CliRunner().invoke(app, ["fit", "points.csv", "--machine", "machine.toml", "--components", "13"])
    assert result.exit_code == 2
    assert "Invalid value for '--components': '13' is not one of '21', '12', 'none'." in result.stderr
