"""A machine that hides effects: its own arithmetic, first and second order of small turns."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from geoerr.machine import Axis, Machine
from geoerr.observations import Observations, observations_from_columns

Numbers = npt.NDArray[np.float64]
LENGTH_MM = 400.0
HIDDEN = Callable[["Motion"], Numbers]


@dataclass
class Motion:
    """What the machine did, row by row; a hidden effect turns it into a displacement (n, 3) in µm."""

    q: Numbers
    d: Numbers
    s: Numbers
    t: Numbers
    feed: Numbers
    bed: Numbers
    frame: Numbers
    session: npt.NDArray[np.int64]
    line: npt.NDArray[np.int64]
    load: Numbers

    @property
    def seen_from_the_tool(self) -> dict[str, object]:
        """Columns of a camera on the tool: of each row its line, and the direction of each axis."""
        columns: dict[str, object] = {"carrier": ["tool"] * len(self.q), "line": [f"L{one}" for one in self.line]}
        return columns | {f"dir_{name}": self.d[:, index] for index, name in enumerate("xyz")}


@dataclass
class Noise:
    """Standard deviations in µm."""

    white: tuple[float, float, float] = (10.0, 10.0, 15.0)
    offset: float = 0.0
    drift: float = 0.0
    drift_memory_s: float = 3000.0
    outliers: float = 0.0
    tails: float | None = None


@dataclass
class Plan:
    n_sessions: int = 4
    n_lines: int = 20
    n_points: int = 24
    seconds: float = 3.0
    columns: dict[str, object] = field(default_factory=dict)


def machine() -> Machine:
    return Machine("test", "wbXYZt", {axis: Axis((0.0, LENGTH_MM)) for axis in "xyz"}, tool_offset_mm=(0.0, 0.0, 0.0))


def motion(rng: np.random.Generator, plan: Plan) -> Motion:
    """Lines along axes and diagonals, there and back, at four feeds, while the bed warms and cools."""
    q, d, feed, session, line, s = [], [], [], [], [], []
    number = 0
    for one in range(plan.n_sessions):
        for index in range(plan.n_lines):
            kind = index // 2 % 5
            low, high = rng.uniform(5.0, 60.0, 3), rng.uniform(340.0, 395.0, 3)
            parked = rng.uniform(20.0, 380.0, 3)
            at = np.sort(rng.uniform(0.0, 1.0, plan.n_points))
            moves = np.eye(3)[kind] if kind < 3 else (np.ones(3) if kind == 3 else np.array([1.0, -1.0, 1.0]))
            if index % 2:
                moves, at = -moves, at
            u = np.where(moves[None, :] > 0.0, at[:, None], 1.0 - at[:, None])
            rows = np.where(moves[None, :] == 0.0, parked, low + (high - low) * u)
            sense = np.where(moves == 0.0, rng.choice([-1.0, 1.0], 3), np.sign(moves))
            q.append(rows)
            d.append(np.tile(sense, (plan.n_points, 1)))
            s.append(np.abs(rows - rows[0]) + 20.0)
            feed.append(np.full(plan.n_points, rng.choice([600.0, 1500.0, 3000.0, 6000.0])))
            session.append(np.full(plan.n_points, one))
            line.append(np.full(plan.n_points, number))
            number += 1
    n = plan.n_sessions * plan.n_lines * plan.n_points
    t = np.arange(n) * plan.seconds + np.repeat(np.arange(plan.n_sessions) * 600.0, plan.n_lines * plan.n_points)
    span = float(t[-1])
    bed = 25.0 + 30.0 * (1.0 - np.exp(-t / (0.25 * span))) * (1.0 + 0.3 * np.sin(2.0 * np.pi * 2.3 * t / span))
    frame = 22.0 + 6.0 * (t / span) + 1.5 * np.sin(2.0 * np.pi * 3.1 * t / span + 1.0)
    load = np.repeat(rng.choice([0.0, 1.0, 2.0], plan.n_sessions * plan.n_lines), plan.n_points)
    return Motion(
        np.concatenate(q),
        np.concatenate(d),
        np.concatenate(s),
        t,
        np.concatenate(feed),
        bed,
        frame,
        np.concatenate(session),
        np.concatenate(line),
        load,
    )


def _cross(turn: Numbers, lever: Numbers) -> Numbers:
    first = np.cross(turn, lever)
    return lever + first + 0.5 * np.cross(turn, first)


def _curves(rng: np.random.Generator, size: float) -> Callable[[Numbers], Numbers]:
    waves = rng.normal(size=(3, 2, 3)) / np.array([1.0, 2.0, 3.0])
    phase = np.pi * np.arange(1, 4) / LENGTH_MM

    def curve(q: Numbers) -> Numbers:
        angle = q[:, None] * phase
        return size * np.stack([np.sin(angle) @ one[0] + np.cos(angle) @ one[1] for one in waves], axis=1)

    return curve


def measure(
    rng: np.random.Generator, moved: Motion, noise: Noise, hidden: Numbers | None = None, plan: Plan | None = None
) -> Observations:
    """Measure the tool with one camera for each session; `hidden` (n, 3) in µm is what no classic error is."""
    point = np.zeros_like(moved.q)
    for index in (2, 1, 0):
        q = moved.q[:, index]
        away = _curves(rng, 0.012)(q)
        turn = _curves(rng, 30e-6)(q)
        point = _cross(turn, point)
        point += q[:, None] * np.eye(3)[index] + away
    if hidden is not None:
        point = point + 1e-3 * hidden
    n = len(point)
    measured = np.empty_like(point)
    for one in np.unique(moved.session):
        rows = moved.session == one
        axis = rng.normal(size=3)
        axis /= np.linalg.norm(axis)
        angle = rng.uniform(-0.6, 0.6)
        skew = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
        turn = np.eye(3) + np.sin(angle) * skew + (1.0 - np.cos(angle)) * skew @ skew
        measured[rows] = point[rows] @ turn.T + rng.uniform(-300.0, 300.0, 3)
    white = rng.normal(size=(n, 3)) if noise.tails is None else rng.standard_t(noise.tails, size=(n, 3))
    error = white * np.array(noise.white)
    if noise.offset:
        error += noise.offset * rng.normal(size=(int(moved.line.max()) + 1, 3))[moved.line]
    if noise.drift:
        for one in np.unique(moved.session):
            rows = np.flatnonzero(moved.session == one)
            keep = np.exp(-np.diff(moved.t[rows]) / noise.drift_memory_s)
            walk = np.empty((len(rows), 3))
            walk[0] = rng.normal(size=3)
            steps = rng.normal(size=(len(rows), 3))
            for row in range(1, len(rows)):
                walk[row] = keep[row - 1] * walk[row - 1] + np.sqrt(1.0 - keep[row - 1] ** 2) * steps[row]
            error[rows] += noise.drift * walk
    if noise.outliers:
        error += 200.0 * rng.normal(size=(n, 3)) * (rng.uniform(size=(n, 1)) < noise.outliers)
    measured = measured + 1e-3 * error
    columns: dict[str, object] = {
        "session": [str(one) for one in moved.session],
        **moved.seen_from_the_tool,
        "t": moved.t,
        "feed": moved.feed,
        "moving": np.ones(n),
        "temp_bed": moved.bed,
        "temp_frame": moved.frame,
    }
    for index, name in enumerate("xyz"):
        columns[name] = moved.q[:, index]
        columns[f"t{name}"] = np.zeros(n)
        columns[f"m{name}"] = measured[:, index]
        columns[f"s{name}"] = np.full(n, 1e-3 * noise.white[index])
    columns |= (plan or Plan()).columns
    return observations_from_columns(columns)
