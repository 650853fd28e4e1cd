"""Straightness, roll and the slopes of lines 1 to 3, from positions across the lines.

E = p − p_nominal in base components, counted along the direction of the session's base line and without a fit to the
offset lines: such a fit would take roll's slope away. With (a, b, c) in cyclic order and the lever λ,

    E_b = δ_ba + ε_ca λ_a − ε_aa λ_c + constant + slope · q
    E_c = δ_ca + ε_aa λ_b − ε_ba λ_a + constant + slope · q

The constant belongs to a pass; the slope belongs to a session, because each session's measuring frame lies
differently: it is what is left of the axis's direction in that frame. Pitch and yaw are known from the distances
along the lines. Between the base line and one offset line the least-squares solution is the linear roll, for X

    ε_xx = (E_y1 − E_y4)/z₀ = (E_z5 − E_z1)/y₀;

with more lines it is their combination with the weights of the data. Roll's slope needs an offset line and the base
line in one session; else nothing tells it from the camera's new pose.

An axis that carries the moving one and is parked where its angles are not 0 turns the whole line; that is taken off
here. Where these angles are unknown the line's slope stays its own, marked by the parked position.

| symbol | code | meaning | unit |
|---|---|---|---|
| E_b, E_c | `data` (n, 2) | error across the line | mm |
| λ | `lever_mm` | lever on the target, minus the base line's | mm |
| δ_ba, δ_ca | `straightness` | straightness at the base line, with its slope | mm |
| ε_aa | `roll` | roll | rad |
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from geoerr.identify.along import ARM_MM, LEAST_STD_MM, FittedPass, Scatter
from geoerr.identify.frames import SessionFrame
from geoerr.identify.least_squares import Solution, solve
from geoerr.identify.levers import axes_that_turn
from geoerr.identify.linear import Curve, Indices, Linear, Numbers, from_rows, interpolation, stacked, zeros
from geoerr.identify.measurements import Measurements
from geoerr.identify.nodes import is_beyond, is_first, within
from geoerr.identify.places import SAME_PLACE_MM
from geoerr.machine import AXES, Machine

Flags = npt.NDArray[np.bool_]

# Axis to direction of rotation to what is known of that angle.
Angles = Mapping[str, Mapping[int, Curve]]


@dataclass(frozen=True, order=True)
class SlopeKey:
    """A direction of travel that the data may show: component `component` of the axis's direction in a session.

    `turned_by` names the parked axes, with their positions, whose unknown rotation is part of it.
    """

    session: str
    component: int
    turned_by: tuple[tuple[str, float], ...]


@dataclass(frozen=True)
class Transverse:
    """What the positions across the lines of one axis show.

    Attributes
    ----------
    straightness
        Component (0, 1, 2) to δ at the base line; its slope is relative to `slopes`.
    roll
        ε_aa, or None.
    angles
        Pitch or yaw that the distances along the lines left open and the positions across them show (targets apart
        along the axis).
    slopes
        Slope of the axis's direction against the session's fitted one, one value each; the reference session's is 0.
    at_moving_point
        Whether straightness is that of the moving target (`relative` data of a work-side axis whose angles are
        unknown).
    scatter
        Of the data about the solution.
    """

    straightness: dict[int, Curve]
    roll: Curve | None
    angles: dict[int, Curve]
    slopes: dict[SlopeKey, Linear]
    at_moving_point: frozenset[int]
    scatter: Scatter


@dataclass(frozen=True)
class _Rows:
    """The rows of one axis across its lines: n rows, two components; `turn` and `slope_key` by number of the pass."""

    axis: int
    components: tuple[int, int]
    nodes_mm: Numbers
    pass_number: Indices
    row: Indices
    position_mm: Numbers
    lever_mm: Numbers
    data: Numbers
    projection: Numbers
    seen: Flags
    covariance_mm2: Numbers | None
    turn: dict[int, Linear]
    slope_key: dict[int, tuple[SlopeKey, SlopeKey]]


def identify_transverse(
    passes: Sequence[FittedPass],
    data: Measurements,
    frames: Mapping[str, SessionFrame],
    machine: Machine,
    nodes_mm: Numbers,
    base_mm: Numbers,
    known: Angles,
    all_nodes_mm: Mapping[str, Numbers],
) -> Transverse | None:
    """Find straightness and roll of one axis.

    Parameters
    ----------
    passes
        The passes of the axis.
    frames
        Session to frame; passes of a session whose frame is not known are left out.
    nodes_mm : (n,)
        Grid of the result.
    base_mm : (3,)
        Lever of the base line.
    known
        Angles found so far: pitch and yaw of this axis, and all angles of the axes that carry it.
    all_nodes_mm
        Positions of each measured axis: at the first its angles are 0, beyond the ends they are unknown.

    Returns
    -------
    Transverse or None
        None where no session shows components across the axis.
    """
    axis = passes[0].source.axis
    rows = _collect(passes, data, frames, machine, nodes_mm, base_mm, known, all_nodes_mm)
    if rows is None:
        return None
    open_angles = [direction for direction in rows.components if direction not in known.get(axis, {})]
    rows = _without_gaps(rows, known.get(axis, {}))
    result = _solve(rows, frames, known.get(axis, {}), open_angles, with_roll=True)
    hidden = [component for component in rows.components if component not in result.straightness]
    at_base = np.all(np.abs(rows.lever_mm[:, list(rows.components)]) < SAME_PLACE_MM, axis=1)
    if not hidden or not open_angles or not at_base.any():
        return result
    # Only for `relative` data of a work-side axis: its lever grows with its own position, so that an unknown angle
    # hides straightness even on the base line. What shows is the straightness of the moving point.
    at_point = _solve(_chosen(rows, at_base), frames, known.get(axis, {}), [], with_roll=False)
    shown = frozenset(component for component in hidden if component in at_point.straightness)
    return replace(
        result,
        straightness=result.straightness | {component: at_point.straightness[component] for component in shown},
        slopes={key: slope for key, slope in result.slopes.items() if key.component not in shown}
        | {key: slope for key, slope in at_point.slopes.items() if key.component in shown},
        at_moving_point=shown,
    )


def _collect(
    passes: Sequence[FittedPass],
    data: Measurements,
    frames: Mapping[str, SessionFrame],
    machine: Machine,
    nodes_mm: Numbers,
    base_mm: Numbers,
    known: Angles,
    all_nodes_mm: Mapping[str, Numbers],
) -> _Rows | None:
    axis = passes[0].source.index
    components = ((axis + 1) % 3, (axis + 2) % 3)
    parts: dict[str, list[npt.NDArray[Any]]] = {
        name: [] for name in ("number", "row", "q", "lever", "data", "proj", "seen")
    }
    turns: dict[int, Linear] = {}
    keys: dict[int, tuple[SlopeKey, SlopeKey]] = {}
    for number, one in enumerate(passes):
        frame = frames[one.source.session]
        inside = within(nodes_mm, one.source.position_mm)
        seen = np.array([frame.origin != "parallel" or one.source.components[c] for c in components])
        if frame.base_from_measured is None or not inside.any() or not seen.any():
            continue
        base_rows = frame.base_from_measured[list(components)]
        q = one.source.position_mm[inside]
        points = np.where(one.source.components, data.measured_mm[one.source.rows[inside]], 0.0)
        points = one.source.sign * (points - points.mean(axis=0))
        direction = base_rows @ frame.direction[one.source.axis]
        turns[number], keys[number] = _turned_by_parked(one, machine, known, all_nodes_mm)
        parts["number"].append(np.full(len(q), number))
        parts["row"].append(one.source.rows[inside])
        parts["q"].append(q)
        parts["lever"].append(one.source.lever_mm[inside] - base_mm)
        parts["data"].append(points @ base_rows.T - np.outer(q - q.mean(), direction))
        parts["proj"].append(np.tile(one.source.sign * base_rows, (len(q), 1, 1)))
        parts["seen"].append(np.tile(seen, (len(q), 1)))
    if not keys:
        return None
    joined = {name: np.concatenate(arrays) for name, arrays in parts.items()}
    row = joined["row"].astype(np.intp)
    return _Rows(
        axis=axis,
        components=components,
        nodes_mm=nodes_mm,
        pass_number=joined["number"].astype(np.intp),
        row=row,
        position_mm=joined["q"],
        lever_mm=joined["lever"],
        data=joined["data"],
        projection=joined["proj"],
        seen=joined["seen"].astype(bool),
        covariance_mm2=None if data.covariance_mm2 is None else data.covariance_mm2[row],
        turn=turns,
        slope_key=keys,
    )


def _turned_by_parked(
    one: FittedPass, machine: Machine, known: Angles, all_nodes_mm: Mapping[str, Numbers]
) -> tuple[Linear, tuple[SlopeKey, SlopeKey]]:
    """Give the slopes (2,) that parked axes give a line by their rotation, and what of them is not known.

    ε × â has the component ε_c along b and −ε_b along c; for a target on the work both are turned, because its axis
    moves it by −q while its travel is reversed (`geoerr.identify.levers`: the bracket has −q_b there).
    """
    axis = one.source.index
    second, third = (axis + 1) % 3, (axis + 2) % 3
    slope = zeros(2)
    unknown: tuple[list[tuple[str, float]], list[tuple[str, float]]] = ([], [])
    for other in axes_that_turn(machine, one.source.carrier, one.source.axis):
        parked = float(one.source.parked_mm[AXES.index(other)])
        for number, (direction, sign) in enumerate(((third, one.source.sign), (second, -one.source.sign))):
            curve = known.get(other, {}).get(direction)
            # An angle is 0 where its own curve begins, which may be behind where other lines do.
            nodes_mm = all_nodes_mm.get(other) if curve is None else curve.position_mm
            if nodes_mm is not None and is_first(parked, nodes_mm):
                continue
            if curve is None or is_beyond(parked, curve.position_mm):
                unknown[number].append((other, round(parked, 3)))
                continue
            place = np.zeros((2, 1))
            place[number, 0] = sign
            slope = slope + curve.at(np.array([parked])).transformed(place)
    keys = (
        SlopeKey(one.source.session, second, tuple(unknown[0])),
        SlopeKey(one.source.session, third, tuple(unknown[1])),
    )
    return slope, keys


def _without_gaps(rows: _Rows, angles: Mapping[int, Curve]) -> _Rows:
    """Leave out rows that need pitch or yaw at a node where they are not determined."""
    keep = np.ones(len(rows.row), dtype=bool)
    hats = interpolation(rows.nodes_mm, rows.position_mm)
    for curve in angles.values():
        lacking = np.ones(len(rows.nodes_mm))
        lacking[curve.nodes] = 0.0
        keep &= (hats @ lacking < 1e-9) | (np.abs(rows.lever_mm[:, rows.axis]) < 1e-9)
    return _chosen(rows, keep)


def _chosen(rows: _Rows, keep: Flags) -> _Rows:
    return replace(
        rows,
        pass_number=rows.pass_number[keep],
        row=rows.row[keep],
        position_mm=rows.position_mm[keep],
        lever_mm=rows.lever_mm[keep],
        data=rows.data[keep],
        projection=rows.projection[keep],
        seen=rows.seen[keep],
        covariance_mm2=None if rows.covariance_mm2 is None else rows.covariance_mm2[keep],
    )


@dataclass(frozen=True)
class _Columns:
    """Which columns of the design are which unknowns; every function has one column a node."""

    straightness: tuple[int, int]
    roll: int
    angles: dict[int, int]
    slopes: dict[SlopeKey, int]
    reference: tuple[SlopeKey, ...]


@dataclass(frozen=True)
class _Known:
    """Pitch and yaw in the data: `matrix` (n, 2, k) times `linear` (k,)."""

    linear: Linear
    matrix: Numbers


def _solve(
    rows: _Rows,
    frames: Mapping[str, SessionFrame],
    angles: Mapping[int, Curve],
    open_angles: Sequence[int],
    with_roll: bool,
) -> Transverse:
    design, columns = _design(rows, frames, open_angles, with_roll)
    whitening = _whitening(rows)
    flat = rows.seen.ravel()
    n_unknowns = design.shape[2]
    solution = solve((whitening @ design).reshape(-1, n_unknowns)[flat])
    inverse = np.zeros((n_unknowns, rows.seen.size))
    inverse[:, flat] = solution.inverse
    inverse = np.einsum("urc,rcd->urd", inverse.reshape(n_unknowns, -1, 2), whitening)
    known = _known(rows, angles)

    def unknowns(index: Indices, scale: float) -> Linear:
        chosen = inverse[index] * scale
        operator = np.einsum("urc,rcv->urv", chosen, rows.projection)
        result = from_rows(np.einsum("urc,rc->u", chosen, rows.data), rows.row, operator)
        if known is not None:
            result = result - known.linear.transformed(np.einsum("urc,rck->uk", chosen, known.matrix))
        return result - _turned(rows, chosen)

    def curve(first_column: int, scale: float, least: int) -> Curve | None:
        index = first_column + np.arange(len(rows.nodes_mm))
        nodes = solution.determined_together(index)
        if len(nodes) < least:
            return None
        return Curve(nodes, rows.nodes_mm[nodes], unknowns(index[nodes], scale)).from_first()

    straightness = {
        component: curve(column, 1.0, least=3)
        for component, column in zip(rows.components, columns.straightness, strict=True)
    }
    found_angles = {direction: curve(column, 1.0 / ARM_MM, least=2) for direction, column in columns.angles.items()}
    slopes = {key: zeros(1) for key in columns.reference}
    for key, column in columns.slopes.items():
        if solution.is_determined(column):
            slopes[key] = unknowns(np.array([column]), 1.0 / ARM_MM)
    return Transverse(
        straightness={component: found for component, found in straightness.items() if found is not None},
        roll=curve(columns.roll, 1.0 / ARM_MM, least=2),
        angles={direction: found for direction, found in found_angles.items() if found is not None},
        slopes=slopes,
        at_moving_point=frozenset(),
        scatter=_scatter(rows, solution, whitening, flat, known),
    )


def _design(
    rows: _Rows, frames: Mapping[str, SessionFrame], open_angles: Sequence[int], with_roll: bool
) -> tuple[Numbers, _Columns]:
    """Give the design (n, 2, n_unknowns); angles and slopes are unknown as displacements at ARM_MM."""
    hats = interpolation(rows.nodes_mm, rows.position_mm)
    second, third = rows.components
    nothing = np.zeros_like(hats)
    lever = rows.lever_mm / ARM_MM
    if np.max(np.abs(rows.lever_mm[:, list(rows.components)])) < SAME_PLACE_MM or not with_roll:
        lever = lever * (np.arange(3) == rows.axis)
    if np.ptp(rows.lever_mm[:, rows.axis]) < SAME_PLACE_MM:
        lever = lever * (np.arange(3) != rows.axis)
    blocks = [
        np.stack([hats, nothing], axis=1),
        np.stack([nothing, hats], axis=1),
        np.stack([-hats * lever[:, [third]], hats * lever[:, [second]]], axis=1),
    ]
    n_nodes = len(rows.nodes_mm)
    angle_columns = {}
    for direction in open_angles:
        angle_columns[direction] = len(blocks) * n_nodes
        turned = hats * lever[:, [rows.axis]]
        blocks.append(np.stack([turned, nothing] if direction == third else [nothing, -turned], axis=1))
    reference = tuple(_reference(rows, frames, number) for number in (0, 1))
    slope_columns: dict[SlopeKey, int] = {}
    start = len(blocks) * n_nodes
    for key in sorted({key for number in set(rows.pass_number) for key in rows.slope_key[number]} - set(reference)):
        number = rows.components.index(key.component)
        members = np.array([rows.slope_key[one][number] == key for one in rows.pass_number])
        column = np.zeros((len(hats), 2, 1))
        column[members, number, 0] = (rows.position_mm[members] - rows.nodes_mm.mean()) / ARM_MM
        slope_columns[key] = start + len(slope_columns)
        blocks.append(column)
    for one in np.unique(rows.pass_number):
        for number in (0, 1):
            column = np.zeros((len(hats), 2, 1))
            column[rows.pass_number == one, number, 0] = 1.0
            blocks.append(column)
    columns = _Columns((0, n_nodes), 2 * n_nodes, angle_columns, slope_columns, reference)
    return np.concatenate(blocks, axis=2), columns


def _reference(rows: _Rows, frames: Mapping[str, SessionFrame], number: int) -> SlopeKey:
    """Choose the direction that straightness counts from: the base line's, in the session with most axes."""
    candidates: dict[SlopeKey, tuple[bool, bool, int, int]] = {}
    for one in sorted(set(rows.pass_number)):
        members = rows.pass_number == one
        key = rows.slope_key[one][number]
        if not rows.seen[members, number].any():
            continue
        offset = np.max(np.abs(rows.lever_mm[members][0, list(rows.components)]))
        score = (
            bool(offset < SAME_PLACE_MM),
            not key.turned_by,
            len(frames[key.session].axes),
            int(members.sum()),
        )
        candidates[key] = max(score, candidates.get(key, score))
    if not candidates:
        return rows.slope_key[int(rows.pass_number[0])][number]
    return max(candidates, key=lambda key: candidates[key])


