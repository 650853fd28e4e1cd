"""A diagnosis in words: values with their units, whether physics would give them, how sure, where, of what shape."""

from __future__ import annotations

import math
from collections.abc import Sequence

from geoerr.effects.amplitudes import Amplitude
from geoerr.effects.plausible import (
    MAX_RELATIVE_STD,
    beyond_all,
    plausible_match,
    plausible_values,
    usual_spans,
    usual_words,
)
from geoerr.summaries import listed, number_words
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
# Probabilities below this say no more by being smaller.
_LEAST_P = 1e-9
_FEW_ALIKE = 3
# What is said of an inner parameter that ended where its range does.
BOUND = "the end of its range; ± of the others hold for it alone"
# A sign is told for certain beyond this many standard errors.
_CERTAIN_STD = 2.0
_SURE = ((1e-6, "certain as can be"), (1e-3, "very sure"), (0.025, "sure"), (0.05, "nearly sure"))


def value_words(parameter: Parameter, beside: Sequence[Parameter] = ()) -> str:
    """Write a parameter with its standard error, to the second figure of it, and its unit as people read it.

    Linear coefficients in mm and rad are read in µm and µrad; inner parameters (places, lags, periods) as they are.
    Values of one effect and unit have one power of ten: `beside` are its parameters.
    """
    if is_open(parameter):
        return f"{parameter.label} is not determined by these data"
    unit, factor = _read_in(parameter, beside)
    # At the end of a range the value is a bound, and its error is none.
    value, std = (nearest_end(parameter), 0.0) if is_at_an_end(parameter) else (parameter.value, parameter.std)
    return f"{parameter.label} = {_number(value * factor, std * factor)} {unit}".rstrip()


def bounded_value_words(parameter: Parameter, beside: Sequence[Parameter] = ()) -> str:
    """Say besides where the value is a bound: the standard errors of the others know nothing of other values."""
    bound = f", {BOUND}" if is_at_an_end(parameter) else ""
    return f"{value_words(parameter, beside)}{bound}"


def amplitude_words(amplitude: Amplitude) -> str:
    """Write a wave's amplitude with its standard error and what it is usual for; a bound where it may be 0."""
    size = amplitude.size
    unit, factor = _read_in(size)
    name = f"amplitude √({amplitude.sine}² + {amplitude.cosine}²)"
    if not amplitude.is_told:
        return f"{name} at most {number_words(amplitude.most * factor)} {unit}: not told from 0"
    usual = plausibility_words(size)
    number = f"{name} = {_number(size.value * factor, size.std * factor)} {unit}".rstrip()
    return number if usual is None else f"{number} ({usual})"


def is_open(parameter: Parameter) -> bool:
    """Tell whether these data leave a value open: it has no standard error."""
    return math.isfinite(parameter.value) and math.isnan(parameter.std)


def plausibility_words(
    parameter: Parameter, sign: int = 0, inner: Sequence[Parameter] = (), beside: Sequence[Parameter] = ()
) -> str | None:
    """Say whether physics would give the value, or such a size is usual; None where nothing is known of it.

    Parameters
    ----------
    sign
        +1 or −1 where physics allows that sign only.
    inner
        The inner parameters of its term. Beside one that is at the end of its range a value is another than it would
        be with the right one.
    beside
        The parameters of its term: known values are written in the power of ten that these have.
    """
    if has_wrong_sign(parameter, sign):
        return f"not physical: it cannot be {'negative' if sign > 0 else 'positive'}"
    if not parameter.plausible or not math.isfinite(parameter.value):
        return None
    bounds = [one.name for one in inner if one.name != parameter.name and is_at_an_end(one)]
    if bounds:
        return f"not to be compared with known values: {listed(bounds)} is at the end of its range"
    unit, factor = _read_in(parameter, beside)
    match = plausible_match(parameter)
    if match is not None:
        return f"plausible: {match.what} has {number_words(match.value * factor)}"
    if usual_spans(parameter):
        # The end of a range is a bound: nothing says how large the value is.
        return None if is_at_an_end(parameter) else usual_words(parameter, factor=factor, unit=unit)
    if not parameter.std <= MAX_RELATIVE_STD * abs(parameter.value):
        return "too uncertain to compare with known values"
    nearest = min(plausible_values(parameter), key=lambda item: abs(item.value - parameter.value))
    beyond = beyond_all(parameter, parameter.value)
    if beyond is not None:
        times, largest = beyond
        known = number_words(largest.value * factor)
        return f"not plausible: {times:.0f} times what {largest.what} has ({known}); something else does this"
    return f"no known value: the nearest is {number_words(nearest.value * factor)}, {nearest.what}"


