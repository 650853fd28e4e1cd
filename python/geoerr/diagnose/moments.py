"""Moments on the clock of all sessions, as the session has them that was being measured then.

The clock lays sessions end to end, for a jump may lie in any of them. Nobody reads that clock: files have their own.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any

import numpy as np

from geoerr.fit.sightings import Sightings
from geoerr.fit.variables import clock_s, times_s
from geoerr.summaries import number_words
from geoerr.terms import CLOCK_NAME, Term


@dataclass(frozen=True)
class Moment:
    """When something was.

    Attributes
    ----------
    session
        Its name; None where there is only one.
    t
        On the session's own clock.
    between
        The rows before and after, on that clock: within these a jump may lie anywhere.
    unit
        `s`, or `rows` where the data have no time.
    """

    session: str | None
    t: float
    between: tuple[float, float]
    unit: str

    def words(self) -> str:
        """Say it: `session hot, between t = 810 and 816 s`."""
        first, last = (number_words(value) for value in self.between)
        # People count from one.
        rows = " and ".join(f"{value + 1:.0f}" for value in self.between)
        span = f"between t = {first} and {last} s" if self.unit == "s" else f"between its rows {rows}"
        return span if self.session is None else f"session {self.session}, {span}"

    def to_document(self) -> dict[str, Any]:
        """Give it for JSON, beside a parameter's value: its session's own time, and the rows around."""
        return {
            "unit": self.unit,
            "session": self.session,
            "session_t": self.t,
            "session_between": list(self.between),
        }


def moments_of(term: Term, sightings: Sightings) -> dict[str, Moment]:
    """Give for each inner parameter of a term that is a moment on the clock (`clock - t0`) when that was."""
    texts = [text for part in term.parts for text in (part.expression or "", *(own for _, own in part.definitions))]
    names = [
        one.name
        for one in term.inner
        if np.isfinite(one.value)
        and any(re.search(rf"(?<!\w){CLOCK_NAME}\s*-\s*{re.escape(one.name)}(?!\w)", text) for text in texts)
    ]
    return {one.name: moment_of(one.value, sightings) for one in term.inner if one.name in names}


def moment_of(clock: float, sightings: Sightings) -> Moment:
    """Give a time on the clock of all sessions (`geoerr.fit.variables.clock_s`) as the session has it."""
    on_clock, own = clock_s(sightings), times_s(sightings)
    ends = [float(on_clock[sightings.session == number].max()) for number in range(len(sightings.sessions))]
    number = min(int(np.searchsorted(ends, clock)), len(ends) - 1)
    rows = np.flatnonzero(sightings.session == number)
    shift = float(own[rows].min() - on_clock[rows].min())
    times = np.unique(own[rows])
    t = clock + shift
    after = int(np.clip(np.searchsorted(times, t), 1, max(len(times) - 1, 1)))
    between = (float(times[after - 1]), float(times[min(after, len(times) - 1)]))
    has_times = "t" in sightings.table.columns and bool(np.isfinite(sightings.numbers("t")[rows]).all())
    name = sightings.sessions[number] if len(ends) > 1 else None
    return Moment(name, t, between, "s" if has_times else "rows")


def span_words(first: int, last: int, sightings: Sightings) -> str:
    """Say when rows were, from one to another: `session hot, t 810 to 900`."""
    times = times_s(sightings)
    ends = [number_words(float(times[row])) for row in (first, last)]
    if len(sightings.sessions) == 1:
        return f"t {ends[0]} to {ends[1]}"
    names = [sightings.sessions[int(sightings.session[row])] for row in (first, last)]
    if names[0] == names[1]:
        return f"session {names[0]}, t {ends[0]} to {ends[1]}"
    return f"session {names[0]}, t {ends[0]}, to session {names[1]}, t {ends[1]}"
