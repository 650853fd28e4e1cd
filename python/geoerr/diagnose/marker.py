"""How far a static reference marker moved while a machine was measured: what moves it is the measuring device.

Targets of the machine and the marker are seen by the same cameras. What moves both alike is no error of the machine,
and what moves the machine's targets alone is none of the cameras.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geoerr.fit.sightings import Numbers, Sightings
from geoerr.fit.variables import times_s
from geoerr.observations import CARRIERS

# Means that a straight line is drawn through.
_FEWEST_MEANS = 5
# Rises that differ by less than so many standard errors are the same.
_SAME_STD = 2.0


@dataclass(frozen=True)
class Rise:
    """How much rows rise with time in a session, with its standard error, µm."""

    um: float
    std_um: float

    @property
    def is_none(self) -> bool:
        """Whether they may stand still."""
        return abs(self.um) < _SAME_STD * self.std_um

    def is_that_of(self, other: Rise) -> bool:
        """Tell whether both may be one."""
        return abs(self.um - other.um) < _SAME_STD * float(np.hypot(self.std_um, other.std_um))


def rises(sightings: Sightings, used: np.ndarray, residual_um: Numbers) -> tuple[Rise, Rise] | None:
    """Give how much markers rise with time in a session, and how much the machine's targets do; None without both.

    Parameters
    ----------
    used : (n,)
        Rows that take part.
    residual_um : (n,)
        One component of what a model leaves of each row.
    """
    is_marker = sightings.carrier == CARRIERS.index("base")
    of_marker, of_machine = (_rise(sightings, used & rows, residual_um) for rows in (is_marker, ~is_marker))
    return None if of_marker is None or of_machine is None else (of_marker, of_machine)


def _rise(sightings: Sightings, rows: np.ndarray, residual_um: Numbers) -> Rise | None:
    """Draw one slope through the means of passes, from each session's own level; by passes, for they have offsets."""
    own = np.flatnonzero(rows)
    passes, number = np.unique(sightings.pass_number[own], return_inverse=True)
    count = np.bincount(number)
    share, level_um = (
        np.bincount(number, weights=values[own]) / count for values in (_shares(sightings), residual_um)
    )
    session = np.zeros(len(passes), dtype=np.int64)
    session[number] = sightings.session[own]
    for one in np.unique(session):
        here = session == one
        share[here] -= share[here].mean()
        level_um[here] -= level_um[here].mean()
    dof = len(passes) - len(np.unique(session)) - 1
    along = float(share @ share)
    if len(passes) < _FEWEST_MEANS or dof < 1 or along == 0.0:
        return None
    um = float(share @ level_um) / along
    scatter_um2 = float(((level_um - um * share) ** 2).sum()) / dof
    return Rise(um, float(np.sqrt(scatter_um2 / along)))


def _shares(sightings: Sightings) -> Numbers:
    """Give how much of its session had gone by at each row, (n,), from 0 to 1."""
    times = times_s(sightings)
    n_sessions = len(sightings.sessions)
    first, last = np.full(n_sessions, np.inf), np.full(n_sessions, -np.inf)
    np.minimum.at(first, sightings.session, times)
    np.maximum.at(last, sightings.session, times)
    span = np.maximum(last - first, np.finfo(np.float64).tiny)
    return np.asarray((times - first[sightings.session]) / span[sightings.session])
