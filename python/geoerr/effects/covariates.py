"""What an effect needs of the data: temperature columns, other covariates, times and speeds."""

from __future__ import annotations

import re
from collections.abc import Collection, Sequence
from itertools import combinations, permutations

from geoerr.column_names import is_temperature
from geoerr.effects.definitions import RESERVED_NAMES
from geoerr.effects.description import FormSpec
from geoerr.terms import names_in

_LAG_END = re.compile(r"(?<![A-Za-z0-9_])lag\s*\Z")
_SPEED_NAMES = ("v", "a")
_SPEEDS = "speeds (the columns moving and feed, or moving and t)"
_TIMES = "times (the column t)"


def is_temperature_entry(entry: str) -> bool:
    """Tell whether an entry of `covariates` is what `T` stands for: `temp`, `temp-temp`, `temp|temp-temp`, ..."""
    return is_temperature(entry.split("|")[0].split("-")[0])


def temperature_entry(form: FormSpec) -> str | None:
    """Give the entry of a form's covariates that `T` stands for; None where it has no temperature."""
    return next(filter(is_temperature_entry, form.covariates), None)


def temperature_choices(
    form: FormSpec, columns: Sequence[str], *, is_ordered: bool = False
) -> tuple[str | None, ...]:
    """Give what `T` may be in these data, as a reference writes it; `(None,)` where the form has no temperature.

    A difference stands once, whichever way round, unless the order of its two columns is asked for.
    """
    entry = temperature_entry(form)
    if entry is None:
        return (None,)
    temperatures = [column for column in columns if is_temperature(column)]
    found: dict[str | None, None] = {}
    for choice in entry.split("|"):
        if choice == "temp":
            found |= dict.fromkeys(temperatures)
        elif choice == "temp-temp":
            pairs = permutations(temperatures, 2) if is_ordered else combinations(temperatures, 2)
            found |= dict.fromkeys(f"{first}-{second}" for first, second in pairs)
        elif set(choice.split("-")) <= set(columns):
            found[choice] = None
    return tuple(found)


def only_temperature(entry: str) -> str | None:
    """Give the one column, or difference, that an entry allows; None where the reference has to say which."""
    return None if entry in ("temp", "temp-temp") or "|" in entry else entry


def temperature_problem(entry: str, covariate: str | None) -> str | None:
    """Say why `T` cannot be what a reference asks for; None where it can."""
    choices = entry.split("|")
    if covariate in choices and covariate not in ("temp", "temp-temp"):
        return None
    if covariate is None:
        return f"needs {_temperature_words(entry).replace('columns', 'columns as a difference')}"
    columns = covariate.split("-")
    others = [column for column in columns if not is_temperature(column)]
    if others:
        return f"cannot follow {others[0]!r}: temperature columns are named temp or temp_..."
    if "temp" in choices or ("temp-temp" in choices and len(columns) == 2):
        return None
    return f"cannot follow {covariate!r}: it needs {_temperature_words(entry)}"


def columns_wanting(form: FormSpec, parameters: Collection[str], columns: Sequence[str]) -> str | None:
    """Say in one sentence what the data lack for a form; None where they lack nothing.

    Parameters
    ----------
    form
        One way to write an effect.
    parameters
        Names of the effect's coefficients and inner parameters.
    columns
        Names of the data's columns that hold values.
    """
    present = set(columns)
    wanting: dict[str, None] = {}
    entry = temperature_entry(form)
    if entry is not None and not temperature_choices(form, columns):
        wanting[_temperature_words(entry)] = None
    declared = {name for needed in form.covariates for name in needed.split("|")}
    for needed in form.covariates:
        if needed != entry and not present.intersection(needed.split("|")):
            wanting[f"the column {' or '.join(needed.split('|'))}"] = None
    for part in form.parts:
        free, lagged = split_lags(part.expression)
        if _mentions_any(free, _SPEED_NAMES) and not ("moving" in present and present & {"feed", "t"}):
            wanting[_SPEEDS] = None
        if (_mentions_any(lagged, _SPEED_NAMES) or _mentions_any(free + lagged, ("t_rev",))) and "t" not in present:
            wanting[_TIMES] = None
        for name in names_in(part.expression):
            if name not in RESERVED_NAMES | declared | present | set(parameters):
                wanting[f"the column {name}"] = None
    return f"wanting: {'; '.join(wanting)}" if wanting else None


def split_lags(expression: str) -> tuple[str, str]:
    """Split a formula into what stands outside `lag(...)` and what stands inside."""
    outside: list[str] = []
    inside: list[str] = []
    depth, opened = 0, None
    for index, character in enumerate(expression):
        if character == "(":
            depth += 1
            if opened is None and _LAG_END.search(expression[:index]):
                opened = depth
        (inside if opened is not None else outside).append(character)
        if character == ")":
            if opened == depth:
                opened = None
            depth -= 1
    return "".join(outside), "".join(inside)


def _mentions_any(expression: str, names: Sequence[str]) -> bool:
    """Tell whether a formula has one of these short names, plain or of a named axis (`v`, `v_x`, `v_a`)."""
    found = [name for name in names_in(expression) if name in RESERVED_NAMES]
    return any(mention == name or mention.startswith(f"{name}_") for mention in found for name in names)


def _temperature_words(entry: str) -> str:
    choices = entry.split("|")
    if "temp" in choices:
        return "a temperature column (temp or temp_...)"
    if "temp-temp" in choices:
        return "two temperature columns (temp_...)"
    return f"the column {' or '.join(choices)}"
