"""Exact kinematics of three linear axes in any order, one target a row, and the levers that projections need."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

CARRIERS = ("tool", "work", "base", "relative")
TOOL, WORK, BASE, RELATIVE = range(4)
_UNIT = np.eye(3)


@dataclass
class Displacements:
    """What moves n rows; arrays may be filled in place. Joint arrays are [row, moving axis, direction].

    Attributes
    ----------
    delta_mm, epsilon_rad
        (n, 3, 3) joint errors, tool seen from the work.
    squareness_rad
        (n, 3) included angles minus 90°: xy, xz, yz.
    tool_mm, work_mm, target_mm
        (n, 3) displacement of the tool, of the work, of the target itself, base frame.
    late_mm
        (n, 3) by how much the axes had moved on when the picture was taken.
    rig_mm
        (n, 3) what the rig adds to the measured point, measuring frame.
    """

    delta_mm: Array
    epsilon_rad: Array
    squareness_rad: Array
    tool_mm: Array
    work_mm: Array
    target_mm: Array
    late_mm: Array
    rig_mm: Array

    def __add__(self, other: Displacements) -> Displacements:
        return Displacements(*(getattr(self, f.name) + getattr(other, f.name) for f in fields(self)))

    def scaled(self, factor: float) -> Displacements:
        """Give everything times a factor."""
        return Displacements(*(factor * getattr(self, f.name) for f in fields(self)))

    def times(self, shape: Array) -> Displacements:
        """Give every row times its own number (n,)."""
        return Displacements(
            *(
                getattr(self, f.name) * shape.reshape(-1, *[1] * (getattr(self, f.name).ndim - 1))
                for f in fields(self)
            )
        )


def nothing(n_rows: int) -> Displacements:
    """Give displacements of nothing."""
    joint, vector = (n_rows, 3, 3), (n_rows, 3)
    return Displacements(np.zeros(joint), np.zeros(joint), *(np.zeros(vector) for _ in range(6)))


def sides(chain: str) -> tuple[list[int], list[int]]:
    """Give the axes of the tool side and of the work side, each from the base outwards, as 0, 1, 2."""
    work, tool = chain[1:-1].split("b")
    return ["XYZ".index(axis) for axis in tool], ["XYZ".index(axis) for axis in reversed(work)]


def places_mm(chain: str, carrier: npt.NDArray[np.int64], q_mm: Array, arm_mm: Array, moved: Displacements) -> Array:
    """Place targets exactly: base frame, or the work's frame for `relative` (T_work⁻¹ T_tool l).

    A carriage's transform is [R(ε), q â' + δ] on the tool side, [R(−ε), −q â' − δ] on the work side.

    Parameters
    ----------
    chain
        Structural code.
    carrier
        (n,) index into `CARRIERS`.
    q_mm
        (n, 3) commanded positions.
    arm_mm
        (n, 3) target on its carrier, from the carriage's origin (tool, relative) or the base origin, at q = 0.
    moved
        All errors.
    """
    tool_axes, work_axes = sides(chain)
    q = q_mm + moved.late_mm
    result = arm_mm.copy()
    on_tool = np.flatnonzero((carrier == TOOL) | (carrier == RELATIVE))
    if on_tool.size:
        turn, origin = _pose(tool_axes, 1.0, q[on_tool], moved, on_tool)
        result[on_tool] = origin + _turned(turn, arm_mm[on_tool]) + moved.tool_mm[on_tool]
    on_work = np.flatnonzero(carrier == WORK)
    if on_work.size:
        turn, origin = _pose(work_axes, -1.0, q[on_work], moved, on_work)
        result[on_work] = origin + _turned(turn, arm_mm[on_work]) + moved.work_mm[on_work]
    relative = np.flatnonzero(carrier == RELATIVE)
    if relative.size:
        turn, origin = _pose(work_axes, -1.0, q[relative], moved, relative)
        from_work = result[relative] - origin - moved.work_mm[relative]
        result[relative] = _turned(np.swapaxes(turn, 1, 2), from_work)
    return result + np.where((carrier == BASE)[:, None], 0.0, moved.target_mm)


def _turned(turn: Array, vector: Array) -> Array:
    return (turn @ vector[:, :, None])[:, :, 0]


def _pose(
    axes: list[int], sign: float, q: Array, moved: Displacements, rows: npt.NDArray[np.intp]
) -> tuple[Array, Array]:
    turn = np.broadcast_to(_UNIT, (len(rows), 3, 3))
    origin = np.zeros((len(rows), 3))
    along = _axis_directions(moved.squareness_rad[rows])
    for axis in axes:
        step = sign * (q[:, axis, None] * along[:, axis] + moved.delta_mm[rows, axis])
        origin = origin + _turned(turn, step)
        turn = turn @ _rotation(sign * moved.epsilon_rad[rows, axis])
    return turn, origin


def _axis_directions(squareness_rad: Array) -> Array:
    """Give unit directions [row, axis]: X the datum, Y in the XY plane, the included angles 90° + S."""
    cosine = -np.sin(squareness_rad)
    result = np.zeros((len(cosine), 3, 3))
    result[:, 0, 0] = 1.0
    result[:, 1, 0] = cosine[:, 0]
    result[:, 1, 1] = np.sqrt(1.0 - cosine[:, 0] ** 2)
    result[:, 2, 0] = cosine[:, 1]
    result[:, 2, 1] = (cosine[:, 2] - cosine[:, 0] * cosine[:, 1]) / result[:, 1, 1]
    result[:, 2, 2] = np.sqrt(1.0 - result[:, 2, 0] ** 2 - result[:, 2, 1] ** 2)
    return result


def _rotation(vector_rad: Array) -> Array:
    """Make rotation matrices from rotation vectors, by the unit quaternion."""
    half = 0.5 * np.sqrt(np.einsum("ij,ij->i", vector_rad, vector_rad))
    w = np.cos(half)
    x, y, z = 0.5 * np.sinc(half / np.pi) * vector_rad.T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def levers(chain: str, carrier: npt.NDArray[np.int64], q_mm: Array, arm_mm: Array) -> tuple[Array, Array]:
    """Give, to first order, the sign (n, 3) with which an axis's errors move a row, and its lever (n, 3 axes, 3)."""
    tool_axes, work_axes = sides(chain)
    n_rows = len(q_mm)
    sign, lever = np.zeros((n_rows, 3)), np.zeros((n_rows, 3, 3))
    is_tool = (carrier == TOOL) | (carrier == RELATIVE)
    is_work, is_relative = carrier == WORK, carrier == RELATIVE
    for place, axis in enumerate(tool_axes):
        reach = arm_mm.copy()
        for outer in tool_axes[place + 1 :]:
            reach[:, outer] += q_mm[:, outer]
        sign[:, axis] = is_tool
        lever[:, axis] = reach
    for place, axis in enumerate(work_axes):
        seen_from_base, seen_from_work = arm_mm.copy(), arm_mm.copy()
        for outer in work_axes[place + 1 :]:
            seen_from_base[:, outer] -= q_mm[:, outer]
        for inner in [*tool_axes, *work_axes[: place + 1]]:
            seen_from_work[:, inner] += q_mm[:, inner]
        sign[:, axis] = is_relative * 1.0 - is_work
        lever[:, axis] = np.where(is_relative[:, None], seen_from_work, seen_from_base)
    return sign, lever
