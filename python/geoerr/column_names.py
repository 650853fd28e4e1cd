"""What names of columns say: apart from tables, so that who reads none starts without the library for them."""

from __future__ import annotations


def is_temperature(column: str) -> bool:
    """Tell whether a column is a temperature by its name: `temp` or `temp_...`."""
    return column == "temp" or column.startswith("temp_")
