"""Lines that hold many strokes: what differs between going and coming back is taken for what passes share."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from geoerr.fit.sightings import SAME_POSITION_MM, SEE_POSITIONS, Sightings
from geoerr.summaries import counted

# So many strokes to a pass are a grid that was run back and forth, not a line and its way back.
_MANY = 3
# A stroke has so many rows on average: of scattered points each is come to from anywhere.
_FEWEST_ROWS = 3


def odd_lines(sightings: Sightings) -> Iterator[str]:
    """Say so where the rows of few passes go back and forth many times."""
    for number, rows in enumerate(sightings.rows_of_sessions):
        if sightings.frames[number] not in SEE_POSITIONS:
            continue
        n_passes = len(np.unique(sightings.pass_number[rows]))
        n_rows, n_strokes = rows.stop - rows.start, _n_strokes(sightings, rows)
        if n_strokes >= _MANY * n_passes and n_rows >= _FEWEST_ROWS * n_strokes:
            name, strokes = sightings.sessions[number], counted(n_strokes, "stroke")
            yield (
                f"in session {name!r} axes go back and forth in {strokes}, which the table counts as "
                f"{counted(n_passes, 'pass')} (rows of one line, repeat and direction): what differs between there "
                "and back is hardly told from what a pass has as a whole; give each stroke a name in the column line"
            )
            return


def _n_strokes(sightings: Sightings, rows: slice) -> int:
    """Count the strokes of the axis that turns most often."""
    steps = np.diff(sightings.commanded_mm[rows], axis=0)
    most = 0
    for own in steps.T:
        moves = np.sign(own[np.abs(own) > SAME_POSITION_MM])
        most = max(most, 1 + int((np.diff(moves) != 0.0).sum()) if len(moves) else 0)
    return most
