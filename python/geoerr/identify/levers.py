"""Who carries whom, and the lever with which each axis's rotation acts on a target (first order of Li Eq. 7).

"Outside" is further from the base. To first order a target with offset l on the tool, or w on the work, moves by

    tool from the base          Σ_tool δ_a + ε_a × (l + Σ_{tool axes outside a} q_b b̂)
    work from the base        − Σ_work δ_a + ε_a × (w − Σ_{work axes outside a} q_b b̂)
    tool from the work          the tool's sum
                              + Σ_work δ_a + ε_a × (l + Σ_tool q_b b̂ + q_a â + Σ_{work axes inside a} q_b b̂)

The brackets are the levers. With the sign of the second line turned (a bed target's travel is reversed first), every
line of points reads as errors of the tool seen from the work.
"""

from __future__ import annotations

import numpy as np

from geoerr.identify.linear import Numbers
from geoerr.machine import AXES, Machine


def moving_axes(machine: Machine, carrier: str) -> str:
    """Give the axes that move a target on this carrier, as the measuring device sees it."""
    return {"tool": machine.tool_axes, "work": machine.work_axes, "relative": "xyz"}.get(carrier, "")


def axes_that_turn(machine: Machine, carrier: str, axis: str) -> str:
    """Give the axes whose rotation turns the travel of `axis`: those that carry it, seen from the measuring frame.

    Seen from the floor the frame is the base; `relative` data are seen from the work.
    """
    if carrier == "relative":
        from_work_to_tool = machine.work_axes[::-1] + machine.tool_axes
        return from_work_to_tool[: from_work_to_tool.index(axis)]
    side = moving_axes(machine, carrier)
    return side[: side.index(axis)]


def travel_sign(carrier: str) -> float:
    """Give −1 where the travel is reversed before it is used: a target on the work moves by −q."""
    return -1.0 if carrier == "work" else 1.0


def lever_mm(machine: Machine, carrier: str, axis: str, commanded_mm: Numbers, offset_mm: Numbers) -> Numbers:
    """Give the lever of `axis` on targets with these offsets at these commanded positions.

    Parameters
    ----------
    commanded_mm, offset_mm
        (n, 3); offsets count from the tool point (on `work` from the base origin).

    Returns
    -------
    ndarray
        (n, 3), base axes.
    """
    weight = np.zeros(3)
    if carrier == "work":
        for other in _outside(machine.work_axes, axis):
            weight[AXES.index(other)] = -1.0
        return np.asarray(offset_mm + commanded_mm * weight)
    if axis in machine.tool_axes:
        counted = _outside(machine.tool_axes, axis)
    else:
        counted = machine.tool_axes + machine.work_axes[: machine.work_axes.index(axis) + 1]
    for other in counted:
        weight[AXES.index(other)] = 1.0
    return np.asarray(np.asarray(machine.tool_offset_mm) + offset_mm + commanded_mm * weight)


def nominal_position_mm(machine: Machine, carrier: str, commanded_mm: Numbers, offset_mm: Numbers) -> Numbers:
    """Give where targets are without errors, (n, 3): in the base frame, for `relative` seen from the work."""
    weight = np.zeros(3)
    for axis in moving_axes(machine, carrier):
        weight[AXES.index(axis)] = travel_sign(carrier)
    origin = np.zeros(3) if carrier == "work" else np.asarray(machine.tool_offset_mm)
    return np.asarray(origin + offset_mm + commanded_mm * weight)


def _outside(side: str, axis: str) -> str:
    return side[side.index(axis) + 1 :]
