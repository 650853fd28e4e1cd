"""Stated directions that are unlike those of the rows around them: one such row would hide a play that all show."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import numpy.typing as npt

from geoerr.fit.sightings import Sightings
from geoerr.machine import AXES
from geoerr.summaries import counted

# A plan that approaches some places from beyond does so in more rows.
_FEW = 0.02
# A sign that is exchanged is so in nearly all rows that have a way there, and there are so many.
_NEARLY_ALL, _FEWEST = 0.9, 20


def odd_rows(sightings: Sightings) -> dict[str, npt.NDArray[np.bool_]]:
    """Tell of each axis, by its name, which few rows have it come against the way, unlike the rows around, (n,)."""
    goes_on = np.diff(sightings.session) == 0
    if "line" in sightings.table.columns:
        line = np.unique(sightings.texts("line"), return_inverse=True)[1]
        goes_on &= np.diff(line) == 0
    odd = {}
    for number, axis in enumerate(AXES):
        stated = sightings.numbers(f"dir_{axis}")
        if not np.isfinite(stated).any() or len(sightings) < 3:
            continue
        way = np.sign(np.diff(sightings.commanded_mm[:, number]))
        # Rows with one before and one behind on the way that they are on.
        is_odd = goes_on[:-1] & goes_on[1:] & (way[:-1] != 0.0) & (way[:-1] == way[1:]) & (stated[1:-1] == -way[:-1])
        is_odd &= (stated[:-2] == way[:-1]) & (stated[2:] == way[1:])
        if 0 < is_odd.sum() <= max(_FEW * len(sightings), 1.0):
            odd[axis] = np.concatenate([[False], is_odd, [False]])
    return odd


def odd_directions(sightings: Sightings) -> Iterator[str]:
    """Say of each axis in how many rows the file has it come against the way there, unlike in the rows around it."""
    for axis, is_odd in sightings.once("odd_rows", odd_rows).items():
        row = int(sightings.source_row[int(np.argmax(is_odd))])
        yield (
            f"dir_{axis} of {counted(int(is_odd.sum()), 'row')} (the first: row {row + 1} of the measurements) is "
            "against the way there and unlike the rows before and behind: if it is a slip, mend it; a search for "
            "what is missing goes on without such rows, of which one would hide a play"
        )
    yield from _exchanged(sightings)


def _exchanged(sightings: Sightings) -> Iterator[str]:
    """Say of which axis the file has nearly all rows come against the way there, both ways."""
    goes_on = np.diff(sightings.pass_number) == 0
    for number, axis in enumerate(AXES):
        stated = sightings.numbers(f"dir_{axis}")[1:]
        way = np.sign(np.diff(sightings.commanded_mm[:, number]))
        shares = []
        for sign in (-1.0, 1.0):
            told = goes_on & (way == sign) & np.isfinite(stated)
            shares.append(float((stated[told] == -sign).mean()) if told.sum() >= _FEWEST else 0.0)
        if min(shares) > _NEARLY_ALL:
            yield (
                f"dir_{axis} is against the way there in nearly all rows, both ways: +1 is where {axis} has grown; "
                "unless every place was approached from beyond its sign is exchanged, and play comes out negative"
            )
