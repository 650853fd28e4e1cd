"""Docstrings as they were written, where Sphinx would make something else of them."""

from __future__ import annotations

import re
from typing import Any

import numpy.typing as npt
from sphinx.util.docstrings import prepare_docstring
from sphinx.util.typing import stringify_annotation

# Sphinx spells out what NumPy has a name for; the first of them is half a line.
_ARRAY_LIKE = stringify_annotation(npt.ArrayLike, "smart")
_ARRAY = re.compile(r"~numpy\.ndarray\[tuple\[~typing\.Any, \.\.\.\], ~numpy\.dtype\[([^]]*)\]\]")
# Defaults that are made anew, and functions, are told in a way that is no Python: the signature would have no links.
_NOT_PYTHON = re.compile(r"<factory>|<function \S+>")
_TYPE = re.compile(r"^(\s*:type: )(.*)$")
_AFTER_NAPOLEON = 600


def setup(app: Any) -> dict[str, bool]:
    """Tell Sphinx what is here."""
    app.connect("autodoc-process-docstring", _restore, priority=_AFTER_NAPOLEON)
    app.connect("autodoc-process-signature", _name_types)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def _restore(app: Any, what: str, name: str, described: Any, options: Any, lines: list[str]) -> None:
    """Undo what Napoleon does to a property: it takes all before the first colon for a type.

    And what Sphinx would do to an attribute's shape, (n, 3): look for something of the name n.
    """
    if what == "property" and described.__doc__:
        lines[:] = prepare_docstring(described.__doc__)
    lines[:] = [_TYPE.sub(r"\1``\2``", line) for line in lines]


def _name_types(
    app: Any, what: str, name: str, described: Any, options: Any, signature: str | None, result: str | None
) -> tuple[str | None, str | None]:
    return _named(signature), _named(result)


def _named(text: str | None) -> str | None:
    if text is None:
        return None
    text = _NOT_PYTHON.sub("...", text.replace(_ARRAY_LIKE, "~numpy.typing.ArrayLike"))
    return _ARRAY.sub(r"~numpy.typing.NDArray[\1]", text)
