"""Looks: rows of one moment, in which several targets were seen, or one."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from geoerr.fit.sightings import SAME_POSITION_MM, Sightings
from geoerr.fit.variables import times_s


def begins_look(sightings: Sightings) -> npt.NDArray[np.bool_]:
    """Tell which rows begin a new moment, (n,)."""
    keys = np.column_stack([sightings.session, times_s(sightings)])
    same = (keys[1:] == keys[:-1]).all(axis=1)
    same &= (np.abs(np.diff(sightings.commanded_mm, axis=0)) <= SAME_POSITION_MM).all(axis=1)
    if "t" not in sightings.covariate_columns:
        # Without times another target at the same place is the same moment.
        same_place = (np.abs(np.diff(sightings.commanded_mm, axis=0)) <= SAME_POSITION_MM).all(axis=1)
        other = (np.diff(sightings.offset_mm, axis=0) != 0.0).any(axis=1) | (np.diff(sightings.carrier) != 0)
        same = same_place & other & (np.diff(sightings.session) == 0)
    return np.concatenate([[True], ~same])
