"""Numbers as people type them."""

from __future__ import annotations

import math

from geoerr.errors import InputFileError

# Beyond anything that is measured at a machine, seconds since 1970 too.
_LARGEST = 1e12


def typed_number(name: str, text: str | None) -> float | None:
    """Read a number, with a decimal point or comma; None of an empty field.

    Raises
    ------
    InputFileError
        for what is no number that can be meant; the field is named.
    """
    text = (text or "").strip().replace(",", ".").replace("−", "-")
    if not text:
        return None
    try:
        number = float(text)
    except ValueError:
        # Words for what is infinite or no number are no number here, either.
        number = math.nan
    if math.isnan(number) or math.isinf(number):
        raise InputFileError(name, f"{text!r} is no number", remedy="write a number, for example 60")
    if abs(number) > _LARGEST:
        raise InputFileError(name, f"{text!r} is too large", remedy="write a number, for example 60")
    return number
