"""Roll the paper's way (Li Eqs. 20 to 22), by name only.

From the line with an offset l along one direction across the axis (4 for X, 6 for Y, 8 for Z): with E⊥ the distance
of its points from its own fitted line and straightness from Eq. 19,

    ε_xx = (δ_yx ∓ √(E⊥² − δ_zx²)) / l_z

Weak as it stands: two roots, none where noise makes E⊥ < |δ_zx|, a root of a sum of squares is biased, and the line's
own fit has taken roll's slope away. The default is the linear roll (`geoerr.identify.transverse`). Of the two roots
the one nearer to that of the point before is taken (at the first point: nearer to 0).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from geoerr.identify.along import FittedPass
from geoerr.identify.linear import Indices, Numbers
from geoerr.identify.measurements import Measurements
from geoerr.identify.places import Line


@dataclass(frozen=True)
class RootRoll:
    """Roll by Eq. 22.

    Attributes
    ----------
    line
        Li's number of the line that it comes from.
    position_mm : (n,)
        Nodes of the axis.
    value_rad : (n,)
        0 at the first point that has a root; NaN where there is none.
    """

    line: int
    position_mm: Numbers
    value_rad: Numbers

    @property
    def n_without_root(self) -> int:
        """Number of points at which E⊥ < |δ|."""
        return int(np.isnan(self.value_rad).sum())


def root_roll(
    axis: int,
    lines: Sequence[Line],
    passes: Sequence[FittedPass],
    data: Measurements,
    nodes_mm: Numbers,
    base_mm: Numbers,
    straightness_mm: Mapping[int, Numbers],
) -> RootRoll | None:
    """Solve Eq. 22 for one axis; None where it has no offset line or no straightness.

    Parameters
    ----------
    axis
        0, 1, 2.
    lines
        The axis's lines with Li's numbers.
    straightness_mm
        Component to straightness (n,) at the nodes by Eq. 19, its line removed; NaN where undetermined.
    """
    numbered = [line for line in lines if line.number is not None and line.number > 3]
    if not numbered or len(straightness_mm) < 2:
        return None
    line = min(numbered, key=lambda one: one.number or 0)
    across = [(axis + 1) % 3, (axis + 2) % 3]
    offset = line.place_mm - base_mm
    arm = max(across, key=lambda component: abs(float(offset[component])))
    # ε × (l along one direction): only the other direction across sees roll; along c it is −ε l, along b it is +ε l.
    other = across[0] if arm == across[1] else across[1]
    sign = -1.0 if arm == across[1] else 1.0
    distance = _distance_from_line([passes[number] for number in line.passes], data, nodes_mm)
    seen, unseen = straightness_mm[other], straightness_mm[arm]
    with np.errstate(invalid="ignore"):
        root = np.sqrt(distance**2 - unseen**2)
    # (sign · ε · l + δ_seen)² = E⊥² − δ_unseen².
    candidates = np.stack([root - seen, -root - seen]) / (sign * float(offset[arm]))
    value = _nearest_branch(candidates)
    first = value[np.isfinite(value)]
    if len(first):
        value = value - first[0]
    return RootRoll(line.number or 0, nodes_mm, value)


def _distance_from_line(passes: Sequence[FittedPass], data: Measurements, nodes_mm: Numbers) -> Numbers:
    """Average the residual vectors of each session's points at each node, and their lengths over sessions."""
    lengths: list[Numbers] = []
    for session in dict.fromkeys(one.source.session for one in passes):
        total = np.zeros((len(nodes_mm), 3))
        count = np.zeros(len(nodes_mm))
        for one in (member for member in passes if member.source.session == session):
            points = data.measured_mm[one.source.rows]
            centered = points - points.mean(axis=0)
            residual = centered - np.outer(centered @ one.direction, one.direction)
            nearest: Indices = np.argmin(np.abs(one.source.position_mm[:, None] - nodes_mm), axis=1)
            np.add.at(total, nearest, one.source.sign * residual)
            np.add.at(count, nearest, 1.0)
        with np.errstate(invalid="ignore"):
            lengths.append(np.linalg.norm(total, axis=1) / np.where(count > 0, count, np.nan))
    return np.asarray(np.mean(lengths, axis=0))


def _nearest_branch(candidates: Numbers) -> Numbers:
    value = np.full(candidates.shape[1], np.nan)
    before = 0.0
    for number in range(candidates.shape[1]):
        both = candidates[:, number]
        if np.isfinite(both).all():
            before = value[number] = both[np.argmin(np.abs(both - before))]
    return value
