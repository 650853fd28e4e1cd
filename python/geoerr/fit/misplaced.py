"""Targets that stand elsewhere than their offsets say: exchanged ids, a wrong sign, another unit.

Where a target sits is fitted, for nobody glues a plate to the micrometre; its stated offset is its lever. One that is
a hand's breadth off is no matter of glue, and its levers are wrong as well.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from geoerr.fit.sightings import Numbers, Sightings
from geoerr.fit.start import nominal_mm
from geoerr.machine import Machine
from geoerr.observations import CARRIERS

# Further than a plate is glued on askew, and than errors of a machine that can be fitted.
_MISPLACED_MM = 15.0
_FEWEST_ROWS = 4
# Rows of a target lie in a plane at least where their second spread is this share of the first.
_FLAT = 0.05


def misplaced_targets(sightings: Sightings, machine: Machine) -> Iterator[str]:
    """Say of each session which target stands elsewhere than stated, seen from another on the same carrier."""
    complete = sightings.is_measured.all(axis=1) & (sightings.carrier != CARRIERS.index("base"))
    if not complete.any():
        return
    nominal = nominal_mm(machine, sightings)
    of_session = np.where(complete, sightings.session, -1)
    for number, carrier in np.unique(np.column_stack([of_session, sightings.carrier])[complete], axis=0):
        targets = _targets(sightings, np.flatnonzero((of_session == number) & (sightings.carrier == carrier)))
        shifts = _shifts_mm(nominal, sightings.measured_mm, targets)
        for own, shift in zip(targets[1:], shifts[1:], strict=True):
            off_mm = float(np.linalg.norm(shift - shifts[0]))
            if off_mm > _MISPLACED_MM:
                yield (
                    f"in session {sightings.sessions[number]!r} the target at {_offset(sightings, own[0])} is seen "
                    f"{off_mm:.0f} mm from there, beside that at {_offset(sightings, targets[0][0])}: exchanged "
                    "targets, or an offset of another sign, order or unit; their levers are wrong, too"
                )
                break


def _targets(sightings: Sightings, rows: np.ndarray) -> list[np.ndarray]:
    """Give the rows of each target that has enough of them, in the order of their first."""
    _, of_target = np.unique(np.round(sightings.offset_mm[rows], 3), axis=0, return_inverse=True)
    targets = [rows[of_target.ravel() == one] for one in range(int(of_target.max(initial=-1)) + 1)]
    return sorted((own for own in targets if len(own) >= _FEWEST_ROWS), key=lambda own: int(own[0]))


def _shifts_mm(nominal_mm: Numbers, measured_mm: Numbers, targets: list[np.ndarray]) -> list[Numbers]:
    """Give by what each target's points are shifted, turned as their motion is; none where that tells no turn."""
    if len(targets) < 2:
        return [np.zeros(3)] * len(targets)
    meant = [nominal_mm[own] - nominal_mm[own].mean(axis=0) for own in targets]
    seen = [measured_mm[own] - measured_mm[own].mean(axis=0) for own in targets]
    left, size, right = np.linalg.svd(np.concatenate(seen).T @ np.concatenate(meant))
    if not size[1] > _FLAT**2 * size[0]:
        return [np.zeros(3)] * len(targets)
    turn = left @ np.diag([1.0, 1.0, np.linalg.det(left @ right)]) @ right
    return [measured_mm[own].mean(axis=0) - turn @ nominal_mm[own].mean(axis=0) for own in targets]


def _offset(sightings: Sightings, row: int) -> str:
    x, y, z = sightings.offset_mm[row]
    return f"({x:g}, {y:g}, {z:g}) mm on the {CARRIERS[sightings.carrier[row]]}"
