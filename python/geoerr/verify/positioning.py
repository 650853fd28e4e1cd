"""Positioning along a straight line as ISO 230-2 states it, and along diagonals (ISO 230-6): measured or predicted.

A line is run to target positions from both sides. With x̄ᵢ↑ and x̄ᵢ↓ the mean deviations at target i and sᵢ their
standard deviations (n − 1):

    B = max |x̄ᵢ↑ − x̄ᵢ↓|            reversal                M = max x̄ᵢ − min x̄ᵢ, x̄ᵢ the mean of both sides
    E = max x̄ᵢ↕ − min x̄ᵢ↕          systematic deviation    Rᵢ = max(2 sᵢ↑ + 2 sᵢ↓ + |Bᵢ|, 4 sᵢ↑, 4 sᵢ↓)
    A = max (x̄ᵢ↕ + 2 sᵢ↕) − min (x̄ᵢ↕ − 2 sᵢ↕)    accuracy  R = max Rᵢ   repeatability

A model has no scatter: of a prediction there are B, E and M, and neither R nor A.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from geoerr.errors import GeometryError, ShapeError
from geoerr.machine import AXES
from geoerr.model import Model
from geoerr.model.conditions import Conditions
from geoerr.model.in_model import moving_along
from geoerr.model.program_conditions import approach_conditions
from geoerr.observations import place_numbers
from geoerr.verify.ballbar import usable_range_mm

Numbers = npt.NDArray[np.float64]

# The standard asks for at least five target positions, and for five runs from each side.
LEAST_TARGETS = 5
USUAL_RUNS = 5
# Target positions of a predicted line.
N_TARGETS = 21
_UM_PER_MM = 1e3
_COVERAGE_95 = 1.96
# How far beyond the last target a predicted line turns round, as the standard's cycle does.
_OVERRUN_MM = 10.0


@dataclass(frozen=True, eq=False)
class PositioningTest:
    """Deviations at the targets of a line that is run both ways.

    Attributes
    ----------
    position_mm : (m,)
        Targets along the line, increasing.
    up_um, down_um : (m,)
        Mean deviation along the line, reached forwards and backwards; their common offset means nothing.
    up_std_um, down_std_um : (m,)
        Standard deviations of single runs; NaN where there was one run.
    n_runs
        Runs from each side: the fewest at any target; 0 of a prediction.
    prediction_std_um : (m,) or None
        Standard uncertainty of a predicted deviation, NaN where the model's data do not determine it; None of
        what was measured, and of a model without a covariance.
    not_in_model
        Errors that move the point along the line and are not in the model: they count as 0 in a prediction, whose
        uncertainty is then that of a part of it, and is not stated.
    """

    position_mm: Numbers
    up_um: Numbers
    down_um: Numbers
    up_std_um: Numbers
    down_std_um: Numbers
    n_runs: int
    prediction_std_um: Numbers | None = None
    not_in_model: tuple[str, ...] = ()

    @property
    def reversal_um(self) -> float:
        """B, the largest reversal."""
        return float(np.abs(self.up_um - self.down_um).max())

    @property
    def mean_reversal_um(self) -> float:
        """B̄, the mean reversal: forwards minus backwards."""
        return float((self.up_um - self.down_um).mean())

    @property
    def systematic_um(self) -> float:
        """E, the bidirectional systematic deviation."""
        return float(np.ptp(np.concatenate([self.up_um, self.down_um])))

    @property
    def one_way_systematic_um(self) -> tuple[float, float]:
        """E↑ and E↓."""
        return float(np.ptp(self.up_um)), float(np.ptp(self.down_um))

    @property
    def mean_um(self) -> float:
        """M, the range of the mean bidirectional deviation."""
        return float(np.ptp(0.5 * (self.up_um + self.down_um)))

    @property
    def known_to_um(self) -> float | None:
        """How far off a predicted deviation may be anywhere along the line (95 %); NaN where nobody knows."""
        return None if self.prediction_std_um is None else float(_COVERAGE_95 * self.prediction_std_um.max())

    @property
    def has_scatter(self) -> bool:
        """Whether every target was reached more than once from each side."""
        return bool(np.isfinite([self.up_std_um, self.down_std_um]).all())

    @property
    def repeatability_um(self) -> float | None:
        """R, the bidirectional repeatability; None where runs were not repeated."""
        if not self.has_scatter:
            return None
        both = 2.0 * (self.up_std_um + self.down_std_um) + np.abs(self.up_um - self.down_um)
        return float(np.max([both, 4.0 * self.up_std_um, 4.0 * self.down_std_um]))

    @property
    def one_way_repeatability_um(self) -> tuple[float, float] | None:
        """R↑ and R↓."""
        if not self.has_scatter:
            return None
        return float(4.0 * self.up_std_um.max()), float(4.0 * self.down_std_um.max())

    @property
    def accuracy_um(self) -> float | None:
        """A, the bidirectional accuracy; None where runs were not repeated."""
        if not self.has_scatter:
            return None
        highest = np.max([self.up_um + 2.0 * self.up_std_um, self.down_um + 2.0 * self.down_std_um])
        return float(highest - np.min([self.up_um - 2.0 * self.up_std_um, self.down_um - 2.0 * self.down_std_um]))

    def to_document(self) -> dict[str, Any]:
        """Give the figures under the standard's letters, µm; null where runs were not repeated."""
        up, down = self.one_way_repeatability_um or (None, None)
        return {
            "n_targets": len(self.position_mm),
            "n_runs": self.n_runs,
            "from_mm": float(self.position_mm[0]),
            "to_mm": float(self.position_mm[-1]),
            "A_um": self.accuracy_um,
            "E_um": self.systematic_um,
            "E_forward_um": self.one_way_systematic_um[0],
            "E_backward_um": self.one_way_systematic_um[1],
            "M_um": self.mean_um,
            "R_um": self.repeatability_um,
            "R_forward_um": up,
            "R_backward_um": down,
            "B_um": self.reversal_um,
            "B_mean_um": self.mean_reversal_um,
            "known_to_um": self.known_to_um,
        }


