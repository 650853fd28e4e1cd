"""Conditions under which a program runs: what the model needs, what the moves tell, and what the data cover."""

from __future__ import annotations

from collections.abc import Sequence

from geoerr.errors import GeoerrError
from geoerr.machine import AXES
from geoerr.model.conditions import OF_MOTION, Conditions, constants_of, refusal
from geoerr.model.model import Model

# Every move of a program moves.
_TOLD = frozenset((*OF_MOTION, "moving"))
# What no program tells, and how an effect that follows it is left out.
_NO_PROGRAM_TELLS = {
    "a": "accelerations: 0 leaves their effect out",
    "t_rev": "the time since a reversal: a long one, such as 1000, leaves out what dies away",
    "mean_v": "the mean speed of hours: it is what has warmed the machine",
}


def needed_conditions(model: Model) -> tuple[str, ...]:
    """Name what has to be stated for a program: all that the model follows and no move tells."""
    return tuple(name for name in model.conditions if name not in _TOLD)


def program_conditions(model: Model, at: Conditions | None) -> dict[str, float]:
    """Give the conditions of a program as one number each.

    Directions, travels, speeds and feed come from the moves; where one of them is stated it has precedence (`v_x=0`
    leaves out what follows that speed). Within `lag()` the mean speed is what has to be stated: a state that lasts.

    Raises
    ------
    GeoerrError
        naming every condition that is needed and not given, with the spans of the data, and a stated one that the
        model does not follow.
    """
    given = constants_of(model.machine, at)
    follows = model.conditions
    for name in given:
        if name not in follows:
            has = f"it needs {', '.join(sorted(follows))}" if follows else "it needs no conditions"
            raise GeoerrError(f"the model does not depend on {name!r}\nhint: leave --at {name} out; {has}")
    missing = [name for name in needed_conditions(model) if name not in given]
    if missing:
        problem, _, hint = refusal(missing, model.machine).partition("\n")
        raise GeoerrError(f"{problem}{_spans(model, missing)}{_no_program_tells(missing)}\n{hint}")
    return given


def beyond_the_data(model: Model, at: dict[str, float]) -> tuple[str, ...]:
    """Give a sentence for each stated condition that the data of the fit do not cover."""
    spans = {} if model.record is None else model.record.covariate_spans
    return tuple(
        f"{name} = {value:g} lies outside what the model was fitted to, {spans[name][0]:g} to {spans[name][1]:g}"
        for name, value in sorted(at.items())
        if name in spans and not spans[name][0] <= value <= spans[name][1]
    )


def _spans(model: Model, names: Sequence[str]) -> str:
    spans = {} if model.record is None else model.record.covariate_spans
    told = [f"{name} {spans[name][0]:g} to {spans[name][1]:g}" for name in names if name in spans]
    return f"; the data had {', '.join(told)}" if told else ""


def _no_program_tells(names: Sequence[str]) -> str:
    heads = {name.rpartition("_")[0] for name in names if name.rpartition("_")[2] in AXES}
    told = [what for head, what in _NO_PROGRAM_TELLS.items() if head in heads]
    return f"; a program does not tell {'; nor '.join(told)}" if told else ""
