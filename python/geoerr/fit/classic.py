"""The classic errors as terms: 18 smooth functions of one axis position each, and three squarenesses.

Gauge (`docs/theory/gauge.md`): positioning and angles are 0 at the first point of the measured range; straightness
has no least-squares slope over the range and is 0 at the first point; the slope is squareness.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Literal

import numpy as np

from geoerr.bases import basis_of, places_for_knots, spline_over
from geoerr.error_functions import LI_NAMES, LINEAR_AND_ANGULAR, is_angular
from geoerr.fit.sightings import SAME_POSITION_MM, Numbers, Sightings
from geoerr.machine import AXES, Machine
from geoerr.observations import ONE_PLACE
from geoerr.terms import SQUARENESS_CHANNELS, BasisSpec, Parameter, Part, Term

Components = Literal["21", "12", "none"]

# Straightness that follows from an angle where a carriage keeps to its guideway's tangent, on the tool side (Li
# Eq. 19, with the signs of exact kinematics): angle -> (straightness, sign). On the work side every sign turns.
TANGENT = {
    "ECX": ("EYX", 1.0),
    "EBX": ("EZX", -1.0),
    "ECY": ("EXY", -1.0),
    "EAY": ("EZY", 1.0),
    "EBZ": ("EXZ", 1.0),
    "EAZ": ("EYZ", -1.0),
}

# Splines of one function that any data may be given.
MOST_FUNCTIONS = 24
# Positions of which a function may not miss one: what it misses of a few levels of a grid looks like a wave. Of more,
# a quarter fewer functions follow what is smooth, with less of the noise and of effects that are still to be found.
_FEW_POSITIONS = 7
# Points are scattered where more of them than this share have positions of their own.
_SCATTERED = 0.7
# As few functions as can bend: a cubic, and one bend.
BENT = 5
# Measured numbers for each of them from which on enough are left over to tell the noise by.
_NUMBERS_OF_A_FUNCTION = 2


def names_of(components: Components) -> tuple[str, ...]:
    """Give the error functions of a model: Li's 18, Dobariya's 9 translations, or none."""
    if components == "none":
        return ()
    return tuple(name for name in LINEAR_AND_ANGULAR if components == "21" or not is_angular(name))


def is_straightness(name: str) -> bool:
    """Tell whether an error function is a translation across its axis."""
    return not is_angular(name) and name[1] != name[2]


def title_of(name: str) -> str:
    """Say in words what one of the 18 is."""
    axis = name[2]
    if not is_angular(name):
        return f"positioning of {axis}" if name[1] == axis else f"straightness of {axis} along {name[1].lower()}"
    about = "XYZ"["ABC".index(name[1])]
    return f"roll of {axis}" if about == axis else f"rotation of {axis} about {about.lower()}"


def classic_terms(
    machine: Machine,
    components: Components,
    bases: Mapping[str, BasisSpec],
    *,
    follows_tangent: bool = False,
) -> tuple[Term, ...]:
    """Make the terms of the classic errors.

    Parameters
    ----------
    components
        Which errors.
    bases
        A basis for each error function that is to be fitted; one that is not named is left out.
    follows_tangent
        Whether straightness is the integral of the angle (Li Eq. 19) instead of functions of its own.
    """
    implied = {straight for straight, _ in TANGENT.values()} if follows_tangent else set()
    terms = [
        _function(machine, name, bases[name], follows_tangent)
        for name in names_of(components)
        if name in bases and name not in implied
    ]
    if components != "none":
        terms += [_squareness(channel) for channel in SQUARENESS_CHANNELS]
    return tuple(terms)


def _function(machine: Machine, name: str, basis: BasisSpec, follows_tangent: bool) -> Term:
    parts = [Part(name, basis=basis)]
    if follows_tangent and name in TANGENT:
        straight, sign = TANGENT[name]
        side = 1.0 if machine.side(basis.axis) == "tool" else -1.0
        integral = replace(basis, is_tangent_integral=True)
        parts.append(Part(straight, basis=integral, factor=side * sign))
    title = f"{title_of(name)} ({LI_NAMES[name]})"
    return Term(name, title, "classic", None, basis.axis, None, tuple(parts), coefficients_of(name, basis))


def coefficients_of(name: str, basis: BasisSpec) -> tuple[Parameter, ...]:
    """Give the coefficients of an error function on a basis, values unknown."""
    unit = "rad" if is_angular(name) else "mm"
    return tuple(Parameter(f"c{number}", unit) for number in range(basis.n_functions))


def on_basis(term: Term, basis: BasisSpec) -> Term:
    """Give an error function on another basis, values unknown; a straightness that follows its angle goes along."""
    parts = tuple(
        replace(part, basis=replace(basis, is_tangent_integral=part.basis.is_tangent_integral))
        for part in term.parts
        if part.basis is not None
    )
    return replace(term, parts=parts, coefficients=coefficients_of(term.id, basis))


def _squareness(channel: str) -> Term:
    pair = channel[-2:]
    return Term(
        channel,
        f"squareness of {pair[0].upper()} and {pair[1].upper()}, included angle less 90°",
        "classic",
        None,
        pair,
        None,
        (Part(channel, expression="S"),),
        (Parameter("S", "rad"),),
    )


def gauge_rows(terms: Sequence[Term]) -> Numbers:
    """Give the gauge as rows C (k, n_coefficients) with C θ = 0, over the coefficients of all terms."""
    total = sum(len(term.coefficients) for term in terms)
    rows: list[Numbers] = []
    first = 0
    for term in terms:
        count = len(term.coefficients)
        if term.kind == "classic" and term.parts[0].basis is not None:
            basis = basis_of(term.parts[0].basis)
            low = basis.range[0]
            functionals = [basis.value_row(low)]
            if is_straightness(term.id):
                functionals.append(basis.slope_row())
            for functional in functionals:
                row = np.zeros(total)
                row[first : first + count] = functional
                rows.append(row)
        first += count
    return np.array(rows).reshape(len(rows), total)


def tells_noise(
    sightings: Sightings, names: Sequence[str], positions_mm: Mapping[str, Numbers], most: int = MOST_FUNCTIONS
) -> bool:
    """Tell whether functions may pass through every position and what is left over still tells the noise.

    A grid has hundreds of points on five levels, nine lines that were run once have little more than they have
    unknowns.
    """
    n_functions = sum(min(len(positions_mm[name[2].lower()]), most) for name in names)
    return int(sightings.is_measured.sum()) >= _NUMBERS_OF_A_FUNCTION * n_functions


def rich_basis(
    axis: str,
    position_mm: Numbers,
    *,
    is_stated: bool = True,
    is_noise_told: bool = True,
    most: int = MOST_FUNCTIONS,
) -> BasisSpec | None:
    """Give the richest basis that the distinct positions (k,) of an axis support; None where it never moved.

    Cubic splines with knots spread like the positions, never more functions than positions; a quarter fewer
    where nothing is stated of the noise, so that some of the positions are left for it. Of few positions none can be
    spared: where the noise is told by what is left over, they are all followed.
    """
    count = len(position_mm)
    if not is_stated:
        count = min(count, max(2, 3 * count // 4, _FEW_POSITIONS if is_noise_told else 0))
    if count < 2:
        return None
    low, high = float(position_mm[0]), float(position_mm[-1])
    count = min(count, most)
    if count < BENT:
        return BasisSpec("polynomial", axis, degree=count - 1, low_mm=low, high_mm=high)
    return spline_over(axis, position_mm, count)


def rich_bases(
    sightings: Sightings, names: Sequence[str], positions_mm: Mapping[str, Numbers], most: int = MOST_FUNCTIONS
) -> dict[str, BasisSpec]:
    """Give the richest basis of each error function (ISO names); functions of an axis that never moved have none.

    Where nothing is stated of the noise, it is told by what all of them leave over: points that are scattered, each
    at positions of its own, would be followed one by one.
    """
    is_noise_told = tells_noise(sightings, names, positions_mm)
    if not sightings.is_stated and _is_scattered(sightings):
        n_seen = sum(_is_seen(name, sightings, positions_mm) for name in names)
        n_numbers = int(sightings.is_measured.sum())
        most = min(most, max(BENT, n_numbers // (_NUMBERS_OF_A_FUNCTION * max(n_seen, 1))))
    found = {}
    for name in names:
        axis = name[2].lower()
        basis = rich_basis(
            axis, positions_mm[axis], is_stated=sightings.is_stated, is_noise_told=is_noise_told, most=most
        )
        if basis is not None:
            found[name] = basis
    return found


def _is_scattered(sightings: Sightings) -> bool:
    """Tell whether most rows stand at positions of their own along some axis: nothing was measured twice there."""
    positions = positions_by_axis(sightings.commanded_mm, SAME_POSITION_MM)
    return max(map(len, positions.values())) > _SCATTERED * len(sightings)


def _is_seen(name: str, sightings: Sightings, positions_mm: Mapping[str, Numbers]) -> bool:
    """Tell whether rows can show an error function: its axis moves, and its component is measured.

    An angle shows in all components, and where more than its own axis moves.
    """
    component, axis = name[1], name[2].lower()
    moves = [one for one in AXES if len(positions_mm[one]) > 1]
    if component in "ABC":
        return axis in moves and len(moves) > 1
    return axis in moves and bool(sightings.is_measured[:, "XYZ".index(component)].any())


def distinct_positions(position_mm: Numbers, same_mm: float) -> Numbers:
    """Give the distinct positions (k,) of an axis, neighbours closer than `same_mm` being one."""
    ordered = np.unique(position_mm)
    if not ordered.size:
        return ordered
    is_new = np.concatenate(([True], np.diff(ordered) > same_mm))
    return np.asarray(ordered[is_new])


def positions_by_axis(commanded_mm: Numbers, same_mm: float) -> dict[str, Numbers]:
    """Give the distinct positions of each axis.

    Neighbours that are a hundredth as far apart as positions are on average are one, too: a third of a length is
    rounded up on the way there, and down on the way back.
    """
    return {axis: _distinct_mm(own_mm, same_mm) for axis, own_mm in zip(AXES, commanded_mm.T, strict=True)}


def _distinct_mm(position_mm: Numbers, same_mm: float = SAME_POSITION_MM) -> Numbers:
    own = distinct_positions(position_mm, same_mm)
    if len(own) > 2:
        low, high = float(own[0]), float(own[-1])
        own = distinct_positions(own, max(same_mm, ONE_PLACE * (high - low) / len(own)))
        own[-1] = high
    return own


def knot_places_by_axis(sightings: Sightings) -> dict[str, Numbers]:
    """Give the positions of each axis that error functions may follow one by one: not all of those side by side.

    Where an axis stands while others move little tells its errors: of lines that cross once, all together, nothing
    but smoothness tells them there. Such places count where an axis has more of them than it runs through.
    """
    found = {}
    for index, axis in enumerate(AXES):
        along_mm = sightings.commanded_mm[:, index]
        moves = moves_in_its_pass(sightings, along_mm)
        of_lines, of_all = (_distinct_mm(own_mm) for own_mm in (along_mm[moves], along_mm))
        # What a function is asked for reaches from end to end.
        own = of_all if len(of_all) > 2 * len(of_lines) else np.union1d(of_lines, of_all[[0, -1]])
        found[axis] = places_for_knots(_distinct_mm(own), MOST_FUNCTIONS)
    return found


def moves_in_its_pass(sightings: Sightings, along_mm: Numbers) -> np.ndarray:
    """Tell in which rows (n,) an axis, commanded to `along_mm` (n,), moves in the row's pass."""
    low, high = np.full(sightings.n_passes, np.inf), np.full(sightings.n_passes, -np.inf)
    np.minimum.at(low, sightings.pass_number, along_mm)
    np.maximum.at(high, sightings.pass_number, along_mm)
    return np.asarray((high - low > SAME_POSITION_MM)[sightings.pass_number])
