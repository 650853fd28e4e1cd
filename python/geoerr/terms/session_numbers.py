"""The numbers by which formulas know sessions."""

from __future__ import annotations

import math
from collections.abc import Sequence


def session_numbers(names: Sequence[str]) -> range:
    """Give the number of each session by their names in order: its own where those count up one by one, else from 0.

    A table whose sessions are 1, 2 and 3 is spoken of, and corrected for, by these.
    """
    try:
        # A spreadsheet may have made 1.0 of 1.
        own = [float(name) for name in names]
    except ValueError:
        own = []
    first = int(own[0]) if own and math.isfinite(own[0]) else 0
    counted = range(first, first + len(names))
    return counted if first >= 0 and own == list(counted) else range(len(names))
