"""A machine's course through a measurement: where it goes, how fast, how long it takes, when pictures are taken."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from geoerr.diagnose.advice.situation import Situation
from geoerr.fit.sightings import Numbers
from geoerr.machine import AXES

# To the switches and back, off and on again slowly.
_HOMING_S = 30.0
# Corners of the travel that are on no common plane, and its middle; the first is reached upwards along every axis.
_PLACES = ((0.9, 0.9, 0.9), (0.1, 0.9, 0.9), (0.1, 0.1, 0.9), (0.1, 0.1, 0.1), (0.9, 0.1, 0.1), (0.5, 0.5, 0.5))


@dataclass(frozen=True, eq=False)
class Pictures:
    """The moments at which pictures are taken, in order.

    Attributes
    ----------
    q_mm : (n, 3)
        Commanded positions.
    direction : (n, 3)
        Direction in which each axis last moved.
    feed_mm_min, t_s : (n,)
        Feed of the last move; time since its session's start.
    is_moving : (n,)
        Whether the machine moves.
    line, repeat, session : (n,)
        Name of the motion, which repetition, number of the session.
    pass_number : (n,)
        Runs that share an offset.
    minutes
        How long it all takes.
    """

    q_mm: Numbers
    direction: np.ndarray
    feed_mm_min: Numbers
    t_s: Numbers
    is_moving: np.ndarray
    line: tuple[str, ...]
    repeat: np.ndarray
    session: np.ndarray
    pass_number: np.ndarray
    minutes: float

    def __len__(self) -> int:
        return len(self.q_mm)


@dataclass
class Course:
    """Takes one move after the other.

    The machine comes from its homing, each axis upwards. Every session begins with a look at six places, but for
    circular tests, which have no frame to be known.
    """

    situation: Situation
    at_mm: Numbers = field(init=False)
    direction: np.ndarray = field(init=False)
    feed_mm_min: float = field(init=False)
    is_oriented: bool = True
    t_s: float = 0.0
    done_s: float = 0.0
    session: int = 0
    _rows: list[tuple[Numbers, np.ndarray, float, float, bool, str, int, int, int]] = field(default_factory=list)
    _passes: dict[tuple[object, ...], int] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.at_mm = self.situation.middle_mm.copy()
        self.direction = np.ones(3, dtype=np.int8)
        self.feed_mm_min = self.situation.feed_mm_min
        if self.is_oriented:
            self.orient()

    def next_session(self, minutes: float = 0.0) -> None:
        """Begin a new session: cameras and machine are set up anew, which takes so long."""
        self.done_s += self.t_s + 60.0 * minutes
        self.t_s = 0.0
        self.session += 1
        self.direction = np.ones(3, dtype=np.int8)
        if self.is_oriented:
            self.orient()

    def orient(self) -> None:
        """Look at six places across the travel, at rest, so that this session's frame is known by itself."""
        span = self.situation.span_mm
        for number, shares in enumerate(_PLACES):
            self.go(span[:, 0] + (span[:, 1] - span[:, 0]) * np.array(shares), self.situation.feed_mm_min)
            self.look("places", number)

    def wait(self, seconds: float) -> None:
        """Stand still."""
        self.t_s += seconds

    def home(self) -> None:
        """Send all axes to their switches, at the low ends, and on from there upwards."""
        self.go(self.situation.span_mm[:, 0], self.situation.feed_mm_min)
        self.wait(_HOMING_S)
        self.direction = np.ones(3, dtype=np.int8)

    def go(self, point_mm: Numbers, feed_mm_min: float) -> None:
        """Move in a straight line, from rest to rest."""
        step = np.asarray(point_mm, dtype=np.float64) - self.at_mm
        length = float(np.linalg.norm(step))
        if length == 0.0:
            return
        self.t_s += self._seconds(length, feed_mm_min / 60.0)
        self.direction = np.where(step != 0.0, np.sign(step), self.direction).astype(np.int8)
        self.at_mm = self.at_mm + step
        self.feed_mm_min = feed_mm_min

    def look(self, line: str, repeat: int = 0) -> None:
        """Take a picture at rest."""
        self.t_s += self.situation.dwell_s
        self._take(line, repeat, is_moving=False)

    def visit(self, points_mm: Numbers, feed_mm_min: float, line: str, repeat: int = 0) -> None:
        """Go to points one after the other, and take a picture at each, at rest."""
        for point in points_mm:
            self.go(point, feed_mm_min)
            self.look(line, repeat)

    def sweep(self, points_mm: Numbers, feed_mm_min: float, line: str, repeat: int = 0) -> None:
        """Run to the last of the points without a stop, and take pictures when passing the others.

        The cameras are not quick enough for every point of a fast run: they take as many as they can, and a run
        that is told to be repeated takes others.
        """
        points = np.asarray(points_mm, dtype=np.float64)
        speed = feed_mm_min / 60.0
        way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
        way += float(np.linalg.norm(points[0] - self.at_mm))
        least = self.situation.interval_s * speed
        n_skipped = max(math.ceil(least * (len(points) - 1) / max(way[-1] - way[0], 1e-9)), 1)
        start_s, ramp_s = self.t_s, self._ramp_s(speed)
        for place in range(repeat % n_skipped, len(points) - 1, n_skipped):
            self._turn_to(points[place])
            self.feed_mm_min = feed_mm_min
            self.t_s = start_s + ramp_s + way[place] / speed
            self._take(line, repeat, is_moving=True)
        self._turn_to(points[-1])
        self.feed_mm_min = feed_mm_min
        self.t_s = start_s + 2.0 * ramp_s + way[-1] / speed
        self.look(line, repeat)

    def ramp(self, point_mm: Numbers, top_mm_s: float, acceleration_mm_s2: float, line: str, repeat: int = 0) -> None:
        """Run to a point by a trapezium of speed, and take pictures all the way, as often as the cameras can.

        The feed of each picture is the speed at its moment.
        """
        start, way = self.at_mm.copy(), np.asarray(point_mm, dtype=np.float64) - self.at_mm
        length, ramp_s = float(np.linalg.norm(way)), top_mm_s / acceleration_mm_s2
        total_s = length / top_mm_s + ramp_s
        start_s = self.t_s
        # Another run takes other moments.
        since_s = self.situation.interval_s * (0.25 + 0.5 * (repeat % 2))
        while since_s < total_s:
            left_s = total_s - since_s
            speed = min(top_mm_s, acceleration_mm_s2 * since_s, acceleration_mm_s2 * left_s)
            gone, left = (0.5 * acceleration_mm_s2 * min(one, ramp_s) ** 2 for one in (since_s, left_s))
            done = gone + top_mm_s * max(since_s - ramp_s, 0.0) if left_s > ramp_s else length - left
            self._turn_to(start + way * done / length)
            self.feed_mm_min = 60.0 * speed
            self.t_s = start_s + since_s
            self._take(line, repeat, is_moving=True)
            since_s += self.situation.interval_s
        self._turn_to(np.asarray(point_mm, dtype=np.float64))
        self.feed_mm_min = 60.0 * top_mm_s
        self.t_s = start_s + total_s
        self.look(line, repeat)

    @property
    def n_pictures(self) -> int:
        """Pictures taken so far."""
        return len(self._rows)

    def pictures(self) -> Pictures:
        """Give what was taken."""
        q, direction, feed, t, moving, line, repeat, session, number = zip(*self._rows, strict=True)
        return Pictures(
            np.array(q),
            np.array(direction),
            np.array(feed),
            np.array(t),
            np.array(moving),
            line,
            np.array(repeat),
            np.array(session),
            np.array(number),
            (self.done_s + self.t_s) / 60.0,
        )

    def _turn_to(self, point_mm: Numbers) -> None:
        step = point_mm - self.at_mm
        self.direction = np.where(step != 0.0, np.sign(step), self.direction).astype(np.int8)
        self.at_mm = point_mm.copy()

    def _take(self, line: str, repeat: int, *, is_moving: bool) -> None:
        key = (self.session, line, repeat, *self.direction.tolist())
        number = self._passes.setdefault(key, len(self._passes))
        self._rows.append(
            (
                self.at_mm.copy(),
                self.direction,
                self.feed_mm_min,
                self.t_s,
                is_moving,
                line,
                repeat,
                self.session,
                number,
            )
        )

    def _ramp_s(self, speed_mm_s: float) -> float:
        """Give what speeding up (or slowing down) costs beyond the way at full speed."""
        a = self.situation.acceleration_mm_s2
        return 0.0 if a is None else 0.5 * speed_mm_s / a

    def _seconds(self, length_mm: float, speed_mm_s: float) -> float:
        a = self.situation.acceleration_mm_s2
        if a is not None and length_mm < speed_mm_s**2 / a:
            return 2.0 * math.sqrt(length_mm / a)
        return length_mm / speed_mm_s + 2.0 * self._ramp_s(speed_mm_s)


def along(situation: Situation, axes: Sequence[str], at_mm: Numbers, shares: Numbers) -> Numbers:
    """Give points (n, 3) along axes through a point, from the low (share 0) to the high end (1) of what was measured.

    Several axes at once make a diagonal.
    """
    points = np.tile(np.asarray(at_mm, dtype=np.float64), (len(shares), 1))
    for axis in axes:
        low, high = situation.span_mm[AXES.index(axis)]
        points[:, AXES.index(axis)] = low + (high - low) * shares
    return points
