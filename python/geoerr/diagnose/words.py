"""A diagnosis in words: how sure, how large, and what else a value may be; values are `geoerr.effects.values`."""

from __future__ import annotations

import math
from collections.abc import Sequence

from geoerr.summaries import listed

# Probabilities below this say no more by being smaller.
_LEAST_P = 1e-9
_FEW_ALIKE = 3
_SURE = ((1e-6, "certain as can be"), (1e-3, "very sure"), (0.025, "sure"), (0.05, "nearly sure"))


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
