"""The virtual machine's own kinematics: exact rotations, any order of three axes.

Written apart from the core's kinematics on purpose: what makes test data shares no code with what explains it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geoerr.machine import AXES, Machine
from geoerr.simulate.guideway import MachineErrors
from geoerr.simulate.rotations import Array, rotation


@dataclass(frozen=True)
class Disturbance:
    """What hidden effects add to n moments; index 1 of the joint arrays is the moving axis, index 2 the direction.

    Attributes
    ----------
    delta_mm, epsilon_rad
        (n, 3, 3) added to the joint errors (tool seen from the work).
    tool_mm, work_mm
        (n, 3) displacement of the tool and of the work in the base frame.
    rig_mm, rig_rad
        (n, 3) displacement of the camera pair, and its rotation about the left camera's centre, base axes.
    """

    delta_mm: Array
    epsilon_rad: Array
    tool_mm: Array
    work_mm: Array
    rig_mm: Array
    rig_rad: Array


def no_disturbance(n_moments: int) -> Disturbance:
    """Give a disturbance of nothing; its arrays may be filled in."""
    return Disturbance(
        np.zeros((n_moments, 3, 3)),
        np.zeros((n_moments, 3, 3)),
        np.zeros((n_moments, 3)),
        np.zeros((n_moments, 3)),
        np.zeros((n_moments, 3)),
        np.zeros((n_moments, 3)),
    )


def axis_directions(included_angle_rad: dict[str, float]) -> dict[str, Array]:
    """Give the unit directions of the axes: X the datum, Y in the XY plane, every included angle 90° + S exactly."""
    s_xy, s_xz, s_yz = (np.sin(included_angle_rad[name]) for name in ("S_xy", "S_xz", "S_yz"))
    y = np.array([-s_xy, np.sqrt(1.0 - s_xy**2), 0.0])
    z_x = -s_xz
    z_y = (-s_yz - y[0] * z_x) / y[1]
    z = np.array([z_x, z_y, np.sqrt(1.0 - z_x**2 - z_y**2)])
    return {"x": np.array([1.0, 0.0, 0.0]), "y": y, "z": z}


@dataclass(frozen=True)
class VirtualMachine:
    """A machine with its errors."""

    machine: Machine
    errors: MachineErrors

    def pose(self, carrier: str, q_mm: Array, disturbance: Disturbance | None = None) -> tuple[Array, Array]:
        """Give the pose of the tool carriage, of the work, or of the base at n moments, in the base frame.

        The product of the side's axes from the base outwards; each is `[R(ε), q·â' + δ]` on the tool side and
        `[R(−ε), −q·â' − δ]` on the work side (Li Eqs. 6 and 7, for errors of the tool as seen from the work).

        Parameters
        ----------
        carrier
            `tool`, `work` or `base`.
        q_mm
            (n, 3) commanded positions.
        disturbance
            What hidden effects add, n rows.

        Returns
        -------
        base_from_carrier
            Rotation (n, 3, 3).
        origin_mm
            Place of the carrier's origin in the base frame (n, 3).
        """
        n_moments = len(q_mm)
        turned = np.broadcast_to(np.eye(3), (n_moments, 3, 3))
        origin_mm = np.zeros((n_moments, 3))
        if carrier == "base":
            return turned, origin_mm
        added = no_disturbance(n_moments) if disturbance is None else disturbance
        axes, sign = (self.machine.tool_axes, 1.0) if carrier == "tool" else (self.machine.work_axes, -1.0)
        directions = axis_directions(self.errors.included_angle_rad)
        for axis in axes:
            index = AXES.index(axis)
            q = q_mm[:, index]
            delta_mm = self.errors.delta_mm(axis, q) + added.delta_mm[:, index]
            epsilon_rad = self.errors.epsilon_rad(axis, q) + added.epsilon_rad[:, index]
            step_mm = sign * (q[:, None] * directions[axis] + delta_mm)
            origin_mm = origin_mm + np.einsum("nij,nj->ni", turned, step_mm)
            turned = turned @ rotation(sign * epsilon_rad)
        return turned, origin_mm + (added.tool_mm if carrier == "tool" else added.work_mm)

    def points_mm(self, carrier: str, q_mm: Array, points_mm: Array, disturbance: Disturbance | None = None) -> Array:
        """Place points that are fixed to a carrier, in the base frame.

        Parameters
        ----------
        carrier
            `tool`, `work` or `base`.
        q_mm
            (n, 3) commanded positions.
        points_mm
            (k, 3) nominal places at x = y = z = 0: from the tool point on the tool, else from the base origin.

        Returns
        -------
        ndarray
            (n, k, 3)
        """
        turned, origin_mm = self.pose(carrier, q_mm, disturbance)
        return np.asarray(origin_mm[:, None, :] + self.arms_mm(carrier, points_mm) @ np.swapaxes(turned, 1, 2))

    def arms_mm(self, carrier: str, points_mm: Array) -> Array:
        """Turn target offsets (k, 3) into coordinates on their carrier: the tool's count from the tool point."""
        return points_mm + np.asarray(self.machine.tool_offset_mm) if carrier == "tool" else points_mm

    def tool_from_work(self, q_mm: Array, offset_mm: Array, disturbance: Disturbance | None = None) -> Array:
        """Give the place (n, 3) of a tool target with that offset (3,), seen from the work: T_work⁻¹ T_tool l."""
        place_mm = self.points_mm("tool", q_mm, offset_mm[None], disturbance)[:, 0]
        turned, origin_mm = self.pose("work", q_mm, disturbance)
        return np.asarray(np.einsum("nji,nj->ni", turned, place_mm - origin_mm))
