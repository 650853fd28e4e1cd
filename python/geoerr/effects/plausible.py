"""Whether a fitted value is one that physics would give, or of a size that is usual, in words."""

from __future__ import annotations

import math
from collections.abc import Sequence

from geoerr.effects.values import is_at_an_end, read_in
from geoerr.summaries import listed, number_words
from geoerr.terms import Parameter, Plausible, UsualSpan

# A value further away than this many standard deviations (of fit and material together) is another value, and one of
# the other sign for certain.
MATCH_STD = 2.0
# A fit less certain than this part of its value would match anything.
_MAX_RELATIVE_STD = 0.25
# Plastics expand up to ten times as much as metals.
_BEYOND_ALL = 10.0


def plausible_match(parameter: Parameter, value: float | None = None, std: float | None = None) -> Plausible | None:
    """Give the plausible value that a fitted one agrees with, the nearest if several do; spans do not count.

    Parameters
    ----------
    parameter
        With its plausible values; those have a tolerance of their own (alloys differ).
    value, std
        Fitted value and its standard deviation in the parameter's unit; None takes the parameter's own.

    Returns
    -------
    Plausible or None
        None where nothing agrees, or where the fit is too uncertain for agreement to mean anything.
    """
    value = parameter.value if value is None else value
    std = parameter.std if std is None else std
    if not math.isfinite(value) or not math.isfinite(std) or std > _MAX_RELATIVE_STD * abs(value):
        return None
    found: list[tuple[float, Plausible]] = []
    for candidate in plausible_values(parameter):
        spread = math.hypot(std, 0.5 * candidate.within * abs(candidate.value))
        distance = abs(value - candidate.value)
        if distance <= MATCH_STD * spread:
            found.append((distance, candidate))
    return min(found, key=lambda item: item[0])[1] if found else None


def usual_match(parameter: Parameter) -> UsualSpan | None:
    """Give the usual span that the size of a fitted value lies in, within twice its standard deviation.

    The nearest if several do, the first of those that hold the value itself. None where none does, and where the
    value is so uncertain that it might as well be smaller as larger than all of the span.
    """
    value, std = parameter.value, parameter.std
    if not math.isfinite(value) or not math.isfinite(std) or has_unusual_sign(parameter):
        return None
    least, most = abs(value) - MATCH_STD * std, abs(value) + MATCH_STD * std
    touched = [
        span
        for span in usual_spans(parameter)
        if least <= span.high and span.low <= most and not (least < span.low and span.high < most)
    ]
    return min(touched, key=lambda span: _ratio_to(span, value), default=None)


def has_unusual_sign(parameter: Parameter) -> bool:
    """Tell whether a value has for certain the other sign than all that is usual: play that is negative is none."""
    spans = usual_spans(parameter)
    return bool(spans) and all(
        span.sign != 0 and parameter.value * span.sign < -MATCH_STD * parameter.std for span in spans
    )


def plausible_what(parameter: Parameter, inner: Sequence[Parameter] = ()) -> str | None:
    """Say what has such a value: what physics gives it to, else what it is usual for.

    None where nothing is known, and where `plausible_words` compares it with nothing.
    """
    if has_wrong_sign(parameter) or _bounds(parameter, inner):
        return None
    match = plausible_match(parameter) or (None if is_at_an_end(parameter) else usual_match(parameter))
    return None if match is None else match.what


