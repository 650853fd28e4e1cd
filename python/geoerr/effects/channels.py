"""From a catalogue channel (`along`, `across`, ...) and an axis to channels of the kinematic chain."""

from __future__ import annotations

from dataclasses import dataclass

from geoerr.effects.description import PartSpec
from geoerr.machine import AXES, Machine

_ROTATION = dict(zip(AXES, "ABC", strict=True))


@dataclass(frozen=True)
class Place:
    """One channel of the chain; `suffix` (`x`, `y`, `z` or empty) is attached to the coefficients that act there."""

    channel: str
    suffix: str = ""
    factor: float = 1.0


def across(axis: str) -> tuple[str, ...]:
    """Give the two directions across an axis."""
    return tuple(direction for direction in AXES if direction != axis)


def angle_of_straightness(axis: str, direction: str, side: str) -> tuple[str, float]:
    """Give the joint angle that follows a guideway's tangent, and the sign s in ε = s·dδ/dq.

    On the tool side ε_zx = +dδ_yx/dx, ε_yx = −dδ_zx/dx and so on round the axes; on the work side every sign turns
    (Li Eq. 19 with its signs corrected: ε × ê_axis is the tangent's change of direction).

    Parameters
    ----------
    axis, direction
        Moving axis and the direction of its straightness.
    side
        `tool` or `work`: which side of the base carries the axis.
    """
    about = next(name for name in AXES if name not in (axis, direction))
    # ε about `about` turns ê_axis towards +direction where (about, axis, direction) is a cyclic order.
    is_cyclic = (AXES.index(axis) - AXES.index(about)) % 3 == 1
    sign = 1.0 if is_cyclic else -1.0
    return f"E{_ROTATION[about]}{axis.upper()}", sign if side == "tool" else -sign


def places(part: PartSpec, axis: str | None, candidate: str | None, machine: Machine) -> tuple[Place, ...]:
    """Give the channels of a part.

    Parameters
    ----------
    part
        As the catalogue has it.
    axis
        The moving axis that the part is of (`x`, `y`, `z`), or None.
    candidate
        The candidate's axis as its reference writes it: a direction for bodies, a pair for squareness.
    machine
        For the side that carries the axis.
    """
    factor = 1.0
    if part.turns_on_work_side and axis is not None and machine.side(axis) == "work":
        factor = -1.0
    if part.channel in ("squareness", "tool", "work", "target", "rig"):
        return (Place(_elsewhere(part, candidate), factor=factor),)
    if axis is None:
        raise AssertionError("a joint's part without an axis passed the reader")
    if part.channel == "along":
        return (Place(f"E{axis.upper()}{axis.upper()}", factor=factor),)
    if part.direction is not None and part.channel in ("across", "angular"):
        letter = part.direction.upper() if part.channel == "across" else _ROTATION[part.direction]
        return (Place(f"E{letter}{axis.upper()}", factor=factor),)
    if part.channel == "across":
        return tuple(Place(f"E{b.upper()}{axis.upper()}", b, factor) for b in across(axis))
    if part.channel == "across-angle":
        angles = {b: angle_of_straightness(axis, b, machine.side(axis)) for b in across(axis)}
        return tuple(Place(name, b, factor * sign) for b, (name, sign) in angles.items())
    if part.channel == "angular":
        return tuple(Place(f"E{_ROTATION[b]}{axis.upper()}", b, factor) for b in AXES)
    return _joint(part, axis, candidate, machine, factor)


def _joint(part: PartSpec, axis: str, candidate: str | None, machine: Machine, factor: float) -> tuple[Place, ...]:
    direction = part.direction or ""
    if direction == "each":
        first, _, second = (candidate or "").partition("*")
        return tuple(
            Place(f"E{b.upper()}{axis.upper()}", b, factor)
            for b in AXES
            if not _is_held_by_an_angle(b, first, second, part.linear_in, machine)
        )
    if direction.startswith("angle-of-"):
        name, sign = angle_of_straightness(axis, direction[-1].lower(), machine.side(axis))
        return (Place(name, factor=factor * sign),)
    return (Place(f"E{direction}{axis.upper()}", factor=factor),)


def _elsewhere(part: PartSpec, candidate: str | None) -> str:
    if part.channel == "rig":
        name = part.direction or ""
        return name if name.startswith("motion-") else f"rig-{name}"
    if part.channel == "squareness":
        return f"S_{candidate if part.axis == 'first' else part.axis}"
    if part.direction is not None:
        return f"{part.channel}-{part.direction}"
    if candidate is None:
        raise AssertionError("a body's part without a direction passed the reader")
    return candidate if candidate.startswith("work-") else f"{part.channel}-{candidate}"


def _is_held_by_an_angle(
    direction: str, first: str, second: str, linear_in: tuple[str, ...], machine: Machine
) -> bool:
    """Tell whether f(q_a)·q_b is already an angle of a times its lever q_b (rigid bodies hold it).

    An angle of `a` acts through the lever q_b in the two directions across b, where the lever of `a` holds q_b.
    Across both axes it comes with a second product, f(q_a)·q_c along b, where the lever holds the third position too:
    then the first product alone is none of the rigid body's.
    """
    carried = {"first": (first, second), "second": (second, first)}
    for which in linear_in:
        lever, owner = carried[which]
        positions = lever_axes(owner, machine)
        if direction != lever and lever in positions and (direction == owner or direction not in positions):
            return True
    return False


def lever_axes(axis: str, machine: Machine) -> str:
    """Give the other axes whose positions are in the lever of an axis's angles, the tool seen from the work.

    On the tool side those further out, on the work side those further in and all of the tool side.
    """
    if machine.side(axis) == "tool":
        order = machine.tool_axes
        return order[order.index(axis) + 1 :]
    order = machine.work_axes
    return machine.tool_axes + order[: order.index(axis)]
