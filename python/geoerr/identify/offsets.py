"""Whether the stated target offsets agree with where the targets were seen.

An offset that is wrong by a share makes the angles wrong by the same share, and a mix-up of tx, ty and tz makes them
nonsense; nothing in the error functions would show it, but the measured distances between targets do.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from geoerr.identify.along import FittedPass
from geoerr.identify.frames import SessionFrame
from geoerr.identify.levers import nominal_position_mm
from geoerr.identify.measurements import Measurements
from geoerr.machine import Machine

# A plate's centre is stated to a few millimetres at worst; more, and more than this share, is a mistake.
_LARGEST_DIFFERENCE_MM = 5.0
_LARGEST_SHARE = 0.05


def offset_doubts(
    passes: Sequence[FittedPass], data: Measurements, frames: Mapping[str, SessionFrame], machine: Machine
) -> list[str]:
    """Give a sentence for each target that lies otherwise from the first one on its carrier than stated."""
    doubts: dict[str, None] = {}
    places: dict[tuple[str, str], dict[tuple[float, ...], tuple[str, list[np.ndarray]]]] = {}
    for one in passes:
        frame = frames[one.source.session]
        if frame.base_from_measured is None or frame.origin in ("parallel", "targets"):
            continue
        rows = one.source.rows
        carrier, offset = one.source.carrier, data.offset_mm[rows]
        seen = data.measured_mm[rows].mean(axis=0) @ frame.base_from_measured.T
        stated = nominal_position_mm(machine, carrier, data.commanded_mm[rows], offset).mean(axis=0)
        key = tuple(np.round(offset[0], 3).tolist())
        name = one.source.target or f"at {key}"
        places.setdefault((one.source.session, carrier), {}).setdefault(key, (name, []))[1].append(seen - stated)
    for (session, carrier), targets in places.items():
        (other_key, (other_name, others)), *further = targets.items()
        for key, (name, own) in further:
            difference = np.mean(own, axis=0) - np.mean(others, axis=0)
            stated_mm = np.subtract(key, other_key)
            limit = max(_LARGEST_DIFFERENCE_MM, _LARGEST_SHARE * float(np.linalg.norm(stated_mm)))
            if np.linalg.norm(difference) > limit:
                doubts[_sentence(session, carrier, name, other_name, stated_mm + difference, stated_mm)] = None
    return list(doubts)


def _sentence(session: str, carrier: str, name: str, other: str, seen_mm: np.ndarray, stated_mm: np.ndarray) -> str:
    return (
        f"session {session}: from target {other} to {name} ({carrier}) the data show {_vector(seen_mm)} mm, the "
        f"offsets tx ty tz say {_vector(stated_mm)} mm: angles are wrong by as much as the offsets"
    )


def _vector(values: np.ndarray) -> str:
    # Adding 0 turns −0 into 0.
    return "(" + ", ".join(f"{value:.0f}" for value in np.round(values) + 0.0) + ")"
