"""What is measured, in which order and when: three plans, as rows of a log.

- `nine-lines`: three sessions of nine lines along the axes, three repeats there and back, three targets on each body
  that has axes, all at rest.
- `volume`: lines of 40 rows at random places along all axes, a third of them in motion, a tenth repeated.
  `volume-relative` sees the tool from the work, `volume-floor` both bodies from the floor, `volume` is one of both.
- `mixed`: lines along axes and diagonals at many feeds, at rest, in motion and with ramps; a static marker; loads,
  forces, duty and three more temperatures.

A line is run without gaps in the log: every turning point is a row, so that directions, travels and times since a
reversal can be read from the rows. The first points after a turn lie 0.1 to 12 mm from it; steps are not
commensurate.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt
from validation.hidden_effects.chain import BASE, RELATIVE, TOOL, WORK, Array, sides

from geoerr.machine import Machine

Integers = npt.NDArray[np.int64]

PLANS = ("nine-lines", "volume", "volume-relative", "volume-floor", "mixed")
FEEDS_MM_MIN = (300.0, 900.0, 2000.0, 4500.0, 9000.0)
RAPID_MM_MIN = 6000.0
MARGIN = 0.03


@dataclass
class Pass:
    """One way along a line: `q_mm` (k, 3) in order; `seconds` (k,) between moments where speed is not `feed`."""

    session: int
    line: str
    repeat: int
    is_back: bool
    q_mm: Array
    feed_mm_min: float
    is_moving: bool = False
    seconds: Array | None = None
    speed_mm_s: Array | None = None
    acceleration_mm_s2: Array | None = None


@dataclass(frozen=True)
class Moments:
    """All moments in order (m rows). `pass_number` counts the passes; speeds are along the path."""

    q_mm: Array
    t_s: Array
    session: Integers
    pass_number: Integers
    feed_mm_min: Array
    is_moving: npt.NDArray[np.bool_]
    acceleration_mm_s2: Array
    passes: tuple[Pass, ...]

    def starts(self) -> Integers:
        """First moment of each session, and the end."""
        first = np.flatnonzero(np.diff(self.session, prepend=-1))
        return np.append(first, len(self.session))


@dataclass(frozen=True)
class Rows:
    """Which target is seen in which moment: (n,) each, and targets' offsets as the table has them (n, 3)."""

    moment: Integers
    carrier: Integers
    target: Integers
    offset_mm: Array


@dataclass(frozen=True)
class Plan:
    """Moments, rows, and what the plan alone decides."""

    name: str
    moments: Moments
    rows: Rows
    is_seen_by_cameras: bool
    columns: dict[str, Array] = field(default_factory=dict)


def draw_plan(rng: np.random.Generator, machine: Machine, plan: str, n_rows: int) -> Plan:
    """Draw a plan of about `n_rows` rows.

    Raises
    ------
    ValueError
        for a name that is no plan.
    """
    if plan not in PLANS:
        raise ValueError(f"{plan!r} is no plan: it is one of {', '.join(PLANS)}")
    if plan == "volume":
        plan = str(rng.choice(["volume-relative", "volume-floor"]))
    if plan == "nine-lines":
        return _nine_lines(rng, machine, n_rows)
    if plan == "mixed":
        return _mixed(rng, machine, n_rows)
    return _volume(rng, machine, n_rows, is_relative=plan == "volume-relative")


def _bodies(machine: Machine) -> list[int]:
    tool_axes, work_axes = sides(machine.chain)
    return [body for body, axes in ((TOOL, tool_axes), (WORK, work_axes)) if axes]


def _nine_lines(rng: np.random.Generator, machine: Machine, n_rows: int) -> Plan:
    bodies = _bodies(machine)
    n_sessions, n_repeats, n_targets = (3 if n_rows > 4000 else 2), 3, 3 * len(bodies)
    n_points = max(5, round(n_rows / (n_sessions * 9 * 2 * n_repeats * n_targets)) + 1)
    passes: list[Pass] = []
    for session in range(n_sessions):
        lines = [(axis, place) for axis in range(3) for place in range(3)]
        for index in rng.permutation(len(lines)):
            axis, place = lines[index]
            base = _anywhere(rng, machine, near_low=place == 0)
            positions = _positions(rng, machine, axis, n_points)
            for repeat in range(n_repeats):
                feed = float(rng.choice(FEEDS_MM_MIN[1:]))
                passes += _there_and_back(session, f"{'XYZ'[axis]}{place + 1}", repeat, base, axis, positions, feed)
    moments = in_time(rng, passes)
    every = np.arange(len(moments.t_s))
    rows = seen(rng, machine, [(body, target, every) for body in bodies for target in range(3)])
    return Plan("nine-lines", moments, rows, is_seen_by_cameras=True)


