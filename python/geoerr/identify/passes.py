"""Lines in the data: rows in which one axis moves, the others stand, and one target is seen (Li §4.3, Fig. 6).

The column `line` only separates passes from each other; which of Li's lines a pass is follows from the axis that
moves and from the lever with which that axis's rotation acts on the target (`geoerr.identify.places`).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from geoerr.identify.levers import lever_mm, moving_axes, travel_sign
from geoerr.identify.linear import Indices, Numbers
from geoerr.identify.measurements import Measurements
from geoerr.machine import AXES, Machine

# Commanded positions closer than this are the same: programs are written in µm at the finest.
SAME_POSITION_MM = 1e-3
# In a file whose `line` does not separate the moves, fewer points than this along one axis are a corner, not a line.
_LEAST_POINTS_OF_A_SPLIT = 3


@dataclass(frozen=True)
class Pass:
    """One target seen while one axis moved.

    Attributes
    ----------
    axis
        `x`, `y` or `z`.
    session, line, repeat, carrier, target
        As in the table.
    rows : (k,)
        Its rows in the table, in their order.
    position_mm : (k,)
        Commanded positions of the moving axis.
    parked_mm : (3,)
        Commanded positions of the others (the moving axis's entry has no meaning).
    lever_mm : (k, 3)
        Lever of the moving axis on the target in each row.
    place_mm : (3,)
        The lever without the part that grows with the moving axis's own position.
    components : (3,)
        Which components of the measuring frame the pass has.
    """

    axis: str
    session: str
    line: str
    repeat: int
    carrier: str
    target: str
    rows: Indices
    position_mm: Numbers
    parked_mm: Numbers
    lever_mm: Numbers
    place_mm: Numbers
    components: tuple[bool, bool, bool]

    @property
    def index(self) -> int:
        """Number of the moving axis: 0, 1, 2."""
        return AXES.index(self.axis)

    @property
    def sign(self) -> float:
        """−1 where the travel is reversed before use (targets on the work), else +1."""
        return travel_sign(self.carrier)

    def named(self) -> str:
        """Name the pass for a message."""
        target = f", target {self.target}" if self.target else ""
        return f"line {self.line or '(unnamed)'} (session {self.session}, repeat {self.repeat}{target})"


@dataclass(frozen=True)
class FoundPasses:
    """All passes, and how many rows were left out for which reason."""

    passes: tuple[Pass, ...]
    left_out: Counter[str]


def find_passes(data: Measurements, machine: Machine) -> FoundPasses:
    """Find the rows in which one axis moved, whatever their order."""
    left_out: Counter[str] = Counter()
    passes: list[Pass] = []
    for rows in _groups(data):
        carrier = str(data.carrier[rows[0]])
        usable = rows[data.usable[rows]]
        left_out["the target's position is missing or incomplete"] += len(rows) - len(usable)
        if carrier == "base":
            left_out["a fixed reference target (carrier = base)"] += len(usable)
            continue
        if len(usable) == 0:
            continue
        found, unused = _passes_of_group(data, machine, carrier, usable)
        passes.extend(found)
        left_out.update(unused)
    return FoundPasses(tuple(passes), Counter({why: count for why, count in left_out.items() if count}))


def _groups(data: Measurements) -> Iterator[Indices]:
    """Give the rows of each session, line, repeat and target, in order of first appearance."""
    offset = np.round(data.offset_mm, 6)
    groups: dict[tuple[object, ...], list[int]] = {}
    labels = zip(
        data.session.tolist(),
        data.line.tolist(),
        data.repeat.tolist(),
        data.carrier.tolist(),
        data.target.tolist(),
        map(tuple, offset.tolist()),
        strict=True,
    )
    for row, label in enumerate(labels):
        groups.setdefault(label, []).append(row)
    for rows in groups.values():
        yield np.asarray(rows, dtype=np.intp)


def _passes_of_group(
    data: Measurements, machine: Machine, carrier: str, rows: Indices
) -> tuple[list[Pass], Counter[str]]:
    commanded = data.commanded_mm[rows]
    moving = [axis for index, axis in enumerate(AXES) if np.ptp(commanded[:, index]) > SAME_POSITION_MM]
    if not moving:
        return [], Counter({"no axis moved": len(rows)})
    split = len(moving) > 1
    found: list[Pass] = []
    used = np.zeros(len(rows), dtype=bool)
    stands = np.zeros(len(rows), dtype=bool)
    for axis in moving:
        for members in _along_one_axis(commanded, AXES.index(axis), split):
            if axis in moving_axes(machine, carrier):
                found.append(_make_pass(data, machine, carrier, axis, rows[members]))
                used[members] = True
            else:
                stands[members] = True
    unused = Counter(
        {
            "the target stands still while this axis moves": int((stands & ~used).sum()),
            "more than one axis moved at once": int((~stands & ~used).sum()),
        }
    )
    return found, unused


def _along_one_axis(commanded: Numbers, index: int, split: bool) -> Iterator[Indices]:
    """Give the rows that share the positions of the other two axes."""
    others = np.round(np.delete(commanded, index, axis=1) / SAME_POSITION_MM).astype(np.int64)
    _, member_of = np.unique(others, axis=0, return_inverse=True)
    for number in range(int(member_of.max()) + 1):
        members = np.flatnonzero(member_of.ravel() == number)
        n_positions = len(np.unique(np.round(commanded[members, index] / SAME_POSITION_MM)))
        if n_positions >= (_LEAST_POINTS_OF_A_SPLIT if split else 2):
            yield members


def _make_pass(data: Measurements, machine: Machine, carrier: str, axis: str, rows: Indices) -> Pass:
    index = AXES.index(axis)
    seen = np.isfinite(data.measured_mm[rows])
    # The components that most rows have; a row that lacks one of them is left out of the pass.
    patterns, counts = np.unique(seen, axis=0, return_counts=True)
    components = patterns[np.argmax(counts)]
    rows = rows[seen[:, components].all(axis=1)]
    commanded = data.commanded_mm[rows]
    lever = lever_mm(machine, carrier, axis, commanded, data.offset_mm[rows])
    grows = carrier == "relative" and axis in machine.work_axes
    place = lever[0].copy()
    if grows:
        place[index] -= commanded[0, index]
    return Pass(
        axis=axis,
        session=str(data.session[rows[0]]),
        line=str(data.line[rows[0]]),
        repeat=int(data.repeat[rows[0]]),
        carrier=carrier,
        target=str(data.target[rows[0]]),
        rows=rows,
        position_mm=commanded[:, index],
        parked_mm=commanded[0],
        lever_mm=lever,
        place_mm=place,
        components=(bool(components[0]), bool(components[1]), bool(components[2])),
    )
