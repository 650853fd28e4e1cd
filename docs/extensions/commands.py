"""The directive `commands`: what `geoerr VERB --help` prints, verb by verb, asked of the command line itself."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import typer
import typer.main
from docutils import nodes
from sphinx.util.docutils import SphinxDirective

from geoerr.cli.main import app as command_line


def setup(app: Any) -> dict[str, bool]:
    """Tell Sphinx what is here."""
    app.add_directive("commands", _Commands)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


class _Commands(SphinxDirective):
    def run(self) -> list[nodes.Node]:
        top: Any = typer.main.get_command(command_line)
        context = typer.Context(top, info_name="geoerr")
        return [self._section(verb, of_verb) for verb, of_verb in _commands_of(top, context)]

    def _section(self, verb: Any, context: Any) -> nodes.section:
        name = context.command_path
        section = nodes.section("", nodes.title("", name), names=[nodes.fully_normalize_name(name)])
        self.state.document.note_implicit_target(section, section)
        section += nodes.paragraph("", " ".join(verb.help.split()))
        section += _code(" ".join([name, *verb.collect_usage_pieces(context)]))
        section += _parameters(verb, context)
        if verb.epilog:
            section += _code(_examples(verb.epilog))
        section += [self._section(inner, of_inner) for inner, of_inner in _commands_of(verb, context)]
        return section


def _commands_of(group: Any, context: Any) -> Iterator[tuple[Any, Any]]:
    for name in group.list_commands(context) if hasattr(group, "list_commands") else ():
        command = group.get_command(context, name)
        yield command, typer.Context(command, info_name=name, parent=context)


def _parameters(verb: Any, context: Any) -> nodes.definition_list:
    listed = nodes.definition_list(classes=["parameters"])
    for parameter in verb.get_params(context):
        record = parameter.get_help_record(context)
        if record is None or "--help" in parameter.opts:
            continue
        term = nodes.term("", "", nodes.literal("", record[0]))
        listed += nodes.definition_list_item(
            "", term, nodes.definition("", nodes.paragraph("", " ".join(record[1].split())))
        )
    return listed


def _code(text: str) -> nodes.literal_block:
    return nodes.literal_block("", text, language="text")


def _examples(epilog: str) -> str:
    """Take off the sign that keeps lines, the heading, and what lines are indented by."""
    return "\n".join(line.removeprefix("  ") for line in epilog.splitlines()[2:])
