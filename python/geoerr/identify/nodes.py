"""The grid of positions at which one axis's functions are given."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from geoerr.identify.linear import Numbers
from geoerr.identify.passes import SAME_POSITION_MM, Pass
from geoerr.identify.places import Line

# Where at least this share of all positions is visited by two lines or more, they have the same points, some missing.
_SAME_POINTS = 0.5
# Width of an interval of the grid in the coarsest line's largest steps, where the lines have different points:
# between two nodes every line then has a point.
_STEPS_PER_INTERVAL = 1.5


def choose_nodes(lines: Sequence[Line], passes: Sequence[Pass]) -> tuple[Numbers, str | None]:
    """Choose the nodes of one axis.

    Where the lines share their points, these are the nodes, those that one line lacks included. Where they do not,
    the nodes are a uniform grid over the common range, no finer than the coarsest line.

    Returns
    -------
    nodes_mm : (n,)
        Increasing.
    note
        What the reader must know about the grid, or None.
    """
    own = [
        distinct_positions(np.concatenate([passes[number].position_mm for number in line.passes])) for line in lines
    ]
    union = distinct_positions(np.concatenate(own))
    if len(own) == 1 or _share_visited_twice(own, union) >= _SAME_POINTS:
        return union, None
    low = max(float(positions[0]) for positions in own)
    high = min(float(positions[-1]) for positions in own)
    axis = lines[0].axis.upper()
    if high - low <= SAME_POSITION_MM:
        return union, f"the lines along {axis} have no range in common"
    step = max(_largest_step(positions, low, high) for positions in own)
    n_intervals = max(1, int((high - low) / (_STEPS_PER_INTERVAL * step)))
    note = (
        f"the lines along {axis} have different points: its functions are given on {n_intervals + 1} nodes "
        f"from {low:g} to {high:g} mm, the range that all of them cover"
    )
    return np.linspace(low, high, n_intervals + 1), note


def distinct_positions(position_mm: Numbers) -> Numbers:
    """Sort positions and merge those that are the same."""
    ordered = np.sort(position_mm)
    starts = np.concatenate([[0], np.flatnonzero(np.diff(ordered) > SAME_POSITION_MM) + 1])
    return np.asarray(np.add.reduceat(ordered, starts) / np.diff(np.append(starts, len(ordered))))


def within(nodes_mm: Numbers, position_mm: Numbers) -> npt.NDArray[np.bool_]:
    """Tell which positions (n,) lie within the grid."""
    return np.asarray(
        (position_mm >= nodes_mm[0] - SAME_POSITION_MM) & (position_mm <= nodes_mm[-1] + SAME_POSITION_MM)
    )


def _share_visited_twice(own: Sequence[Numbers], union: Numbers) -> float:
    visits = sum((_is_visited(positions, union) for positions in own), start=np.zeros(len(union), dtype=np.intp))
    return float((visits >= 2).mean())


def _is_visited(positions: Numbers, union: Numbers) -> npt.NDArray[np.intp]:
    nearest = np.abs(union[:, None] - positions[None]).min(axis=1)
    return np.asarray(nearest <= SAME_POSITION_MM, dtype=np.intp)


def _largest_step(positions: Numbers, low: float, high: float) -> float:
    inside = positions[(positions >= low - SAME_POSITION_MM) & (positions <= high + SAME_POSITION_MM)]
    return float(np.max(np.diff(np.concatenate([[low], inside, [high]]))))


def is_first(position_mm: float, nodes_mm: Numbers) -> bool:
    """Tell whether an axis stood at its first node, or before it by no more than the nodes are apart."""
    first = float(nodes_mm[0])
    return first - _spacing_mm(nodes_mm) <= position_mm + SAME_POSITION_MM <= first + 2.0 * SAME_POSITION_MM


def is_beyond(position_mm: float, nodes_mm: Numbers) -> bool:
    """Tell whether an axis stood farther from its nodes than they are from each other."""
    reach_mm = _spacing_mm(nodes_mm) + SAME_POSITION_MM
    return not float(nodes_mm[0]) - reach_mm <= position_mm <= float(nodes_mm[-1]) + reach_mm


def _spacing_mm(nodes_mm: Numbers) -> float:
    return float(nodes_mm[-1] - nodes_mm[0]) / max(len(nodes_mm) - 1, 1)
