"""Equations as MathML, which browsers draw by themselves: MathJax would have to be fetched, or copied to here."""

from __future__ import annotations

from typing import Any

from docutils.nodes import SkipNode
from docutils.utils.math import MathError
from docutils.utils.math.latex2mathml import tex2mathml
from sphinx.util.logging import getLogger

_LOG = getLogger(__name__)


def setup(app: Any) -> dict[str, bool]:
    """Tell Sphinx what is here."""
    app.add_html_math_renderer("mathml", (_write_inline, None), (_write_block, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def _write_inline(writer: Any, node: Any) -> None:
    _write(writer, node, as_block=False)


def _write_block(writer: Any, node: Any) -> None:
    _write(writer, node, as_block=True)


def _write(writer: Any, node: Any, *, as_block: bool) -> None:
    try:
        written = tex2mathml(node.astext(), as_block=as_block)
    except MathError as error:
        _LOG.warning("equation: %s", error, location=node)
        raise SkipNode from error
    writer.body.append(f'<div class="math">{written}</div>' if as_block else written)
    raise SkipNode
