"""Temperatures that are in another unit than degrees Celsius."""

from __future__ import annotations

import re
from collections.abc import Iterator

import numpy as np

from geoerr.column_names import is_temperature
from geoerr.fit.sightings import Sightings

_KELVIN_DEGC = 273.15
# Rooms, beds and frames, as a thermometer in kelvins has them. What is as hot in degrees melts filament.
_LOW_K, _HIGH_K = _KELVIN_DEGC, _KELVIN_DEGC + 60.0
_HOT = re.compile(r"nozzle|hot_?end|extruder|spindle|tool|head|heater(?!_bed)|_e\d")


def odd_temperatures(sightings: Sightings) -> Iterator[str]:
    """Say so where a temperature looks like one in kelvins."""
    for name in sightings.table.columns:
        if not is_temperature(name) or _HOT.search(name):
            continue
        values = sightings.numbers(name)
        known = values[np.isfinite(values)]
        if len(known) and known.min() >= _LOW_K and known.max() <= _HIGH_K:
            yield (
                f"{name} is {known.min():g} to {known.max():g}: temperatures are in °C, and these look like kelvins "
                f"(subtract {_KELVIN_DEGC:g})"
            )
