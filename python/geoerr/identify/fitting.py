"""The total-least-squares line of each pass, and the passes that cannot be what they say."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from geoerr.geometry import fit_lines
from geoerr.identify.along import FittedPass
from geoerr.identify.measurements import Measurements
from geoerr.identify.passes import Pass

# Travel that differs from the commanded one by more than this factor is another unit, another axis or another target.
_LARGEST_RATIO = 1.25


def fit_passes(passes: Sequence[Pass], data: Measurements) -> tuple[list[FittedPass], list[str]]:
    """Fit a line to each pass.

    Components that were not measured count as 0: with one component the line is the axis itself.

    Returns
    -------
    fitted
        The usable passes.
    refused
        A sentence for each other one.
    """
    if not passes:
        return [], []
    points = [np.where(one.components, data.measured_mm[one.rows], 0.0) for one in passes]
    starts = np.concatenate([[0], np.cumsum([len(part) for part in points])])
    lines = fit_lines(np.concatenate(points), starts[:-1])
    fitted: list[FittedPass] = []
    refused: list[str] = []
    for number, one in enumerate(passes):
        if not lines.is_ok[number]:
            refused.append(f"{one.named()} was left out: its points are one point or spread in all directions")
            continue
        along = lines.along_mm[starts[number] : starts[number + 1]]
        # The line points from its first row to its last; travel must grow with q.
        centered = one.position_mm - one.position_mm.mean()
        sense = 1.0 if float(centered @ along) >= 0.0 else -1.0
        candidate = FittedPass(
            source=one,
            direction=sense * one.sign * lines.direction[number],
            along_mm=sense * along,
            rms_mm=float(lines.rms_mm[number]),
        )
        problem = _travel_problem(candidate, float(centered @ candidate.along_mm) / float(centered @ centered))
        if problem is None:
            fitted.append(candidate)
        else:
            refused.append(f"{one.named()} was left out: {problem}")
    return fitted, refused


def _travel_problem(candidate: FittedPass, ratio: float) -> str | None:
    axis = candidate.source.axis.upper()
    if not candidate.shows_travel:
        return None
    if not all(candidate.source.components) and candidate.direction[candidate.source.index] < 0.0:
        return f"the target moved towards −{axis} where +{axis} was commanded; check carrier and signs"
    if 1.0 / _LARGEST_RATIO < ratio < _LARGEST_RATIO:
        return None
    return f"the target travelled {ratio:.3g} mm for each mm commanded along {axis}; check unit, carrier and target"
