"""Rows beside a reversal of which the record does not tell on which side of it they lie.

A bar's angle is known no better than its rows are apart: it is counted from a start, at a feed that is nearly even,
and commanded positions are rounded. A row beside a reversal may have been read before it or behind it, and one row on
the wrong side of a gap of 20 µm looks like a wind-up, a spike and stick-slip. Where a search names several causes it
is made again without such rows, for what a reversal does shows in the rows behind: an explanation that needs fewer
holds. So it is where the one cause that is named dies away behind reversals: play, read on the other side in one row,
looks so. One cause that does not needs no such doubt, and is told best by all rows.

Nor does a record tell how an axis stood that reversed just before the first row of a run: whether the circle was
entered along itself, so that friction is still winding up, or from rest.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from geoerr.diagnose.circles.runs import Runs
from geoerr.fit.sightings import Numbers
from geoerr.terms import Term

_QUARTER_RAD = 0.5 * np.pi
# A side is told beyond one step of the rows, and beyond a degree whatever they are apart.
_UNTOLD_RAD = float(np.radians(1.0))
_ROUNDING = 1e-3
# Variables that begin anew at a reversal, and those that jump there.
_OF_PAST = ("s_", "t_rev_")
_OF_SIDES = ("d_", *_OF_PAST)
# Wind-up, spikes and stick-slip are over, or nearly, so far behind a reversal: of a circle of 100 mm two millimetres.
_ENTRY_RAD = float(np.radians(12.0))


def beside_reversals(runs: Runs) -> np.ndarray:
    """Tell which rows may lie on either side of a reversal, (n,)."""
    result = np.zeros(len(runs), dtype=bool)
    for own, turned, reach in _turned(runs):
        result[own] = np.abs(turned - _QUARTER_RAD * np.rint(turned / _QUARTER_RAD)) <= reach
    return result


def after_entry(runs: Runs) -> np.ndarray:
    """Tell which first rows of runs follow soon upon a reversal that the record does not show, (n,)."""
    result = np.zeros(len(runs), dtype=bool)
    for own, turned, reach in _turned(runs):
        last_rad = _QUARTER_RAD * np.floor((turned[0] + reach) / _QUARTER_RAD)
        result[own] = turned - last_rad < _ENTRY_RAD
    return result


def turns_at_reversals(term: Term) -> bool:
    """Tell whether a term differs between both sides of a reversal."""
    return any(name.startswith(_OF_SIDES) for name in term.variables)


def dies_away(term: Term) -> bool:
    """Tell whether a term follows how far or how long ago an axis turned: the first row behind says most of it."""
    return any(name.startswith(_OF_PAST) for name in term.variables)


def _turned(runs: Runs) -> Iterator[tuple[slice, Numbers, float]]:
    """Give of each run its rows, their angles in the direction of travel, and how near a reversal no side is told."""
    for number, own in enumerate(runs.slices):
        # The first row may have been left out: travel is counted from there.
        turned = runs.sense[number] * np.unwrap(runs.angle_rad[own])
        step = float(np.median(np.diff(turned)))
        yield own, turned, min(step, _UNTOLD_RAD) * (1.0 + _ROUNDING)
