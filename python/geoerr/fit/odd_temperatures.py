"""Temperatures that are in another unit than degrees Celsius, and such as scatter more than what they show."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence

import numpy as np

from geoerr.column_names import is_temperature
from geoerr.fit.looks import begins_look
from geoerr.fit.sightings import Numbers, Sightings

_KELVIN_DEGC = 273.15
# Rooms, beds and frames, as a thermometer in kelvins has them. What is as hot in degrees melts filament.
_LOW_K, _HIGH_K = _KELVIN_DEGC, _KELVIN_DEGC + 60.0
_HOT = re.compile(r"nozzle|hot_?end|extruder|spindle|tool|head|heater(?!_bed)|_e\d")
# The share of its variance that a temperature's scatter is: of less nothing is said, and of more it shows nothing
# that an effect could follow.
_LEAST_SCATTER, _MOST_SCATTER = 0.02, 0.5
_FEWEST = 30
# The share of second differences that the scatter is told from, and how many standard deviations of theirs, which is
# √6 of a reading's, the largest of so many has. The others are jumps, of a heater that is switched.
_BELOW, _AT = 0.9, 1.6449
# How large one may be, in standard deviations of a reading, and half of what each takes back of the one before.
_MOST_BENT, _TAKEN_BACK = 6.0, 1.0 / 3.0


def odd_temperatures(sightings: Sightings) -> Iterator[str]:
    """Say so where a temperature looks like one in kelvins, and where its readings scatter."""
    for name in sightings.table.columns:
        if not is_temperature(name):
            continue
        values = sightings.numbers(name)
        known = values[np.isfinite(values)]
        if len(known) and not _HOT.search(name) and known.min() >= _LOW_K and known.max() <= _HIGH_K:
            yield (
                f"{name} is {known.min():g} to {known.max():g}: temperatures are in °C, and these look like kelvins "
                f"(subtract {_KELVIN_DEGC:g})"
            )
        yield from _scattered(name, sightings)


def _changes(values_k: Numbers) -> Numbers:
    """Give readings (n,) where they change: one that is held, or noted once a pass, does not scatter."""
    known_k = values_k[np.isfinite(values_k)]
    return np.asarray(known_k[np.diff(known_k, prepend=np.nan) != 0.0])


def _go_up_and_down(bends_k: Sequence[Numbers], most_k: float) -> bool:
    """Tell second differences of scatter, of which each takes back two thirds of the one before, from a curve's.

    Parameters
    ----------
    most_k
        Those of a jump are as large; they count as no more.
    """
    bends_k = [np.clip(own_k, -most_k, most_k) for own_k in bends_k]
    taken_back = sum(float(own_k[1:] @ own_k[:-1]) for own_k in bends_k)
    return taken_back < -_TAKEN_BACK * sum(float(own_k @ own_k) for own_k in bends_k)


def _scattered(name: str, sightings: Sightings) -> Iterator[str]:
    """Say by how much readings scatter, and what that does to what follows them.

    A straight line on a variable whose errors are the share s of its variance is flatter by s (Fuller, Measurement
    Error Models (1987), §1.1.1).
    """
    values = sightings.numbers(name)
    is_first = sightings.once("begins_look", begins_look)
    sessions = [_changes(values[rows][is_first[rows]]) for rows in sightings.rows_of_sessions]
    sessions = [own_k for own_k in sessions if len(own_k) >= _FEWEST]
    if not sessions:
        return
    bends_k = [np.diff(own_k, n=2) for own_k in sessions]
    scatter_k = float(np.quantile(np.abs(np.concatenate(bends_k)), _BELOW)) / (_AT * math.sqrt(6.0))
    if not _go_up_and_down(bends_k, _MOST_BENT * scatter_k):
        return
    all_k = np.concatenate(sessions)
    share = scatter_k**2 / float(all_k.var()) if np.ptp(all_k) > 0.0 else 0.0
    if _LEAST_SCATTER < share < _MOST_SCATTER:
        yield (
            f"{name} scatters by {scatter_k:.2g} K from look to look, where it varies by {all_k.std():.2g} K: if the "
            f"sensor scatters, what follows it comes out {100.0 * share:.0f} % too small, or gets a lag that smooths "
            "it; give means of several readings"
        )
