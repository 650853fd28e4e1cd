"""What names of columns say: apart from tables, so that who reads none starts without the library for them."""

from __future__ import annotations

import re

# What sensors are called where nobody thought of what geoerr calls them.
_LIKE_A_TEMPERATURE = re.compile(
    r"(?:^|[_ ])temp(?:erature)?s?\d*(?:$|[_ ])|heater|thermo|degc|celsius", re.IGNORECASE
)


def is_temperature(column: str) -> bool:
    """Tell whether a column is a temperature by its name: `temp` or `temp_...`."""
    return column == "temp" or column.startswith("temp_")


def looks_like_temperature(column: str) -> bool:
    """Tell whether a column that is not named as a temperature is one by what it is called."""
    return not is_temperature(column) and _LIKE_A_TEMPERATURE.search(column) is not None