def _whitening(rows: _Rows) -> Numbers:
    """Give (n, 2, 2) that makes the seen components of each row independent with variance 1."""
    if rows.covariance_mm2 is None:
        return np.asarray(np.eye(2) * rows.seen[:, :, None])
    covariance = rows.projection @ rows.covariance_mm2 @ np.swapaxes(rows.projection, 1, 2)
    both = rows.seen.all(axis=1)
    covariance = covariance * (rows.seen[:, :, None] & rows.seen[:, None, :])
    # A component that was not seen gets variance 1 for the decomposition, and is taken out again below.
    covariance = covariance + np.eye(2) * np.where(rows.seen, LEAST_STD_MM**2, 1.0)[:, :, None]
    root = np.linalg.cholesky(covariance)
    whitening = np.linalg.inv(root)
    whitening[~both] = whitening[~both] * (rows.seen[~both][:, :, None] & rows.seen[~both][:, None, :])
    return np.asarray(whitening)


def _known(rows: _Rows, angles: Mapping[int, Curve]) -> _Known | None:
    """Give what pitch and yaw contribute where targets are offset along the axis."""
    lever = rows.lever_mm[:, rows.axis]
    if not angles or np.ptp(lever) < 1e-9:
        return None
    parts, matrices = [], []
    for direction, curve in sorted(angles.items()):
        turned = interpolation(curve.position_mm, rows.position_mm) * lever[:, None]
        nothing = np.zeros_like(turned)
        is_third = direction == rows.components[1]
        matrices.append(np.stack([turned, nothing] if is_third else [nothing, -turned], axis=1))
        parts.append(curve.linear)
    return _Known(stacked(parts), np.concatenate(matrices, axis=2))


