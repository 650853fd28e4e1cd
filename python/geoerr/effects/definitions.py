"""What the short names of an effect's formula (`q`, `d`, `T`, `L`, ...) mean for one axis and one covariate."""

from __future__ import annotations

import re

from geoerr.machine import AXES, Machine
from geoerr.terms import HISTORY_NAMES, RAW_VARIABLES, names_in

# Short names that follow an axis; `q_a`, `q_b`, `d_a` ... are those of the first and second axis of a pair.
AXIS_NAMES = ("q", "q_low", "L", *(name for name in HISTORY_NAMES if name != "mean_v"))
PAIR_NAMES = tuple(f"{name}_{which}" for name in AXIS_NAMES for which in "ab")
OWN_NAMES = frozenset({*AXIS_NAMES, *PAIR_NAMES, "q_cross", "T"})
RESERVED_NAMES = OWN_NAMES | RAW_VARIABLES
_IDENTIFIER = re.compile(r"(?<![A-Za-z0-9_.])[A-Za-z_][A-Za-z0-9_]*")


def number_text(value: float) -> str:
    """Write a number so that the formula's reader gets the same number back."""
    text = repr(float(value))
    return text if value >= 0 else f"({text})"


def position_text(axis: str, machine: Machine, *, from_low_end: bool) -> str:
    """Write the coordinate of an axis, counted from the low end of its range where the formula has its length."""
    low = machine.axes[axis].range_mm[0]
    if not from_low_end or low == 0.0:
        return axis
    return f"{axis} - {number_text(low)}" if low > 0 else f"{axis} + {number_text(-low)}"


def axis_definitions(axis: str, machine: Machine, suffix: str, *, from_low_end: bool) -> dict[str, str]:
    """Give `q`, `q_low`, `d`, `s`, `t_rev`, `v`, `a`, `L` of one axis, each with `suffix` (`""`, `_a`, `_b`)."""
    texts = {"q": position_text(axis, machine, from_low_end=from_low_end)}
    texts["q_low"] = position_text(axis, machine, from_low_end=True)
    texts["L"] = number_text(machine.axes[axis].length_mm)
    texts |= {name: f"{name}_{axis}" for name in AXIS_NAMES if name not in texts}
    return {f"{name}{suffix}": text for name, text in texts.items()}


def temperature_text(covariate: str, reference_degc: float) -> str:
    """Write T: a column minus the reference temperature, or the difference of two columns."""
    first, minus, second = covariate.partition("-")
    if minus:
        return f"{first} - {second}"
    if reference_degc < 0:
        return f"{first} + {number_text(-reference_degc)}"
    return f"{first} - {number_text(reference_degc)}"


def pair_of(candidate: str | None) -> tuple[str | None, str | None]:
    """Give the moving axes of a candidate: the first and, for a pair or a product, the second."""
    if candidate is None:
        return None, None
    letters = [letter for letter in candidate.removeprefix("work-") if letter in AXES]
    return letters[0], letters[1] if len(letters) > 1 else None


def used_definitions(
    expression: str, part_axis: str | None, candidate: str | None, machine: Machine, temperature: str | None
) -> tuple[tuple[str, str], ...]:
    """Give the definitions that an expression uses, in the order in which it uses them.

    Parameters
    ----------
    expression
        The formula.
    part_axis
        Axis of the part (`x`, `y`, `z`), whose `q`, `d`, ... the plain names are; None where there is none.
    candidate
        The candidate's axis as the reference writes it; its axes are `_a` and `_b`.
    machine
        For ranges.
    temperature
        Text of `T`; None where the candidate has no temperature.
    """
    names = names_in(expression)
    from_low_end = any(name in names for name in ("L", "L_a", "L_b"))
    texts: dict[str, str] = {}
    first, second = pair_of(candidate)
    for axis, suffix in ((part_axis, ""), (first, "_a"), (second, "_b")):
        if axis is not None:
            texts |= axis_definitions(axis, machine, suffix, from_low_end=from_low_end)
    if part_axis in ("x", "y"):
        texts["q_cross"] = "y" if part_axis == "x" else "x"
    if temperature is not None:
        texts["T"] = temperature
    return tuple((name, texts[name]) for name in names if name in texts)


def renamed(expression: str, names: dict[str, str]) -> str:
    """Replace whole names in a formula."""
    return _IDENTIFIER.sub(lambda match: names.get(match[0], match[0]), expression)
