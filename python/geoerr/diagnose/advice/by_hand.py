"""Plans whose outcome a person reads: homing again, which no formula of an effect knows of.

A jump that is over does nothing new in any plan: to every fit it is one more constant of the next set-up. What tells
a lost count from a knocked camera is that homing finds the count again.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from geoerr.diagnose.advice.course import Course
from geoerr.diagnose.advice.measurement import Measurement
from geoerr.diagnose.advice.menu_set_up import lines
from geoerr.diagnose.advice.question import question_of
from geoerr.diagnose.advice.situation import Situation
from geoerr.machine import AXES
from geoerr.summaries import listed
from geoerr.terms import CLOCK_NAME, SESSION_NAME, Term, mentions

_ALONG = {f"E{axis.upper()}{axis.upper()}" for axis in AXES}
_N_POINTS = 5
# How often an axis is homed where homing itself is in doubt.
_HOMINGS = 3


@dataclass(frozen=True, eq=False)
class ByHand:
    """A measurement, and how to read what comes of it."""

    measurement: Measurement
    reading: str

    @property
    def plan(self) -> str:
        """What to do, how long it takes, and what it says."""
        return f"{self.measurement.text()}. {self.reading}"


def by_hand(situation: Situation, terms: Sequence[Term]) -> ByHand | None:
    """Give what a person can tell candidates apart by where no fit can; None where that is nothing.

    Parameters
    ----------
    terms
        The candidates.
    """
    if situation.is_circular:
        return None
    lost = [term for term in terms if _is_lost_count(term)]
    homed = [term for term in terms if SESSION_NAME in term.variables and set(term.channels) <= _ALONG]
    if not lost and not homed:
        return None
    times = _HOMINGS if homed else 1
    readings = []
    if lost:
        names = listed([term.id for term in lost])
        readings.append(f"What {names} did is gone after homing; what anything else did stays")
    if homed:
        names = listed([term.id for term in homed])
        readings.append(f"What {names} does is another after each homing; what anything else does stays")
    return ByHand(home_again(situation, question_of([*lost, *homed]).axes, times), ". ".join(readings))


def home_again(situation: Situation, axes: Sequence[str], times: int = 1) -> Measurement:
    """Compare what axes show before and after they are homed, the cameras untouched."""
    course = Course(situation)
    lines(course, axes, " as it is", n_points=_N_POINTS)
    for number in range(times):
        course.home()
        lines(course, axes, " homed", number, n_points=_N_POINTS)
    again = "run the same again" if times == 1 else f"run the same again, {times} times over"
    words = (
        f"Without homing or switching off before, run {listed(list(axes))} there and back, {_N_POINTS} points each, "
        f"home all axes and {again}, the cameras untouched"
    )
    return Measurement("home-again", "homing again", words, course.pictures(), situation.targets)


def _is_lost_count(term: Term) -> bool:
    """Tell whether a term is a jump along an axis: its count was lost, and its switch finds it again."""
    is_jump = term.variables == (CLOCK_NAME,) and all(mentions(part.expression or "", "step") for part in term.parts)
    return is_jump and set(term.channels) <= _ALONG
