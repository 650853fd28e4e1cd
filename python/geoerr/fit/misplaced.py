"""Targets that stand elsewhere than their offsets say: exchanged ids, a wrong sign, another unit.

Where a target sits is fitted, for nobody glues a plate to the micrometre; its stated offset is its lever. One that is
a hand's breadth off is no matter of glue, and its levers are wrong as well.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from geoerr.fit.sightings import Numbers, Sightings
from geoerr.fit.start import moving_targets, nominal_mm, turn_between
from geoerr.machine import Machine
from geoerr.observations import CARRIERS

# Further than a plate is glued on askew, and than errors of a machine that can be fitted.
_MISPLACED_MM = 15.0
_FEWEST_ROWS = 4
# Rows of a target lie in a plane at least where their second spread is this share of the first.
_FLAT = 0.05


def misplaced_targets(sightings: Sightings, machine: Machine) -> Iterator[str]:
    """Say of each session which target stands elsewhere than stated, seen from another on the same carrier."""
    on_base = sightings.carrier == CARRIERS.index("base")
    complete = sightings.is_measured.all(axis=1) & ~on_base
    if not complete.any():
        return
    nominal = nominal_mm(machine, sightings)
    together: dict[tuple[int, int], list[np.ndarray]] = {}
    for rows in sightings.once("moving_targets", moving_targets):
        own = rows[complete[rows]]
        if len(own) >= _FEWEST_ROWS:
            together.setdefault((sightings.session[own[0]], sightings.carrier[own[0]]), []).append(own)
    for targets in together.values():
        shifts = _shifts_mm(nominal, sightings.measured_mm, targets)
        first = targets[0][0]
        for own, shift in zip(targets[1:], shifts[1:], strict=True):
            off_mm = float(np.linalg.norm(shift - shifts[0]))
            if off_mm > _MISPLACED_MM:
                yield (
                    f"in session {sightings.sessions[sightings.session[first]]!r} the target at "
                    f"{sightings.place_of_target(own[0])} is seen {off_mm:.0f} mm from there, beside that at "
                    f"{sightings.place_of_target(first)}: exchanged targets, or an offset of another sign, order or "
                    "unit; their levers are wrong, too"
                )
                break


def _shifts_mm(nominal_mm: Numbers, measured_mm: Numbers, targets: list[np.ndarray]) -> list[Numbers]:
    """Give by what each target's points are shifted, turned as their motion is; none where that tells no turn."""
    meant, seen = (
        np.concatenate([points[own] - points[own].mean(axis=0) for own in targets])
        for points in (nominal_mm, measured_mm)
    )
    turn, spread = turn_between(meant, seen)
    if not spread[1] > _FLAT**2 * spread[0]:
        return [np.zeros(3)] * len(targets)
    return [measured_mm[own].mean(axis=0) - turn @ nominal_mm[own].mean(axis=0) for own in targets]
