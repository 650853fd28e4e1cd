"""From the stages' curves to tables with uncertainties, the alternatives, and what is not determined."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Literal

import numpy as np

from geoerr.error_functions import (
    ALL_NAMES,
    LI_SQUARENESS,
    SQUARENESS,
    ErrorFunction,
    ErrorFunctions,
    NotDetermined,
    Squareness,
)
from geoerr.identify.axis import angle_name, delta_name
from geoerr.identify.between_places import integral_covariance
from geoerr.identify.linear import Curve, Numbers
from geoerr.identify.measurements import Measurements
from geoerr.identify.reasons import (
    Findings,
    why_pitch_or_yaw,
    why_positioning,
    why_roll,
    why_squareness,
    why_straightness,
)
from geoerr.identify.roll import RootRoll, root_roll
from geoerr.identify.squareness import PAIRS, included_angle
from geoerr.identify.stages import Stages
from geoerr.identify.straightness import TangentVerdict, angle_of, compare, integrated
from geoerr.identify.uncertainty import Noise
from geoerr.machine import AXES

METHOD = "nine-line"
# What holds where its line ran and not at the carriage origin stands under this name among the alternatives.
AT_LINE = "at-line"

Curves = dict[str, Curve]


def assemble(
    findings: Findings,
    data: Measurements,
    stages: Stages,
    noise: Noise,
    straightness: Literal["direct", "integrated"],
    roll: Literal["linear", "li"],
    notes: Sequence[str],
) -> tuple[ErrorFunctions, tuple[TangentVerdict, ...]]:
    """Make the error functions and judge direct against integrated straightness."""
    curves = {name: curve for axis in stages.functions.values() for name, curve in axis.functions.items()}
    names = _straightness_names()
    direct = {name: curves[name] for name in names if name in curves}
    by_integral = _integrals(findings, curves)
    verdicts = [
        compare(
            name,
            direct[name],
            by_integral[name],
            noise.covariance_of,
            _between(axis, by_integral[name], curves, noise),
        )
        for name, (axis, _) in names.items()
        if name in direct and name in by_integral
    ]
    chosen, other = (direct, by_integral) if straightness == "direct" else (by_integral, direct)
    other_name = "integrated" if straightness == "direct" else "direct"
    kept = {name: curve for name, curve in curves.items() if name not in names} | chosen
    functions = {name: _table(curve, noise) for name, curve in kept.items()}
    alternatives: dict[str, dict[str, ErrorFunction | Squareness]] = {}
    if other:
        alternatives[f"straightness-{other_name}"] = {name: _table(curve, noise) for name, curve in other.items()}
    roots = _root_rolls(findings, data, stages)
    _place_rolls(functions, alternatives, roots, roll)
    squareness = _squareness(findings, noise)
    elsewhere = _at_lines(findings, functions, squareness)
    if elsewhere:
        places: dict[str, ErrorFunction | Squareness] = {**functions, **squareness}
        alternatives[AT_LINE] = {name: places[name] for name in ALL_NAMES if name in elsewhere}
        functions = {name: table for name, table in functions.items() if name not in elsewhere}
        squareness = {name: value for name, value in squareness.items() if name not in elsewhere}
    not_determined = tuple(
        NotDetermined(name, elsewhere.get(name) or _why(findings, name, straightness, other, roots, roll))
        for name in ALL_NAMES
        if name not in functions and name not in squareness
    )
    errors = ErrorFunctions(
        machine=findings.machine,
        functions={name: functions[name] for name in ALL_NAMES if name in functions},
        squareness=squareness,
        method=METHOD,
        not_determined=not_determined,
        alternatives=alternatives,
        notes=(*notes, *_notes(findings, roots, () if straightness == "direct" else direct)),
    )
    return errors, tuple(verdict for verdict in verdicts if verdict is not None)


def _straightness_names() -> dict[str, tuple[str, int]]:
    """Give the six names with their axis and component."""
    return {
        delta_name(component, axis): (axis, component)
        for axis in AXES
        for component in range(3)
        if component != AXES.index(axis)
    }


def _integrals(findings: Findings, curves: Curves) -> Curves:
    result = {}
    for name, (axis, component) in _straightness_names().items():
        angle = curves.get(angle_name(angle_of(axis, component), axis))
        if angle is not None and len(angle.nodes) >= 3:
            result[name] = integrated(findings.machine, axis, component, angle)
    return result


def _between(axis: str, integral: Curve, curves: Curves, noise: Noise) -> Numbers:
    """Give the covariance of an integral that is due to what angles of its axis do between its nodes."""
    angles = [curves[name] for name in (angle_name(direction, axis) for direction in range(3)) if name in curves]
    own = [angle.linear for angle in angles if np.array_equal(angle.nodes, integral.nodes)]
    return integral_covariance(
        integral.position_mm, [one.value for one in own], [noise.covariance_of(one) for one in own]
    )


def _table(curve: Curve, noise: Noise) -> ErrorFunction:
    return ErrorFunction(curve.position_mm, curve.linear.value, noise.std_of(curve.linear))


def _squareness(findings: Findings, noise: Noise) -> dict[str, Squareness]:
    result = {}
    for name in SQUARENESS:
        found = included_angle(PAIRS[name], findings.axes, findings.frames, noise)
        if found is not None:
            std = noise.std_of(found.angle)
            iso_sign = LI_SQUARENESS[name][1]
            result[name] = Squareness(iso_sign * float(found.angle.value[0]), None if std is None else float(std[0]))
    return result


def _root_rolls(findings: Findings, data: Measurements, stages: Stages) -> dict[str, RootRoll]:
    """Solve Eq. 22 for each axis, with straightness by Eq. 19 as the paper has it."""
    rolls = {}
    for axis, nodes_mm in stages.nodes_mm.items():
        along = stages.along[axis]
        if along is None or any(data.is_parallel[one.source.session] for one in findings.passes_along(axis)):
            continue
        angles = {direction: curve for direction, curve in along.angles.items() if len(curve.nodes) == len(nodes_mm)}
        straightness = {
            component: _minus_line_of_points(
                nodes_mm, integrated(findings.machine, axis, component, angles[turn]).linear.value
            )
            for component in range(3)
            if component != AXES.index(axis) and (turn := angle_of(axis, component)) in angles
        }
        found = root_roll(
            AXES.index(axis),
            findings.lines(axis),
            findings.passes,
            data,
            nodes_mm,
            findings.places.base_mm[axis],
            straightness,
        )
        if found is not None and len(nodes_mm) - found.n_without_root >= 2:
            rolls[angle_name(AXES.index(axis), axis)] = found
    return rolls


def _minus_line_of_points(position_mm: Numbers, value: Numbers) -> Numbers:
    """Take the least-squares line through the points off, as the fit of Eq. 22's line does."""
    centered = position_mm - position_mm.mean()
    return np.asarray(value - value.mean() - centered * (centered @ value) / (centered @ centered))


