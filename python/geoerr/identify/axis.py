"""One axis: its functions, referred from the base line to the carriage origin, in the gauge.

Stages work at the base line's lever λ. errors.json holds the functions of the carriage origin (l = 0): δ − ε × λ.
What this moves into a slope of straightness goes, with the slope that straightness already had, to the axis's
direction and so to squareness: E(q, l) stays what was measured.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from geoerr.identify.along import Along
from geoerr.identify.linear import Curve, Linear, Numbers
from geoerr.identify.places import SAME_PLACE_MM
from geoerr.identify.straightness import without_slope
from geoerr.identify.transverse import SlopeKey, Transverse
from geoerr.machine import AXES

TRANSLATION = "XYZ"
ROTATION = "ABC"


@dataclass(frozen=True)
class AxisFunctions:
    """The functions of one axis.

    Attributes
    ----------
    functions
        ISO name to curve, in the gauge; absent where undetermined. Straightness is the direct one.
    slopes
        What is to be added to the session's fitted direction, by component.
    at_line
        ISO name to the lever (3,) that the function belongs to, where it could not be referred to the carriage
        origin.
    """

    functions: dict[str, Curve]
    slopes: dict[SlopeKey, Linear] = field(default_factory=dict)
    at_line: dict[str, Numbers] = field(default_factory=dict)


def angle_name(direction: int, axis: str) -> str:
    """Give the ISO name of a rotation, e.g. ECX for direction 2 of x."""
    return f"E{ROTATION[direction]}{axis.upper()}"


def delta_name(component: int, axis: str) -> str:
    """Give the ISO name of a translation, e.g. EYX for component 1 of x."""
    return f"E{TRANSLATION[component]}{axis.upper()}"


def angles_of(axis: str, along: Along | None, transverse: Transverse | None) -> dict[int, Curve]:
    """Join the angles that the stages found."""
    angles = dict(along.angles) if along is not None else {}
    if transverse is not None:
        angles |= transverse.angles
        if transverse.roll is not None:
            angles[AXES.index(axis)] = transverse.roll
    return angles


def at_carriage_origin(
    axis: str, along: Along | None, transverse: Transverse | None, base_mm: Numbers
) -> AxisFunctions:
    """Refer one axis's functions to l = 0 and put them into the gauge."""
    angles = angles_of(axis, along, transverse)
    functions = {angle_name(direction, axis): curve for direction, curve in angles.items()}
    at_line: dict[str, Numbers] = {}
    index = AXES.index(axis)
    if along is not None and along.positioning is not None:
        positioning, complete = _referred(along.positioning, index, angles, base_mm)
        if positioning is not None:
            functions[delta_name(index, axis)] = positioning.from_first()
            if not complete:
                at_line[delta_name(index, axis)] = base_mm
    slopes: dict[SlopeKey, Linear] = {}
    if transverse is None:
        return AxisFunctions(functions, slopes, at_line)
    for component, curve in transverse.straightness.items():
        referred, complete = _referred(curve, component, angles, base_mm)
        if referred is None or len(referred.nodes) < 3:
            continue
        name = delta_name(component, axis)
        functions[name], removed = without_slope(referred)
        if not complete or component in transverse.at_moving_point:
            at_line[name] = base_mm
        slopes |= {key: slope + removed for key, slope in transverse.slopes.items() if key.component == component}
    return AxisFunctions(functions, slopes, at_line)


def _referred(
    curve: Curve, component: int, angles: Mapping[int, Curve], lever_mm: Numbers
) -> tuple[Curve | None, bool]:
    """Subtract (ε × λ) of one component; say whether all of it was known. None where no two nodes are left."""
    following, last = (component + 1) % 3, (component + 2) % 3
    complete = True
    result = curve
    # (ε × λ) of a component = ε_following λ_last − ε_last λ_following.
    for direction, arm_mm in ((following, lever_mm[last]), (last, -lever_mm[following])):
        if abs(arm_mm) < 1e-9:
            continue
        if direction in angles:
            result = result.minus(angles[direction], float(arm_mm))
        elif abs(arm_mm) >= SAME_PLACE_MM:
            complete = False
    return (result if len(result.nodes) >= 2 else None), complete


def common_nodes(first: Curve, second: Curve) -> Numbers:
    """Give the positions that two functions share."""
    return first.on(np.intersect1d(first.nodes, second.nodes)).position_mm
