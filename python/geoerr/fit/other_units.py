"""Positions that are in another unit than millimetres: distances in them are that much longer or shorter."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from geoerr.fit.sightings import SEE_POSITIONS, Numbers, Sightings
from geoerr.machine import AXES, Machine
from geoerr.observations import CARRIERS

# How long a millimetre is in it.
_UNITS = {"µm": 1e3, "inches": 1.0 / 25.4, "metres": 1e-3}
# No machine's scale is off by as much, nor two units as near.
_WITHIN = 0.02
_FEWEST_ROWS = 6
# A machine that is measured goes through so much of its travel, at least; in metres through a thousandth of that.
_SOME_TRAVEL = 0.1


def other_units(sightings: Sightings) -> Iterator[str]:
    """Say of each session that was measured in another unit in which one, from how far its targets moved."""
    for number, (name, own) in enumerate(zip(sightings.sessions, sightings.rows_of_sessions, strict=True)):
        if sightings.frames[number] not in SEE_POSITIONS:
            continue
        for carrier in np.unique(sightings.carrier[own]):
            if CARRIERS[carrier] == "base":
                continue
            rows = sightings.rows_of_session(number, sightings.carrier == carrier)
            unit = _unit_of(sightings, rows)
            if unit is not None:
                yield (
                    f"in session {name!r} what was measured goes {_UNITS[unit]:.4g} times as far as what was "
                    f"commanded: mx, my and mz are in millimetres, and these look like {unit}"
                )
                break


def places_in_metres(sightings: Sightings, machine: Machine) -> Iterator[str]:
    """Say so where all places look like metres, on a machine that travels by millimetres."""
    travel_mm = max(high - low for low, high in (machine.axes[axis].range_mm for axis in AXES))
    extent_mm = float(np.ptp(sightings.commanded_mm, axis=0).max()) if len(sightings) >= _FEWEST_ROWS else 0.0
    if _SOME_TRAVEL <= extent_mm / (travel_mm * _UNITS["metres"]) <= 1.0 + _WITHIN:
        yield (
            f"all places are within {extent_mm:.3g} mm, on a machine that travels {travel_mm:g}: x, y, z, mx, my and "
            "mz are in millimetres, and these look like metres"
        )


def _unit_of(sightings: Sightings, rows: np.ndarray) -> str | None:
    """Give the unit in which rows (k,) were measured; None where that is millimetres, or cannot be told."""
    seen = sightings.is_measured[rows]
    # Rows that have the same components.
    own = (seen == seen[0]).all(axis=1) if len(seen) else np.zeros(0, dtype=bool)
    if own.sum() < _FEWEST_ROWS:
        return None
    measured_mm = sightings.measured_mm[rows][own][:, seen[0]]
    places_mm = (sightings.commanded_mm[rows] + sightings.offset_mm[rows])[own]
    # A device along axes sees these alone; all three components see every distance.
    meant_mm = places_mm if seen[0].all() else places_mm[:, seen[0]]
    size = _spread(meant_mm)
    ratio = _spread(measured_mm) / size if size > 0.0 else 1.0
    return next((unit for unit, times in _UNITS.items() if abs(ratio / times - 1.0) < _WITHIN), None)


def _spread(points: Numbers) -> float:
    return float(np.sqrt(np.sum((points - points.mean(axis=0)) ** 2)))
