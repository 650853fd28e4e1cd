"""Arguments of public functions that are one of a few words, or a number of threads."""

from __future__ import annotations

import re
from collections.abc import Collection, Sequence

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


def check_still(still: Sequence[str]) -> None:
    """Refuse what is no name of a macro, M code or T code; what a G code does is known, or no matter of a name.

    Raises
    ------
    GeoerrError
        naming what is none.
    """
    if isinstance(still, str):
        raise GeoerrError(f"still is {still!r}\nhint: write a list of names")
    for name in still:
        if not re.fullmatch(r"[A-Za-z_][A-Za-z0-9_.]*", name) or re.fullmatch(r"[Gg][\d.]+", name):
            raise GeoerrError(
                f"still cannot be {name!r}\n"
                "hint: write names of macros, or M and T codes, such as _ON_LAYER_CHANGE or M600"
            )


def check_threads(threads: object) -> None:
    """Refuse what is no number of threads.

    Raises
    ------
    ShapeError
        naming the argument.
    """
    if not isinstance(threads, int | np.integer) or threads < 0:
        raise ShapeError(f"threads is {threads!r}\nhint: write a whole number: how many cores to use, 0 for all")
