"""How devices stand that never measure all three components, as far as it can be told.

Where a component is empty throughout, the measuring frame is parallel to the base: nobody can tell how it is tilted.

- Of two components the turn about the third can be told, and is known to no microradian beforehand: a plate lies on
  the table of a CMM as it may. 70 µrad of 650 mm are 45 µm at its rim, which would be squareness and straightness.
- Of runs that are measured across what moves, by a straight edge, a retroreflector or a dial over a plate, the slopes
  are how the device stands: nobody levels it to the microradians that straightness is measured to.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from geoerr.fit.sightings import Numbers, Sightings
from geoerr.fit.start import Frames


def turned_in_plane(
    frames: Frames, nominal_mm: Numbers, sightings: Sightings, static: np.ndarray
) -> tuple[Frames, Numbers | None]:
    """Turn the frames of sessions that measured two components, and give the unknown rest of each turn and slope.

    Parameters
    ----------
    frames
        As a start, parallel to the base.
    nominal_mm : (n, 3)
        Of a machine without errors.
    static : (n,)
        Rows of static targets: they have no nominal place.

    Returns
    -------
    Frames
        With the least-squares turn in the plane (Kabsch).
    derivative : (n, 3, k) or None
        Of the measured points by the remaining turn of sessions, and by tilts of those that saw across what moved,
        mm/rad.
    """
    rotations, translations = frames.rotations.copy(), frames.translations_mm.copy()
    derivatives: list[Numbers] = []
    for number, kind in enumerate(sightings.frames):
        if kind != "parallel":
            continue
        own = sightings.session == number
        seen = sightings.is_measured[own].any(axis=0)
        moving = own & ~static
        moved = sightings.axes_moved(moving)
        if moved.any() and not (moved & seen).any():
            derivatives += _tilts(nominal_mm, moving, moved, seen)
            continue
        if int(seen.sum()) != 2:
            continue
        missing = int(np.flatnonzero(~seen)[0])
        first, second = (missing + 1) % 3, (missing + 2) % 3
        both = own & sightings.is_measured[:, first] & sightings.is_measured[:, second] & ~static
        if not both.any():
            continue
        plane = [first, second]
        middle, seen_middle = nominal_mm[both].mean(axis=0), sightings.measured_mm[both].mean(axis=0)
        a = (nominal_mm[both] - middle)[:, plane]
        b = (sightings.measured_mm[both] - seen_middle)[:, plane]
        angle = float(np.arctan2((a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum(), (a * b).sum()))
        turn = np.eye(3)
        turn[np.ix_(plane, plane)] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
        rotations[number] = turn
        translations[number] = np.where(seen, seen_middle - turn @ middle, 0.0)
        about = np.zeros(3)
        about[missing] = 1.0
        lever = np.where(own[:, None], (nominal_mm - middle) @ turn.T, 0.0)
        derivatives.append(np.cross(about, lever)[:, :, None])
    turned = replace(frames, rotations=rotations, translations_mm=translations)
    return turned, np.concatenate(derivatives, axis=2) if derivatives else None


def _tilts(nominal_mm: Numbers, rows: np.ndarray, moved: np.ndarray, seen: np.ndarray) -> Iterator[Numbers]:
    """Give what tilts of a device do to the points (n, 3, 1) of rows (n,) of its session.

    `moved` and `seen` (3,) tell along which axes it went, and which components were measured: each tilts along each.
    """
    lever = np.where(rows[:, None], nominal_mm - nominal_mm[rows].mean(axis=0), 0.0)
    for along, across in itertools.product(np.eye(3)[moved], np.eye(3)[seen]):
        yield np.cross(np.cross(along, across), lever)[:, :, None]