def _turned(rows: _Rows, inverse: Numbers) -> Linear:
    """Give what the parked axes' rotations contribute to unknowns with this inverse (n_unknowns, n, 2)."""
    total = zeros(len(inverse))
    for number in np.unique(rows.pass_number):
        turn = rows.turn[int(number)]
        if len(turn.rows):
            members = rows.pass_number == number
            total = total + turn.transformed(np.einsum("urc,r->uc", inverse[:, members], rows.position_mm[members]))
    return total


def _scatter(rows: _Rows, solution: Solution, whitening: Numbers, flat: Flags, known: _Known | None) -> Scatter:
    data = rows.data.copy()
    for number in np.unique(rows.pass_number):
        members = rows.pass_number == number
        data[members] -= np.outer(rows.position_mm[members], rows.turn[int(number)].value)
    expected = float(solution.dof)
    if known is not None:
        data = data - known.matrix @ known.linear.value
        expected += _added_by_known(rows, solution, whitening, flat, known)
    residual = np.zeros(rows.seen.size)
    residual[flat] = solution.residual(np.einsum("rcd,rd->rc", whitening, data).ravel()[flat])
    in_mm = np.linalg.solve(whitening + np.eye(2) * (~rows.seen)[:, :, None], residual.reshape(-1, 2)[:, :, None])
    return Scatter(
        chi_squared=float(np.sum(residual**2)),
        expected=expected,
        dof=solution.dof,
        sum_of_squares_mm2=float(np.sum(in_mm**2)),
        n_residuals=int(flat.sum()),
    )