def positioning_test(
    position_mm: npt.ArrayLike, deviation_um: npt.ArrayLike, direction: npt.ArrayLike
) -> PositioningTest | None:
    """Sum up the runs of a line by its targets that were reached from both sides.

    Parameters
    ----------
    position_mm, deviation_um, direction : (n,)
        Each reading: commanded place along the line, actual minus commanded, and +1 forwards, −1 backwards (0 takes
        no part).

    Returns
    -------
    PositioningTest or None
        None where fewer than five targets were reached from both sides.

    Raises
    ------
    ShapeError
        where the three do not have one length.

    Notes
    -----
    ISO 230-2:2014, clause 3. Verified in tests/verify/test_positioning.py against sums by hand.
    """
    position, deviation, sense = (np.asarray(one, dtype=np.float64) for one in (position_mm, deviation_um, direction))
    if not position.shape == deviation.shape == sense.shape or position.ndim != 1:
        raise ShapeError(
            f"positions, deviations and directions are {position.shape}, {deviation.shape} and {sense.shape}, "
            "not one reading each"
        )
    target, number = _targets(position)
    sides = [[deviation[(number == one) & (sense == side)] for side in (1.0, -1.0)] for one in range(len(target))]
    kept = [one for one, (up, down) in enumerate(sides) if len(up) and len(down)]
    if len(kept) < LEAST_TARGETS:
        return None
    up, down = np.array([[side.mean() for side in sides[one]] for one in kept]).T
    up_std, down_std = np.array(
        [[side.std(ddof=1) if len(side) > 1 else np.nan for side in sides[one]] for one in kept]
    ).T
    n_runs = min(len(side) for one in kept for side in sides[one])
    return PositioningTest(target[kept], up, down, up_std, down_std, n_runs)


def why_no_test(position_mm: npt.ArrayLike, direction: npt.ArrayLike) -> str:
    """Say why the readings of a line are no test.

    Parameters
    ----------
    position_mm, direction : (n,)
        As for `positioning_test`.
    """
    position, sense = (np.asarray(one, dtype=np.float64) for one in (position_mm, direction))
    _, number = _targets(position)
    forwards, backwards = (set(number[sense == side].tolist()) for side in (1.0, -1.0))
    if not forwards and not backwards:
        return "the data do not tell from which side a place was reached"
    if not forwards or not backwards:
        return "run in one direction only"
    return f"{len(forwards & backwards)} targets were reached from both sides, and a test needs {LEAST_TARGETS}"


