"""The tree beside every page, from the links that the pages have anyway.

A page that lists others says in which order they are to be read; a second list for Sphinx would grow old. A page that
no list has is a warning, and thus an error where warnings are.
"""

from __future__ import annotations

import re
from posixpath import dirname, join, normpath
from typing import Any

_LINK = re.compile(r"\]\((?!\w+:)([^)#\s]+)\.md\)")
_HEADING = re.compile(r"^## (.*)$", re.MULTILINE)


def setup(app: Any) -> dict[str, bool]:
    """Tell Sphinx what is here."""
    app.add_config_value("pages_that_list_others", [], "env")
    app.connect("source-read", _add_tree)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def _add_tree(app: Any, page: str, source: list[str]) -> None:
    if page == app.config.root_doc:
        source[0] += _trees_by_heading(page, source[0])
    elif page in app.config.pages_that_list_others:
        source[0] += _tree(_linked(page, source[0], below=dirname(page) + "/"))


def _trees_by_heading(page: str, text: str) -> str:
    """Write one tree for the links under each heading; a page belongs to the first that links to it."""
    start, *sections = _HEADING.split(text)
    seen = {page}
    trees = []
    for caption, body in zip(["", *sections[::2]], [start, *sections[1::2]], strict=True):
        pages = [linked for linked in _linked(page, body) if linked not in seen]
        seen.update(pages)
        if pages:
            trees.append(_tree(pages, caption.partition(":")[0]))
    return "".join(trees)


def _linked(page: str, text: str, below: str = "") -> list[str]:
    pages = dict.fromkeys(normpath(join(dirname(page), target)) for target in _LINK.findall(text))
    return [linked for linked in pages if linked.startswith(below)]


def _tree(pages: list[str], caption: str = "") -> str:
    options = [":hidden:", *([f":caption: {caption}"] if caption else [])]
    return "\n".join(["", "```{toctree}", *options, "", *(f"/{page}" for page in pages), "```", ""])