def _place_rolls(
    functions: dict[str, ErrorFunction],
    alternatives: dict[str, dict[str, ErrorFunction | Squareness]],
    roots: Mapping[str, RootRoll],
    roll: Literal["linear", "li"],
) -> None:
    """Put one kind of roll into the functions and the other under the alternatives."""
    names = [angle_name(AXES.index(axis), axis) for axis in AXES]
    linear = {name: functions[name] for name in names if name in functions}
    by_root = {}
    for name, found in roots.items():
        has_root = np.isfinite(found.value_rad)
        by_root[name] = ErrorFunction(found.position_mm[has_root], found.value_rad[has_root], None)
    if roll == "linear":
        if by_root:
            alternatives["roll-li"] = dict(by_root)
        return
    for name in linear:
        del functions[name]
    functions.update(by_root)
    if linear:
        alternatives["roll-linear"] = dict(linear)


def _why(
    findings: Findings,
    name: str,
    straightness: Literal["direct", "integrated"],
    other: Curves,
    roots: Mapping[str, RootRoll],
    roll: Literal["linear", "li"],
) -> str:
    if name in SQUARENESS:
        return why_squareness(findings, PAIRS[name])
    axis = name[2].lower()
    index = AXES.index(axis)
    if name[1] in "ABC":
        direction = "ABC".index(name[1])
        if direction != index:
            return why_pitch_or_yaw(findings, axis, direction)
        if roll == "li" and name not in roots:
            return f"Eq. 22 needs pitch, yaw, an offset line along {axis.upper()} and roots at two points"
        return why_roll(findings, axis)
    component = "XYZ".index(name[1])
    if component == index:
        return why_positioning(findings, axis)
    if straightness == "integrated":
        needed = angle_of(axis, component)
        return f"the integral needs {angle_name(needed, axis)}: {why_pitch_or_yaw(findings, axis, needed)}"
    why = why_straightness(findings, axis, component)
    return f"{why}; integrated from the angle it stands under alternatives" if name in other else why


def _at_lines(
    findings: Findings, functions: Mapping[str, ErrorFunction], squareness: Mapping[str, Squareness]
) -> dict[str, str]:
    """Say of what was found at a line and not at the carriage origin where it holds, by name."""
    result: dict[str, str] = {}
    for axis, axis_functions in findings.axes.items():
        names = [name for name in axis_functions.at_line if name in functions]
        names += [name for name, pair in PAIRS.items() if name in squareness and _is_at_line(findings, axis, pair)]
        result |= dict.fromkeys(names, f"{_where(findings, axis)}; what it is there stands under alternatives")
    return result


def _where(findings: Findings, axis: str) -> str:
    place = ", ".join(f"{value:g}" for value in findings.places.base_mm[axis])
    return (
        f"known at the {axis.upper()} line's own place only (lever {place} mm): the angles that would refer it to "
        "the carriage origin are unknown"
    )


def _notes(findings: Findings, roots: Mapping[str, RootRoll], direct_alternatives: Collection[str]) -> list[str]:
    notes = []
    missing = sorted(number for numbers in findings.places.missing.values() for number in numbers)
    if missing:
        numbers = ", ".join(str(number) for number in missing)
        notes.append(f"of Li's nine lines the data lack {numbers}")
    for axis, axis_functions in findings.axes.items():
        # With integrated straightness the direct one, which this is about, stands under the alternatives.
        names = [f"{name} (direct)" for name in axis_functions.at_line if name in direct_alternatives]
        if names:
            notes.append(f"{_where(findings, axis)}: {', '.join(names)}")
    for name, found in roots.items():
        if found.n_without_root:
            notes.append(f"{name} by Eq. 22: {found.n_without_root} of {len(found.value_rad)} points have no root")
    return notes


def _is_at_line(findings: Findings, axis: str, pair: tuple[str, str]) -> bool:
    """Tell whether a squareness contains an axis's direction at its line instead of at the carriage origin."""
    others = [other for other in pair if other != axis]
    return len(others) == 1 and delta_name(AXES.index(others[0]), axis) in findings.axes[axis].at_line
