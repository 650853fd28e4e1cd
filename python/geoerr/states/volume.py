r"""The difference of two states over the volume: the error of the tool seen from the work, rigid motions taken off.

With E_a and E_b the errors of the two models at places p, and G the six columns of a shift and a small turn of all
places as one body,

    D = (1 − G (GᵀG)⁻¹ Gᵀ) (E_b − E_a),      cov D = (1 − ...) J (C_a + C_b) Jᵀ (1 − ...)

J first order at each place, E by the exact chain. What is taken off is the set-up of the work in its best fit over
the places asked for: at another temperature the work is probed or homed anew.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from geoerr import _core
from geoerr.drawing import drawn
from geoerr.errors import GeometryError, NotDeterminedError, ShapeError
from geoerr.fit.sightings import SAME_POSITION_MM, Numbers
from geoerr.geometry import rigid_columns
from geoerr.model.arrays import offsets, points
from geoerr.states.chance import Largest, Spread, Test, deviations, largest_by_chance, whole_test
from geoerr.states.functions import Estimate, Functions, above_rounding, grid_mm

if TYPE_CHECKING:
    import plotly.graph_objects as go

# Points along each edge: 125 places of a printer's volume, 100 mm apart at most.
N_GRID = 5
# What an undetermined direction moves below this part of its reach is rounding; see `Model.is_determined_at`.
_NO_EFFECT = 1e-6
_UM_PER_MM = 1e3


@dataclass(frozen=True, eq=False)
class VolumeDifference:
    """How the error differs over the volume.

    Attributes
    ----------
    position_mm : (n, 3)
        Commanded positions; of a grid x slowest.
    shape
        Points of the grid along x, y, z; None for places of one's own.
    difference_mm : (n, 3)
        Second state minus first, the best rigid motion taken off.
    spread
        Root (n, 3, k) of its covariance over all places: cov(D_i, D_j) = root_i root_jᵀ; and how well that is known.
    shift_mm, turn_rad : (3,)
        The rigid motion that was taken off: the work moved so, seen from the tool, about the places' middle.
    growth : (3,) or None
        Growth of each axis that was taken off besides, mm/mm.
    """

    position_mm: Numbers
    shape: tuple[int, int, int] | None
    difference_mm: Numbers
    spread: Spread
    shift_mm: Numbers
    turn_rad: Numbers
    growth: Numbers | None

    def plot_map(self, title: str = "Difference over the volume") -> go.Figure:
        """Draw how the error differs over the volume, on slices at heights."""
        return drawn("difference_map", self, title)

    @property
    def root_mm(self) -> Numbers:
        """Root of the covariance, (n, 3, k)."""
        return self.spread.root

    @property
    def std_mm(self) -> Numbers:
        """Standard uncertainty of each component, (n, 3)."""
        return self.spread.std

    @cached_property
    def covariance_mm2(self) -> Numbers:
        """Covariance of each vector, (n, 3, 3)."""
        return np.asarray(self.root_mm @ self.root_mm.transpose(0, 2, 1))

    @property
    def length_mm(self) -> Numbers:
        """Length of each vector, (n,)."""
        return np.asarray(np.linalg.norm(self.difference_mm, axis=1))

    @property
    def rms_um(self) -> float:
        """Root mean square length."""
        return _UM_PER_MM * float(np.sqrt(np.mean(self.length_mm**2)))

    @property
    def rms_by_chance_um(self) -> float:
        """Root mean square length that the covariance gives two states that do not differ."""
        return _UM_PER_MM * float(np.sqrt(np.mean((self.root_mm**2).sum(axis=(1, 2)))))

    @cached_property
    def test(self) -> Test:
        """One test of the whole map."""
        root, part = (one.reshape(self.difference_mm.size, -1) for one in (self.spread.root, self.spread.part))
        return whole_test(self.difference_mm.ravel(), replace(self.spread, root=root, part=part))

    @property
    def p_value(self) -> float:
        """Probability that two states of one unchanged machine differ as much over the volume."""
        return self.test.p_value

    @cached_property
    def _largest(self) -> Largest:
        return largest_by_chance(self.spread)

    @cached_property
    def deviation(self) -> Numbers:
        """How many standard deviations each vector is long, (n,): √(dᵀ V⁻¹ d)."""
        return deviations(self.difference_mm, self.root_mm)

    @cached_property
    def critical_deviation(self) -> float:
        """Deviation that chance exceeds nowhere in the map in 95 % of cases."""
        return self._largest.quantile()

    @cached_property
    def p_values(self) -> Numbers:
        """Probability for each place, (n,), that chance does as much anywhere in the map."""
        return self._largest.p_value(self.deviation)

    @property
    def is_beyond(self) -> npt.NDArray[np.bool_]:
        """Tell where the machine differs beyond chance, (n,), with 5 % for one false place anywhere."""
        return np.asarray(self.deviation > self.critical_deviation)

    def to_document(self) -> dict[str, Any]:
        """Give plain values for `--json`."""
        return {
            "rms_um": self.rms_um,
            "rms_by_chance_um": self.rms_by_chance_um,
            "largest_um": _UM_PER_MM * float(self.length_mm.max()),
            "p_value": self.p_value,
            "chi_squared": self.test.chi_squared,
            "degrees_of_freedom": self.test.rank,
            "critical_deviation": self.critical_deviation,
            "beyond_chance": int(self.is_beyond.sum()),
            "places": [
                {
                    **dict(zip("xyz", place, strict=True)),
                    "difference_um": vector,
                    "std_um": std,
                    "p_value": p_value,
                }
                for place, vector, std, p_value in zip(
                    self.position_mm.tolist(),
                    (_UM_PER_MM * self.difference_mm).tolist(),
                    (_UM_PER_MM * self.std_mm).tolist(),
                    self.p_values.tolist(),
                    strict=True,
                )
            ],
        }


def volume_difference(
    functions: Functions,
    before: Estimate,
    after: Estimate,
    estimate: Estimate,
    n_points: int,
    q_mm: npt.ArrayLike | None,
    offset_mm: npt.ArrayLike | None,
    *,
    without_growth: bool,
    threads: int,
) -> VolumeDifference:
    """Compare two estimates over the volume; see `Difference.volume`."""
    if q_mm is None and n_points < 2:
        raise ShapeError(f"a grid has two points or more along each edge, not {n_points}")
    if q_mm is None:
        _refuse_flat(functions.range_mm)
    places = grid_mm(functions.range_mm, n_points) if q_mm is None else points(q_mm, "q_mm")
    offset = np.ascontiguousarray(np.broadcast_to(offsets(offset_mm, len(places)), places.shape))
    tool = np.asarray(functions.machine.tool_offset_mm)
    apart = places + offset + tool
    middle = apart.mean(axis=0)
    rigid = rigid_columns(apart - middle)
    if without_growth:
        grown = (np.eye(3)[None, :, :] * (apart - middle)[:, None, :]).reshape(3 * len(places), 3)
        rigid = np.hstack([rigid, grown])
    if len(places) < 4 or np.linalg.svd(apart - middle, compute_uv=False)[2] < 1e-6 * np.ptp(apart):
        raise GeometryError(
            "a difference over the volume needs places that do not lie in one plane\n"
            "hint: of places in one plane a rigid motion takes part of the difference along"
        )
    columns = _columns(functions, before, places, offset, threads).reshape(3 * len(places), -1)
    orthonormal, triangle = np.linalg.qr(rigid)
    _refuse_undetermined(functions, columns, orthonormal)
    raw = (
        _displacement_mm(functions, after, places, offset, threads)
        - _displacement_mm(functions, before, places, offset, threads)
    ).ravel()
    motion = np.linalg.solve(triangle, orthonormal.T @ raw)
    spread = estimate.spread.through(columns)
    root, part = (
        (one - orthonormal @ (orthonormal.T @ one)).reshape(len(places), 3, -1) for one in (spread.root, spread.part)
    )
    # Where the rigid motion takes all, as in the middle of axes that stood at two places, nothing is left to test.
    known = above_rounding(np.linalg.norm(root, axis=2))[:, :, None]
    return VolumeDifference(
        position_mm=places,
        shape=(n_points,) * 3 if q_mm is None else None,
        difference_mm=(raw - rigid @ motion).reshape(-1, 3),
        spread=replace(spread, root=np.where(known, root, 0.0), part=np.where(known, part, 0.0)),
        shift_mm=motion[:3],
        turn_rad=motion[3:6],
        growth=motion[6:] if without_growth else None,
    )


def _refuse_flat(range_mm: Mapping[str, tuple[float, float]]) -> None:
    """Refuse a grid without extent: what one state lacks, no map of the volume can have."""
    flat = [axis for axis, (low, high) in range_mm.items() if high - low <= SAME_POSITION_MM]
    if flat:
        raise NotDeterminedError(
            "the difference over the volume is not determined: the states share one position only of "
            f"{', '.join(flat)}\n"
            "hint: move all axes at every temperature; the functions that are known can be compared one by one"
        )


def _refuse_undetermined(functions: Functions, columns: Numbers, orthonormal: Numbers) -> None:
    """Refuse where a direction that some state does not determine moves the point not as one rigid body."""
    moved = columns @ functions.loose
    left = moved - orthonormal @ (orthonormal.T @ moved)
    reach = (np.abs(columns) @ np.abs(functions.loose)).max(axis=0, initial=0.0)
    bends = np.abs(left).max(axis=0, initial=0.0) > _NO_EFFECT * reach
    if bends.any():
        involved = np.abs(functions.loose[:, bends]).max(axis=1) > _NO_EFFECT
        names = ", ".join(term for term, own in functions.own.items() if involved[own].any())
        raise NotDeterminedError(
            f"the difference over the volume is not determined: {names} move the tool point and are not known in "
            "every state\nhint: the functions that are known can be compared one by one"
        )


def _displacement_mm(
    functions: Functions, estimate: Estimate, places: Numbers, offset: Numbers, threads: int
) -> Numbers:
    return np.asarray(
        functions.compiled.core.displacements(
            *_rows(places, offset), None, np.ascontiguousarray(estimate.parameters), np.zeros(0), threads
        )
    )


def _columns(functions: Functions, estimate: Estimate, places: Numbers, offset: Numbers, threads: int) -> Numbers:
    return np.asarray(
        functions.compiled.core.columns(
            *_rows(places, offset), None, np.ascontiguousarray(estimate.parameters), np.zeros(0), threads
        )
    )


def _rows(
    places: Numbers, offset: Numbers
) -> tuple[npt.NDArray[np.uint8], Numbers, Numbers, Numbers, npt.NDArray[np.int64]]:
    relative = np.full(len(places), _core.CARRIERS.index("relative"), dtype=np.uint8)
    return relative, places, offset, np.zeros((0, len(places))), np.arange(len(places), dtype=np.int64)
