"""The turn of a device that measures two components: a plate on a CMM table lies turned in its plane.

Where a component is empty throughout, the measuring frame is parallel to the base: nobody can tell how it is tilted.
How it is turned about the component that is missing can be told, and is known to no microradian beforehand: 70 µrad
of a plate of 650 mm are 45 µm at its rim, and would be taken for squareness and straightness of the machine.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from geoerr.fit.sightings import Numbers, Sightings
from geoerr.fit.start import Frames


def turned_in_plane(
    frames: Frames, nominal_mm: Numbers, sightings: Sightings, static: np.ndarray
) -> tuple[Frames, Numbers | None]:
    """Turn the frames of sessions that measured two components, and give the unknown rest of each turn.

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
        Of the measured points by the remaining turn of k sessions, mm/rad.
    """
    rotations, translations = frames.rotations.copy(), frames.translations_mm.copy()
    derivatives = []
    for number, kind in enumerate(sightings.frames):
        own = sightings.session == number
        seen = sightings.is_measured[own].any(axis=0)
        if kind != "parallel" or int(seen.sum()) != 2:
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
