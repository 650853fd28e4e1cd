"""What a cell that is no number was meant to be, and how it is written."""

from __future__ import annotations

import re

_DECIMAL_COMMA = re.compile(r"[-+−]?(\d{1,3}(?:[.' ]\d{3})*|\d+),\d+")
_UNIT = re.compile(
    r"[-+−]?\d+(?:[.,]\d+)?\s*(?:[mcµμu]?m|in|inch|\"|°\s*[CF]?|deg\s*[CF]?|[CFKs]|sec|min|h|ms|%|mm/min)",
    re.IGNORECASE,
)
_TIME_OF_DAY = re.compile(r"(?:\d{4}-\d\d?-\d\d?[T ]?|\d\d?[./]\d\d?[./]\d{2,4}[ ,]*)?(?:\d\d?:\d\d.*)?")


def remedy_of(cell: str, column: str) -> str | None:
    """Say how what stands in a cell is written as a number; None where it is like none.

    Parameters
    ----------
    column
        Its name: only a time is written as one of day.
    """
    if column == "t" and _TIME_OF_DAY.fullmatch(cell):
        return "times are seconds since the session began"
    if _DECIMAL_COMMA.fullmatch(cell):
        return "numbers are written with a point, and not with a decimal comma"
    if _UNIT.fullmatch(cell):
        return "numbers are written without units"
    return None
