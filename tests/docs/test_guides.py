"""Guides, theory, a tutorial: their commands are understood, and what they print is what stands in them."""

from __future__ import annotations

import importlib.util
import math
import re
import shlex
import shutil
import subprocess
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
import typer.main

from geoerr.cli.main import app

DOCS = Path(__file__).parents[2] / "docs"
GUIDES = [
    *sorted(f"guides/{path.name}" for path in (DOCS / "guides").glob("*.md")),
    "tutorials/pictures_to_program.md",
]
# The examples run what the others tell.
RUN = (
    *(f"guides/{name}.md" for name in ("cameras", "controller", "notebook", "ovals", "refused")),
    *("theory/compensation.md", "theory/triangulation.md", "tutorials/pictures_to_program.md"),
)
_COMMAND = re.compile(r"(?<![\w./`-])geoerr ((?:[^\n|;>&\\]|\\\n)+)")
_CONSOLE = re.compile(r"```console\n(.*?)```", re.DOTALL)
_COMMANDS = re.compile(r"```(?:console|sh)\n(.*?)```", re.DOTALL)
_WRITTEN = re.compile(r"(?:-o|--report|--plan|>) ([a-z][\w./-]*)")
_FILE = re.compile(r"<!-- file: (\S+) -->")
_NUMBER = re.compile(r"[−-]?\d+(?:\.\d+)?(?:e[−-]?\d+)?")


def maker() -> ModuleType:
    spec = importlib.util.spec_from_file_location("make_tutorials", DOCS / "make_tutorials.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def text_of(name: str) -> str:
    return (DOCS / name).read_text(encoding="utf-8")


_FINGERPRINT = re.compile(r"model [0-9a-f]{12}")


@pytest.mark.parametrize("name", GUIDES)
def test_commands_are_understood(name: str) -> None:
    top: Any = typer.main.get_command(app)
    commands = [found[1] for block in _CONSOLE.findall(text_of(name)) for found in _COMMAND.finditer(block)]
    assert commands
    for command in commands:
        words = shlex.split(command.replace("\\\n", " ").replace("$mm", "1"))
        verb = top.get_command(typer.Context(top), words[0])
        depth = 1
        if words[0] == "verify":
            verb, depth = verb.get_command(typer.Context(verb), words[1]), 2
        verb.make_context(words[0], words[depth:]).close()


@pytest.mark.parametrize("name", RUN)
def test_what_it_prints_is_what_stands_there(name: str) -> None:
    """Words to the letter; numbers to 5 % or two of the last digit, for other processors round otherwise."""
    page = text_of(name)
    made, _ = maker().run_page(page, with_real_data=False)
    # A model's fingerprint has all its digits in it.
    page, made = (_FINGERPRINT.sub("model #", text) for text in (page, made))
    for there, now in zip(page.splitlines(), made.splitlines(), strict=True):
        assert _NUMBER.sub("#", there).split() == _NUMBER.sub("#", now).split()
        for old, new in zip(_NUMBER.findall(there), _NUMBER.findall(now), strict=True):
            assert near(old, new), f"{there}\n{now}"


@pytest.mark.skipif(shutil.which("git") is None or not (DOCS.parent / ".git").exists(), reason="no clone")
@pytest.mark.parametrize("name", [*GUIDES, "../README.md"])
def test_what_a_page_leaves_is_no_change_of_the_project(name: str) -> None:
    """Who follows a page from the clone's own folder finds it as it was."""
    lines = [line for block in _COMMANDS.findall(text_of(name)) for line in block.replace("\\\n", "").splitlines()]
    written = {found for line in lines if "cd " not in line for found in _WRITTEN.findall(line)}
    for path in sorted(written | set(_FILE.findall(text_of(name)))):
        # A folder is ignored with what is in it.
        both = subprocess.run(
            ["git", "check-ignore", "--no-index", path, f"{path}/x"],
            cwd=DOCS.parent,
            capture_output=True,
            check=False,
        )
        assert both.returncode == 0, path


def near(old: str, new: str) -> bool:
    one, other = (float(text.replace("−", "-")) for text in (old, new))
    # A probability far from any that matters is told by its power of ten.
    if 0.0 < one < 1e-6 and 0.0 < other < 1e-6:
        return math.isclose(math.log(one), math.log(other), rel_tol=0.05)
    digits = len(old.partition("e")[0].partition(".")[2])
    return math.isclose(one, other, rel_tol=0.05, abs_tol=2.0 * 10.0**-digits)


def test_links_lead_somewhere() -> None:
    for path in [*DOCS.rglob("*.md"), *DOCS.parent.glob("*.md"), DOCS.parent / "examples" / "README.md"]:
        for target in re.findall(r"\]\((?!https?:)([^)#\s]+)", path.read_text(encoding="utf-8")):
            assert (path.parent / target).exists(), f"{path}: {target}"
