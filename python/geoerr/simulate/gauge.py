"""The truth in the project's gauge, worked out exactly.

The same machine can be written with many sets of 21 functions: constant angles, slopes of straightness and constant
shifts can be moved from one axis to another, to squareness, to the set-up of the work and to the tilt of the tool.
The gauge picks one: positioning and angles 0 at the first point of the measured range; straightness without
least-squares slope over the range (continuous, uniform) and 0 at its first point; X the datum, Y in the XY plane,
slopes in squareness. Every step below is an identity of rigid transforms, not a first-order one.

With axes 1, 2, 3 of a side from the base outwards, `A_i(q) = [R_i, t_i]` and C_i = R_i(first point), D_i = C_1 ...
C_i:

    A_1 A_2 A_3 l = A_1'' A_2'' A_3'' (D_3 l),   R_i'' = D_{i−1} R_i C_iᵀ D_{i−1}ᵀ,  t_i'' = D_{i−1} t_i

    t_i + R_i (c + p) = [t_i + (R_i − I) c] + c + R_i p        a constant c moves inwards
    A⁻¹ (c + p) = c + Ã⁻¹ p,   t̃ = t + (R − I) c               and out on the other side of the base
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from geoerr.machine import AXES
from geoerr.simulate.curves import Function, table_slope
from geoerr.simulate.guideway import MachineErrors
from geoerr.simulate.machine import VirtualMachine, axis_directions
from geoerr.simulate.rotations import Array, rotation, rotation_vector

# Each round of the fixed point gains a factor of the size of the angles (1e-3): five are more than enough.
_N_ROUNDS = 6


@dataclass(frozen=True)
class Gauged:
    """Errors in the gauge, and the rigid motions that lead back to the errors they came from.

    `tool_from_work(q, l) = work_rotation (gauged.tool_from_work(q, tool_rotation l) + work_shift_mm)`, l counted from
    the carriage origin.
    """

    errors: MachineErrors
    work_rotation: Array
    work_shift_mm: Array
    tool_rotation: Array


@dataclass(frozen=True)
class _Axis:
    """One axis with its constant rotation taken out: `turn` (n, 3, 3) and `step_mm` (n, 3) as functions of q."""

    sign: float
    position_mm: Array
    turn: Callable[[Array], Array]
    step_mm: Callable[[Array], Array]

    def step_with_lever(self, lever_mm: Array) -> Callable[[Array], Array]:
        """Give t + (R − I) c."""
        return lambda q_mm: np.asarray(self.step_mm(q_mm) + (self.turn(q_mm) - np.eye(3)) @ lever_mm)


def to_gauge(machine: VirtualMachine, positions_mm: dict[str, Array]) -> Gauged:
    """Rewrite a machine's errors in the gauge of the measured range.

    Parameters
    ----------
    machine
        The machine with its errors, in any gauge.
    positions_mm
        Axis to its measured positions (two or more, increasing): the entries of its tables.
    """
    axes: dict[str, _Axis] = {}
    tool_tilt = _level(machine, machine.machine.tool_axes, 1.0, positions_mm, axes)
    work_tilt = _level(machine, machine.machine.work_axes, -1.0, positions_mm, axes)

    lever_mm = {axis: np.zeros(3) for axis in AXES}
    shift_mm = np.zeros(3)
    constant_mm = {axis: np.zeros(3) for axis in AXES}
    for _ in range(_N_ROUNDS):
        frame, included_angle_rad = _directions(axes, lever_mm)
        unit = axis_directions(included_angle_rad)
        for axis, motion in axes.items():
            start_mm = motion.step_mm(motion.position_mm[:1])[0]
            constant_mm[axis] = start_mm - motion.sign * motion.position_mm[0] * (frame.T @ unit[axis])
        lever_mm, shift_mm = _move_constants(machine, constant_mm)

    functions: dict[str, Function] = {}
    for axis, motion in axes.items():
        step = motion.step_with_lever(lever_mm[axis])
        for index in range(3):
            direction = "XYZ"[index] + axis.upper()
            functions[f"E{direction}"] = _delta(motion, step, constant_mm[axis], frame, unit[axis], index)
            functions[f"E{'ABC'[index]}{axis.upper()}"] = _epsilon(motion, frame, index)
    return Gauged(
        errors=MachineErrors(functions, included_angle_rad),
        work_rotation=work_tilt.T @ frame.T,
        work_shift_mm=frame @ shift_mm,
        tool_rotation=frame @ tool_tilt,
    )


def _level(
    machine: VirtualMachine,
    side_axes: str,
    sign: float,
    positions_mm: dict[str, Array],
    axes: dict[str, _Axis],
) -> Array:
    """Put the side's axes without their constant rotations into `axes`; give the product of these rotations."""
    directions = axis_directions(machine.errors.included_angle_rad)
    product = np.eye(3)
    for axis in side_axes:
        constant = rotation(sign * machine.errors.epsilon_rad(axis, positions_mm[axis][:1]))[0]
        axes[axis] = _leveled(machine.errors, axis, directions[axis], sign, positions_mm[axis], product, constant)
        product = product @ constant
    return product


