"""Whether a fitted value is one that physics would give, or of a size that is usual, in words."""

from __future__ import annotations

import math

from geoerr.summaries import number_words
from geoerr.terms import Parameter, Plausible, UsualSpan

# A value further away than this many standard deviations (of fit and material together) is another value.
MATCH_STD = 2.0
# A fit less certain than this part of its value would match anything.
MAX_RELATIVE_STD = 0.25
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
    if not math.isfinite(value) or not math.isfinite(std) or std > MAX_RELATIVE_STD * abs(value):
        return None
    found: list[tuple[float, Plausible]] = []
    for candidate in plausible_values(parameter):
        spread = math.hypot(std, 0.5 * candidate.within * abs(candidate.value))
        distance = abs(value - candidate.value)
        if distance <= MATCH_STD * spread:
            found.append((distance, candidate))
    return min(found, key=lambda item: item[0])[1] if found else None


def usual_match(parameter: Parameter, value: float | None = None, std: float | None = None) -> UsualSpan | None:
    """Give the usual span that the size of a fitted value lies in, within twice its standard deviation.

    The nearest if several do, the first of those that hold the value itself. None where none does, and where the
    value is so uncertain that it might as well be smaller as larger than all of the span.
    """
    value = parameter.value if value is None else value
    std = parameter.std if std is None else std
    if not math.isfinite(value) or not math.isfinite(std):
        return None
    least, most = abs(value) - MATCH_STD * std, abs(value) + MATCH_STD * std
    touched = [
        span
        for span in usual_spans(parameter)
        if least <= span.high and span.low <= most and not (least < span.low and span.high < most)
    ]
    return min(touched, key=lambda span: _ratio_to(span, value), default=None)


def plausible_what(parameter: Parameter) -> str | None:
    """Say what has such a value: what physics gives it to, else what it is usual for; None where nothing is known."""
    match = plausible_match(parameter) or usual_match(parameter)
    return None if match is None else match.what


def plausible_words(
    parameter: Parameter,
    value: float | None = None,
    std: float | None = None,
    *,
    factor: float = 1.0,
    unit: str | None = None,
) -> str | None:
    """Say whether a fitted value is plausible; None where the catalogue has nothing to compare it with.

    Parameters
    ----------
    parameter, value, std
        As of `plausible_match`.
    factor, unit
        What a reader sees values in: `unit` is `factor` times the parameter's own, None is its own.
    """
    unit = parameter.unit if unit is None else unit
    match = plausible_match(parameter, value, std)
    if match is not None:
        return f"plausible: {match.what} has {match.value * factor:.4g} {unit}".rstrip()
    if usual_spans(parameter):
        return usual_words(parameter, value, std, factor=factor, unit=unit)
    if not plausible_values(parameter):
        return None
    value = parameter.value if value is None else value
    std = parameter.std if std is None else std
    if not math.isfinite(value) or not math.isfinite(std) or std > MAX_RELATIVE_STD * abs(value):
        return "too uncertain to compare with known values"
    beyond = beyond_all(parameter, value)
    if beyond is not None:
        times, largest = beyond
        return f"not plausible: {times:.0f} times what {largest.what} has ({largest.value * factor:.4g} {unit})"
    nearest = min(plausible_values(parameter), key=lambda item: abs(item.value - value))
    return f"not a known value; the nearest is {nearest.value * factor:.4g} {unit} ({nearest.what})"


def beyond_all(parameter: Parameter, value: float) -> tuple[float, Plausible] | None:
    """Give how many times an expansion is what the material that expands most has; None of one that plastics have."""
    if parameter.unit != "1/K":
        return None
    largest = max(plausible_values(parameter), key=lambda item: abs(item.value))
    times = abs(value / largest.value)
    return (times, largest) if times > _BEYOND_ALL else None


def usual_words(
    parameter: Parameter, value: float | None = None, std: float | None = None, *, factor: float, unit: str
) -> str | None:
    """Say whether the size of a fitted value is usual, and for what; None where no span is known, or no value."""
    spans = usual_spans(parameter)
    value = parameter.value if value is None else value
    std = parameter.std if std is None else std
    if not spans or not math.isfinite(value) or not math.isfinite(std):
        return None
    match = usual_match(parameter, value, std)
    if match is not None:
        return f"usual: {_span_words(match, factor, unit)}"
    size = abs(value)
    nearest = min(spans, key=lambda span: _ratio_to(span, size))
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
