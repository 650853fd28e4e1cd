"""The range of positions that all states share: where their errors are compared.

Bases must be the same in all states, and reach from end to end of what takes part. Where a line starts a little
further in, or a homing was a hundredth of a millimetre off, a function's last piece follows what is beside it; far
beyond the ends of a state nothing of it is told, and rows of others there take no part.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from geoerr.errors import GeometryError
from geoerr.fit import sightings_of
from geoerr.fit.classic import moves_in_its_pass
from geoerr.fit.sightings import SAME_POSITION_MM, Numbers
from geoerr.machine import AXES
from geoerr.observations import Observations
from geoerr.summaries import counted

# Rows beyond the common range by no more than this share of it take part.
_MARGIN = 0.1

Range = tuple[float, float]


def within_common_range(
    tables: Mapping[float, Observations],
) -> tuple[dict[float, Observations], dict[str, Range], tuple[str, ...]]:
    """Leave out what lies far beyond the range that all states share.

    Parameters
    ----------
    tables
        Temperature to rows.

    Returns
    -------
    tables, range_mm, notes
        Rows that take part; axis to the range over which states are compared; what was left out, in words.

    Raises
    ------
    GeometryError
        where the states share no range, or nothing of one is left.
    """
    reach = {temperature: _reach(table) for temperature, table in tables.items()}
    range_mm: dict[str, Range] = {}
    for index, axis in enumerate(AXES):
        first = max(reach, key=lambda temperature: float(reach[temperature][index, 0]))
        last = min(reach, key=lambda temperature: float(reach[temperature][index, 1]))
        low, high = float(reach[first][index, 0]), float(reach[last][index, 1])
        if low > high:
            raise GeometryError(
                f"the states share no range of {axis}: at {called(first, tables[first])} it starts at {low:g} mm, at "
                f"{called(last, tables[last])} it ends at {high:g} mm\n"
                "hint: measure the same volume at every temperature"
            )
        range_mm[axis] = low, high
    kept, notes = {}, [note for temperature, table in tables.items() for note in _stood_still(temperature, table)]
    for temperature, table in tables.items():
        beyond = _beyond(table.commanded_mm, range_mm)
        is_lost = beyond.any(axis=1)
        notes += _lost(called(temperature, table), table.commanded_mm, beyond, range_mm)
        if is_lost.all():
            raise GeometryError(
                f"no row at {called(temperature, table)} lies within the range that all states share: "
                f"{_ranges(range_mm)}\nhint: measure the same volume at every temperature"
            )
        kept[temperature] = table.select(~is_lost) if is_lost.any() else table
    return kept, range_mm, tuple(notes)


def called(temperature_degc: float, table: Observations) -> str:
    """Name a state with its files."""
    file = f" ({', '.join(table.sources)})" if table.sources else ""
    return f"{temperature_degc:g} °C{file}"


def _reach(table: Observations) -> Numbers:
    """Give lowest and highest position (3, 2) of each axis in passes in which it moves; of all where it never does.

    A line that stands beside the others has one position there, whatever these run over.
    """
    sightings, found = sightings_of(table), []
    for index in range(3):
        along_mm = sightings.commanded_mm[:, index]
        moves = moves_in_its_pass(sightings, along_mm)
        own = along_mm[moves] if moves.any() else table.commanded_mm[:, index]
        found.append((own.min(), own.max()))
    return np.array(found)


def _beyond(commanded_mm: Numbers, range_mm: Mapping[str, Range]) -> np.ndarray:
    """Tell along which axes rows lie far outside, (n, 3)."""
    low, high = np.array([range_mm[axis] for axis in AXES]).T
    margin = np.maximum(_MARGIN * (high - low), SAME_POSITION_MM)
    return np.asarray((commanded_mm < low - margin) | (commanded_mm > high + margin))


def _lost(state: str, commanded_mm: Numbers, beyond: np.ndarray, range_mm: Mapping[str, Range]) -> Iterator[str]:
    for index, axis in enumerate(AXES):
        own = commanded_mm[beyond[:, index], index]
        if own.size:
            low, high = range_mm[axis]
            yield (
                f"{own.size} of {counted(len(commanded_mm), 'row')} at {state} lie outside the range that all states "
                f"share, {axis} from {low:g} to {high:g} mm, and take no part: there {axis} is at {own.min():g} to "
                f"{own.max():g} mm"
            )


def _ranges(range_mm: Mapping[str, Range]) -> str:
    return ", ".join(f"{axis} from {low:g} to {high:g} mm" for axis, (low, high) in range_mm.items())


def _stood_still(temperature: float, table: Observations) -> Iterator[str]:
    """Name the axes that never moved in a state: because of it, none of the states is compared along them."""
    for axis, span in zip(AXES, np.ptp(table.commanded_mm, axis=0), strict=True):
        if span <= SAME_POSITION_MM:
            yield (
                f"the {axis} axis never moved at {called(temperature, table)}: its errors are not compared at any "
                "temperature, and there is no map over the volume"
            )
