"""Where each session's device stands, as a start: the rigid motion from nominal to measured positions.

Sums of squares are smallest for the rotation that the singular value decomposition of the cross-covariance gives
(Kabsch). Points on one line leave a turn about it open: the smallest turn is taken, and `rolls` finds it by what the
machine's errors do across that line.

Where a target sits is known well enough for a lever arm (a millimetre of 200 changes it by a two-hundredth), but not
to the micrometre to which it is seen: its place is an unknown of its session. So a plate that was glued on a tenth of
a millimetre off, or turned, is no error of the machine.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geoerr import _core
from geoerr.commanded_circle import circle_through
from geoerr.errors import GeometryError
from geoerr.fit.moved_targets import numbers_of_targets, times_moved
from geoerr.fit.other_units import other_units
from geoerr.fit.sightings import SEE_POSITIONS, Numbers, Sightings
from geoerr.machine import Machine
from geoerr.observations import CARRIERS, MEASURED

# A machine that is off by this share of its travel in half of what was measured is another machine.
_STRANGE = 0.05
# Fewer rows than this say nothing about the motion.
_FEWEST_STRANGERS = 6
# Points nearer to a line than this share of its length see no turn about it: errors are a thousandth at most.
ON_A_LINE = 5e-3


@dataclass(frozen=True, eq=False)
class Frames:
    """How each session's device stands, as arrays over the sessions.

    Attributes
    ----------
    kinds : (s,) uint8
        0 free pose, 1 parallel to the base, 2 circle, 3 lengths, which have no frame.
    rotations : (s, 3, 3)
        measured_from_base.
    translations_mm : (s, 3)
        Of the base origin in the measuring frame; the centre of a circle.
    excess_mm : (s,)
        What a circular device adds to every radius.
    pivots_mm : (s, 3)
        Middle of each session's points.
    along : (s, 3)
        Direction of the one line that a free session's points lie on, in base axes; 0 where they do not.
    is_rounded : (s,)
        Whether points beside that line, as rounded commands are, would tell a turn about it.
    """

    kinds: np.ndarray
    rotations: Numbers
    translations_mm: Numbers
    excess_mm: Numbers
    pivots_mm: Numbers
    along: Numbers
    is_rounded: np.ndarray


KINDS = {"free": 0, "parallel": 1, "circle": 2, "lengths": 3}
# Unknowns of each: a rotation and a translation, a translation, a centre and what is added to every radius, none.
N_UNKNOWNS = {"free": 6, "parallel": 3, "circle": 4, "lengths": 0}


def nominal_mm(machine: Machine, sightings: Sightings) -> Numbers:
    """Give where a machine without errors has every row's point, (n, 3)."""
    return _core.chain_positions(
        machine.chain,
        "nominal",
        sightings.carrier,
        np.ascontiguousarray(sightings.commanded_mm),
        np.ascontiguousarray(sightings.offset_mm),
        machine.tool_offset_mm,
        np.zeros((len(sightings), 30)),
        0,
    )


def start_frames(nominal: Numbers, sightings: Sightings, static: np.ndarray) -> Frames:
    """Place every session's device by the positions of a machine without errors; static targets (n,) have none."""
    n_sessions = len(sightings.sessions)
    kinds = np.array([KINDS[kind] for kind in sightings.frames], dtype=np.uint8)
    rotations = np.tile(np.eye(3), (n_sessions, 1, 1))
    translations = np.zeros((n_sessions, 3))
    excess = np.zeros(n_sessions)
    pivots, along = np.zeros((n_sessions, 3)), np.zeros((n_sessions, 3))
    is_rounded = np.zeros(n_sessions, dtype=bool)
    for number, kind in enumerate(sightings.frames):
        rows = sightings.rows_of_session(number, ~static)
        if kind == "lengths" or not len(rows):
            continue
        points, measured, seen = nominal[rows], sightings.measured_mm[rows], sightings.is_measured[rows]
        pivots[number] = points.mean(axis=0)
        if kind == "circle":
            translations[number] = _centre(points)
            radius = np.linalg.norm(points - translations[number], axis=1)
            excess[number] = float(np.mean(measured[:, 0] - radius))
        elif kind == "parallel":
            count = np.maximum(seen.sum(axis=0), 1)
            translations[number] = np.where(seen, measured - points, 0.0).sum(axis=0) / count
        else:
            complete = seen.all(axis=1)
            along[number], is_rounded[number] = _one_line(points[complete])
            rotations[number], translations[number] = _rigid_motion(
                points[complete], measured[complete], along[number]
            )
    return Frames(kinds, rotations, translations, excess, pivots, along, is_rounded)


