"""A parameter in words: its value with its standard error, in the unit and with the figures that people read."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

from geoerr.summaries import number_words
from geoerr.terms import Parameter

# Units as people read them: text and factor. Others get a power of ten where they need one.
_READ_IN = {
    "mm": ("µm", 1e3),
    "mm/K": ("µm/K", 1e3),
    "mm/N": ("µm/N", 1e3),
    "mm/s": ("µm/s", 1e3),
    "rad": ("µrad", 1e6),
    "rad/K": ("µrad/K", 1e6),
    "rad/s": ("µrad/s", 1e6),
    "rad/mm": ("µrad/mm", 1e6),
    "1": ("×10⁻⁶", 1e6),
    "1/K": ("×10⁻⁶/K", 1e6),
}
_SUPERSCRIPT = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
# Beyond these a number is written with a power of ten.
_SMALLEST, _LARGEST = 1e-2, 1e5
# Larger ones are not written out: nobody counts so many digits.
_WRITTEN_OUT = 1e9
# What is said of an inner parameter that ended where its range does.
BOUND = "the end of its range; ± of the others hold for it alone"


def value_words(parameter: Parameter, beside: Sequence[Parameter] = ()) -> str:
    """Write a parameter with its standard error, to the second figure of it, and its unit as people read it.

    Linear coefficients in mm and rad are read in µm and µrad; inner parameters (places, lags, periods) as they are.
    Values of one effect and unit have one power of ten: `beside` are its parameters.
    """
    if is_open(parameter):
        return f"{parameter.label} is not determined by these data"
    unit, factor = read_in(parameter, beside)
    # At the end of a range the value is a bound, and its error is none.
    value, std = (nearest_end(parameter), 0.0) if is_at_an_end(parameter) else (parameter.value, parameter.std)
    return f"{parameter.label} = {number_with_std(value * factor, std * factor)} {unit}".rstrip()


def bounded_value_words(parameter: Parameter, beside: Sequence[Parameter] = ()) -> str:
    """Say besides where the value is a bound: the standard errors of the others know nothing of other values."""
    bound = f", {BOUND}" if is_at_an_end(parameter) else ""
    return f"{value_words(parameter, beside)}{bound}"


def is_open(parameter: Parameter) -> bool:
    """Tell whether these data leave a value open: it has no standard error."""
    return math.isfinite(parameter.value) and math.isnan(parameter.std)


def as_stated(parameter: Parameter) -> Parameter:
    """Give a value that nobody fitted, for words: without a standard error it is not left open by any data."""
    return replace(parameter, std=0.0) if math.isnan(parameter.std) else parameter


def is_at_an_end(parameter: Parameter) -> bool:
    """Tell whether an inner parameter ended where its range does: then it is a bound and no value."""
    low, high = parameter.low, parameter.high
    if low is None or high is None or low == high:
        return False
    span = math.log(high / low) if parameter.spacing == "log" else high - low
    ends = (
        [abs(math.log(parameter.value / end)) for end in (low, high)]
        if parameter.spacing == "log" and parameter.value > 0.0
        else [abs(parameter.value - end) for end in (low, high)]
    )
    return min(ends) < 1e-6 * span


def nearest_end(parameter: Parameter) -> float:
    """Give the end of an inner parameter's range that its value is nearest to."""
    return min(parameter.ends, key=lambda end: abs(end - parameter.value))


def read_in(parameter: Parameter, beside: Sequence[Parameter] = ()) -> tuple[str, float]:
    """Give the unit that people read a value in, and how many of it the parameter's own is; `beside` as above."""
    unit = "" if parameter.unit == "1" and parameter.low is not None else parameter.unit
    if parameter.low is not None:
        return unit, 1.0
    if unit in _READ_IN:
        return _READ_IN[unit]
    others = [one for one in beside if one.unit == parameter.unit and one.low is None and math.isfinite(one.value)]
    size = max([abs(parameter.value), *(abs(one.value) for one in others)])
    if size == 0.0:
        # Of nothing the unit does not matter, and this one would read as a number.
        return "" if unit.startswith("1/") else unit, 1.0
    if not math.isfinite(size) or _SMALLEST <= size < _LARGEST:
        return unit, 1.0
    power = 3 * math.floor(math.log10(size) / 3.0)
    rest = unit[1:] if unit.startswith("1/") else f" {unit}"
    return f"×10{str(power).translate(_SUPERSCRIPT)}{rest}".replace("*", "·").replace("^2", "²"), 10.0**-power


def number_with_std(value: float, std: float) -> str:
    """Write a number to the second figure of its standard error; alone where it has none."""
    if not (math.isfinite(std) and std > 0.0) or std > 1e6 * max(abs(value), 1e-300):
        return number_words(value)
    if max(abs(value), std) >= _WRITTEN_OUT:
        return f"{value:.2g} ± {std:.1g}".replace("-", "−")
    digits = 1 - math.floor(math.log10(std))
    # An error as large as the value needs no second figure.
    digits = min(digits, 6) if std < abs(value) else min(digits - 1, 6)
    texts = [f"{round(number, digits):.{max(digits, 0)}f}" for number in (value, std)]
    return " ± ".join(texts).replace("-", "−")
