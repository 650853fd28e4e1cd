"""Whether a cause predicts: what is named beside others lowers the error where it was not fitted.

A cause that follows one corner of the record, or mends another's formula there, wins evidence and predicts nothing.
Arcs are left out one after the other, each in all runs at once: what happens at a reversal has to be told by the
other reversals, in one run as in many. Rows are weighed, and what wanders along the circle is taken off, as
everywhere (`Noise.whiten`).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from geoerr.diagnose.circles.found import Found
from geoerr.diagnose.circles.state import State
from geoerr.fit.sightings import Numbers

# A reversal lies in the middle of an arc.
_N_ARCS = 12


def without_idle(state: State, found: Sequence[Found]) -> tuple[list[Found], list[Found]]:
    """Give causes that lower the held-out error beside the others; and those that do not, the idlest first."""
    kept, dropped = list(found), list[Found]()
    while len(kept) > 1:
        whole = held_out_square(state, kept)
        without = [held_out_square(state, [*kept[:place], *kept[place + 1 :]]) for place in range(len(kept))]
        idlest = int(np.argmin(without))
        if without[idlest] > whole:
            break
        dropped.append(kept.pop(idlest))
    return kept, dropped


def held_out_square(state: State, found: Sequence[Found]) -> float:
    """Give the sum of squares of whitened rows, each predicted without its arc."""
    columns = np.concatenate([state.base, *(state.white(one) for one in found)], axis=1)
    columns = columns / np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    arc = np.mod(np.rint(state.runs.angle_rad * _N_ARCS / (2.0 * np.pi)), _N_ARCS)
    return float(sum(_square(columns, state.signal, arc == one) for one in np.unique(arc)))


def _square(columns: Numbers, signal: Numbers, left_out: np.ndarray) -> float:
    values = np.linalg.lstsq(columns[~left_out], signal[~left_out], rcond=1e-7)[0]
    return float(np.sum((signal[left_out] - columns[left_out] @ values) ** 2))