def target_places(sightings: Sightings, static: np.ndarray, frames: Frames) -> tuple[Numbers | None, Numbers]:
    """Give the unknown places of targets: what they move in the measuring frames, and the offsets to start from.

    Every target of a session has its own place, but for the first one that an axis carries, whose place the frame's
    own translation holds. A target is told by its carrier and its stated offset, a static one by its name: it starts
    at the mean of where it was seen. A circular test has one point, and so none; of a length nobody asks.

    Returns
    -------
    derivative : (n, 3, 3k) or None
        Of the measured points, by the places of k targets in base axes (mm/mm).
    offset_mm : (n, 3)
        Stated offsets; those of static targets by their mean.
    """
    offsets = sightings.offset_mm.copy()
    offsets[static] = 0.0
    has_first: set[int] = set()
    free = []
    for rows in by_target(sightings):
        session, carrier = int(sightings.session[rows[0]]), CARRIERS[sightings.carrier[rows[0]]]
        if sightings.frames[session] not in SEE_POSITIONS:
            continue
        if carrier == "base":
            rotation, translation = frames.rotations[session], frames.translations_mm[session]
            offsets[rows] = _mean_of_measured(sightings, rows, translation) @ rotation
        elif session not in has_first:
            has_first.add(session)
            continue
        free.append((session, rows))
    if not free:
        return None, offsets
    derivative = np.zeros((len(sightings), 3, 3 * len(free)))
    for number, (session, rows) in enumerate(free):
        derivative[rows, :, 3 * number : 3 * number + 3] = frames.rotations[session]
    return derivative, offsets


def moving_targets(sightings: Sightings) -> list[np.ndarray]:
    """Give the rows of each target that is not on the base, by its stated offset; `sightings.once` keeps them."""
    on_base = sightings.carrier == CARRIERS.index("base")
    return [rows for rows in by_target(sightings) if not on_base[rows[0]]]


def by_target(sightings: Sightings) -> list[np.ndarray]:
    """Give the rows of each target of each session, targets in the order of their first rows.

    One that moved while the others stayed is another one from then on.
    """
    keys = [sightings.session, sightings.once("targets", numbers_of_targets), times_moved(sightings)]
    order = np.lexsort(keys)
    differs = np.any([np.diff(key[order]) != 0 for key in keys], axis=0)
    return sorted(np.split(order, np.flatnonzero(differs) + 1), key=lambda rows: int(rows[0]))


def _mean_of_measured(sightings: Sightings, rows: np.ndarray, translation_mm: Numbers) -> Numbers:
    """Give the mean place (3,) in the measuring frame from the translation; 0 along what was never measured."""
    seen = sightings.is_measured[rows]
    from_origin = np.where(seen, sightings.measured_mm[rows] - translation_mm, 0.0)
    return np.asarray(from_origin.sum(axis=0) / np.maximum(seen.sum(axis=0), 1))


def refuse_strangers(nominal: Numbers, sightings: Sightings, static: np.ndarray, frames: Frames) -> None:
    """Refuse measurements that do not follow the commanded motion at all: of another machine, column or unit.

    Raises
    ------
    GeometryError
        where half of the numbers of a session, in one of its components, are off by more than a twentieth of what its
        points span; where none of them moves, of what was commanded.
    """
    for number, kind in enumerate(sightings.frames):
        rows = sightings.rows_of_session(number, ~static)
        if kind not in SEE_POSITIONS or len(rows) < _FEWEST_STRANGERS:
            continue
        seen = sightings.is_measured[rows]
        expected = nominal[rows] @ frames.rotations[number].T + frames.translations_mm[number]
        # Each target stands somewhere else than stated by what its plate is off; that is no matter of motion.
        off = np.abs(sightings.measured_mm[rows] - expected)
        told = [number for number, has in enumerate(seen.T) if int(has.sum()) >= _FEWEST_STRANGERS]
        median_mm, worst = max(((float(np.median(off[seen[:, i], i])), i) for i in told), default=(0.0, 0))
        # What stands still as its carrier says may have followed the commands all the same.
        span = _span_mm(nominal[rows]) or _span_mm(sightings.commanded_mm[rows])
        if span > 0.0 and median_mm > _STRANGE * span:
            remedy = (
                "check that mx, my and mz are what was measured (in mm), the machine's chain, the carriers, and the "
                "targets' offsets tx, ty and tz (mm, as the axes point)"
            )
            raise GeometryError(
                f"the measured positions of session {sightings.sessions[number]!r} do not follow the commanded ones: "
                f"half of {MEASURED[worst]} is off by more than {median_mm:.1f} mm over {span:.0f} mm\n"
                f"hint: {next(other_units(sightings), remedy)}"
            )


