"""Rows that lie far from the others of their line: the arithmetic of the nine lines uses every row that there is."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from geoerr.identify.along import FittedPass
from geoerr.identify.linear import Numbers
from geoerr.identify.measurements import Measurements
from geoerr.observations import Observations
from geoerr.summaries import counted, place_of_row

# Errors of a machine bend a line, and no point of it stands so many times as far off as half of them do, and as its
# neighbours, which lie on the bend as well.
_TIMES_THE_USUAL, _TIMES_THE_NEIGHBOURS = 10.0, 4.0
_FEWEST_POINTS = 5


def lone_rows(passes: Sequence[FittedPass], data: Measurements, observations: Observations) -> Iterator[str]:
    """Say how many rows lie far from their line, and which is the farthest."""
    found = [(row, off_mm) for one in passes for row, off_mm in _far_off(one, data)]
    if not found:
        return
    row, off_mm = max(found, key=lambda each: each[1])
    place = place_of_row(float(observations.numbers("file_row")[row, 0]), row)
    are = "is" if len(found) == 1 else "are"
    yield (
        f"{counted(len(found), 'row')} {are} far from the others of the line, the farthest by {off_mm:.3g} mm "
        f"({place}): the nine lines' arithmetic uses them; leave them out, or let the joint method do so"
    )


def _far_off(one: FittedPass, data: Measurements) -> Iterator[tuple[int, float]]:
    """Give rows and how far they are off, mm, of a pass."""
    rows, position_mm = one.source.rows, one.source.position_mm
    order = np.argsort(position_mm, kind="stable")
    seen = data.measured_mm[rows[order]][:, one.source.components]
    if len(rows) < _FEWEST_POINTS:
        return
    off_mm = np.linalg.norm(seen - _median_line(position_mm[order], seen), axis=1)
    beside = np.pad(off_mm, 1, mode="edge")
    # The lower of two neighbours: the other may be a mistake, too; at an end the one that there is.
    neighbours = np.minimum(beside[:-2], beside[2:])
    neighbours[[0, -1]] = off_mm[[1, -2]]
    is_far = off_mm > np.maximum(_TIMES_THE_USUAL * np.median(off_mm), _TIMES_THE_NEIGHBOURS * neighbours)
    for place in np.flatnonzero(is_far):
        yield int(rows[order[place]]), float(off_mm[place])


def _median_line(position_mm: Numbers, seen_mm: Numbers) -> Numbers:
    """Give the points (k, c) of the line through most of them: median slope of all pairs (Theil & Sen)."""
    first, second = np.triu_indices(len(position_mm), 1)
    apart = position_mm[second] - position_mm[first]
    told = apart > 0.0
    slope = np.median((seen_mm[second] - seen_mm[first])[told] / apart[told, None], axis=0)
    return np.asarray(slope * position_mm[:, None] + np.median(seen_mm - slope * position_mm[:, None], axis=0))
