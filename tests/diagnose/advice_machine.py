"""A machine that is measured once, and then again as a plan says: smooth errors of its own, one hidden effect."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from geoerr.diagnose.advice.measurement import Measurement
from geoerr.machine import Axis, Machine
from geoerr.observations import CARRIERS, Observations, observations_from_columns

Numbers = npt.NDArray[np.float64]
LENGTH_MM = 400.0
SIGMA_UM = np.array([5.0, 5.0, 7.0])


@dataclass
class Log:
    """Rows as they were taken: one target each, sessions one after the other."""

    q: Numbers
    d: Numbers
    t: Numbers
    feed: Numbers
    moving: npt.NDArray[np.bool_]
    session: npt.NDArray[np.int64]
    line: list[str]
    repeat: npt.NDArray[np.int64]
    carrier: list[str]
    offset: Numbers
    columns: dict[str, Numbers] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.q)

    @property
    def speed(self) -> Numbers:
        """Signed speed of each axis along the last move, mm/s."""
        last = np.zeros(3)
        result = np.zeros_like(self.q)
        for row in range(len(self)):
            if row == 0 or self.session[row] != self.session[row - 1]:
                last = np.zeros(3)
            elif (step := self.q[row] - self.q[row - 1]).any():
                last = step / np.linalg.norm(step)
            result[row] = last
        return result * (self.feed / 60.0 * self.moving)[:, None]

    @property
    def travel(self) -> Numbers:
        """Travel of x since its last reversal, mm, as the rows show it."""
        result = np.zeros(len(self))
        for row in range(1, len(self)):
            if self.session[row] != self.session[row - 1]:
                continue
            way = abs(self.q[row, 0] - self.q[row - 1, 0])
            same = self.d[row, 0] == self.d[row - 1, 0]
            result[row] = way + (result[row - 1] if same else 0.0)
        return result


Hidden = Callable[[Log], Numbers]


def machine() -> Machine:
    return Machine("test", "wbXYZt", {axis: Axis((0.0, LENGTH_MM)) for axis in "xyz"})


def lines_at_one_feed(
    rng: np.random.Generator, n_lines: int = 10, n_points: int = 18, feed: float = 1500.0, is_moving: bool = True
) -> Log:
    """Lines along x in a session, along y and z in another, there and back: every picture at one feed.

    Points lie 15 mm apart and more, and the axis turns where a picture is taken.
    """
    q, d, line, session = [], [], [], []
    base = rng.uniform(150.0, 250.0, 3)
    for axis in range(3):
        for number in range(n_lines if axis == 0 else n_lines // 2):
            if number % 2 == 0:
                # X stands still in the other session.
                base[1:] = rng.uniform(20.0, 380.0, 2)
            at = 5.0 + 390.0 * (np.arange(n_points) + rng.uniform(0.15, 0.85, n_points) * 0.3) / n_points
            points = np.tile(base, (2 * n_points - 1, 1))
            points[:, axis] = np.concatenate([at, at[-2::-1]])
            q.append(points)
            sense = np.ones((2 * n_points - 1, 3))
            sense[n_points:, axis] = -1.0
            d.append(sense)
            line += [f"{'XYZ'[axis]}{number}"] * (2 * n_points - 1)
            session += [min(axis, 1)] * (2 * n_points - 1)
    n = len(line)
    where = np.array(session)
    t = 3.0 * np.arange(n)
    t -= np.array([t[where == one].min() for one in range(2)])[where]
    return Log(
        np.concatenate(q),
        np.concatenate(d),
        t,
        np.full(n, feed),
        np.full(n, is_moving),
        where,
        line,
        np.zeros(n, dtype=np.int64),
        ["tool"] * n,
        np.zeros((n, 3)),
    )


def planned_log(plan: Measurement, times: int, first_session: int) -> Log:
    """Carry out a plan: rows in the order in which its pictures show its targets."""
    pictures, n_targets = plan.pictures, len(plan.targets)
    moment = np.repeat(np.arange(len(pictures)), n_targets)
    carriers = [CARRIERS[one.carrier] for one in plan.targets] * len(pictures)
    offsets = np.tile([one.offset_mm for one in plan.targets], (len(pictures), 1))
    parts = [
        Log(
            pictures.q_mm[moment],
            pictures.direction[moment].astype(np.float64),
            pictures.t_s[moment],
            pictures.feed_mm_min[moment],
            pictures.is_moving[moment],
            pictures.session[moment] + first_session + number * plan.n_sessions,
            [pictures.line[one] for one in moment],
            pictures.repeat[moment],
            carriers,
            offsets,
            {name: values[moment] for name, values in plan.conditions.items()},
        )
        for number in range(times)
    ]
    return joined(*parts)


def again(log: Log) -> Log:
    """Measure the same once more, in new sessions."""
    return replace(log, session=log.session + int(log.session.max()) + 1)


def joined(*logs: Log) -> Log:
    names = {name for log in logs for name in log.columns}
    return Log(
        *(
            np.concatenate([getattr(log, name) for log in logs])
            for name in ("q", "d", "t", "feed", "moving", "session")
        ),
        [name for log in logs for name in log.line],
        np.concatenate([log.repeat for log in logs]),
        [name for log in logs for name in log.carrier],
        np.concatenate([log.offset for log in logs]),
        {name: np.concatenate([log.columns[name] for log in logs]) for name in names},
    )


def measure(
    log: Log, hidden: Hidden, seed: int, *, offset_um: float = 1.0, drift: Hidden | None = None
) -> Observations:
    """Measure with one camera for each session.

    `hidden` moves the tool (n, 3) in µm, `drift` everything that the cameras see. Noise is drawn by row, so that the
    first rows of a longer log are what they were.
    """
    rng = np.random.default_rng(seed)
    waves = rng.normal(size=(3, 3, 2)) * 8.0
    phase = np.pi * log.q / LENGTH_MM
    errors = np.einsum("na,acw->nc", np.sin(phase), waves[:, :, :1]) + np.einsum(
        "na,acw->nc", np.cos(2.0 * phase), waves[:, :, 1:]
    )
    is_static = np.array([name == "base" for name in log.carrier])
    moved = np.where(is_static[:, None], 0.0, log.q + 1e-3 * (errors + hidden(log)))
    point = moved + log.offset
    if drift is not None:
        point = point + 1e-3 * drift(log)
    measured = np.empty_like(point)
    for one in np.unique(log.session):
        own = np.random.default_rng([seed, 1, int(one)])
        rows = log.session == one
        axis = own.normal(size=3)
        axis /= np.linalg.norm(axis)
        skew = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
        angle = own.uniform(-0.2, 0.2)
        turn = np.eye(3) + np.sin(angle) * skew + (1.0 - np.cos(angle)) * skew @ skew
        measured[rows] = point[rows] @ turn.T + own.uniform(-300.0, 300.0, 3) + np.array([0.0, 0.0, 900.0])
    _, number = np.unique(
        [f"{a} {b} {c} {d}" for a, b, c, d in zip(log.session, log.line, log.repeat, log.d.tolist(), strict=True)],
        return_inverse=True,
    )
    noise = np.random.default_rng([seed, 2]).normal(size=(len(log), 3)) * SIGMA_UM
    noise += offset_um * np.random.default_rng([seed, 3]).normal(size=(int(number.max()) + 1, 3))[number]
    measured += 1e-3 * noise
    columns: dict[str, object] = {
        "session": [str(one) for one in log.session],
        "line": log.line,
        "repeat": log.repeat,
        "carrier": log.carrier,
        "target": [f"{carrier}{place}" for carrier, place in zip(log.carrier, log.offset.tolist(), strict=True)],
        "t": log.t,
        "feed": log.feed,
        "moving": log.moving.astype(np.int64),
    }
    columns |= log.columns
    for index, name in enumerate("xyz"):
        columns[name] = log.q[:, index]
        columns[f"t{name}"] = np.where(is_static, 0.0, log.offset[:, index])
        columns[f"m{name}"] = measured[:, index]
        columns[f"s{name}"] = np.full(len(log), 1e-3 * SIGMA_UM[index])
        columns[f"dir_{name}"] = log.d[:, index].astype(np.int64)
    return observations_from_columns(columns)
