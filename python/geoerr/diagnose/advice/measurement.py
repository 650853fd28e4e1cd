"""A measurement that a user could make: what to do, in words and as pictures to be taken."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from geoerr.diagnose.advice.course import Pictures
from geoerr.diagnose.advice.situation import Target
from geoerr.fit.sightings import Numbers
from geoerr.summaries import listed

# What further carrying-outs of a measurement are called.
_TIMES = {1: "", 2: ", twice", 3: ", three times", 4: ", four times"}


@dataclass(frozen=True, eq=False, repr=False)
class Measurement:
    """A plan.

    Attributes
    ----------
    name
        For tables: what is done, and along which axes (`feeds:x`).
    title
        What differs from other measurements, in a few words.
    words
        What to do, in a sentence without an end.
    pictures
        When and where.
    targets
        What every picture shows.
    conditions
        Covariate to its prescribed values, (n,) each.
    set_ups
        For each session how the cameras stand against today: a turn about the middle of what was measured (rad), and
        a shift of that middle in the measuring frame (mm), (n_sessions, 2, 3).
    n_on_bar
        So many of the last targets sit on one static bar of known length; 0 where there is none.
    is_from_the_floor
        Whether cameras stand where no axis carries them, however the data were measured.
    is_circular
        Whether it is circular tests, with centre and radius free in each session.
    handling_minutes
        To prepare it, once however often it is carried out: targets to fix, a bar to stand up.
    """

    name: str
    title: str
    words: str
    pictures: Pictures
    targets: tuple[Target, ...]
    conditions: dict[str, Numbers] = field(default_factory=dict)
    set_ups: Numbers | None = None
    n_on_bar: int = 0
    is_from_the_floor: bool = False
    is_circular: bool = False
    handling_minutes: float = 0.0

    def __repr__(self) -> str:
        return f"<{self.name}: {len(self.pictures)} pictures, {self.minutes():.0f} min>"

    def minutes(self, times: int = 1) -> float:
        """Give how long it takes, carried out so often."""
        return self.handling_minutes + times * self.pictures.minutes

    @property
    def n_sessions(self) -> int:
        """Number of set-ups."""
        return int(self.pictures.session.max()) + 1

    def text(self, times: int = 1) -> str:
        """Say what to do, how often and how long it takes."""
        often = _TIMES.get(times, f", {times} times")
        return f"{self.words}{often}: {duration(self.minutes(times))}"


def duration(minutes: float) -> str:
    """Say a duration: minutes below two hours, else hours."""
    if minutes >= 120.0:
        return f"{minutes / 60.0:.1f} h"
    return f"{max(round(minutes), 1):d} min"


def feeds_words(feeds_mm_min: list[float]) -> str:
    """Name feeds: `300, 1000 and 3000 mm/min`."""
    return f"{listed([f'{feed:g}' for feed in feeds_mm_min])} mm/min"


def uneven(n: int) -> Numbers:
    """Give n shares from 0 to 1 whose steps have no common measure: every period shows in them."""
    steps = 0.5 + np.mod(np.arange(1, n) * 0.6180339887498949, 1.0)
    sums = np.cumsum(steps)
    return np.concatenate([[0.0], sums / sums[-1]])


def tidy(value: float) -> float:
    """Round a feed or an acceleration to one that a person would write."""
    size = 10.0 ** np.floor(np.log10(value))
    known = np.array([1.0, 1.2, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0])
    return float(size * known[np.argmin(np.abs(np.log(known * size / value)))])
