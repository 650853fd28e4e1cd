"""Tutorials, guides and theory run when the site is built: where one tells something else than comes out is told.

Each page runs as `make_tutorials.py` runs it, in a folder of its own, and stays as it is. What differs is a warning,
and thus an error where warnings are; so is a page that cannot run. It takes a minute or two, and `-D run_pages=0`
leaves it out, for a look.
"""

from __future__ import annotations

import multiprocessing
import os
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

import make_tutorials
from make_tutorials import Difference
from sphinx.util.display import status_iterator
from sphinx.util.logging import getLogger

_LOG = getLogger(__name__)
_REMEDY = "python docs/make_tutorials.py"


def setup(app: Any) -> dict[str, bool]:
    """Tell Sphinx what is here."""
    app.add_config_value("run_pages", True, "", types=frozenset({bool}))
    app.connect("builder-inited", _run_all)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def _run_all(app: Any) -> None:
    if not app.config.run_pages:
        return
    pages = make_tutorials.pages()
    # Processes of their own: a page changes the working folder, and may leave what it likes in its modules.
    anew = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(mp_context=anew, initializer=_on_one_thread) as pool:
        results = zip(pages, pool.map(_run, pages), strict=True)
        for path, found in status_iterator(
            results, "running pages... ", "brown", len(pages), app.verbosity, lambda result: result[0].stem
        ):
            _tell(app.env.path2doc(path), found)


def _on_one_thread() -> None:
    """Leave the cores to the pages beside: before NumPy is loaded, and the core makes its threads."""
    for library in ("OPENBLAS", "RAYON"):
        os.environ.setdefault(f"{library}_NUM_THREADS", "1")


def _run(path: Path) -> list[Difference] | str:
    """Give where a page differs from what it prints, or why it does not run."""
    page = path.read_text(encoding="utf-8")
    try:
        made, _ = make_tutorials.run_page(page, with_real_data=make_tutorials.has_real_data())
    except Exception as error:  # of any kind, and not always one that another process could read
        return f"{type(error).__name__}: {error}"
    return make_tutorials.differences(page, made)


def _tell(page: str, found: list[Difference] | str) -> None:
    if isinstance(found, str):
        _LOG.warning("does not run: %s", found, location=page)
        return
    for line, there, now in found:
        message = "says %r, and what comes out is %r; %s writes it anew"
        _LOG.warning(message, there, now, _REMEDY, location=(page, line))
