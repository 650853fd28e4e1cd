"""A plan as the fit would see it once it is measured: rows, poses of the cameras, unknown places, noise."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import polars as pl
from scipy import linalg

from geoerr.diagnose.advice.columns import Poses
from geoerr.diagnose.advice.measurement import Measurement
from geoerr.diagnose.advice.situation import Situation, pinhole
from geoerr.fit.sightings import Numbers, Sightings
from geoerr.fit.start import KINDS, nominal_mm, turn_about
from geoerr.machine import AXES
from geoerr.observations import CARRIERS

# Rows of a run over which a slow drift is constant.
_BLOCK_ROWS = 12
_BASE = CARRIERS.index("base")
_KIND_NAMES = {number: name for name, number in KINDS.items()}


@dataclass(frozen=True, eq=False)
class Planned:
    """Rows that a plan would give.

    Attributes
    ----------
    sightings
        Everything but what will be measured.
    poses
        How the device stands in each of its sessions.
    own : (n, 3, k)
        Derivative of the measured points by unknowns of these rows alone: places of targets, in base axes turned
        into the measuring frame; mm/mm. A bar has one place and one turn.
    target : (n,)
        Which of the plan's targets each row shows.
    clock_from_s
        When they begin on the clock of all sessions.
    as_in_session
        The last that was measured: nothing is done to the machine before.
    """

    sightings: Sightings
    poses: Poses
    own: Numbers
    target: np.ndarray
    clock_from_s: float
    as_in_session: int


def planned(situation: Situation, plan: Measurement) -> Planned:
    """Lay out the rows of a plan: every picture shows every target."""
    pictures, targets = plan.pictures, plan.targets
    n_targets = len(targets)
    moment = np.repeat(np.arange(len(pictures)), n_targets)
    target = np.tile(np.arange(n_targets), len(pictures))
    n = len(moment)
    offset = np.array([one.offset_mm for one in targets])[target]
    carrier = np.array([one.carrier for one in targets], dtype=np.uint8)[target]
    whitening = np.array([one.whitening for one in targets])[target]
    n_sessions = plan.n_sessions
    poses = _poses(situation, plan, n_sessions)
    directions = pictures.direction[moment].astype(np.int8)
    table = {
        "t": pictures.t_s[moment],
        "feed": pictures.feed_mm_min[moment],
        "moving": pictures.is_moving[moment].astype(np.float64),
    }
    table |= {f"dir_{axis}": directions[:, number].astype(np.float64) for number, axis in enumerate(AXES)}
    table |= {name: values[moment] for name, values in plan.conditions.items()}
    for name, (cold, _) in situation.temperatures.items():
        table.setdefault(name, np.full(n, cold))
    for name, (usual, _) in situation.conditions.items():
        table.setdefault(name, np.full(n, usual))
    sightings = Sightings(
        table=pl.DataFrame(table),
        commanded_mm=np.ascontiguousarray(pictures.q_mm[moment]),
        offset_mm=np.ascontiguousarray(offset),
        measured_mm=np.zeros((n, 3)),
        is_measured=np.abs(whitening).max(axis=2) > 0.0,
        whitening=np.ascontiguousarray(whitening),
        is_stated=True,
        carrier=np.ascontiguousarray(carrier),
        session=pictures.session[moment].astype(np.int64),
        sessions=tuple(str(number) for number in range(n_sessions)),
        frames=(_KIND_NAMES[int(poses.kinds[0])],) * n_sessions,
        pass_number=pictures.pass_number[moment].astype(np.int64),
        directions=directions,
        source_row=moment.astype(np.int64),
        left_out={},
        notes=(),
    )
    if situation.pixels:
        sightings = _with_pixels(situation, sightings, poses)
    own = _own_unknowns(plan, sightings, poses, target)
    return Planned(sightings, poses, own, target, situation.clock_s, situation.last_session)


def _poses(situation: Situation, plan: Measurement, n_sessions: int) -> Poses:
    kind = KINDS["circle"] if plan.is_circular else KINDS["free"] if plan.is_from_the_floor else situation.kind
    kinds = np.full(n_sessions, kind, dtype=np.uint8)
    rotations = np.tile(situation.rotation, (n_sessions, 1, 1))
    translations = np.tile(situation.translation_mm, (n_sessions, 1))
    if plan.is_circular:
        for session in range(n_sessions):
            own = plan.pictures.q_mm[plan.pictures.session == session]
            # The mean of both ends of each axis: a circle is closed, but its rows need not be even.
            translations[session] = 0.5 * (own.min(axis=0) + own.max(axis=0))
    elif plan.set_ups is not None:
        middle = situation.middle_mm
        seen = situation.rotation @ middle + situation.translation_mm
        for session, (turn, shift) in enumerate(plan.set_ups):
            rotations[session] = situation.rotation @ turn_about(turn)
            translations[session] = seen + shift - rotations[session] @ middle
    return Poses(kinds, rotations, translations, np.zeros(n_sessions))


def _with_pixels(situation: Situation, sightings: Sightings, poses: Poses) -> Sightings:
    points = nominal_mm(situation.machine, sightings)
    session = sightings.session
    seen = np.einsum("nij,nj->ni", poses.rotations[session], points) + poses.translations_mm[session]
    table = sightings.table.with_columns(
        *(pl.Series(name, pinhole(seen) @ coefficients) for name, coefficients in situation.pixels.items())
    )
    return replace(sightings, table=table)


def _own_unknowns(plan: Measurement, sightings: Sightings, poses: Poses, target: np.ndarray) -> Numbers:
    """Give the derivative by where targets sit: of every target and session but the first that an axis carries."""
    n = len(sightings)
    columns: list[Numbers] = []
    if plan.is_circular:
        return np.zeros((n, 3, 0))
    n_single = len(plan.targets) - plan.n_on_bar
    first = next((number for number, one in enumerate(plan.targets) if one.carrier != _BASE), -1)
    for session in range(plan.n_sessions):
        in_session = sightings.session == session
        turned = poses.rotations[session]
        for number in range(n_single):
            if number != first:
                columns.append(np.where((in_session & (target == number))[:, None, None], turned, 0.0))
        if plan.n_on_bar:
            on_bar = in_session & (target >= n_single)
            columns.append(np.where(on_bar[:, None, None], turned, 0.0))
            middle = np.mean([one.offset_mm for one in plan.targets[n_single:]], axis=0)
            arm = sightings.offset_mm - middle
            # ω × a = −[a]× ω
            turns = -np.array([_skew(one) for one in arm])
            columns.append(np.where(on_bar[:, None, None], turned @ turns, 0.0))
    return np.concatenate(columns, axis=2) if columns else np.zeros((n, 3, 0))


def _skew(vector: Numbers) -> Numbers:
    x, y, z = vector
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


@dataclass(frozen=True, eq=False)
class PlannedNoise:
    """The inverse covariance of a plan's rows, by component: σ⁻²(I − Z K Zᵀ).

    Attributes
    ----------
    sigma : (3,)
        Scatter from row to row.
    block : (n,)
        Runs of rows that share an offset.
    inner : (3, n_blocks, n_blocks)
        K = (I + C N)⁻¹ C, N the rows of each block, C the covariance of offsets and drift in units of σ².
    rows : (n, 3)
        1 where a number will be measured.
    """

    sigma: Numbers
    block: np.ndarray
    inner: Numbers
    rows: Numbers

    def product(self, left: Numbers, right: Numbers) -> Numbers:
        """Give Σ_c leftᵀ V_c⁻¹ right of columns (n, 3, k) and (n, 3, m), (k, m)."""
        n_blocks = self.inner.shape[1]
        first = np.searchsorted(self.block, np.arange(n_blocks))
        result = np.zeros((left.shape[2], right.shape[2]))
        for c in range(3):
            a, b = (np.ascontiguousarray(one[:, c] * self.rows[:, c, None]) for one in (left, right))
            sums = [np.add.reduceat(one, first, axis=0) for one in (a, b)]
            result += (a.T @ b - sums[0].T @ (self.inner[c] @ sums[1])) / self.sigma[c] ** 2
        return result


def noise_of(situation: Situation, rows: Planned) -> PlannedNoise:
    """Carry the noise of the data over to a plan: offsets of its passes, and drift within its sessions."""
    sightings = rows.sightings
    times = sightings.numbers("t")
    # Rows are in the order of time, so that runs of one pass lie together.
    begins = np.flatnonzero(np.diff(sightings.pass_number, prepend=-1))
    since = np.arange(len(sightings)) - np.repeat(begins, np.diff([*begins, len(sightings)]))
    starts = np.zeros(len(sightings), dtype=bool)
    starts[begins] = True
    starts |= since % _BLOCK_ROWS == 0
    block = np.cumsum(starts) - 1
    first = np.flatnonzero(starts)
    count = np.diff([*first, len(sightings)])
    time = np.add.reduceat(times, first) / count
    session, pass_number = sightings.session[first], sightings.pass_number[first]
    same_pass = (pass_number[:, None] == pass_number).astype(np.float64)
    same_session = (session[:, None] == session).astype(np.float64)
    apart = np.abs(time[:, None] - time)
    measured = sightings.is_measured.astype(np.float64)
    inner = np.zeros((3, len(first), len(first)))
    for c in range(3):
        if situation.offset[c] == 0.0 and situation.drift[c] == 0.0:
            continue
        covariance = situation.offset[c] ** 2 * same_pass
        covariance += situation.drift[c] ** 2 * np.exp(-apart / situation.memory_s[c]) * same_session
        n = np.add.reduceat(measured[:, c], first)
        inner[c] = linalg.solve(np.eye(len(first)) + covariance * n, covariance, check_finite=False)
    return PlannedNoise(np.asarray(situation.sigma), block, inner, measured)


def directions_of(plan: Measurement) -> dict[str, np.ndarray]:
    """Give `dir_x dir_y dir_z` by picture."""
    return {f"dir_{axis}": plan.pictures.direction[:, number] for number, axis in enumerate(AXES)}