def _span_mm(points: Numbers) -> float:
    return float(np.ptp(points, axis=0).max(initial=0.0))


def _one_line(points: Numbers) -> tuple[Numbers, bool]:
    """Give the direction (3,) of the line that points lie on, 0 where on none; and whether some lie beside it."""
    centred = points - points.mean(axis=0)
    _, spread, axes = np.linalg.svd(centred, full_matrices=False)
    if len(points) < 2 or spread[0] == 0.0 or spread[1] > ON_A_LINE * spread[0]:
        return np.zeros(3), False
    # Even round-off does: a column of 1e-14 mm is as good as another when it is scaled, and a step along it a radian.
    return axes[0], bool(np.cross(centred, axes[0]).any())


def _rigid_motion(points: Numbers, seen: Numbers, along: Numbers) -> tuple[Numbers, Numbers]:
    """Give R, t of the least-squares motion `seen = R points + t`, with the smallest turn of points along a line."""
    from_centre, seen_from_centre = points - points.mean(axis=0), seen - seen.mean(axis=0)
    if along.any():
        seen_along = seen_from_centre.T @ (from_centre @ along)
        rotation = _smallest_turn(along, seen_along / max(float(np.linalg.norm(seen_along)), 1e-300))
    else:
        rotation, _ = turn_between(from_centre, seen_from_centre)
    return rotation, seen.mean(axis=0) - rotation @ points.mean(axis=0)


def turn_between(from_centre: Numbers, seen_from_centre: Numbers) -> tuple[Numbers, Numbers]:
    """Give the least-squares rotation of centred points (n, 3) to seen ones, and how they spread together, (3,)."""
    left, spread, right = np.linalg.svd(seen_from_centre.T @ from_centre)
    return left @ np.diag([1.0, 1.0, np.linalg.det(left @ right)]) @ right, spread


def _smallest_turn(start: Numbers, end: Numbers) -> Numbers:
    """Give the smallest rotation that takes one unit vector to another."""
    axis, cosine = np.cross(start, end), float(start @ end)
    if cosine < -1.0 + 1e-12:
        other = np.eye(3)[int(np.argmin(np.abs(start)))]
        half = np.cross(start, other)
        half /= np.linalg.norm(half)
        return np.asarray(2.0 * np.outer(half, half) - np.eye(3))
    cross = np.array([[0.0, -axis[2], axis[1]], [axis[2], 0.0, -axis[0]], [-axis[1], axis[0], 0.0]])
    return np.asarray(np.eye(3) + cross + cross @ cross / (1.0 + cosine))


def turn_about(vector_rad: Numbers) -> Numbers:
    """Give the rotation by a vector, (3, 3)."""
    angle = float(np.linalg.norm(vector_rad))
    if angle == 0.0:
        return np.eye(3)
    x, y, z = vector_rad / angle
    skew = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.asarray(np.eye(3) + np.sin(angle) * skew + (1.0 - np.cos(angle)) * skew @ skew)


def first_frame_column(problem: _core.FitProblem, sightings: Sightings) -> int:
    """Give the first column of the frames' unknowns: they end where those that rows share begin."""
    return problem.first_shared_column - sum(N_UNKNOWNS[kind] for kind in sightings.frames)


def planes_of_circles(sightings: Sightings, first_frame_column: int, n_columns: int) -> Numbers:
    """Give rows C (k, n_columns), C x = 0: the centre of a circle stays in the plane of its commanded points.

    To first order no radius notices it leave, so that round-off would decide how far. A circle of which no row is
    left has no plane.
    """
    rows = []
    first = first_frame_column
    for own, kind in zip(sightings.rows_of_sessions, sightings.frames, strict=True):
        points = sightings.commanded_mm[own]
        if kind == "circle" and len(points):
            _, _, axes = np.linalg.svd(points - points.mean(axis=0), full_matrices=len(points) < 3)
            row = np.zeros(n_columns)
            row[first : first + 3] = axes[2]
            rows.append(row)
        first += N_UNKNOWNS[kind]
    return np.array(rows).reshape(len(rows), n_columns)


def _centre(points: Numbers) -> Numbers:
    """Give the centre of commanded points on a circle: least squares in their plane (Kåsa)."""
    middle = points.mean(axis=0)
    _, _, axes = np.linalg.svd(points - middle, full_matrices=False)
    centre, _ = circle_through((points - middle) @ axes[:2].T)
    return np.asarray(middle + centre @ axes[:2])
