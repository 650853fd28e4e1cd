"""What a machine does not repeat: the scatter of repeated rows beyond the noise that they state."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
import numpy.typing as npt

from geoerr.budget.source import Source
from geoerr.fit import Fitted
from geoerr.fit.noise import repeats_of
from geoerr.fit.sightings import SEE_POSITIONS
from geoerr.machine import AXES
from geoerr.model.arrays import Numbers
from geoerr.observations import CARRIERS

_UM_PER_MM = 1e3


def repeatability_source(fitted: Fitted) -> Source | str:
    """Give the machine's repeatability, or a sentence that says why it is not counted.

    Rows are sorted by the axes that moved in their pass (an axis that is parked does not scatter, and a body that
    stands still shows the noise of measuring only); what the groups scatter beyond their stated noise is added up,
    since in a part all axes move. The degrees of freedom are those of differences of which one member is known,
    `(Σ s²)² / Σ (v²/ν)` (Welch, Satterthwaite).
    """
    stated = _stated_variance(fitted)
    variance, doubt, n_seen = np.zeros(3), np.zeros(3), 0
    for rows in _by_moving_axes(fitted):
        repeats = repeats_of(fitted.sightings, fitted.residual_mm, rows)
        for component in np.flatnonzero(repeats.dof > 0):
            n_seen += 1
            seen = rows & fitted.sightings.is_measured[:, component]
            again = seen & (np.bincount(repeats.group[seen], minlength=len(seen) + 1)[repeats.group] > 1)
            noise, dof = float(stated[again, component].mean()), float(repeats.dof[component])
            total = float(repeats.variance_mm2[component])
            variance[component] += total - noise
            doubt[component] += total**2 / dof
    if not n_seen:
        return "repeatability of the machine: no row was measured again under the same conditions"
    # A difference that does not exceed its own standard deviation √(2 Σ v²/ν) tells nothing.
    is_told = variance > np.sqrt(2.0 * doubt)
    variance, doubt = np.where(is_told, variance, 0.0), np.where(is_told, doubt, 0.0)
    if not variance.any():
        return "repeatability of the machine: repeats scatter no more than their stated noise"
    return Source(
        "repeatability",
        "what the machine does not repeat" + ("" if fitted.sightings.is_stated else " (with the noise of measuring)"),
        "A",
        "normal",
        math.sqrt(float(variance.sum())) * _UM_PER_MM,
        "µm",
        float(variance.sum() ** 2 / doubt.sum()),
        everywhere_mm=np.diag(np.sqrt(variance)),
        is_of_part=True,
    )


def _stated_variance(fitted: Fitted) -> Numbers:
    """Give the stated variances of the measured points along the base axes, (n, 3); 0 where nothing is stated."""
    stated = np.zeros((len(fitted.sightings), 3))
    if fitted.sightings.is_stated:
        root = fitted.sightings.unwhitening
        for column in np.moveaxis(root, 2, 0):
            stated += fitted.problem.in_base_axes(fitted.solved.state, np.ascontiguousarray(column)) ** 2
    return stated


def _by_moving_axes(fitted: Fitted) -> Iterator[npt.NDArray[np.bool_]]:
    """Give the rows (n,) of positions that count, by the axes that moved the target in their pass."""
    sightings, machine = fitted.sightings, fitted.machine
    sees_positions = sightings.of_kind(*SEE_POSITIONS)
    carries = {"tool": machine.tool_axes, "work": machine.work_axes, "relative": "".join(AXES)}
    is_carried = np.zeros((len(sightings), 3), dtype=np.bool_)
    for carrier, axes in carries.items():
        is_carried[sightings.carrier == CARRIERS.index(carrier)] = [axis in axes for axis in AXES]
    moving = np.zeros((len(sightings), 3), dtype=np.bool_)
    for number in range(sightings.n_passes):
        rows = sightings.pass_number == number
        moving[rows] = sightings.axes_moved(rows)
    kinds = (moving & is_carried) @ np.array([1, 2, 4])
    wanted = [7] if (kinds == 7).any() else [kind for kind in np.unique(kinds).tolist() if kind]
    for kind in wanted:
        yield fitted.solved.used & sees_positions & (kinds == kind)