def has_wrong_sign(parameter: Parameter, sign: int) -> bool:
    """Tell whether a value has for certain the sign that physics does not allow; `sign` is 0 where it allows both."""
    return bool(sign) and math.isfinite(parameter.std) and parameter.value * sign < -_CERTAIN_STD * parameter.std


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
    assert parameter.low is not None
    assert parameter.high is not None
    return min((parameter.low, parameter.high), key=lambda end: abs(end - parameter.value))


def sure_words(p_value: float) -> str:
    """Say how sure that is, and what the probability means."""
    name = next((words for most, words in _SURE if p_value < most), "not beyond chance")
    return f"{name}: {chance_words(p_value)}"


def chance_words(p_value: float) -> str:
    """Say what a probability means: in how many searches of noise as much is found."""
    if p_value < _LEAST_P:
        return "chance does as much in fewer than one search of a billion"
    if p_value >= 0.995:
        return "chance does as much in every search"
    if p_value >= 0.1:
        return f"chance does as much in {round(100.0 * p_value)} of 100 searches (p = {p_value:.2g})"
    return f"chance does as much in one search of {counted_words(1.0 / p_value)} (p = {p_value:.2g})"


def counted_words(count: float) -> str:
    """Write a large number as people say it: `4,300`, `2.3 million`."""
    for size, name in ((1e9, "billion"), (1e6, "million")):
        if count >= size:
            scaled = _rounded(count / size, 2)
            return f"{scaled:.{0 if scaled >= 10.0 else 1}f} {name}".replace(".0 ", " ")
    return f"{_rounded(count, 2 if count >= 100 else 1):,.0f}"


def _rounded(value: float, digits: int) -> float:
    return round(value, digits - 1 - math.floor(math.log10(max(value, 1.0))))


def um_words(value_um: float) -> str:
    """Write a length in µm with the digits that a reader needs."""
    return f"{value_um:.{0 if value_um >= 100.0 else 1}f} µm"


def _read_in(parameter: Parameter, beside: Sequence[Parameter] = ()) -> tuple[str, float]:
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


def _number(value: float, std: float) -> str:
    if not (math.isfinite(std) and std > 0.0) or std > 1e6 * max(abs(value), 1e-300):
        return number_words(value)
    if max(abs(value), std) >= _WRITTEN_OUT:
        return f"{value:.2g} ± {std:.1g}".replace("-", "−")
    digits = 1 - math.floor(math.log10(std))
    # An error as large as the value needs no second figure.
    digits = min(digits, 6) if std < abs(value) else min(digits - 1, 6)
    texts = [f"{round(number, digits):.{max(digits, 0)}f}" for number in (value, std)]
    return " ± ".join(texts).replace("-", "−")


def alike_words(values: Sequence[float], unit: str) -> str:
    """Say other values that are the same at places in even steps, the first few, and what would tell them apart."""
    return f"{_first_of(values, unit)}, which are the same at these places: measure in uneven steps"


def as_good_words(values: Sequence[float], unit: str) -> str:
    """Say other values that explain what was measured at few places as well, and what would tell them apart."""
    return f"{_first_of(values, unit)}, which explain so few places as well: measure at more"


def _first_of(values: Sequence[float], unit: str) -> str:
    texts = [f"{value:.4g}" for value in values[:_FEW_ALIKE]]
    more = [f"{len(values) - _FEW_ALIKE} more"] if len(values) > _FEW_ALIKE else []
    return f"{listed([*texts, *more], 'or')} {unit}".rstrip()
