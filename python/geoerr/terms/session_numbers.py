"""The numbers by which formulas know sessions."""

from __future__ import annotations

import itertools
import re
from collections.abc import Sequence

# A spreadsheet may have made 1.0 of 1. What is longer is a date or a serial number.
_OWN = re.compile(r"(\d{1,4})(?:\.0+)?", re.ASCII)


def session_numbers(names: Sequence[str]) -> list[int]:
    """Give the number of each session by their names in order: its own where its name is one; others count on behind.

    A table whose sessions are 1, 2 and 3 is spoken of, and corrected for, by these, whatever is measured besides.
    """
    own = [None if (found := _OWN.fullmatch(name)) is None else int(found[1]) for name in names]
    # Of two that would be one the second counts on.
    first = {number: place for place, number in reversed([*enumerate(own)]) if number is not None}
    behind = itertools.count(max(first, default=-1) + 1)
    return [
        number if number is not None and first[number] == place else next(behind) for place, number in enumerate(own)
    ]
