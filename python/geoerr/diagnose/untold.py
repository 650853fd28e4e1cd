"""Rows of which nobody knows from which side their axis came: a search goes on without them.

A candidate that follows directions is 0 at such a row, and the machine is not: beside half of a play of 16 noises it
would have to step there, within a pass, which no offset of passes or drift takes over. One such row of 160 made
nothing of a play that every other row shows. A fit leaves them out where its model follows directions. A stated
direction that is against the way there, in few rows and unlike those around, is likelier a slip, and does the same.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from geoerr.fit.classic import moves_in_its_pass
from geoerr.fit.odd_directions import odd_rows
from geoerr.fit.sightings import Sightings
from geoerr.fit.variables import variable_columns
from geoerr.machine import AXES

# Where more rows than this share of them would go, all stay.
_MOST_UNTOLD = 0.5


def untold_rows(sightings: Sightings) -> npt.NDArray[np.bool_]:
    """Tell in which rows an axis came from nobody knows where that moves in the row's pass, (n,).

    One that rests in a pass is what it is there: an offset, whichever side it came from. Where the file has a
    direction that contradicts the way and the rows around, nobody knows either.
    """
    if not len(sightings):
        return np.zeros(0, dtype=bool)
    direction = variable_columns(sightings, [f"d_{axis}" for axis in AXES]).T
    moves = np.stack([moves_in_its_pass(sightings, along_mm) for along_mm in sightings.commanded_mm.T], axis=1)
    # From which side the ends of a length were made is asked of effects that follow it alone.
    untold = np.asarray((np.isnan(direction) & moves).any(axis=1)) & ~sightings.of_kind("lengths")
    for is_odd in sightings.once("odd_rows", odd_rows).values():
        untold |= is_odd
    return untold if untold.mean() <= _MOST_UNTOLD else np.zeros(len(untold), dtype=bool)
