"""Numbers as people type them."""

from __future__ import annotations

from geoerr.errors import InputFileError


def typed_number(name: str, text: str | None) -> float | None:
    """Read a number, with a decimal point or comma; None of an empty field.

    Raises
    ------
    InputFileError
        for what is no number; the field is named.
    """
    text = (text or "").strip().replace(",", ".").replace("−", "-")
    if not text:
        return None
    try:
        return float(text)
    except ValueError:
        raise InputFileError(name, f"{text!r} is no number", remedy="write a number, for example 60") from None