def predict_positioning(
    model: Model,
    start_mm: npt.ArrayLike,
    end_mm: npt.ArrayLike,
    *,
    at: Conditions | None = None,
    n_targets: int = N_TARGETS,
) -> PositioningTest:
    """Predict a line's test: from start to end and back, at rest at each target, axes that stand still from below.

    Parameters
    ----------
    start_mm, end_mm : (3,)
        Ends of the line in axis positions; the error is taken of the tool point.
    at
        Conditions that the model follows and the motion does not tell.
    n_targets
        Targets in even steps, the ends among them.

    Raises
    ------
    GeometryError
        where the ends are one place.
    GeoerrError
        for conditions that are needed and not given.
    """
    start, end = np.asarray(start_mm, dtype=np.float64), np.asarray(end_mm, dtype=np.float64)
    length = float(np.linalg.norm(end - start))
    if not length > 0.0:
        raise GeometryError("the line to predict begins where it ends")
    unit = (end - start) / length
    along = np.linspace(0.0, length, n_targets)
    q_mm = start + along[:, None] * unit
    means: list[Numbers] = []
    variances: list[Numbers] = []
    for sense in (1.0, -1.0):
        motion = _motion(model, unit * sense, _OVERRUN_MM + (along if sense > 0.0 else length - along))
        conditions = {**motion, **(at or {})}
        means.append(model.error_mm(q_mm, at=conditions) @ unit * _UM_PER_MM)
        if model.record is not None:
            covariance = model.prediction_covariance_mm2(q_mm, at=conditions)
            moves = np.flatnonzero(unit)
            # A component across the line may be unknown without harm.
            along_line = covariance[:, moves][:, :, moves]
            variances.append(np.einsum("a,nab,b->n", unit[moves], along_line, unit[moves]))
    nothing = np.full(n_targets, np.nan)
    # Where the gauge fixes the error its variance is 0, to rounding; NaN, not determined, stays.
    std_um = np.sqrt(np.maximum(np.max(variances, axis=0), 0.0)) * _UM_PER_MM if variances else None
    absent = () if model.is_nominal else moving_along(model.machine, model.not_in_model, q_mm, unit)
    if absent and std_um is not None:
        std_um = nothing
    return PositioningTest(
        along, means[0], means[1], nothing, nothing, n_runs=0, prediction_std_um=std_um, not_in_model=absent
    )


def axis_line_mm(model: Model, axis: str) -> tuple[Numbers, Numbers]:
    """Give the ends (3,) of the line along an axis through the middle of the usable volume."""
    low, high = usable_range_mm(model)
    start, end = (low + high) / 2.0, (low + high) / 2.0
    column = AXES.index(axis)
    start[column], end[column] = low[column], high[column]
    return start, end


def diagonals_mm(model: Model) -> dict[str, tuple[Numbers, Numbers]]:
    """Give the ends of the four space diagonals of the usable volume, by ISO 230-6's letters (P: that axis rises)."""
    low, high = usable_range_mm(model)
    found = {}
    for name in ("PPP", "NPP", "PNP", "PPN"):
        rises = np.array([letter == "P" for letter in name])
        found[name] = (np.where(rises, low, high), np.where(rises, high, low))
    return found


def _targets(position_mm: Numbers) -> tuple[Numbers, npt.NDArray[np.int64]]:
    """Give the places, increasing, and the number of each reading's: an encoder tells one target with some spread."""
    number = place_numbers(position_mm)
    return np.array([np.median(position_mm[number == one]) for one in range(int(number.max(initial=-1)) + 1)]), number


def _motion(model: Model, way: Numbers, travel_mm: Numbers) -> dict[str, npt.ArrayLike]:
    """Give direction and travel at each target of the axes that move; the others have come from below."""
    told: dict[str, npt.ArrayLike] = dict(approach_conditions(model))
    if "moving" in told:
        told["moving"] = 0.0
    for axis, share in zip(AXES, way.tolist(), strict=True):
        if share == 0.0:
            continue
        for name, value in ((f"d_{axis}", np.sign(share)), (f"s_{axis}", travel_mm * abs(share))):
            if name in told:
                told[name] = value
    return told
