"""Whether a fitted value is one that physics would give, in words."""

from __future__ import annotations

import math

from geoerr.terms import Parameter, Plausible

# A value further away than this many standard deviations (of fit and material together) is another value.
MATCH_STD = 2.0
# A fit less certain than this part of its value would match anything.
MAX_RELATIVE_STD = 0.25


def plausible_match(parameter: Parameter, value: float | None = None, std: float | None = None) -> Plausible | None:
    """Give the plausible value that a fitted one agrees with, the nearest if several do.

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
    for candidate in parameter.plausible:
        spread = math.hypot(std, 0.5 * candidate.within * abs(candidate.value))
        distance = abs(value - candidate.value)
        if distance <= MATCH_STD * spread:
            found.append((distance, candidate))
    return min(found, key=lambda item: item[0])[1] if found else None


def plausible_words(parameter: Parameter, value: float | None = None, std: float | None = None) -> str | None:
    """Say whether a fitted value is plausible; None where the catalogue has no values to compare with."""
    if not parameter.plausible:
        return None
    match = plausible_match(parameter, value, std)
    if match is not None:
        return f"plausible: {match.what} has {match.value:.4g} {parameter.unit}".rstrip()
    value = parameter.value if value is None else value
    std = parameter.std if std is None else std
    if not math.isfinite(value) or not math.isfinite(std) or std > MAX_RELATIVE_STD * abs(value):
        return "too uncertain to compare with known values"
    nearest = min(parameter.plausible, key=lambda item: abs(item.value - value))
    return f"not a known value; the nearest is {nearest.value:.4g} {parameter.unit} ({nearest.what})"
