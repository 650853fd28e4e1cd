"""Positioning, pitch and yaw from distances along the lines (Li Eqs. 17 and 18).

ΔL is the distance travelled along a pass's total-least-squares line minus the nominal distance. With the lever λ of
the axis a on the target, and (a, b, c) in cyclic order,

    ΔL = δ_aa + ε_ba λ_c − ε_ca λ_b + a constant of the pass.

On nodes common to all lines this is solved by least squares for the three functions, with the levers counted from the
base line's. With Li's lines, one point at each node, there are as many data as unknowns, and the solution is Eqs. 17
and 18: δ_xx = ΔL₁, ε_yx = (ΔL₄ − ΔL₁)/z₀, ε_zx = (ΔL₁ − ΔL₅)/y₀ and so on. The equations hold as printed on both
sides of the chain because travel is that of the tool relative to the work (`geoerr.identify.levers`).

| symbol | code | meaning | unit |
|---|---|---|---|
| ΔL | `data` | distance along the line minus nominal distance | mm |
| λ | `offset_mm` | lever on the target, minus the base line's | mm |
| δ_aa | `positioning` | positioning error at the base line | mm |
| ε_ba, ε_ca | `angles` | pitch and yaw, by direction of rotation | rad |
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from geoerr.identify.least_squares import Solution, solve
from geoerr.identify.linear import Curve, Indices, Numbers, from_rows, interpolation
from geoerr.identify.measurements import Measurements
from geoerr.identify.nodes import within
from geoerr.identify.passes import Pass
from geoerr.identify.places import SAME_PLACE_MM

Flags = npt.NDArray[np.bool_]

# Angles and slopes are solved for as displacements at this distance, so that all unknowns are of one size.
ARM_MM = 100.0
# Smallest standard uncertainty of a row's weight: data that state 0 are not divided by 0.
LEAST_STD_MM = 1e-9


@dataclass(frozen=True)
class FittedPass:
    """A pass with its total-least-squares line.

    Attributes
    ----------
    direction : (3,)
        Unit direction of the line, of the tool's travel relative to the work for growing q; measuring frame.
    along_mm : (k,)
        Distance of each point along the line from the pass's first point, same sense.
    rms_mm
        Root mean square distance of the points from the line.
    """

    source: Pass
    direction: Numbers
    along_mm: Numbers
    rms_mm: float

    @property
    def shows_travel(self) -> bool:
        """Whether the component along the axis was measured."""
        return all(self.source.components) or self.source.components[self.source.index]


@dataclass(frozen=True)
class Scatter:
    """How much more the data of one stage scatter than their uncertainties say.

    Attributes
    ----------
    chi_squared
        Sum of squared residuals, each divided by its variance (by 1 mm² where no uncertainty is stated).
    expected
        What that sum is on average if the uncertainties are right.
    dof
        Degrees of freedom.
    sum_of_squares_mm2, n_residuals
        Of the residuals themselves.
    """

    chi_squared: float
    expected: float
    dof: int
    sum_of_squares_mm2: float
    n_residuals: int


@dataclass(frozen=True)
class Along:
    """Positioning, pitch and yaw of one axis, as far as its lines determine them.

    Attributes
    ----------
    positioning
        δ_aa at the base line.
    angles
        Direction of rotation (0, 1, 2) to pitch or yaw; undetermined ones are absent.
    scatter
        Of ΔL about the solution.
    n_outside
        Rows outside the common range of the lines.
    """

    positioning: Curve | None
    angles: dict[int, Curve]
    scatter: Scatter
    n_outside: int


def identify_along(passes: Sequence[FittedPass], data: Measurements, nodes_mm: Numbers, base_mm: Numbers) -> Along:
    """Find positioning, pitch and yaw of one axis.

    Parameters
    ----------
    passes
        The passes of that axis which show the component along it; at least one.
    data
        For the covariances.
    nodes_mm : (n,)
        Grid of the result.
    base_mm : (3,)
        Lever of the base line.

    Notes
    -----
    Verified against Eqs. 17 and 18 written out (10⁻¹² of the travel), against exact rotations on eleven chains, and
    its uncertainty by Monte-Carlo: tests/identify/.
    """
    axis = passes[0].source.index
    kept = [within(nodes_mm, one.source.position_mm) for one in passes]
    n_outside = sum(int((~inside).sum()) for inside in kept)
    design = _design(passes, kept, nodes_mm, offsets_across(passes, base_mm), axis)
    delta_l = np.concatenate(
        [
            (one.along_mm - (one.source.position_mm - one.source.position_mm[0]))[i]
            for one, i in zip(passes, kept, strict=True)
        ]
    )
    rows = np.concatenate([one.source.rows[i] for one, i in zip(passes, kept, strict=True)])
    projection = np.concatenate(
        [np.tile(one.source.sign * one.direction, (int(i.sum()), 1)) for one, i in zip(passes, kept, strict=True)]
    )
    std = _std_along(data, rows, projection)
    solution = solve(design / std[:, None])
    residual = solution.residual(delta_l / std)
    scatter = Scatter(
        chi_squared=float(np.sum(residual**2)),
        expected=float(solution.dof),
        dof=solution.dof,
        sum_of_squares_mm2=float(np.sum((residual * std) ** 2)),
        n_residuals=len(delta_l),
    )
    n_nodes = len(nodes_mm)
    inverse = solution.inverse / std
    curves = [
        _curve(solution, inverse, np.arange(n_nodes) + block * n_nodes, scale, delta_l, rows, projection, nodes_mm)
        for block, scale in enumerate((1.0, 1.0 / ARM_MM, 1.0 / ARM_MM))
    ]
    angles = {(axis + 1) % 3: curves[1], (axis + 2) % 3: curves[2]}
    return Along(
        positioning=curves[0],
        angles={direction: curve for direction, curve in angles.items() if curve is not None},
        scatter=scatter,
        n_outside=n_outside,
    )


def offsets_across(passes: Sequence[FittedPass], base_mm: Numbers) -> Numbers:
    """Give each pass's lever minus the base line's, (n_passes, 3), with offsets that are no offsets made 0.

    Where all lines lie in one plane with the axis, a stray millimetre across that plane would make neither angle
    unique; it is smaller than what a target's place is known to.
    """
    axis = passes[0].source.index
    across = [(axis + 1) % 3, (axis + 2) % 3]
    offsets = np.array([one.source.place_mm - base_mm for one in passes])
    singular = np.linalg.svd(offsets[:, across], compute_uv=False)
    if len(singular) < 2 or singular[1] < SAME_PLACE_MM:
        stray = np.zeros_like(offsets, dtype=bool)
        stray[:, across] = np.abs(offsets[:, across]) < SAME_PLACE_MM
        offsets[stray] = 0.0
    return offsets


def _design(
    passes: Sequence[FittedPass], kept: Sequence[Flags], nodes_mm: Numbers, offset_mm: Numbers, axis: int
) -> Numbers:
    blocks = []
    for number, (one, inside) in enumerate(zip(passes, kept, strict=True)):
        hats = interpolation(nodes_mm, one.source.position_mm[inside])
        constant = np.zeros((len(hats), len(passes)))
        constant[:, number] = 1.0
        first, second = (axis + 1) % 3, (axis + 2) % 3
        blocks.append(
            np.hstack(
                [
                    hats,
                    hats * (offset_mm[number, second] / ARM_MM),
                    hats * (-offset_mm[number, first] / ARM_MM),
                    constant,
                ]
            )
        )
    return np.vstack(blocks)


def _std_along(data: Measurements, rows: Indices, projection: Numbers) -> Numbers:
    if data.covariance_mm2 is None:
        return np.ones(len(rows))
    variance = np.einsum("ri,rij,rj->r", projection, data.covariance_mm2[rows], projection)
    return np.asarray(np.sqrt(np.maximum(variance, LEAST_STD_MM**2)))


def _curve(
    solution: Solution,
    inverse: Numbers,
    unknowns: Indices,
    scale: float,
    data_mm: Numbers,
    rows: Indices,
    projection: Numbers,
    nodes_mm: Numbers,
) -> Curve | None:
    """Take one function out of the solution, 0 at its first node; None where fewer than two nodes are determined."""
    nodes = solution.determined_together(unknowns)
    if len(nodes) < 2:
        return None
    chosen = inverse[unknowns[nodes]] * scale
    linear = from_rows(chosen @ data_mm, rows, chosen[:, :, None] * projection)
    return Curve(nodes, nodes_mm[nodes], linear).from_first()