def _leveled(
    errors: MachineErrors,
    axis: str,
    direction: Array,
    sign: float,
    position_mm: Array,
    product: Array,
    constant: Array,
) -> _Axis:
    def turn(q_mm: Array) -> Array:
        own = rotation(sign * errors.epsilon_rad(axis, q_mm))
        return np.asarray(product @ own @ (constant.T @ product.T))

    def step_mm(q_mm: Array) -> Array:
        own = sign * (q_mm[:, None] * direction + errors.delta_mm(axis, q_mm))
        return np.asarray(own @ product.T)

    return _Axis(sign, position_mm, turn, step_mm)


def _directions(axes: dict[str, _Axis], lever_mm: dict[str, Array]) -> tuple[Array, dict[str, float]]:
    """Give the frame (rows: X, Y, Z directions) and the included angles that the axes' fitted lines define."""
    slope = {
        axis: motion.sign
        * table_slope(motion.position_mm, motion.step_with_lever(lever_mm[axis])(motion.position_mm))
        for axis, motion in axes.items()
    }
    x = slope["x"] / np.linalg.norm(slope["x"])
    z = np.cross(x, slope["y"])
    z /= np.linalg.norm(z)
    frame = np.stack([x, np.cross(z, x), z])
    # The unit vector whose transverse components are the line's slopes: then no slope is left in straightness.
    y_x = float((frame @ slope["y"])[0])
    z_x, z_y, _ = (float(value) for value in frame @ slope["z"])
    y_z = y_x * z_x + np.sqrt(1.0 - y_x**2) * z_y
    included = {"S_xy": -np.arcsin(y_x), "S_xz": -np.arcsin(z_x), "S_yz": -np.arcsin(y_z)}
    return frame, {name: float(value) for name, value in included.items()}


def _move_constants(machine: VirtualMachine, constant_mm: dict[str, Array]) -> tuple[dict[str, Array], Array]:
    """Move every axis's constant inwards to the base, then through the work side out: levers and the shift."""
    lever_mm: dict[str, Array] = {}
    at_base_mm = {}
    for side, side_axes in (("tool", machine.machine.tool_axes), ("work", machine.machine.work_axes)):
        carried = np.zeros(3)
        for axis in reversed(side_axes):
            lever_mm[axis] = carried
            carried = carried + constant_mm[axis]
        at_base_mm[side] = carried
    shift_mm = at_base_mm["tool"] - at_base_mm["work"]
    for axis in machine.machine.work_axes:
        lever_mm[axis] = lever_mm[axis] + shift_mm
    return lever_mm, shift_mm


def _delta(
    motion: _Axis, step: Callable[[Array], Array], constant_mm: Array, frame: Array, unit: Array, index: int
) -> Function:
    return lambda q_mm: np.asarray(motion.sign * ((step(q_mm) - constant_mm) @ frame[index]) - q_mm * unit[index])


def _epsilon(motion: _Axis, frame: Array, index: int) -> Function:
    return lambda q_mm: np.asarray(motion.sign * (rotation_vector(motion.turn(q_mm)) @ frame[index]))
