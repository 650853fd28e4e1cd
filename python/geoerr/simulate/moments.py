"""The moments at which the cameras look: what is commanded, when, and from which side."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from geoerr.machine import AXES, Machine
from geoerr.simulate.rotations import Array


@dataclass(frozen=True)
class PassPlan:
    """One axis going through positions while the others stay at `at_mm`."""

    line: str
    axis: str
    positions_mm: tuple[float, ...]
    at_mm: dict[str, float]
    repeats: int
    both_directions: bool


@dataclass(frozen=True)
class CovariatePlan:
    """A column as a function of time: straight lines between points, or a rise to an end value.

    With `tau_s` there are two values, and the column is start + (end − start)(1 − e^(−t/τ)).
    """

    t_s: tuple[float, ...]
    value: tuple[float, ...]
    tau_s: float | None = None


@dataclass(frozen=True)
class Moments:
    """n moments in order.

    Attributes
    ----------
    line, repeat
        Name of the motion and number of its repetition, n entries each.
    moving_axis
        Index 0 to 2 of the axis that the pass moves (n,).
    q_mm
        Commanded positions (n, 3).
    direction
        −1, 0 (not moved yet), +1 (n, 3).
    t_s
        Time since the start (n,).
    covariates
        Name to (n,) values.
    """

    line: tuple[str, ...]
    repeat: npt.NDArray[np.int64]
    moving_axis: npt.NDArray[np.int64]
    q_mm: Array
    direction: npt.NDArray[np.int64]
    t_s: Array
    covariates: dict[str, Array]

    def __len__(self) -> int:
        return len(self.line)


def moments_of(
    passes: tuple[PassPlan, ...], covariates: dict[str, CovariatePlan], machine: Machine, seconds_per_frame: float
) -> Moments:
    """Run through passes, one picture at each position.

    The axis of a pass overshoots before its first point, so every point of a pass is approached from one side (as
    ISO 230-2 has it). The other axes come from where they were; at the very start, from the low ends of their ranges.
    """
    line: list[str] = []
    repeat: list[int] = []
    moving: list[int] = []
    q_mm: list[list[float]] = []
    direction: list[list[int]] = []
    at = [machine.axes[axis].range_mm[0] for axis in AXES]
    last = [0, 0, 0]
    for item in passes:
        axis = AXES.index(item.axis)
        upwards = item.positions_mm[-1] >= item.positions_mm[0]
        for number in range(item.repeats):
            for backwards in (False, True) if item.both_directions else (False,):
                positions = item.positions_mm[::-1] if backwards else item.positions_mm
                for position in positions:
                    goal = [position if name == item.axis else item.at_mm[name] for name in AXES]
                    last = [
                        int(np.sign(new - old)) or before for new, old, before in zip(goal, at, last, strict=True)
                    ]
                    last[axis] = 1 if upwards != backwards else -1
                    at = goal
                    line.append(item.line)
                    repeat.append(number)
                    moving.append(axis)
                    q_mm.append(goal)
                    direction.append(last)
    t_s = np.arange(len(line), dtype=np.float64) * seconds_per_frame
    return Moments(
        line=tuple(line),
        repeat=np.array(repeat, dtype=np.int64),
        moving_axis=np.array(moving, dtype=np.int64),
        q_mm=np.array(q_mm, dtype=np.float64).reshape(-1, 3),
        direction=np.array(direction, dtype=np.int64).reshape(-1, 3),
        t_s=t_s,
        covariates={name: _values(item, t_s) for name, item in covariates.items()},
    )


def measured_positions(moments: Moments, axis: int) -> Array:
    """Give the distinct commanded positions, ascending, of the passes that move an axis (maybe none)."""
    return np.unique(moments.q_mm[moments.moving_axis == axis, axis])


def _values(plan: CovariatePlan, t_s: Array) -> Array:
    if plan.tau_s is None:
        return np.interp(t_s, plan.t_s, plan.value)
    start, end = plan.value
    return np.asarray(start + (end - start) * -np.expm1(-t_s / plan.tau_s))
