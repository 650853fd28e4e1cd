"""Readings of a thermometer that are none: what it gives when its wire is broken, and single ones far off.

A sensor that fails reads −127, 999 or whatever its driver has for that, and what follows its column then fits these
rows, not the machine: of five such readings among five hundred rows another sensor was the cause for certain. They
are left out as if the cells were empty.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import polars as pl

from geoerr.column_names import is_temperature
from geoerr.fit.looks import begins_look
from geoerr.fit.sightings import Numbers, Sightings
from geoerr.summaries import counted, listed

# Colder and hotter is no part of a machine, in kelvins neither.
_COLDEST_DEGC, _HOTTEST_DEGC = -80.0, 700.0
# A reading this far from the ones before and behind it, which are ten times nearer to each other, is no temperature
# where such are few: what takes a minute to warm does not cool in the next.
_FAR_K, _NEAR, _FEW = 30.0, 0.1, 0.05
# Values that a note names.
_SPOKEN = 3


def without_false_readings(sightings: Sightings) -> Sightings:
    """Give sightings with false readings of temperatures empty, and a note of each column that had some."""
    cleaned: list[pl.Series] = []
    notes: list[str] = []
    for name in sightings.table.columns:
        if not is_temperature(name):
            continue
        values = sightings.numbers(name)
        is_false = (values < _COLDEST_DEGC) | (values > _HOTTEST_DEGC)
        is_false |= _stand_alone(sightings, np.where(is_false, np.nan, values))
        if is_false.any():
            cleaned.append(pl.Series(name, np.where(is_false, np.nan, values)).fill_nan(None))
            shown = [f"{value:g}" for value in dict.fromkeys(values[is_false].tolist())]
            more = ["..."] if len(shown) > _SPOKEN else []
            notes.append(
                f"{name} reads {listed([*shown[:_SPOKEN], *more])} in {counted(int(is_false.sum()), 'row')}: no "
                "temperature of a machine, or a single reading far from those around it; these cells count as empty"
            )
    if not cleaned:
        return sightings
    return replace(sightings, table=sightings.table.with_columns(cleaned), notes=(*sightings.notes, *notes))


def _stand_alone(sightings: Sightings, values_degc: Numbers) -> np.ndarray:
    """Tell in which rows (n,) a reading is far from those of the looks before and behind in its session."""
    is_first = sightings.once("begins_look", begins_look)
    look = np.cumsum(is_first) - 1
    of_look_degc, session = values_degc[is_first], sightings.session[is_first]
    is_alone = np.zeros(len(of_look_degc), dtype=bool)
    known = np.flatnonzero(np.isfinite(of_look_degc))
    before, own, behind = known[:-2], known[1:-1], known[2:]
    off_k = np.minimum(*(np.abs(of_look_degc[own] - of_look_degc[other]) for other in (before, behind)))
    is_near = np.abs(of_look_degc[behind] - of_look_degc[before]) < _NEAR * off_k
    is_alone[own] = (off_k > _FAR_K) & is_near & (session[before] == session[behind])
    # One that is switched between two looks is so in many.
    return is_alone[look] if is_alone.sum() <= _FEW * len(known) else np.zeros(len(values_degc), dtype=bool)