def plausible_words(
    parameter: Parameter, inner: Sequence[Parameter] = (), beside: Sequence[Parameter] = ()
) -> str | None:
    """Say whether physics would give a value, or such a size is usual; None where nothing is known of it.

    Known values are written in the unit that `values.value_words` writes the value in.

    Parameters
    ----------
    inner
        The inner parameters of its term. Beside one that is at the end of its range a value is another than it would
        be with the right one.
    beside
        The parameters of its term: known values are written in the power of ten that these have.
    """
    if has_wrong_sign(parameter):
        return f"not physical: it cannot be {'negative' if parameter.sign > 0 else 'positive'}"
    if not parameter.plausible or not math.isfinite(parameter.value):
        return None
    bounds = _bounds(parameter, inner)
    if bounds:
        return f"not to be compared with known values: {listed(bounds)} is at the end of its range"
    unit, factor = read_in(parameter, beside)
    match = plausible_match(parameter)
    if match is not None:
        return f"plausible: {match.what} has {number_words(match.value * factor)}"
    if usual_spans(parameter):
        # The end of a range is a bound: nothing says how large the value is.
        return None if is_at_an_end(parameter) else _usual_words(parameter, factor, unit)
    if not parameter.std <= _MAX_RELATIVE_STD * abs(parameter.value):
        return "too uncertain to compare with known values"
    beyond = _beyond_all(parameter)
    if beyond is not None:
        times, largest = beyond
        known = number_words(largest.value * factor)
        return f"not plausible: {times:.0f} times what {largest.what} has ({known}); something else does this"
    nearest = min(plausible_values(parameter), key=lambda item: abs(item.value - parameter.value))
    return f"no known value: the nearest is {number_words(nearest.value * factor)}, {nearest.what}"


def has_wrong_sign(parameter: Parameter) -> bool:
    """Tell whether a value has for certain the sign that physics does not allow."""
    is_known = parameter.sign != 0 and math.isfinite(parameter.std)
    return is_known and parameter.value * parameter.sign < -MATCH_STD * parameter.std


def _bounds(parameter: Parameter, inner: Sequence[Parameter]) -> list[str]:
    """Name the inner parameters beside a value that are at the end of their ranges."""
    return [one.name for one in inner if one.name != parameter.name and is_at_an_end(one)]


def _beyond_all(parameter: Parameter) -> tuple[float, Plausible] | None:
    """Give how many times an expansion is what the material that expands most has; None of one that plastics have."""
    if parameter.unit != "1/K":
        return None
    largest = max(plausible_values(parameter), key=lambda item: abs(item.value))
    times = abs(parameter.value / largest.value)
    return (times, largest) if times > _BEYOND_ALL else None


def _usual_words(parameter: Parameter, factor: float, unit: str) -> str | None:
    """Say whether the size of a value is usual, and for what; None where there is no value."""
    spans, value, std = usual_spans(parameter), parameter.value, parameter.std
    if not math.isfinite(value) or not math.isfinite(std):
        return None
    match = usual_match(parameter)
    if match is not None:
        return f"usual: {_span_words(match, factor, unit)}"
    size = abs(value)
    nearest = min(spans, key=lambda span: _ratio_to(span, size))
    if has_unusual_sign(parameter):
        sign = "negative" if value < 0.0 else "positive"
        return f"not what is usual: it is {sign}, where {_span_words(nearest, factor, unit)}"
    if any(size - MATCH_STD * std <= span.high and span.low <= size + MATCH_STD * std for span in spans):
        return f"too uncertain to tell whether it is usual: {_span_words(nearest, factor, unit)}"
    how = (
        "unusually large"
        if all(size > span.high for span in spans)
        else "unusually small"
        if all(size < span.low for span in spans)
        else "unusual"
    )
    return f"{how}: {_span_words(nearest, factor, unit)}"


def plausible_values(parameter: Parameter) -> tuple[Plausible, ...]:
    """Give the values that physics would give a parameter."""
    return tuple(item for item in parameter.plausible if isinstance(item, Plausible))


def usual_spans(parameter: Parameter) -> tuple[UsualSpan, ...]:
    """Give the spans of sizes that are usual for a parameter."""
    return tuple(item for item in parameter.plausible if isinstance(item, UsualSpan))


def _span_words(span: UsualSpan, factor: float, unit: str) -> str:
    high = number_words(span.high * factor)
    size = f"{number_words(span.low * factor)} to {high}" if span.low > 0.0 else f"up to {high}"
    return f"{span.what} has {size} {unit}".rstrip()


def _ratio_to(span: UsualSpan, value: float) -> float:
    """How many times too large or too small a value is for a span, 1 within it."""
    size = abs(value)
    if size > span.high:
        return size / span.high
    return 1.0 if size >= span.low else span.low / size if size > 0.0 else math.inf
