"""Runs the tutorials and writes what they print into them: `python docs/make_tutorials.py`.

A tutorial is a page of Markdown. Its blocks of Python run one after the other in one namespace; what a block prints
stands in a block of text after it. Blocks below `<!-- needs GEOERR_TEST_DATA -->` run where that variable names the
folder of real data, and else keep what they printed there. Tests run the pages too, and hold them to what they claim.
"""

from __future__ import annotations

import contextlib
import io
import os
import re
from pathlib import Path
from typing import Any

TUTORIALS = Path(__file__).with_name("tutorials")
_BLOCK = re.compile(r"```python\n(?P<code>.*?)```\n(?:\n```text\n.*?```\n)?", re.DOTALL)
_REAL_DATA = "<!-- needs GEOERR_TEST_DATA -->"


def run_page(page: str, *, with_real_data: bool) -> tuple[str, dict[str, Any]]:
    """Run a page's blocks; give the page with what they printed, and all that they named."""
    own, _, real = page.partition(_REAL_DATA)
    names: dict[str, Any] = {"__name__": "tutorial"}
    own = _BLOCK.sub(lambda match: _run(match["code"], names), own)
    if real and with_real_data:
        real = _BLOCK.sub(lambda match: _run(match["code"], names), real)
    return own + (_REAL_DATA + real if real else ""), names


def _run(code: str, names: dict[str, Any]) -> str:
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        exec(compile(code, "tutorial", "exec"), names)  # the page is ours
    text = "\n".join(line.rstrip() for line in printed.getvalue().splitlines())
    return f"```python\n{code}```\n" + (f"\n```text\n{text}\n```\n" if text else "")


if __name__ == "__main__":
    for path in sorted(TUTORIALS.glob("*.md")):
        made, _ = run_page(path.read_text(encoding="utf-8"), with_real_data="GEOERR_TEST_DATA" in os.environ)
        path.write_text(made, encoding="utf-8")
