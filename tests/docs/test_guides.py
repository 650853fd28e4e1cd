"""Guides, theory, a tutorial: their commands are understood, and what they print is what stands in them."""

from __future__ import annotations

import importlib.util
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
# `test_tutorials.py` runs the other tutorial.
RUN = [*GUIDES, "theory/compensation.md", "theory/triangulation.md"]
_COMMAND = re.compile(r"(?<![\w./`-])geoerr ((?:[^\n|;>&\\]|\\\n)+)")
_CONSOLE = re.compile(r"```console\n(.*?)```", re.DOTALL)
_COMMANDS = re.compile(r"```(?:console|sh)\n(.*?)```", re.DOTALL)
_WRITTEN = re.compile(r"(?:-o|--report|--plan|>) ([a-z][\w./-]*)")
_FILE = re.compile(r"<!-- file: (\S+) -->")


def maker() -> ModuleType:
    spec = importlib.util.spec_from_file_location("make_tutorials", DOCS / "make_tutorials.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def text_of(name: str) -> str:
    return (DOCS / name).read_text(encoding="utf-8")


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
    page, make = text_of(name), maker()
    made, _ = make.run_page(page, with_real_data=False)
    assert not make.differences(page, made)


@pytest.mark.parametrize("name", RUN)
def test_a_reader_is_told_the_names_of_files(name: str) -> None:
    """What names a file for whoever runs the page is a comment, which nobody sees who reads it."""
    page = text_of(name)
    for mark in _FILE.finditer(page):
        assert f"`{mark[1]}`" in page[: mark.start()], mark[1]


def test_what_differs_is_told() -> None:
    """Words to the letter; numbers to what another processor makes of them."""
    page = "the model 0123456789ab\nis off by 0.104 mm, p = 2.1e-9\n\nand the end\n"
    differences = maker().differences
    assert not differences(page, page.replace("0.104", "0.106").replace("2.1e-9", "4.0e-9").replace("ab", "cd"))
    assert differences(page, page.replace("0.104", "0.124")) == [
        (2, "is off by 0.104 mm, p = 2.1e-9", "is off by 0.124 mm, p = 2.1e-9")
    ]
    assert differences(page, page.replace("off", "away")) == [
        (2, "is off by 0.104 mm, p = 2.1e-9", "is away by 0.104 mm, p = 2.1e-9")
    ]
    assert differences(page, page + "or not\n") == [(5, "(the end)", "or not")]
    assert differences(page, page.replace("\n\n", "\n")) == [(3, "", "and the end")]


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


def test_links_lead_somewhere() -> None:
    for path in [*DOCS.rglob("*.md"), *DOCS.parent.glob("*.md"), DOCS.parent / "examples" / "README.md"]:
        for target in re.findall(r"\]\((?!https?:)([^)#\s]+)", path.read_text(encoding="utf-8")):
            assert (path.parent / target).exists(), f"{path}: {target}"
