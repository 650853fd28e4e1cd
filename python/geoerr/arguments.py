"""Arguments of public functions that are one of a few words, or a number of threads."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from geoerr.errors import GeoerrError, ShapeError


def check_choice(name: str, value: object, known: Collection[str]) -> None:
    """Refuse what is none of the words that an argument takes.

    Raises
    ------
    GeoerrError
        naming the argument, and the words.
    """
    if value not in known:
        raise GeoerrError(f"{name} cannot be {value!r}\nhint: write one of {', '.join(map(repr, known))}")


def check_threads(threads: object) -> None:
    """Refuse what is no number of threads.

    Raises
    ------
    ShapeError
        naming the argument.
    """
    if not isinstance(threads, int | np.integer) or threads < 0:
        raise ShapeError(f"threads is {threads!r}\nhint: write a whole number: how many cores to use, 0 for all")
