"""Stretches of an axis in which nothing was measured, wide beside what is between its other places.

A curve that is told on both sides goes through such a stretch as smoothly as it can. Its standard error is that of
its values at places, carried on: that a machine is off by something else in between is in no uncertainty.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from geoerr.fit.classic import positions_by_axis
from geoerr.fit.sightings import SAME_POSITION_MM, Sightings
from geoerr.machine import AXES, Machine
from geoerr.summaries import counted

# As a share of the way between the outermost places, and beside the median distance of two. Of 24 places that are
# drawn anywhere one set in thirty has a gap of a quarter.
_WIDE_SHARE, _WIDE = 0.25, 4.0
# As a share of the axis's range: less is no way of an axis, but how it stands.
_LEAST_SHARE = 0.05


def wide_gaps(sightings: Sightings, machine: Machine) -> Iterator[str]:
    """Say of each axis where nothing was measured though it was before and behind, the widest first named."""
    positions = positions_by_axis(sightings.commanded_mm, SAME_POSITION_MM)
    for axis in AXES:
        places_mm = positions[axis]
        gap_mm = np.diff(places_mm)
        if gap_mm.size < 2:
            continue
        way_mm, range_mm = float(np.ptp(places_mm)), float(np.ptp(machine.axes[axis].range_mm))
        least_mm = max(_WIDE_SHARE * way_mm, _WIDE * float(np.median(gap_mm)), _LEAST_SHARE * range_mm)
        is_wide = gap_mm >= least_mm
        if not is_wide.any():
            continue
        widest = int(np.argmax(gap_mm))
        others = int(is_wide.sum()) - 1
        more = f" (and in {counted(others, 'other such gap')})" if others else ""
        low_mm, high_mm = places_mm[widest], places_mm[widest + 1]
        yield (
            f"nothing was measured between {axis} = {low_mm:.4g} and {high_mm:.4g} mm{more}: there a fit goes on as "
            "smoothly as it can, and no uncertainty holds what else the machine does; measure a few places in "
            "between, or keep to where it was measured"
        )
