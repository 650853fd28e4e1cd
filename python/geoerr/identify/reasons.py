"""Why one of the 21 is not determined: the line by Li's number, and what else is missing."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from geoerr.identify.along import FittedPass
from geoerr.identify.axis import AxisFunctions, angle_name
from geoerr.identify.frames import SessionFrame
from geoerr.identify.passes import FoundPasses
from geoerr.identify.places import BASE_NUMBER, OFFSET_NUMBER, SAME_PLACE_MM, Line, Places
from geoerr.machine import AXES, Machine


@dataclass(frozen=True)
class Findings:
    """What the reasons are read from."""

    machine: Machine
    found: FoundPasses
    passes: Sequence[FittedPass]
    places: Places
    frames: Mapping[str, SessionFrame]
    axes: Mapping[str, AxisFunctions]

    def lines(self, axis: str) -> list[Line]:
        """Give the lines along an axis."""
        return [line for line in self.places.lines if line.axis == axis]

    def passes_along(self, axis: str) -> list[FittedPass]:
        """Give the passes along an axis."""
        return [one for one in self.passes if one.source.axis == axis]


def why_positioning(findings: Findings, axis: str) -> str:
    """Say why δ_aa is not determined."""
    missing = _why_no_line(findings, axis)
    if missing:
        return missing
    if not any(one.shows_travel for one in findings.passes_along(axis)):
        return f"no pass along {axis.upper()} measured the component along it"
    return f"no two positions on {axis.upper()} have points on all lines that refer it to the carriage origin"


def why_pitch_or_yaw(findings: Findings, axis: str, direction: int) -> str:
    """Say why pitch or yaw is not determined."""
    missing = _why_no_line(findings, axis)
    if missing:
        return missing
    if not any(one.shows_travel for one in findings.passes_along(axis)):
        return f"no pass along {axis.upper()} measured the component along it"
    single = _why_one_place(findings, axis)
    if single:
        return single
    offset = AXES[3 - AXES.index(axis) - direction]
    needed = {OFFSET_NUMBER[(axis, offset)], BASE_NUMBER[axis]}
    lacking = sorted(needed & set(findings.places.missing[axis]))
    if lacking:
        return f"{name_lines(lacking)} missing"
    if _is_one_plane(findings, axis):
        other = angle_name(AXES.index(offset), axis)
        return (
            f"all targets on the {axis.upper()} lines lie on one slanted line, so that only a sum of "
            f"{angle_name(direction, axis)} and {other} shows"
        )
    return f"no two positions on {axis.upper()} have points on all the lines that it needs"


def why_roll(findings: Findings, axis: str) -> str:
    """Say why roll is not determined."""
    missing = _why_no_line(findings, axis) or _why_one_place(findings, axis) or _why_not_across(findings, axis)
    if missing:
        return missing
    if _base_and_offset_apart(findings, axis):
        return (
            f"its linear part is lost: no session holds line {BASE_NUMBER[axis]} together with an offset line along "
            f"{axis.upper()} (the camera was moved between them)"
        )
    lacking = [number for number in findings.places.missing[axis] if number > 3]
    if lacking:
        return f"{name_lines(lacking)} missing"
    return "the targets' offsets across the axis do not separate it from pitch and yaw"


def why_straightness(findings: Findings, axis: str, component: int) -> str:
    """Say why a direct straightness is not determined."""
    missing = _why_no_line(findings, axis) or _why_not_across(findings, axis, component)
    if missing:
        return missing
    return f"fewer than three positions on {axis.upper()} have points on all the lines that it needs"


def why_squareness(findings: Findings, pair: tuple[str, str]) -> str:
    """Say why a squareness is not determined."""
    for axis in pair:
        missing = _why_no_line(findings, axis)
        if missing:
            return missing
    together = [frame for frame in findings.frames.values() if set(pair) <= frame.axes]
    first, second = (axis.upper() for axis in pair)
    if not together:
        return f"no session holds lines along both {first} and {second}: the camera was moved between them"
    for axis, other in (pair, pair[::-1]):
        across = _why_not_across(findings, axis, AXES.index(other))
        if across:
            return across
        keys = [key for key in findings.axes[axis].slopes if key.component == AXES.index(other)]
        turned = sorted({turn for key in keys for turn in key.turned_by})
        if turned:
            places = ", ".join(f"{name.upper()} = {position:g} mm" for name, position in turned)
            return f"the {axis.upper()} line was taken at {places}, where the angle that turns it is not known"
    return f"the directions of {first} and {second} at the carriage origin are not determined in one session"


def name_lines(numbers: Sequence[int]) -> str:
    """Name lines by Li's numbers and by what they are, with the verb."""
    described = {
        number: f"{axis.upper()}, target offset along {offset}" for (axis, offset), number in OFFSET_NUMBER.items()
    }
    described |= {number: f"{axis.upper()}, through the crossing point" for axis, number in BASE_NUMBER.items()}
    names = " and ".join(f"{number} ({described[number]})" for number in numbers)
    return f"line {names} is" if len(numbers) == 1 else f"lines {names} are"


def _why_no_line(findings: Findings, axis: str) -> str | None:
    if findings.passes_along(axis):
        return None
    upper = axis.upper()
    side = findings.machine.side(axis)
    numbers = sorted(
        [BASE_NUMBER[axis], *(number for (moving, _), number in OFFSET_NUMBER.items() if moving == axis)]
    )
    text = f"no line along {upper} is in the data (lines {numbers[0]}, {numbers[1]} and {numbers[2]})"
    if findings.found.left_out["the target stands still while this axis moves"]:
        text += f"; {upper} moves the {side}: for a camera on the floor the target must be there (carrier = {side})"
    return text


def _why_one_place(findings: Findings, axis: str) -> str | None:
    if len(findings.lines(axis)) > 1:
        return None
    lacking = findings.places.missing[axis]
    return f"only one target place moves along {axis.upper()}: {name_lines(lacking)} missing"


def _why_not_across(findings: Findings, axis: str, component: int | None = None) -> str | None:
    passes = findings.passes_along(axis)
    frames = [findings.frames[one.source.session] for one in passes]
    if all(frame.base_from_measured is None for frame in frames):
        return (
            f"each session shows one target moving along {axis.upper()} and no other axis: how the measuring frame "
            "is turned about this line is not known"
        )
    components = [component] if component is not None else [index for index in range(3) if AXES[index] != axis]
    for one, frame in zip(passes, frames, strict=True):
        if frame.origin != "parallel" or any(one.source.components[index] for index in components):
            return None
    wanted = " or ".join(AXES[index].upper() for index in components)
    return f"the component along {wanted} was not measured on the {axis.upper()} lines"


def _is_one_plane(findings: Findings, axis: str) -> bool:
    across = [index for index in range(3) if AXES[index] != axis]
    points = np.array([line.place_mm for line in findings.lines(axis)])[:, across]
    singular = np.linalg.svd(points - points[0], compute_uv=False)
    return len(singular) < 2 or float(singular[1]) < SAME_PLACE_MM


def _base_and_offset_apart(findings: Findings, axis: str) -> bool:
    """Tell whether no session shows two places of the axis."""
    sessions: dict[str, set[int]] = {}
    for number, line in enumerate(findings.lines(axis)):
        for one in line.passes:
            sessions.setdefault(findings.passes[one].source.session, set()).add(number)
    return all(len(numbers) < 2 for numbers in sessions.values())
