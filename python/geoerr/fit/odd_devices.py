"""Runs of a laser or a dial among points of cameras, without a session of their own: one pose would hold for both."""

from __future__ import annotations

import itertools
from collections.abc import Iterator

import numpy as np

from geoerr.fit.sightings import Sightings
from geoerr.observations import CARRIERS, MEASURED
from geoerr.summaries import counted

_BASE = CARRIERS.index("base")
# Rows of a pass that lack a component throughout; of fewer, cameras may have seen no more.
_FEWEST = 5


def odd_devices(sightings: Sightings) -> Iterator[str]:
    """Name the first session in which passes lack a component in all their rows, and others have all three."""
    is_whole = sightings.is_measured.all(axis=1)
    n_rows, n_whole = (
        np.bincount(sightings.pass_number, weights=weights, minlength=sightings.n_passes)
        for weights in (None, is_whole.astype(np.float64))
    )
    lacks = ((n_whole == 0.0) & (n_rows >= _FEWEST))[sightings.pass_number] & (sightings.carrier != _BASE)
    for number, name in enumerate(sightings.sessions):
        own = sightings.session == number
        if sightings.frames[number] == "free" and (lacks & own).any():
            row = int(np.flatnonzero(lacks & own)[0])
            seen = ", ".join(itertools.compress(MEASURED, sightings.is_measured[row]))
            line = sightings.texts("line")[row]
            yield (
                f"in session {name!r} {counted(int((lacks & own).sum()), 'row')} of passes with {seen} alone (line "
                f"{line!r} the first) stand beside rows with all three: what was measured has one pose there; a "
                "laser or a dial needs a session of its own (the column session, or a file of its own)"
            )
            return
