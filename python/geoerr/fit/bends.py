"""Rows in motion on a bent path: their speed is along the tangent, not along the chord from the row before.

The chord leans by half of the angle to the next one. Beside a lag of 0.4 ms, two hundred rows of a circle left what
an acceleration would, and were named so.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from geoerr.fit.sightings import SEE_POSITIONS, Numbers, Sightings

# A path that turns by more than this from one chord to the next has a corner there; one that never turns by as much
# as the other is straight, and its chords are its tangents.
_CORNER_RAD, _STRAIGHT_RAD = 0.2, 1e-4
# Fewer rows are no path.
_FEWEST_ROWS = 5


def on_bends(sightings: Sightings, is_moving: npt.NDArray[np.bool_], feed_mm_min: Numbers) -> npt.NDArray[np.bool_]:
    """Tell which rows of points were taken on a bent path at one feed, (n,); circular tests are told otherwise.

    Rows of one session that follow each other in motion, at one feed, without a corner between them.
    """
    n = len(sightings)
    found = np.zeros(n, dtype=bool)
    if n < _FEWEST_ROWS or not is_moving.any():
        return found
    is_points = sightings.of_kind(*SEE_POSITIONS)
    chord = np.diff(sightings.commanded_mm, axis=0, prepend=np.nan)
    length = np.linalg.norm(chord, axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        along = chord / length[:, None]
        # Of the chord to a row against the one from it.
        turn_rad = 2.0 * np.arcsin(np.minimum(0.5 * np.linalg.norm(np.diff(along, axis=0), axis=1), 1.0))
    turn_rad = np.append(turn_rad, np.nan)
    goes_on = np.zeros(n, dtype=bool)
    # Whether a row is reached on the path that the one before it is on.
    goes_on[1:] = (
        (is_moving & is_points)[1:]
        & (is_moving & is_points)[:-1]
        & (np.diff(sightings.session) == 0)
        & (feed_mm_min[1:] == feed_mm_min[:-1])
        & (length[1:] > 0.0)
    )
    is_corner = goes_on & np.append(goes_on[1:], False) & ~(turn_rad <= _CORNER_RAD)
    # A corner ends the path that leads to it; what follows is another.
    starts = np.flatnonzero(~goes_on | np.append(False, is_corner[:-1]))
    for start, end in zip(starts, [*starts[1:], n], strict=True):
        inner = turn_rad[start + 1 : end - 1]
        if end - start >= _FEWEST_ROWS and inner.max(initial=0.0) > _STRAIGHT_RAD:
            found[start:end] = True
            # The core tells runs apart by rows that are on none.
            found[start] = start == 0 or not found[start - 1]
    return found
