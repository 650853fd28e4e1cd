"""What a machine's log holds, and what was physically so: motion since reversals, heat, conditions, cameras."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from scipy.signal import lfilter
from validation.hidden_effects.chain import RELATIVE, TOOL, Array, nothing, places_mm
from validation.hidden_effects.limited import Limits, limited_temperatures
from validation.hidden_effects.plans import Integers, Moments, Plan

from geoerr.machine import Machine

REFERENCE_DEGC = 20.0
_GRID_S = 0.5
FOCAL_PX, CENTRE_PX, BASELINE_MM = 2319.0, (1224.0, 1024.0), 120.0


@dataclass(frozen=True)
class Motion:
    """Motion of the axes at m moments, (m, 3) each; acceleration too is signed by axis."""

    direction: Array
    travel_mm: Array
    since_reversal_s: Array
    velocity_mm_s: Array
    mean_velocity_mm_s: Array
    acceleration_mm_s2: Array


def motion_of(moments: Moments) -> Motion:
    """Follow the axes from moment to moment. Each session begins long after homing: every axis came from below."""
    n_moments = len(moments.t_s)
    result = Motion(*(np.zeros((n_moments, 3)) for _ in range(6)))
    starts = moments.starts()
    for first, end in pairwise(starts.tolist()):
        rows = slice(first, end)
        q, t = moments.q_mm[rows], moments.t_s[rows]
        step = np.diff(q, axis=0, prepend=q[:1])
        seconds = np.diff(t, prepend=t[0] - 1.0)
        index = np.arange(len(q))
        for axis in range(3):
            has_moved = step[:, axis] != 0.0
            latest = np.maximum.accumulate(np.where(has_moved, index, 0))
            sense = np.where(latest > 0, np.sign(step[latest, axis]), 1.0)
            turned = np.flatnonzero(np.diff(sense, prepend=1.0))
            way = np.cumsum(np.abs(step[:, axis]))
            # A turn lies just after the moment before the first one of the new sense.
            last_turn = np.zeros(len(q), dtype=np.int64)
            last_turn[turned] = turned
            last_turn = np.maximum.accumulate(last_turn)
            before = np.maximum(last_turn - 1, 0)
            result.direction[rows, axis] = sense
            result.travel_mm[rows, axis] = way - way[before]
            result.since_reversal_s[rows, axis] = t - t[before]
        length = np.linalg.norm(step, axis=1, keepdims=True)
        heading = np.divide(step, length, out=np.zeros_like(step), where=length > 0.0)
        moving = moments.is_moving[rows, None]
        result.velocity_mm_s[rows] = np.where(moving, heading * moments.feed_mm_min[rows, None] / 60.0, 0.0)
        result.acceleration_mm_s2[rows] = np.where(moving, heading * moments.acceleration_mm_s2[rows, None], 0.0)
        result.mean_velocity_mm_s[rows] = step / seconds[:, None]
    return result


def followed(u: Array, t_s: Array, starts: Integers, tau_s: float, *, is_held: bool = False) -> Array:
    """Follow u (m,) with a first-order lag, session by session, in equilibrium at the start of each.

    Between two moments u goes in a straight line, or has been what it is at the second (`is_held`: a mean speed).
    """
    result = np.array(u, dtype=float)
    for first, end in pairwise(starts.tolist()):
        step = np.diff(t_s[first:end])
        keep = np.exp(-step / tau_s)
        mean_keep = keep if is_held else np.where(step > 0, (1.0 - keep) * tau_s / np.maximum(step, 1e-12), 1.0)
        value = result[first]
        for row, (stay, mean) in enumerate(zip(keep.tolist(), mean_keep.tolist(), strict=True), start=first + 1):
            value = stay * value + (mean - stay) * u[row - 1] + (1.0 - mean) * u[row]
            result[row] = value
    return result


def temperatures(rng: np.random.Generator, moments: Moments, motion: Motion, is_rich: bool) -> dict[str, Array]:
    """Heat the machine: (m,) °C for each sensor, as the sensors themselves have it.

    The bed is switched between set points, its underside lags behind it, the frame follows slowly, `temp_window`
    belongs to nothing. With `is_rich` also a nozzle, a chamber and the motor of x, which warms with its use.
    """
    starts = moments.starts()
    names = ["temp_bed", "temp_bed_low", "temp_frame", "temp_window"]
    names += ["temp_nozzle", "temp_chamber", "temp_motor"] if is_rich else []
    result = {name: np.zeros(len(moments.t_s)) for name in names}
    for first, end in pairwise(starts.tolist()):
        t = moments.t_s[first:end]
        grid = np.arange(0.0, t[-1] + 2 * _GRID_S, _GRID_S)
        length_s = max(float(t[-1]), 60.0)
        room = 20.0 + rng.uniform(0.0, 3.0)
        bed = _heated(grid, _set_points(rng, grid, length_s / 5.0, room, 40.0, 100.0), length_s / 45.0, room)
        own = _set_points(rng, grid, length_s / 4.0, 0.0, -8.0, 8.0)
        low = (
            room
            + 0.75 * (_heated(grid, bed, length_s / 16.0, room) - room)
            + _heated(grid, own, length_s / 30.0, 0.0)
        )
        frame = _heated(grid, room + 0.3 * (bed - room), length_s / 6.0, room)
        window = 18.0 + _heated(grid, 40.0 * rng.standard_normal(len(grid)), length_s / 12.0, 0.0) * np.sqrt(
            length_s / 60.0
        )
        of = {"temp_bed": bed, "temp_bed_low": low, "temp_frame": frame, "temp_window": window}
        if is_rich:
            nozzle = _heated(grid, _set_points(rng, grid, length_s / 9.0, room, 60.0, 240.0), length_s / 90.0, room)
            chamber = _heated(grid, room + 0.25 * (bed - room) + 0.04 * (nozzle - room), length_s / 10.0, room)
            effort = np.interp(grid, t, np.minimum(np.abs(motion.mean_velocity_mm_s[first:end, 0]) / 40.0, 2.0))
            of |= {"temp_nozzle": nozzle, "temp_chamber": chamber}
            of["temp_motor"] = _heated(grid, room + 45.0 * effort, length_s / 18.0, room)
        for name, values in of.items():
            result[name][first:end] = np.interp(t, grid, values)
    return {name: np.round(values, 3) for name, values in result.items()}


def _set_points(
    rng: np.random.Generator, grid: Array, every_s: float, start: float, low: float, high: float
) -> Array:
    switched = np.cumsum(every_s * rng.uniform(0.5, 1.5, 40)) - 0.4 * every_s
    levels = np.append(start, rng.uniform(low, high, 40))
    return levels[np.searchsorted(switched, grid)]


def _heated(grid: Array, towards: Array, tau_s: float, start: float) -> Array:
    keep = np.exp(-(grid[1] - grid[0]) / tau_s)
    return np.asarray(lfilter([1.0 - keep], [1.0, -keep], towards - start)) + start


@dataclass(frozen=True)
class Log:
    """All that a hidden effect may follow, by row (n), nothing of it noisy.

    Attributes
    ----------
    columns
        (n,) temperatures and other covariates as the table has them.
    nominal_mm
        (n, 3) where the target would be, base frame (`relative`: the work's frame).
    in_camera_mm
        (n, 3) the same in the measuring frame.
    camera_from_base
        (n, 3, 3) rotation into the measuring frame.
    given
        Parameters of the hidden effect that are not to be drawn.
    """

    machine: Machine
    plan: Plan
    motion: Motion
    columns: dict[str, Array]
    nominal_mm: Array
    in_camera_mm: Array
    camera_from_base: Array
    by_moment: dict[str, Array] = field(default_factory=dict)
    given: dict[str, float] = field(default_factory=dict)

    def value(self, name: str, drawn: float) -> float:
        """Give a parameter of the hidden effect: as drawn, or as `given` has it."""
        return self.given.get(name, float(drawn))

    @property
    def n_rows(self) -> int:
        """Number of rows."""
        return len(self.moment)

    @property
    def moment(self) -> Integers:
        """Moment of each row, (n,)."""
        return self.plan.rows.moment

    @property
    def carrier(self) -> Integers:
        """Carrier of each row, (n,) index into `CARRIERS`."""
        return self.plan.rows.carrier

    @property
    def q_mm(self) -> Array:
        """Commanded positions, (n, 3)."""
        return self.plan.moments.q_mm[self.moment]

    @property
    def t_s(self) -> Array:
        """Time within the session, (n,)."""
        return self.plan.moments.t_s[self.moment]

    @property
    def session(self) -> Integers:
        """Session of each row, (n,)."""
        return self.plan.moments.session[self.moment]

    @property
    def pass_number(self) -> Integers:
        """Pass of each row, (n,)."""
        return self.plan.moments.pass_number[self.moment]

    @property
    def feed_mm_min(self) -> Array:
        """Feed of the last move, (n,)."""
        return self.plan.moments.feed_mm_min[self.moment]

    def moved(self, name: str, axis: int) -> Array:
        """Give a column of `Motion`, by row."""
        return np.asarray(getattr(self.motion, name)[self.moment, axis])

    def range_mm(self, axis: int) -> tuple[float, float]:
        """Give the range of an axis."""
        return self.machine.axes["xyz"[axis]].range_mm

    def share(self, axis: int) -> Array:
        """Position within the range, −1 to 1."""
        low, high = self.range_mm(axis)
        return np.asarray(2.0 * (self.q_mm[:, axis] - low) / (high - low) - 1.0)

    def bed_mm(self) -> Array:
        """Give the place on the work (n, 3) that the target is at, or that lies at the tool for `relative`."""
        offset = self.plan.rows.offset_mm
        return np.where((self.carrier == RELATIVE)[:, None], offset + self.q_mm, offset)

    def pixels(self) -> dict[str, Array]:
        """Where two cameras side by side see the targets (left one: the measuring frame)."""
        x, y, z = self.in_camera_mm.T
        u_0, v_0 = CENTRE_PX
        v = v_0 + FOCAL_PX * y / z
        left, right = u_0 + FOCAL_PX * x / z, u_0 + FOCAL_PX * (x - BASELINE_MM) / z
        return {"u_left": left, "v_left": v, "u_right": right, "v_right": v}


def make_log(rng: np.random.Generator, machine: Machine, plan: Plan, limits: Limits | None = None) -> Log:
    """Draw poses and temperatures, and put everything by row."""
    moments, rows = plan.moments, plan.rows
    motion = motion_of(moments)
    sensors = temperatures(rng, moments, motion, is_rich=plan.name == "mixed")
    if limits is not None:
        sensors = limited_temperatures(limits, sensors)
    by_moment = {**sensors, **plan.columns}
    arm = arms_mm(machine, plan)
    nominal = places_mm(machine.chain, rows.carrier, moments.q_mm[rows.moment], arm, nothing(len(rows.moment)))
    turn, place = np.zeros((len(arm), 3, 3)), np.zeros((len(arm), 3))
    for session in np.unique(moments.session):
        mine = moments.session[rows.moment] == session
        pose, shift = camera_of(rng, nominal[mine])
        turn[mine] = pose
        place[mine] = nominal[mine] @ pose.T + shift
    columns = {name: values[rows.moment] for name, values in by_moment.items()}
    return Log(machine, plan, motion, columns, nominal, place, turn, by_moment)


def arms_mm(machine: Machine, plan: Plan) -> Array:
    """Targets from their carriage's origin: those of the tool count from the tool point."""
    on_tool = (plan.rows.carrier == TOOL) | (plan.rows.carrier == RELATIVE)
    return plan.rows.offset_mm + np.where(on_tool[:, None], np.asarray(machine.tool_offset_mm), 0.0)


def camera_of(rng: np.random.Generator, places: Array) -> tuple[Array, Array]:
    """Draw a pose that sees the places from 1.1 to 1.5 m: rotation camera from base, and translation."""
    centre = 0.5 * (places.min(axis=0) + places.max(axis=0))
    q, r = np.linalg.qr(rng.standard_normal((3, 3)))
    turn = q * np.sign(np.diag(r))
    turn[:, 0] *= np.sign(np.linalg.det(turn))
    return turn, np.array([0.0, 0.0, rng.uniform(1100.0, 1500.0)]) - turn @ centre
