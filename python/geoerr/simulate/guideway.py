"""The 18 error functions and three squarenesses of a virtual machine: drawn, or given as tables.

Straightness and the angle about the third direction are tied by how the carriage rides on its guideway:

- `tangent`: a short carriage follows the guideway's tangent (Li's assumption, Eq. 19);
- a carriage of length Λ touches the guideway at both ends: δ is the mean of the two heights, the angle their
difference
  over Λ;
- `free`: straightness and angles have nothing to do with each other.

Errors are those of the tool seen from the work on both sides of the chain, so dδ/dq = ±ε × â, plus on the tool side,
minus on the work side.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from geoerr.error_functions import LI_SQUARENESS, LINEAR_AND_ANGULAR
from geoerr.machine import AXES, Machine
from geoerr.simulate.curves import Curve, Function, Polyline, draw_wave, from_zero, without_line
from geoerr.simulate.rotations import Array

_TRANSLATION = "XYZ"
_ROTATION = "ABC"


@dataclass(frozen=True)
class AxisPlan:
    """How the errors of one axis are to be.

    Attributes
    ----------
    positioning_um, straightness_um, pitch_yaw_urad, roll_urad
        Largest size over the axis's range of what is drawn. `straightness_um` is used by a free carriage only: on a
        guideway the straightness follows from the angles.
    carriage
        `tangent`, `free` or `length`.
    carriage_length_mm
        Of a carriage of given length, else 0.
    """

    positioning_um: float = 0.0
    straightness_um: float = 0.0
    pitch_yaw_urad: float = 0.0
    roll_urad: float = 0.0
    carriage: str = "tangent"
    carriage_length_mm: float = 0.0


@dataclass(frozen=True)
class ErrorPlan:
    """What `[errors]` of a plan asks for.

    Attributes
    ----------
    axes
        `x`, `y`, `z` to its plan.
    squareness_rad
        ISO name (`EC0Y`, `EB0Z`, `EA0Z`, ISO signs) to value.
    tables
        ISO name to a table (mm; mm or rad) that stands in place of what would be drawn.
    """

    axes: dict[str, AxisPlan]
    squareness_rad: dict[str, float]
    tables: dict[str, Polyline] = field(default_factory=dict)


@dataclass(frozen=True)
class MachineErrors:
    """Errors that can be evaluated at any q.

    Attributes
    ----------
    functions
        The 18 ISO names to functions, (n,) mm to (n,) mm or rad.
    included_angle_rad
        `S_xy`, `S_xz`, `S_yz`: included angle of two axes' positive directions minus 90° (Li §4.3).
    """

    functions: dict[str, Function]
    included_angle_rad: dict[str, float]

    def delta_mm(self, axis: str, q_mm: Array) -> Array:
        """Give the translation errors (n, 3) of one axis."""
        return self._three(_TRANSLATION, axis, q_mm)

    def epsilon_rad(self, axis: str, q_mm: Array) -> Array:
        """Give the rotation errors (n, 3) of one axis."""
        return self._three(_ROTATION, axis, q_mm)

    def _three(self, letters: str, axis: str, q_mm: Array) -> Array:
        return np.stack([self.functions[f"E{letter}{axis.upper()}"](q_mm) for letter in letters], axis=-1)


def build_errors(machine: Machine, plan: ErrorPlan, seed: np.random.SeedSequence) -> MachineErrors:
    """Draw the errors of a machine, or take them from tables.

    Every function has a random stream of its own, so that giving one as a table leaves the others as they were.
    """
    streams = dict(
        zip(LINEAR_AND_ANGULAR, map(np.random.default_rng, seed.spawn(len(LINEAR_AND_ANGULAR))), strict=True)
    )
    functions: dict[str, Function] = {}
    for index, axis in enumerate(AXES):
        functions |= _axis_functions(machine, index, plan.axes[axis], plan.tables, streams)
    squareness = {
        li_name: sign * plan.squareness_rad.get(iso_name, 0.0) for iso_name, (li_name, sign) in LI_SQUARENESS.items()
    }
    return MachineErrors({name: functions[name] for name in LINEAR_AND_ANGULAR}, squareness)


def pair_sign(axis: int, direction: int, side: str) -> float:
    """Give σ of dδ_b/dq = σ ε_c for moving axis a and the third direction c: (±ε × â)_b.

    On the tool side +1 for EYX/ECX, −1 for EZX/EBX and so on round; every sign turns on the work side.
    """
    third = 3 - axis - direction
    even = (direction, third, axis) in ((0, 1, 2), (1, 2, 0), (2, 0, 1))
    return (1.0 if even else -1.0) * (1.0 if side == "tool" else -1.0)


def _axis_functions(
    machine: Machine,
    index: int,
    plan: AxisPlan,
    tables: dict[str, Polyline],
    streams: dict[str, np.random.Generator],
) -> dict[str, Function]:
    axis = AXES[index]
    low_mm, high_mm = machine.axes[axis].range_mm
    length_mm = high_mm - low_mm

    def name(letters: str, direction: int) -> str:
        return f"E{letters[direction]}{axis.upper()}"

    def own(error: str, amplitude: float) -> Curve:
        if error in tables:
            return tables[error]
        return draw_wave(streams[error], low_mm, length_mm, amplitude)

    functions: dict[str, Function] = {
        name(_TRANSLATION, index): own(name(_TRANSLATION, index), plan.positioning_um * 1e-3).at,
        name(_ROTATION, index): own(name(_ROTATION, index), plan.roll_urad * 1e-6).at,
    }
    for direction in range(3):
        if direction == index:
            continue
        straight, angle = name(_TRANSLATION, direction), name(_ROTATION, 3 - index - direction)
        sign = pair_sign(index, direction, machine.side(axis))
        angle_curve = own(angle, plan.pitch_yaw_urad * 1e-6)
        free = plan.carriage == "free" or (straight in tables and angle in tables)
        if free:
            height = own(straight, plan.straightness_um * 1e-3)
            functions[straight] = height.at if straight in tables else without_line(height.at, low_mm, high_mm)
            functions[angle] = angle_curve.at
        elif straight in tables:
            functions[straight] = tables[straight].at
            functions[angle] = _times(sign, from_zero(tables[straight].slope, low_mm))
        elif plan.carriage == "tangent":
            functions[straight] = without_line(_times(sign, angle_curve.integral), low_mm, high_mm)
            functions[angle] = angle_curve.at
        else:
            height_at = _times(sign, angle_curve.integral)
            mean, slope = _on_two_feet(height_at, plan.carriage_length_mm)
            functions[straight] = without_line(mean, low_mm, high_mm)
            functions[angle] = from_zero(_times(sign, slope), low_mm)
    return functions


def _times(factor: float, function: Function) -> Function:
    return lambda q_mm: np.asarray(factor * function(q_mm))


def _on_two_feet(height: Function, length_mm: float) -> tuple[Function, Function]:
    """Give height and slope of a carriage that touches its guideway length_mm / 2 before and behind its middle."""
    half_mm = 0.5 * length_mm
    return (
        lambda q_mm: np.asarray(0.5 * (height(q_mm + half_mm) + height(q_mm - half_mm))),
        lambda q_mm: np.asarray((height(q_mm + half_mm) - height(q_mm - half_mm)) / length_mm),
    )
