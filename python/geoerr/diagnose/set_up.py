"""What of a disagreement is the measuring frame's: as measured, shifted, turned.

Of a device that is parallel to the base (a laser, a CMM, a probe on the machine) one wants to know how far it was off
before its frame was fitted; a camera stands anywhere, and there is nothing to say.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geoerr.fit import Fitted
from geoerr.fit.sightings import Numbers

_UM_PER_MM = 1e3


@dataclass(frozen=True)
class SetUp:
    """Residuals, rms per component over all numbers, µm.

    Attributes
    ----------
    as_measured_um
        With the measuring frame where the file has it.
    shifted_um
        With the mean difference of each session and component taken off.
    turned_um
        With the frame as fitted: turned, too, where two components were measured.
    """

    as_measured_um: float
    shifted_um: float
    turned_um: float


def set_up_of(fitted: Fitted) -> SetUp | None:
    """Compare the measuring frames with the base; None where a session is a camera's or a circle's."""
    sightings = fitted.sightings
    if set(sightings.frames) != {"parallel"}:
        return None
    state = fitted.solved.state
    rotation, shift = np.asarray(state.rotations), np.asarray(state.translations_mm)
    in_frame = sightings.measured_mm - fitted.solved.residual_mm - shift[sightings.session]
    predicted = np.einsum("nji,nj->ni", rotation[sightings.session], in_frame)
    seen = sightings.is_measured & fitted.solved.used[:, None]
    raw = np.where(seen, sightings.measured_mm - predicted, 0.0)
    shifted = raw.copy()
    for number in range(len(sightings.sessions)):
        rows = sightings.session == number
        count = np.maximum(seen[rows].sum(axis=0), 1)
        shifted[rows] -= np.where(seen[rows], raw[rows].sum(axis=0) / count, 0.0)
    turned = np.where(seen, fitted.residual_mm, 0.0)
    return SetUp(*(_rms_um(values, seen) for values in (raw, shifted, turned)))


def _rms_um(values_mm: Numbers, seen: np.ndarray) -> float:
    return float(np.sqrt((values_mm**2).sum() / max(int(seen.sum()), 1))) * _UM_PER_MM
