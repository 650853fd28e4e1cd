"""Which of the 21 errors a model stands for, and which figures of a machine need them.

An error that no table, no classic term and no effect stands for counts as 0 in every prediction, and has no
uncertainty there: not because it is 0, but because nobody asked. What is not determined by the data is named in the
record; this is about what was never asked of them.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import combinations

import numpy as np
import numpy.typing as npt

from geoerr import _core
from geoerr.error_functions import ALL_NAMES, LI_SQUARENESS, LINEAR_AND_ANGULAR, ErrorFunctions, is_angular
from geoerr.machine import AXES, Machine
from geoerr.model.arrays import Numbers, contiguous, points
from geoerr.model.functionals import functionals, tabular_terms
from geoerr.terms import JOINT_CHANNELS, SQUARENESS_CHANNELS, Term

# Places of an axis, as shares of its range, at which a function is told from a constant: uneven, so that no wave
# hides between them.
_SHARES = np.sort(np.modf(np.arange(101) * 0.6180339887498949)[0])
# A whole period of a sine has 0.78 of a line, two have 0.39.
_LEAST_TREND = 0.5
# A place this near is the same: no squareness tells over a micrometre.
_SAME_PLACE_MM = 1e-3
# A lever below this, in mm or as a part of a shift, is rounding.
_NO_LEVER = 1e-9
_ISO_OF_LI = {li: iso for iso, (li, _) in LI_SQUARENESS.items()}
ANGLES = frozenset(name for name in LINEAR_AND_ANGULAR if is_angular(name))
# By a pair of axes; a squareness moves the tool along the first of its pair.
SQUARENESS_OF = {channel[2:]: iso for channel, iso in _ISO_OF_LI.items()}


def names_in_model(machine: Machine, errors: ErrorFunctions | None, terms: Sequence[Term]) -> frozenset[str]:
    """Give the ISO names of the errors that tables, classic terms or effects stand for.

    An effect stands for a function where it follows the position of its axis alone, and for a squareness where it is
    a constant: play and thermal growth act in the same place and say nothing of it. A positioning is first of all how
    far an axis goes: of that the wave of a screw or a belt's teeth says nothing either.
    """
    names = set() if errors is None else {*errors.functions, *errors.squareness}
    names |= {_ISO_OF_LI.get(term.id, term.id) for term in terms if term.kind == "classic"}
    position_mm = {axis: low + _SHARES * (high - low) for axis in AXES for low, high in [machine.axes[axis].range_mm]}
    effects = [term for term in tabular_terms(terms, {}) if term.kind != "classic"]
    joints, squareness = functionals(effects, effects, position_mm, {})
    for name, rows in joints.items():
        moved = rows.by_parameter - rows.by_parameter[:1]
        if (_goes_along(moved, position_mm[name[2].lower()]) if name[1] == name[2] else moved != 0.0).any():
            names.add(name)
    return frozenset(names | {_ISO_OF_LI[channel] for channel in SQUARENESS_CHANNELS if channel in squareness})


def _goes_along(values: Numbers, position_mm: Numbers) -> npt.NDArray[np.bool_]:
    """Tell which columns (n, m) rise or fall with the position (n,), more than they go up and down."""
    arm = position_mm - position_mm.mean()
    own = values - values.mean(axis=0)
    size = np.linalg.norm(own, axis=0) * np.linalg.norm(arm)
    # A column without a value, or without a size, goes nowhere.
    return np.asarray((np.abs(arm @ own) > _LEAST_TREND * size) & (size > 0.0))


def needed_by(axes: Iterable[str]) -> frozenset[str]:
    """Name the errors that a figure of these axes is about: the positioning of each, the squareness of each pair.

    A line along an axis, a circle in a plane, a diagonal and the error over the volume are wrong to any amount where
    one of these is unknown; straightness and angles add to them.
    """
    moving = [axis for axis in AXES if axis in axes]
    pairs = {SQUARENESS_OF[first + second] for first, second in combinations(moving, 2)}
    return frozenset({f"E{axis.upper()}{axis.upper()}" for axis in moving} | pairs)


def is_about_the_model(names: Iterable[str], q_mm: Numbers, from_mm: Numbers) -> npt.NDArray[np.bool_]:
    """Tell which components (n, 3) of the error at places (n, 3) are about none of some errors: `needed_by`.

    A positioning moves its own axis. E = ... − (S_xy y + S_xz z, S_yz z, 0): a squareness moves the first axis of its
    pair, as far as the second is from where it counts (3,): the first place of the range, or where it always stood.
    """
    away = np.abs(q_mm - from_mm) > _SAME_PLACE_MM
    known = np.ones((len(q_mm), len(AXES)), dtype=np.bool_)
    for name in names:
        if name in LI_SQUARENESS:
            first, second = (AXES.index(axis) for axis in LI_SQUARENESS[name][0][2:])
            known[:, first] &= ~away[:, second]
        elif name[1] == name[2]:
            known[:, AXES.index(name[2].lower())] = False
    return known


def in_order(names: Iterable[str]) -> tuple[str, ...]:
    """Give ISO names in their usual order."""
    given = set(names)
    return tuple(name for name in ALL_NAMES if name in given)


def moving_along(
    machine: Machine, names: Iterable[str], q_mm: npt.ArrayLike, along: npt.ArrayLike
) -> tuple[str, ...]:
    """Name those errors that move the tool point along a direction (3,) at some of places (n, 3)."""
    wanted = in_order(names)
    rows, unit = points(q_mm, "q_mm"), np.asarray(along, dtype=np.float64)
    carriers = np.full(len(rows), _core.CARRIERS.index("relative"), dtype=np.uint8)
    columns = _core.channel_columns(
        machine.chain, carriers, rows, contiguous(np.zeros_like(rows)), machine.tool_offset_mm, 1
    )
    channels = (*JOINT_CHANNELS, *SQUARENESS_CHANNELS)
    lever = np.abs(columns[:, : len(channels)] @ unit).max(axis=0, initial=0.0)
    moving = {_ISO_OF_LI.get(name, name) for name, size in zip(channels, lever, strict=True) if size > _NO_LEVER}
    return tuple(name for name in wanted if name in moving)


def not_in_model_words(names: Sequence[str]) -> str:
    """Say which errors a model has not; a whole kind by its kind, for eighteen names are no help."""
    left, told = list(names), []
    if len(left) == len(ALL_NAMES):
        left, told = [], ["all of the 21 errors"]
    if set(ANGLES) <= set(left):
        left, told = [name for name in left if name not in ANGLES], ["the nine angles"]
    return f"not in the model, taken as 0: {', '.join([*left, *told])}"
