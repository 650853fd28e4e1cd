"""Conditions of a prediction: covariates and history variables that terms need, by name."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Literal, TypeAlias

import numpy as np
import numpy.typing as npt

from geoerr.column_names import is_temperature
from geoerr.errors import GeoerrError, ShapeError
from geoerr.machine import AXES, Machine
from geoerr.model.arrays import Numbers, as_numbers
from geoerr.terms import CLOCK_NAME, PLACE_NAMES, SESSION_NAME

REFERENCE: Literal["reference"] = "reference"

# Name to one number for all rows, (n,) numbers, or `reference`: for a temperature the machine's own reference.
Conditions: TypeAlias = Mapping[str, npt.ArrayLike | str]

# What a row's own position and offset give.
OF_POSITION = (*AXES, *(f"t{axis}" for axis in AXES), *PLACE_NAMES)
# What a move of a program tells, in the order of the core's `motion`.
OF_MOTION = (*(f"{name}_{axis}" for name in ("d", "s", "v") for axis in AXES), "feed")
_DIRECTIONS = tuple(f"d_{axis}" for axis in AXES)
_MEANING = {
    "d": "the direction of approach, 1 or -1",
    "s": "the travel since the last reversal, mm",
    "t_rev": "the time since the last reversal, s",
    "v": "the signed speed, mm/s",
    "a": "the signed acceleration, mm/s²",
    "mean_v": "the mean speed since the previous row, mm/s",
}


def variables_of(
    names: Sequence[str],
    machine: Machine,
    q_mm: Numbers,
    offset_mm: Numbers,
    at: Conditions | None,
    *,
    carrier: str = "relative",
) -> Numbers:
    """Give the core's variables (k, n), k as in `names`.

    Parameters
    ----------
    names
        Raw variables and covariates, as compiled.
    q_mm : (n, 3)
        Axis positions: `x y z`.
    offset_mm : (n, 3)
        Target offsets: `tx ty tz`.
    carrier
        What the target is fixed to: `bed_x bed_y` is the place on the work that it is, or stands over.
    at
        The rest. Within `lag()` the mean speed is the speed itself, if it is not given: a steady state. Without a
        `clock`, `t` is that of the first session.

    Raises
    ------
    GeoerrError
        naming every condition that is needed and not given.
    ShapeError
        for a condition that is neither a number nor one number a row.
    """
    given = {} if at is None else dict(at)
    for axis in AXES:
        if f"v_{axis}" in given:
            given.setdefault(f"mean_v_{axis}", given[f"v_{axis}"])
    if "t" in given:
        given.setdefault(CLOCK_NAME, given["t"])
    missing = [name for name in names if name not in OF_POSITION and name not in given]
    if missing:
        raise GeoerrError(refusal(missing, machine))
    n_rows = len(q_mm)
    place_mm = offset_mm if carrier == "work" else q_mm + offset_mm
    positions = dict(zip(OF_POSITION, (*q_mm.T, *offset_mm.T, *place_mm.T[:2]), strict=True))
    rows = [positions[name] if name in positions else _row(name, given[name], machine, n_rows) for name in names]
    return np.ascontiguousarray(np.array(rows, dtype=np.float64).reshape(len(names), n_rows))


def constants_of(machine: Machine, at: Conditions | None) -> dict[str, float]:
    """Give conditions that are one number each.

    Raises
    ------
    ShapeError
        for a condition that is not.
    GeoerrError
        for a text that is not `reference`, or not of a temperature, and a direction that is none.
    """
    return {name: float(_row(name, value, machine, 1)[0]) for name, value in ({} if at is None else at).items()}


def bound_conditions(
    names: Sequence[str], machine: Machine, at: Conditions | None, n_rows: int
) -> tuple[dict[str, float], Numbers | None]:
    """Give conditions as the core's `TermMachine` takes them: numbers for all rows, and each row's motion (n, 10).

    Raises
    ------
    GeoerrError
        naming every condition of `names` that is needed and not given.
    ShapeError
        for a condition that is neither a number nor, for direction, travel, speed or feed, one number a row.
    """
    given = {} if at is None else dict(at)
    moving = {name: given.pop(name) for name in OF_MOTION if np.ndim(given.get(name, 0.0)) == 1}
    constants = constants_of(machine, given)
    for axis in AXES:
        if f"v_{axis}" in constants:
            constants.setdefault(f"mean_v_{axis}", constants[f"v_{axis}"])
    if "t" in constants:
        constants.setdefault(CLOCK_NAME, constants["t"])
    missing = [name for name in names if name not in constants and name not in moving]
    if missing:
        raise GeoerrError(refusal(missing, machine))
    if not moving:
        return constants, None
    columns = [
        _row(name, moving[name], machine, n_rows) if name in moving else np.zeros(n_rows) for name in OF_MOTION
    ]
    return constants, np.ascontiguousarray(np.column_stack(columns))


def _row(name: str, value: npt.ArrayLike | str, machine: Machine, n_rows: int) -> Numbers:
    if isinstance(value, str):
        if value != REFERENCE or not is_temperature(name):
            raise GeoerrError(
                f"the condition {name} is {value!r}, a number is needed\n"
                f"hint: only temperatures have a {REFERENCE!r}: that of the machine, so that T = 0"
            )
        return np.full(n_rows, machine.reference_temperature_degc)
    numbers = as_numbers(value, f"the condition {name}")
    if numbers.shape not in ((), (1,), (n_rows,)):
        raise ShapeError(f"the condition {name} must be one number or ({n_rows},), not {numbers.shape}")
    # One a row is the caller's: a formula may be asked between the two.
    if name in _DIRECTIONS and numbers.size == 1 and float(numbers.flat[0]) not in (-1.0, 0.0, 1.0):
        raise GeoerrError(
            f"the condition {name} is {float(numbers.flat[0]):g}, a direction is −1 or 1\n"
            f"hint: leave it out where a path tells it, or state {name}=1 for a place that is reached from below"
        )
    if name == SESSION_NAME and not (np.isfinite(numbers) & (numbers >= 0.0) & (numbers == np.round(numbers))).all():
        raise GeoerrError(
            f"the condition session is {float(numbers.flat[0]):g}, which is no number of a session\n"
            "hint: they are the data's own where those are numbers; others are counted behind these, in the order of "
            "the data; of a machine that changed state the last"
        )
    return np.broadcast_to(numbers, (n_rows,))


def refusal(missing: Sequence[str], machine: Machine) -> str:
    """Say which conditions are needed, what they are, and how to give them."""
    wanted = "; ".join(f"{name} ({_meaning(name, machine)})" for name in missing)
    example = " ".join(f"--at {name}={REFERENCE if is_temperature(name) else '...'}" for name in missing)
    has_temperature = any(map(is_temperature, missing))
    meaning = f"; {REFERENCE!r} is the machine's reference temperature, at which T = 0" if has_temperature else ""
    return f"the model needs conditions that are not given: {wanted}\nhint: state them, as {example}{meaning}"


def _meaning(name: str, machine: Machine) -> str:
    if is_temperature(name):
        return f"a temperature in °C, reference {machine.reference_temperature_degc:g} °C"
    head, _, axis = name.rpartition("_")
    if axis in AXES and head in _MEANING:
        return f"{_MEANING[head]}, of {axis}"
    if name == SESSION_NAME:
        return "which of the measured sessions it is as in: as it is now, the last"
    if name == CLOCK_NAME:
        return "the time, s, from session to session"
    return "the time, s" if name == "t" else "in the unit of the measured column"
