"""Circular tests of machines with known causes: a generator that shares no code with what diagnoses them.

Written from geometry: where the tool is (in workpiece axes) when the bar is read, the distance to a ball that is not
quite at the centre, noise. Servos are exact first-order ones (amplitude and phase), spikes and play are rounder than
any formula of the catalogue where a case asks for it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import polars as pl

from geoerr.observations import CircularTest

CENTRE_MM = np.array([210.0, 260.0, 120.0])
UM = 1e-3
RUN_IN_S = 2.0


@dataclass(frozen=True)
class Run:
    """One run: plane (first axis, second axis), sense, feed, repetition, name of its line (its set-up)."""

    plane: tuple[int, int] = (0, 1)
    sense: int = 1
    feed_mm_min: float = 1500.0
    repeat: int = 0
    line: str = "XY"
    start_rad: float = 0.35


@dataclass(frozen=True)
class Plan:
    """Runs of one radius, rows of each, and whether times are stated."""

    name: str
    runs: tuple[Run, ...]
    n_rows: int = 360
    radius_mm: float = 100.0
    with_times: bool = True


@dataclass
class Motion:
    """What one run does: angle, positions, speeds; everything in mm and s."""

    run: Run
    radius: float
    theta: np.ndarray
    t: np.ndarray
    q: np.ndarray
    v: np.ndarray

    def d(self, axis: int) -> np.ndarray:
        """Direction of an axis; at its reversal that of the way back."""
        arm = self.q[:, axis] - CENTRE_MM[axis]
        return np.where(np.abs(self.v[:, axis]) > 1e-9, np.sign(self.v[:, axis]), -np.sign(arm))

    def since(self, axis: int) -> np.ndarray:
        """Angle travelled since the axis reversed."""
        arm = (self.q[:, axis] - CENTRE_MM[axis]) / self.radius
        return np.arccos(np.clip(-self.d(axis) * arm, -1.0, 1.0))

    @property
    def speed(self) -> float:
        """Speed along the circle, mm/s."""
        return self.run.feed_mm_min / 60.0


# A cause: displacement (n, 3) in mm, or radius (n,) in mm.
Cause = Callable[[Motion, np.random.Generator], np.ndarray]


def plans() -> dict[str, Plan]:
    """Give the plans of the study."""
    both = tuple(Run(sense=s, feed_mm_min=f) for f in (3000.0, 750.0) for s in (1, -1))
    return {
        "both senses, two feeds": Plan("both senses, two feeds", both),
        "both senses, one feed": Plan("both senses, one feed", tuple(Run(sense=s) for s in (1, -1))),
        "both senses, three times": Plan(
            "both senses, three times", tuple(Run(sense=s, repeat=k) for k in range(3) for s in (1, -1))
        ),
        "one sense": Plan("one sense", (Run(),)),
        "three planes": Plan(
            "three planes",
            tuple(
                Run(plane=p, sense=s, line="XYZ"[p[0]] + "XYZ"[p[1]])
                for p in ((0, 1), (1, 2), (2, 0))
                for s in (1, -1)
            ),
            n_rows=240,
        ),
    }


def backlash(axis: int, b_um: float) -> Cause:
    return _along(axis, lambda m, _: -0.5 * b_um * UM * m.d(axis))


def unequal_backlash(axis: int, low_um: float, high_um: float) -> Cause:
    def displacement(m: Motion, _: np.random.Generator) -> np.ndarray:
        u = (m.q[:, axis] - CENTRE_MM[axis]) / m.radius
        return -0.5 * UM * m.d(axis) * (0.5 * (low_um + high_um) + 0.5 * (high_um - low_um) * u)

    return _along(axis, displacement)


def lateral_play(axis: int, across: int, l_um: float) -> Cause:
    return _along(across, lambda m, _: 0.5 * l_um * UM * m.d(axis) if axis in m.run.plane else np.zeros(len(m.t)))


def spike(axis: int, height_um: float, decay_s: float) -> Cause:
    def displacement(m: Motion, _: np.random.Generator) -> np.ndarray:
        since_s = m.since(axis) * m.radius / m.speed
        return -height_um * UM * m.d(axis) * np.exp(-since_s / decay_s)

    return _along(axis, displacement)


def rounded_spike(axis: int, height_um: float, decay_s: float) -> Cause:
    """Rises within a fifth of its decay: no catalogue has it so."""

    def displacement(m: Motion, _: np.random.Generator) -> np.ndarray:
        since_s = m.since(axis) * m.radius / m.speed
        shape = (1.0 - np.exp(-5.0 * since_s / decay_s)) * np.exp(-since_s / decay_s)
        return -height_um * UM * m.d(axis) * shape / 0.7

    return _along(axis, displacement)


def squareness(a: int, b: int, s_urad: float) -> Cause:
    """Included angle minus 90 degrees: the second axis leans against the first."""
    return _along(a, lambda m, _: -s_urad * 1e-6 * (m.q[:, b] - CENTRE_MM[b]))


def scale(axis: int, k_um_m: float) -> Cause:
    return _along(axis, lambda m, _: k_um_m * 1e-6 * (m.q[:, axis] - CENTRE_MM[axis]))


def servo(tau_s: Sequence[float]) -> Cause:
    """First-order servos, one time constant an axis: amplitude 1/√(1 + ω²τ²), phase −atan ωτ."""

    def displacement(m: Motion, _: np.random.Generator) -> np.ndarray:
        result = np.zeros_like(m.q)
        omega = m.run.sense * m.speed / m.radius
        for place, axis in enumerate(m.run.plane):
            turn = omega * tau_s[axis]
            phase = m.theta - np.arctan(turn)
            actual = m.radius / np.hypot(1.0, turn) * (np.cos(phase) if place == 0 else np.sin(phase))
            result[:, axis] = actual - (m.q[:, axis] - CENTRE_MM[axis])
        return result

    return displacement


def bow(axis: int, across: int, h_um: float) -> Cause:
    def displacement(m: Motion, _: np.random.Generator) -> np.ndarray:
        u = (m.q[:, axis] - CENTRE_MM[axis]) / m.radius
        return h_um * UM * (1.0 - u**2)

    return _along(across, displacement)


def s_shape(axis: int, across: int, s_um: float) -> Cause:
    """About its least-squares line, as straightness is told (ISO 230-1): from end to end it holds a squareness."""

    def displacement(m: Motion, _: np.random.Generator) -> np.ndarray:
        u = (m.q[:, axis] - CENTRE_MM[axis]) / m.radius
        return s_um * UM * (u**3 - 0.6 * u)

    return _along(across, displacement)


def periodic(axis: int, a_um: float, pitch_mm: float) -> Cause:
    return _along(axis, lambda m, _: a_um * UM * np.sin(2.0 * np.pi * m.q[:, axis] / pitch_mm + 0.7))


def vibration(axis: int, a_um: float, f_hz: float) -> Cause:
    return _along(axis, lambda m, rng: a_um * UM * np.sin(2.0 * np.pi * f_hz * m.t + rng.uniform(0.0, 2.0 * np.pi)))


def stick_slip(axis: int, b_um: float, v_mm_s: float) -> Cause:
    return _along(axis, lambda m, _: -0.5 * b_um * UM * m.d(axis) * np.exp(-np.abs(m.v[:, axis]) / v_mm_s))


def change_over(step_um: float) -> Cause:
    def radius(m: Motion, _: np.random.Generator) -> np.ndarray:
        a, b = m.run.plane
        return 0.5 * step_um * UM * np.sign(np.abs(m.v[:, b]) - np.abs(m.v[:, a]))

    return radius


def spiral(um_min: float) -> Cause:
    return lambda m, _: um_min * UM * m.t / 60.0


def lobes(order: int, a_um: float) -> Cause:
    """Give the radius as many lobes: no catalogue has it."""
    return lambda m, _: a_um * UM * np.cos(order * m.theta + 0.4)


def sense_lobes(order: int, a_um: float) -> Cause:
    """Do the same, turned over in the other sense."""
    return lambda m, _: m.run.sense * a_um * UM * np.cos(order * m.theta + 0.4)


def ridge(angle_rad: float, width_rad: float, a_um: float) -> Cause:
    """Put a ridge at one angle."""

    def radius(m: Motion, _: np.random.Generator) -> np.ndarray:
        off = np.angle(np.exp(1j * (m.theta - angle_rad)))
        return a_um * UM * np.exp(-0.5 * (off / width_rad) ** 2)

    return radius


def _along(axis: int, of: Callable[[Motion, np.random.Generator], np.ndarray]) -> Cause:
    def displacement(m: Motion, rng: np.random.Generator) -> np.ndarray:
        return np.asarray(of(m, rng))[:, None] * np.eye(3)[axis]

    return displacement


@dataclass(frozen=True)
class Noise:
    """Noise of the radius in µm.

    `white` scatter; `short` wanders within 5 degrees, `smooth` within 7 without corners, `drift` over a turn;
    `offset` of each run; `tails` degrees of freedom of Student's t; `outliers` share of rows; `by_feed` how much the
    scatter grows with the feed (power).
    """

    name: str = "white"
    white: float = 0.3
    short: float = 0.0
    smooth: float = 0.0
    drift: float = 0.0
    offset: float = 0.0
    tails: float | None = None
    outliers: float = 0.0
    by_feed: float = 0.0
    digits_um: float = 0.0


NOISES = {
    noise.name: noise
    for noise in (
        Noise(),
        Noise("heavy tails", tails=3.0),
        Noise("outliers", outliers=0.005),
        Noise("wanders within 5°", short=0.4),
        Noise("smooth within 7°", smooth=0.4),
        Noise("drifts over a turn", drift=0.6),
        Noise("offset of each run", offset=1.0),
        Noise("louder at speed", by_feed=1.0),
        Noise("digits of 0.1 µm", white=0.03, digits_um=0.1),
        Noise("all of it", short=0.3, drift=0.4, offset=0.5, tails=4.0, outliers=0.002, by_feed=0.5),
    )
}


def noise_um(run: Run, n: int, turned: np.ndarray, noise: Noise, rng: np.random.Generator) -> np.ndarray:
    """Draw the noise of one run."""
    scatter = rng.standard_normal(n)
    if noise.tails is not None:
        scatter = rng.standard_t(noise.tails, n) / np.sqrt(noise.tails / (noise.tails - 2.0))
    result = noise.white * (run.feed_mm_min / 1500.0) ** noise.by_feed * scatter
    step = float(np.median(np.diff(turned)))
    for size, memory in ((noise.short, np.radians(5.0)), (noise.drift, 2.0 * np.pi)):
        if size:
            keep = np.exp(-step / memory)
            walk = np.empty(n)
            walk[0] = rng.standard_normal()
            for k in range(1, n):
                walk[k] = keep * walk[k - 1] + np.sqrt(1.0 - keep**2) * rng.standard_normal()
            result += size * walk
    if noise.smooth:
        width = np.radians(7.0) / step
        kernel = np.exp(-0.5 * (np.arange(-4 * int(width), 4 * int(width) + 1) / width) ** 2)
        kernel /= np.sqrt((kernel**2).sum())
        result += noise.smooth * np.convolve(rng.standard_normal(n + len(kernel) - 1), kernel, mode="valid")
    result += noise.offset * rng.standard_normal()
    wrong = rng.random(n) < noise.outliers
    result[wrong] += rng.choice([-1.0, 1.0], int(wrong.sum())) * rng.uniform(5.0, 40.0, int(wrong.sum()))
    return result


def circular_test(
    plan: Plan, causes: Sequence[Cause], noise: Noise, rng: np.random.Generator, **columns: object
) -> CircularTest:
    """Run a plan on a machine with these causes."""
    frames, clock = [], 0.0
    ball = {run.line: rng.normal(0.0, 0.02, 3) for run in plan.runs}
    excess = {run.line: rng.normal(0.0, 0.03) for run in plan.runs}
    for run in plan.runs:
        n, radius = plan.n_rows, plan.radius_mm
        turned = np.arange(n) * (2.0 * np.pi / n)
        theta = run.start_rad + run.sense * turned
        speed = run.feed_mm_min / 60.0
        t = clock + RUN_IN_S + turned * radius / speed
        clock = float(t[-1]) + RUN_IN_S
        a, b = run.plane
        q, v = np.tile(CENTRE_MM, (n, 1)), np.zeros((n, 3))
        q[:, a] += radius * np.cos(theta)
        q[:, b] += radius * np.sin(theta)
        v[:, a], v[:, b] = -run.sense * speed * np.sin(theta), run.sense * speed * np.cos(theta)
        motion = Motion(run, radius, theta, t, q, v)
        at, more = q.copy(), np.zeros(n)
        for cause in causes:
            value = cause(motion, rng)
            if value.ndim == 2:
                at += value
            else:
                more += value
        off = ball[run.line] * np.isin(np.arange(3), run.plane)
        r = np.linalg.norm(at - CENTRE_MM - off, axis=1) + excess[run.line] + more
        r += UM * noise_um(run, n, turned, noise, rng)
        if noise.digits_um:
            r = np.round(r / (noise.digits_um * UM)) * noise.digits_um * UM
        frame = {
            "line": [run.line] * n,
            "repeat": [run.repeat] * n,
            "dir": [run.sense] * n,
            "feed": [run.feed_mm_min] * n,
            **dict(zip("xyz", np.round(q, 6).T, strict=True)),
            "r": r,
        }
        if plan.with_times:
            frame["t"] = t
        frames.append(pl.DataFrame(frame))
    return CircularTest(pl.concat(frames), ("simulated",))