def _volume(rng: np.random.Generator, machine: Machine, n_rows: int, *, is_relative: bool) -> Plan:
    bodies = [RELATIVE] if is_relative else _bodies(machine)
    n_points = 40 // len(bodies)
    n_lines = max(20, round(n_rows / 40))
    n_sessions = 5 if n_lines >= 100 else 3
    n_repeated = max(1, n_lines // 10)
    passes: list[Pass] = []
    for session, share in enumerate(np.array_split(np.arange(n_lines - n_repeated), n_sessions)):
        runs = [_random_line(rng, machine, session, f"L{line}", n_points) for line in share]
        again = len(np.array_split(np.arange(n_repeated), n_sessions)[session])
        # What was inserted before is among the runs: a line may be measured a third time.
        for index in rng.choice(len(runs), min(again, len(runs)), replace=False):
            later = int(rng.integers(index + 1, len(runs) + 1))
            repeat = sum(run[0].line == runs[index][0].line for run in runs)
            runs.insert(later, [_again(one, repeat) for one in runs[index]])
        passes += [one for run in runs for one in run]
    moments = in_time(rng, passes)
    of_line = rng.integers(0, 3, len(moments.passes))[moments.pass_number]
    targets = [
        (body, target, np.flatnonzero((of_line + body) % 3 == target)) for body in bodies for target in range(3)
    ]
    rows = seen(rng, machine, targets)
    return Plan("volume-relative" if is_relative else "volume-floor", moments, rows, not is_relative)


def _mixed(rng: np.random.Generator, machine: Machine, n_rows: int) -> Plan:
    bodies = _bodies(machine)
    per_moment = len(bodies) + 1.0 / 3.0
    n_points = 25
    n_lines = max(24, round(n_rows / (n_points * per_moment)))
    n_sessions = 4 if n_lines >= 80 else 2
    passes: list[Pass] = []
    for session, share in enumerate(np.array_split(np.arange(n_lines), n_sessions)):
        for line in share:
            kind = rng.random()
            if kind < 0.30:
                passes += _ramps(rng, machine, session, f"R{line}", n_points)
            elif kind < 0.60:
                passes += _diagonal(rng, machine, session, f"D{line}", n_points)
            else:
                passes += _random_line(rng, machine, session, f"L{line}", n_points)
    moments = in_time(rng, passes)
    n_moments = len(moments.t_s)
    of_line = rng.integers(0, 3, len(moments.passes))[moments.pass_number]
    targets = [
        (body, target, np.flatnonzero((of_line + body) % 3 == target)) for body in bodies for target in range(3)
    ]
    targets.append((BASE, 0, np.arange(0, n_moments, 3)))
    n_passes = len(moments.passes)
    held = rng.choice([0.0, 0.0, 20.0, 50.0, 80.0], n_moments)
    is_probing = (rng.random(n_passes) < 0.4)[moments.pass_number]
    columns = {
        "load": rng.choice([0.0, 1.5, 3.0], n_passes)[moments.pass_number],
        "force": np.where(is_probing & ~moments.is_moving, held, 0.0),
        "duty": np.round(
            rng.uniform(0.05, 0.95, max(2, n_passes // 6))[
                np.minimum(moments.pass_number // 6, max(2, n_passes // 6) - 1)
            ],
            3,
        ),
    }
    return Plan("mixed", moments, seen(rng, machine, targets), True, columns)


def limits_mm(machine: Machine) -> tuple[Array, Array]:
    """Give the lowest and highest position that is measured, a little inside the travel."""
    ranges = np.array([machine.axes[axis].range_mm for axis in "xyz"])
    room = MARGIN * (ranges[:, 1] - ranges[:, 0])
    return ranges[:, 0] + room, ranges[:, 1] - room


def _anywhere(rng: np.random.Generator, machine: Machine, *, near_low: bool = False) -> Array:
    low, high = limits_mm(machine)
    return low + (high - low) * (rng.uniform(0.0, 0.05, 3) if near_low else rng.random(3))


def _positions(rng: np.random.Generator, machine: Machine, axis: int, n_points: int) -> Array:
    """Points along an axis from end to end, uneven, with fine steps after either end."""
    low, high = limits_mm(machine)
    return low[axis] + (high[axis] - low[axis]) * _shares(rng, n_points, high[axis] - low[axis])


def _shares(rng: np.random.Generator, n_points: int, length_mm: float) -> Array:
    """Places from 0 to 1: about a third of the points within 12 mm of either end, the others jittered."""
    n_fine = max(1, n_points // 6)
    fine = [np.sort(np.exp(rng.uniform(np.log(0.1), np.log(12.0), n_fine))) / length_mm for _ in range(2)]
    n_coarse = n_points - 2 * n_fine - 2
    coarse = 0.05 + 0.9 * (np.arange(n_coarse) + rng.uniform(0.1, 0.9, n_coarse)) / max(n_coarse, 1)
    return np.sort(np.concatenate([[0.0], fine[0], coarse, 1.0 - fine[1], [1.0]]))


def _there_and_back(
    session: int, line: str, repeat: int, base: Array, axis: int, positions: Array, feed: float
) -> list[Pass]:
    points = np.tile(base, (len(positions), 1))
    points[:, axis] = positions
    return [
        Pass(session, line, repeat, False, points, feed),
        Pass(session, line, repeat, True, points[-2::-1], feed),
    ]


def _random_line(rng: np.random.Generator, machine: Machine, session: int, line: str, n_points: int) -> list[Pass]:
    """Draw a line along a drawn axis; 60 % there and back, a third in motion."""
    axis = int(rng.integers(3))
    base = _anywhere(rng, machine)
    goes_back = rng.random() < 0.6
    positions = _positions(rng, machine, axis, n_points // 2 + 1 if goes_back else n_points)
    if rng.random() < 0.5:
        positions = positions[::-1]
    passes = _there_and_back(session, line, 0, base, axis, positions, float(rng.choice(FEEDS_MM_MIN)))
    is_moving = rng.random() < 1.0 / 3.0
    for one in passes:
        one.is_moving = is_moving
    return passes if goes_back else passes[:1]


def _diagonal(rng: np.random.Generator, machine: Machine, session: int, line: str, n_points: int) -> list[Pass]:
    """Draw a straight line over two or three axes, half of them in motion, there and back."""
    start, end = _anywhere(rng, machine), _anywhere(rng, machine)
    while np.linalg.norm(end - start) < 150.0:
        end = _anywhere(rng, machine)
    if rng.random() < 0.5:
        still = int(rng.integers(3))
        end[still] = start[still]
    shares = _shares(rng, n_points // 2 + 1, float(np.linalg.norm(end - start)))
    points = start + shares[:, None] * (end - start)
    feed, is_moving = float(rng.choice(FEEDS_MM_MIN)), rng.random() < 0.5
    return [
        Pass(session, line, 0, False, points, feed, is_moving),
        Pass(session, line, 0, True, points[-2::-1], feed, is_moving),
    ]


def _ramps(rng: np.random.Generator, machine: Machine, session: int, line: str, n_points: int) -> list[Pass]:
    """Draw a trapezium of speed along an axis: most pictures in the ramps, one of them where each ends."""
    axis = int(rng.integers(3))
    low, high = limits_mm(machine)
    base = _anywhere(rng, machine)
    length = 0.9 * (high[axis] - low[axis])
    acceleration = float(rng.uniform(150.0, 900.0))
    top = min(float(rng.uniform(60.0, 160.0)), np.sqrt(0.8 * acceleration * length))
    ramp_s, cruise_s = top / acceleration, length / top - top / acceleration
    passes: list[Pass] = []
    # Both ways begin with a rapid move to their first point: two lines, not one there and back.
    for is_back in (False, True):
        n_ramp, n_cruise = max(2, n_points // 5), max(1, n_points // 2 - 2 * max(2, n_points // 5))
        up = ramp_s * np.append(np.sort(rng.uniform(0.05, 0.95, n_ramp)), 1.0)
        level = ramp_s + cruise_s * np.append(np.sort(rng.uniform(0.1, 0.9, n_cruise)), 1.0)
        down = ramp_s + cruise_s + ramp_s * np.sort(rng.uniform(0.05, 0.9, n_ramp))
        since = np.concatenate([up, level, down])
        slope = np.repeat([acceleration, 0.0, -acceleration], [len(up), len(level), len(down)])
        late = since - ramp_s - cruise_s
        way = np.where(
            since <= ramp_s,
            0.5 * acceleration * since**2,
            np.where(
                late <= 0.0,
                0.5 * top * ramp_s + top * (since - ramp_s),
                length - 0.5 * acceleration * (ramp_s - late) ** 2,
            ),
        )
        speed = np.where(
            since <= ramp_s, acceleration * since, np.where(late <= 0.0, top, acceleration * (ramp_s - late))
        )
        points = np.tile(base, (len(way) + 1, 1))
        way = np.append(0.0, way)
        begin = low[axis] + 0.02 * length
        points[:, axis] = begin + length - way if is_back else begin + way
        passes.append(
            Pass(
                *(session, f"{line}-back" if is_back else line, 0, is_back, points, RAPID_MM_MIN, True),
                seconds=np.append(np.nan, np.diff(since, prepend=0.0)),
                speed_mm_s=np.append(0.0, speed),
                acceleration_mm_s2=np.append(0.0, slope),
            )
        )
    return passes


def _again(one: Pass, repeat: int) -> Pass:
    return Pass(one.session, one.line, repeat, one.is_back, one.q_mm, one.feed_mm_min, one.is_moving)


def in_time(rng: np.random.Generator, passes: list[Pass]) -> Moments:
    """Put passes one after the other: pictures at rest wait until the machine has settled."""
    return Moments(*_columns_in_time(rng, passes), passes=tuple(passes))


def _columns_in_time(rng: np.random.Generator, passes: list[Pass]) -> Iterator[npt.NDArray]:  # type: ignore[type-arg]
    counts = [len(one.q_mm) for one in passes]
    number = np.repeat(np.arange(len(passes)), counts)
    first_of_pass = np.cumsum([0, *counts[:-1]])
    q_mm = np.concatenate([one.q_mm for one in passes])
    session = np.array([one.session for one in passes])[number]
    is_moving = np.array([one.is_moving for one in passes])[number]
    feed = np.array([one.feed_mm_min for one in passes])[number]
    step_mm = np.linalg.norm(np.diff(q_mm, axis=0, prepend=q_mm[:1]), axis=1)
    # The way back begins at the point where the way there ended, and goes on without a stop. Other passes begin at
    # rest, after a rapid move to their first point.
    begins = np.array([not one.is_back or one.seconds is not None for one in passes])
    is_moving[first_of_pass[begins]] = False
    # Where a line ends or turns, the machine stands.
    ends = np.array([one.seconds is None for one in passes])
    is_moving[(first_of_pass + counts - 1)[ends]] = False
    feed[first_of_pass[begins]] = RAPID_MM_MIN
    speed, seconds = feed / 60.0, np.full(len(q_mm), np.nan)
    acceleration = np.zeros(len(q_mm))
    for one, first, count in zip(passes, first_of_pass, counts, strict=True):
        if one.seconds is not None:
            inner = slice(first + 1, first + count)
            seconds[inner] = one.seconds[1:]
            feed[inner] = 60.0 * one.speed_mm_s[1:]
            acceleration[inner] = one.acceleration_mm_s2[1:]
    wait_s = np.where(is_moving, 0.0, rng.uniform(0.8, 1.6, len(q_mm)))
    seconds = np.where(np.isnan(seconds), step_mm / speed + wait_s, seconds)
    elapsed = np.cumsum(seconds)
    start = np.flatnonzero(np.diff(session, prepend=-1))
    yield q_mm
    yield elapsed - elapsed[start][np.searchsorted(start, np.arange(len(q_mm)), side="right") - 1]
    yield session
    yield number
    yield feed
    yield is_moving
    yield acceleration


def seen(rng: np.random.Generator, machine: Machine, targets: list[tuple[int, int, Integers]]) -> Rows:
    """Make rows, by moment; targets sit at three places that are on no common line on each body."""
    low, high = limits_mm(machine)
    middle = 0.5 * (low + high)
    places = {
        TOOL: _triangle(rng, 110.0),
        RELATIVE: _triangle(rng, 60.0) * np.array([1.0, 1.0, 0.8]),
        WORK: middle + _triangle(rng, 150.0),
        BASE: middle + _triangle(rng, 250.0),
    }
    moment = np.concatenate([moments for _, _, moments in targets])
    carrier = np.concatenate([np.full(len(moments), body) for body, _, moments in targets])
    target = np.concatenate([np.full(len(moments), name) for _, name, moments in targets])
    order = np.argsort(moment, kind="stable")
    moment, carrier, target = moment[order], carrier[order], target[order]
    offset = np.zeros((len(moment), 3))
    for body, where in places.items():
        rows = carrier == body
        offset[rows] = where[target[rows]]
    return Rows(moment, carrier, target, np.round(offset, 3))


def _triangle(rng: np.random.Generator, size_mm: float) -> Array:
    corners = size_mm * np.array([[1.0, 0.2, -0.4], [-0.6, 1.0, 0.3], [-0.2, -0.5, 1.0]])
    return corners * rng.uniform(0.7, 1.1, (3, 3)) * rng.choice([-1.0, 1.0], 3)
