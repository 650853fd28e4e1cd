"""One self-contained HTML page: summary first, then tables and figures, then how to get the same result again.

Plotly's script is embedded once and nothing is loaded from a network: the page's content policy forbids it. The same
input gives the same bytes.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from html import escape
from importlib import resources
from pathlib import Path
from string import Template
from typing import TypeAlias

import plotly.graph_objects as go
from plotly.offline import get_plotlyjs

from geoerr.files import write_text
from geoerr.report.provenance import Provenance
from geoerr.summaries import capitalised

# What stands in a number's place; the column stays one of numbers.
NOT_DETERMINED, NOT_IN_MODEL, NOT_KNOWN = "not determined", "not in the model", "not known"
NOT_COMPUTABLE = "not computable"
_NO_NUMBERS = (NOT_DETERMINED, NOT_IN_MODEL, NOT_KNOWN, NOT_COMPUTABLE)

# Letters of the longest cell of a column: up to so many a name, which does not break; from so many on sentences.
_NAME, _SENTENCE = 20, 60

_TEMPLATE = resources.files("geoerr.report") / "page.html"


@dataclass(frozen=True)
class Paragraph:
    """A paragraph of plain text."""

    text: str


@dataclass(frozen=True)
class Heading:
    """The heading of a part of a section."""

    text: str


@dataclass(frozen=True)
class Table:
    """A table of texts; columns whose every cell looks like a number are set flush right."""

    caption: str
    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


@dataclass(frozen=True)
class Figure:
    """A figure and what it shows, in words (also for readers who cannot see it)."""

    figure: go.Figure
    caption: str


Block = Paragraph | Heading | Table | Figure


@dataclass(frozen=True)
class Section:
    """A heading and what stands under it."""

    title: str
    blocks: tuple[Block, ...]


# Called with the steps done and their number.
Progress: TypeAlias = Callable[[int, int], None]
# Gives sections: what takes time happens when it is called.
Maker: TypeAlias = Callable[[], Sequence[Section]]


def as_one(title: str, parts: Sequence[Section], *before: Block) -> Section:
    """Make one section of several, each under a heading of its own."""
    return Section(title, (*before, *(block for part in parts for block in (Heading(part.title), *part.blocks))))


def made(makers: Sequence[Maker], progress: Progress | None = None) -> list[Section]:
    """Make sections one after the other.

    Parameters
    ----------
    makers
        Each gives its sections when it is called.
    progress
        Called after each with those that are made and the number of all, of which the page around them is the last.
    """
    sections: list[Section] = []
    for number, make in enumerate(makers, start=1):
        sections += make()
        if progress is not None:
            progress(number, len(makers) + 1)
    return sections


def as_sentence(note: str) -> Paragraph:
    """Make a paragraph of a note: notes begin small and end without a full stop."""
    return Paragraph(f"{capitalised(note)}.")


def write_report(
    path: str | Path, title: str, summary: Sequence[str], sections: Sequence[Section], provenance: Provenance
) -> None:
    """Write `render_report(...)`, whole or not at all."""
    write_text(path, render_report(title, summary, sections, provenance))


def render_report(title: str, summary: Sequence[str], sections: Sequence[Section], provenance: Provenance) -> str:
    """Make the page.

    Parameters
    ----------
    title
        Heading of the page.
    summary
        Sentences in plain words; they stand at the top.
    sections
        In order.
    provenance
        Versions, command and digests for the last section.

    Returns
    -------
    str
        HTML. All texts are escaped; figures are numbered in order, so their ids are the same in every run.
    """
    figures: list[go.Figure] = []
    body = [_section(number, section, figures) for number, section in enumerate(sections, start=1)]
    contents = [
        f'<li><a href="#section-{number}">{escape(section.title)}</a></li>'
        for number, section in enumerate(sections, start=1)
    ]
    return Template(_TEMPLATE.read_text(encoding="utf-8")).substitute(
        title=escape(title),
        summary="\n".join(f"<li>{escape(sentence)}</li>" for sentence in summary),
        contents="\n".join(contents),
        sections="\n".join(body),
        version=escape(provenance.version),
        runs_on=escape(", ".join(f"{name} {version}" for name, version in provenance.runs_on)),
        command=escape(provenance.command),
        inputs=_inputs(provenance),
        plotly=get_plotlyjs() if figures else "",
        figures=_in_script("[" + ",\n".join(str(figure.to_json()) for figure in figures) + "]"),
    )


def _section(number: int, section: Section, figures: list[go.Figure]) -> str:
    blocks = "\n".join(_block(block, figures) for block in section.blocks)
    return f'<section id="section-{number}">\n<h2>{escape(section.title)}</h2>\n{blocks}\n</section>'


def _block(block: Block, figures: list[go.Figure]) -> str:
    if isinstance(block, Paragraph):
        return f"<p>{escape(block.text)}</p>"
    if isinstance(block, Heading):
        return f"<h3>{escape(block.text)}</h3>"
    if isinstance(block, Table):
        return _table(block)
    figures.append(block.figure)
    height = block.figure.layout.height or 450
    return (
        f'<figure><div class="plot" id="figure-{len(figures)}" style="height:{height:g}px" role="img" '
        f'aria-label="{escape(block.caption, quote=True)}"></div>'
        f"<figcaption>Figure {len(figures)}. {escape(block.caption)}</figcaption></figure>"
    )


def _table(table: Table) -> str:
    kinds = [_kind([row[column] for row in table.rows]) for column in range(len(table.header))]
    classes = [f' class="{kind}"' if kind else "" for kind in kinds]
    head = "".join(
        f'<th scope="col"{style}>{escape(name)}</th>' for name, style in zip(table.header, classes, strict=True)
    )
    rows = "\n".join(
        "<tr>"
        + "".join(
            f"<td{style}>{escape(_with_minus(cell) if kind == 'number' else cell)}</td>"
            for cell, kind, style in zip(row, kinds, classes, strict=True)
        )
        + "</tr>"
        for row in table.rows
    )
    return (
        f'<div class="table"><table><caption>{escape(table.caption)}</caption>\n'
        f"<thead><tr>{head}</tr></thead>\n<tbody>\n{rows}\n</tbody></table></div>"
    )


def _kind(cells: Sequence[str]) -> str:
    """Give the class of a column by its cells: how it is set, and where it may break."""
    if all(map(_looks_numeric, cells)):
        return "number"
    longest = max(map(len, cells))
    return "name" if longest <= _NAME else "sentences" if longest >= _SENTENCE else ""


def _looks_numeric(cell: str) -> bool:
    return not cell or cell in _NO_NUMBERS or cell[0] in "0123456789+-−–±."


def _with_minus(cell: str) -> str:
    """Set the sign of numbers as one: a hyphen is shorter, and `-4 – -2` no range. Powers of ten stay as typed."""
    return re.sub(r"(?<![\w.])-(?=[\d.])", "−", cell)


def _inputs(provenance: Provenance) -> str:
    if not provenance.inputs:
        return "<p>No input files.</p>"
    rows = tuple((name, sha256) for name, sha256 in provenance.inputs)
    return _table(Table("Inputs", ("file", "SHA-256"), rows))


def _in_script(json: str) -> str:
    """Keep a text inside a figure from ending the script element."""
    return json.replace("<", "\\u003c").replace("\u2028", "\\u2028").replace("\u2029", "\\u2029")
