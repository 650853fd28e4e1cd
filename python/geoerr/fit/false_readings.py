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
from geoerr.fit.sightings import Numbers, Sightings
from geoerr.summaries import counted, listed

# Colder and hotter is no part of a machine, in kelvins neither.
_COLDEST, _HOTTEST = -80.0, 700.0
# A reading this far from the ones before and behind it, which are ten times nearer to each other, is no temperature:
# what takes a minute to warm does not cool in the next.
_FAR_K, _NEAR = 30.0, 0.1
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
        is_false = _are_false(values, [rows for rows in sightings.rows_of_sessions if rows.start < rows.stop])
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


def _are_false(values: Numbers, sessions: list[slice]) -> np.ndarray:
    """Tell which readings (n,) are none."""
    is_false = (values < _COLDEST) | (values > _HOTTEST)
    for rows in sessions:
        known = np.flatnonzero(np.isfinite(values[rows]) & ~is_false[rows]) + rows.start
        if len(known) < 3:
            continue
        before, own, behind = values[known[:-2]], values[known[1:-1]], values[known[2:]]
        off = np.minimum(np.abs(own - before), np.abs(own - behind))
        is_false[known[1:-1]] |= (off > _FAR_K) & (np.abs(behind - before) < _NEAR * off)
    return is_false
