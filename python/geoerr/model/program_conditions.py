"""Conditions under which a program runs: what the model needs, what the moves tell, and what the data cover."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass

from geoerr.column_names import is_temperature
from geoerr.errors import GeoerrError
from geoerr.machine import AXES
from geoerr.model.conditions import OF_MOTION, Conditions, constants_of, refusal
from geoerr.model.finite import refuse_not_finite
from geoerr.model.model import Model
from geoerr.terms import SESSION_NAME

# A model that was tested over a span of a condition is trusted half of that span's width beyond it, with a note.
MOST_SPANS_BEYOND = 0.5
# A temperature that was held still was so within a few degrees.
_LEAST_WIDTH_DEGC = 4.0
# Every move of a program moves.
_TOLD = frozenset((*OF_MOTION, "moving"))
# Reached from below after a long stroke, and at rest.
_APPROACH = {"d": 1.0, "s": 100.0, "v": 0.0, "feed": 0.0}
# What no program tells, and how an effect that follows it is left out.
_NO_PROGRAM_TELLS = {
    "a": "accelerations: 0 leaves their effect out",
    "t_rev": "the time since a reversal: a long one, such as 1000, leaves out what dies away",
    "mean_v": "the mean speed of hours: it is what has warmed the machine",
}


def approach_conditions(model: Model) -> dict[str, float]:
    """Give the conditions of motion that the model follows, as they are where nothing else is stated."""
    motion = {name: _APPROACH[name if name in _APPROACH else name.partition("_")[0]] for name in OF_MOTION}
    return {name: value for name, value in {**motion, "moving": 1.0}.items() if name in model.conditions}


def without_waves_in_time(model: Model) -> Model:
    """Give what of a model a program can be corrected by: how a wave in time will stand then, nobody knows."""
    return model.without_terms(term.id for term in model.terms if term.is_wave_in_time)


def needed_conditions(model: Model) -> tuple[str, ...]:
    """Name what has to be stated for a program: all that the model follows and no move tells."""
    return tuple(name for name in without_waves_in_time(model).conditions if name not in _TOLD)


@dataclass(frozen=True)
class Extrapolated:
    """A stated condition that the data of the fit do not cover.

    Attributes
    ----------
    name, value
        What is stated.
    low, high
        Span of the data.
    is_reference
        Whether it is the machine's reference temperature: where what follows the temperature is 0 by definition.
    sessions
        Of a session those that were measured; empty where a model does not tell.
    """

    name: str
    value: float
    low: float
    high: float
    is_reference: bool = False
    sessions: tuple[int, ...] = ()

    @property
    def beyond(self) -> float:
        """How far outside, in the condition's unit."""
        return max(self.low - self.value, self.value - self.high)

    @property
    def spans(self) -> float:
        """How far outside, in widths of the span; infinite beside a span of one value."""
        if self.name == SESSION_NAME:
            # Nothing is known of how the machine was, however near the number.
            return math.inf
        width = max(self.high - self.low, _LEAST_WIDTH_DEGC if is_temperature(self.name) else 0.0)
        return self.beyond / width if width > 0.0 else math.inf

    @property
    def is_far(self) -> bool:
        """Whether it is so far outside that nobody should rely on it without having been asked."""
        return self.spans > MOST_SPANS_BEYOND and not self.is_reference

    def __str__(self) -> str:
        """Say it in one sentence."""
        if self.name == SESSION_NAME:
            known = ", ".join(map(str, self.sessions)) or f"{self.low:g} to {self.high:g}"
            return f"session {self.value:g} is none that was measured: the model's are {known}"
        unit = " °C" if is_temperature(self.name) else ""
        side = "above" if self.value > self.high else "below"
        span = f"{self.low:g} to {self.high:g}{unit}" if self.high > self.low else f"nothing but {self.low:g}{unit}"
        share = (
            f", {self.spans:.2g} of that span's width" if math.isfinite(self.spans) and self.high > self.low else ""
        )
        return (
            f"{self.name} = {self.value:g} is extrapolated: {self.beyond:.3g}{unit} {side} what the model was fitted "
            f"to ({span}){share}"
        )


def program_conditions(model: Model, at: Conditions | None, *, extrapolates: bool = True) -> dict[str, float]:
    """Give the conditions of a program as one number each.

    Directions, travels, speeds and feed come from the moves; where one of them is stated it has precedence (`v_x=0`
    leaves out what follows that speed). Within `lag()` the mean speed is what has to be stated: a state that lasts.

    Parameters
    ----------
    extrapolates
        Whether a condition may lie outside the data of the fit by more than half of their span's width.

    Raises
    ------
    GeoerrError
        naming every condition that is needed and not given, with the spans of the data, a stated one that the model
        does not follow, those that are too far outside, and a term that gives no finite number under them.
    """
    given = constants_of(model.machine, at)
    refuse_unneeded(given, model.conditions)
    missing = [name for name in needed_conditions(model) if name not in given]
    if missing:
        problem, _, hint = refusal(missing, model.machine).partition("\n")
        raise GeoerrError(f"{problem}{_spans(model, missing)}{_no_program_tells(missing)}\n{hint}")
    far = [one for one in extrapolated_conditions(model, at) if one.is_far]
    if far and not extrapolates:
        raise GeoerrError(
            f"{'; '.join(map(str, far))}\n"
            "hint: a formula that holds where it was fitted need not hold there: measure in that state, or ask for "
            f"it (--extrapolate); up to {MOST_SPANS_BEYOND:g} of a span's width is taken with a note"
        )
    refuse_not_finite(model, given)
    return given


def refuse_unneeded(at: Conditions | None, follows: Collection[str]) -> None:
    """Refuse a stated condition that is not among those that a model follows: it may be a slip of the pen.

    Raises
    ------
    GeoerrError
        naming it.
    """
    for name in at or {}:
        if name not in follows:
            raise GeoerrError(f"the model does not depend on {name!r}\nhint: leave it out of the conditions")


def extrapolated_conditions(model: Model, at: Conditions | None) -> tuple[Extrapolated, ...]:
    """Give each stated condition, one number, that the data of the fit do not cover."""
    spans = {} if model.record is None else model.record.covariate_spans
    sessions = () if model.record is None else tuple(model.record.sessions.values())
    found = []
    for name, value in sorted(constants_of(model.machine, at).items()):
        known = sessions if name == SESSION_NAME else ()
        if name in spans and (not spans[name][0] <= value <= spans[name][1] or (known and value not in known)):
            found.append(Extrapolated(name, value, *spans[name], isinstance((at or {})[name], str), known))
    return tuple(found)


def _spans(model: Model, names: Sequence[str]) -> str:
    spans = {} if model.record is None else model.record.covariate_spans
    told = [f"{name} {spans[name][0]:g} to {spans[name][1]:g}" for name in names if name in spans]
    return f"; the data had {', '.join(told)}" if told else ""


def _no_program_tells(names: Sequence[str]) -> str:
    heads = {name.rpartition("_")[0] for name in names if name.rpartition("_")[2] in AXES}
    told = [what for head, what in _NO_PROGRAM_TELLS.items() if head in heads]
    return f"; a program does not tell {'; nor '.join(told)}" if told else ""