def _added_by_known(rows: _Rows, solution: Solution, whitening: Numbers, flat: Flags, known: _Known) -> float:
    """Give what the uncertainty of pitch and yaw adds to the expected sum of squares.

    Residual = P (w − K f), P the projector, w the data with unit covariance: E|residual|² − tr P =
    tr(Kᵀ P K C_f) − 2 tr(Kᵀ P C_wf).
    """
    if rows.covariance_mm2 is None:
        return 0.0
    n_known = len(known.linear)
    k = (whitening @ known.matrix).reshape(-1, n_known)[flat]
    pk = solution.residual(k)
    # Pitch and yaw come from the same rows (and from rows that show no components across).
    place = np.searchsorted(known.linear.rows, rows.row)
    place = np.minimum(place, len(known.linear.rows) - 1)
    shared = known.linear.rows[place] == rows.row
    operator = known.linear.operator[:, place] * shared[None, :, None]
    c_row_f = np.einsum("rij,krj->rik", rows.covariance_mm2, operator)
    c_wf = (whitening @ rows.projection @ c_row_f).reshape(-1, n_known)[flat]
    # C_f over these rows: all rows of pitch and yaw but those outside the grid or without a frame.
    c_f = np.einsum("kri,rij,lrj->kl", operator, rows.covariance_mm2, operator, optimize=True)
    return float(np.sum((k.T @ pk) * c_f) - 2.0 * np.sum(pk * c_wf))
