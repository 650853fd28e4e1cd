"""Variables of the data in words, with their unit, as axes and tables name them."""

from __future__ import annotations

from geoerr.column_names import is_temperature
from geoerr.machine import AXES
from geoerr.observations import PIXELS

_UNITS = {
    **dict.fromkeys(("x", "y", "z", "tx", "ty", "tz"), "mm"),
    "t": "s",
    "feed": "mm/min",
    **dict.fromkeys(PIXELS, "px"),
}
_WORDS = {
    **{f"t{axis}": f"target offset {axis}" for axis in "xyz"},
    "t": "time",
    "row": "number of the row",
    "repeat": "repetition",
    "moving": "moving (1) or at rest (0)",
    **{f"u_{side}": f"column of the {side} picture" for side in ("left", "right")},
    **{f"v_{side}": f"row of the {side} picture" for side in ("left", "right")},
}
_BY_AXIS = {
    "d": ("direction of approach in {}, −1 or +1", None),
    "s": ("travel of {} since it turned round", "mm"),
    "v": ("speed of {}", "mm/s"),
}


def variable_label(name: str) -> str:
    """Name a variable: `temp_bed, °C`, `travel of x since it turned round, mm`."""
    text, unit = _words_and_unit(name)
    return text if unit is None else f"{text}, {unit}"


def variable_meaning(name: str) -> str:
    """Say what stands behind a name: `position, mm`, `temperature, °C`, `travel of x since it turned round, mm`."""
    text, unit = _words_and_unit(name)
    if text == name:
        text = "position" if name in AXES else "temperature" if is_temperature(name) else "as measured"
    return text if unit is None else f"{text}, {unit}"


def variable_unit(name: str) -> str:
    """Give a variable's unit; nothing where it has none."""
    return _words_and_unit(name)[1] or ""


def value_label(name: str, value: str) -> str:
    """Say what a variable is somewhere: `temp_bed 34.99 °C`, `direction of approach in x 1`."""
    text, unit = _words_and_unit(name)
    return f"{text.partition(',')[0]} {value}{'' if unit is None else f' {unit}'}"


def _words_and_unit(name: str) -> tuple[str, str | None]:
    head, _, axis = name.partition("_")
    if head in _BY_AXIS and axis in AXES:
        words, unit = _BY_AXIS[head]
        return words.format(axis), unit
    return _WORDS.get(name, name), "°C" if is_temperature(name) else _UNITS.get(name)
