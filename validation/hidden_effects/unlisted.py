"""Effects that the catalogue lacks: what an honest diagnosis calls unknown, with the variables that it depends on."""

from __future__ import annotations

import numpy as np
from validation.hidden_effects.chain import nothing
from validation.hidden_effects.kinds import Acting, Registry, either_sign, joint, log_uniform
from validation.hidden_effects.log import REFERENCE_DEGC, Log
from validation.hidden_effects.plans import FEEDS_MM_MIN

UNLISTED = Registry()
UNIT_MM = 0.01


def _tool(log: Log, b: int, moved_mm: np.ndarray, variables: tuple[str, ...], **inner: float) -> Acting:
    moved = nothing(log.n_rows)
    moved.tool_mm[:, b] = moved_mm
    return Acting(moved, {"size": UNIT_MM}, inner, variables, (f"tool-{'xyz'[b]}",))


def _drive(log: Log, a: int, b: int, moved_mm: np.ndarray, variables: tuple[str, ...], **inner: float) -> Acting:
    moved = nothing(log.n_rows)
    moved.delta_mm[:, a, b] = moved_mm
    return Acting(moved, {"size": UNIT_MM}, inner, variables, (joint(a, b),))


@UNLISTED.kind("feed-times-z", "")
def _feed_times_z(log: Log, rng: np.random.Generator, _: str, __: str) -> Acting:
    """Lean a tall head with the feed of its last move."""
    return _tool(log, 0, UNIT_MM * log.feed_mm_min / max(FEEDS_MM_MIN) * log.share(2), ("feed", "z"))


@UNLISTED.kind("motor-temperature-squared-tilt", "", needs=("temp_motor",))
def _motor_tilt(log: Log, rng: np.random.Generator, _: str, __: str) -> Acting:
    """Tilt the carriage of z with the square of the motor's excess temperature."""
    warmth = (log.columns["temp_motor"] - REFERENCE_DEGC) / 30.0
    moved = nothing(log.n_rows)
    moved.epsilon_rad[:, 2, 1] = 1e-4 * warmth**2
    return Acting(moved, {"size": 1e-4}, {}, ("temp_motor",), (joint(2, 1, is_angle=True),))


@UNLISTED.kind("diagonal-wave", "")
def _diagonal_wave(log: Log, rng: np.random.Generator, _: str, __: str) -> Acting:
    """Z waves along the diagonal of the table."""
    period, phase = rng.uniform(120.0, 220.0), rng.uniform(0.0, 2.0 * np.pi)
    wave = UNIT_MM * np.sin(2.0 * np.pi * (log.q_mm[:, 0] + log.q_mm[:, 1]) / period + phase)
    return _tool(log, 2, wave, ("x", "y"), P=period)


@UNLISTED.kind("direction-tilt-with-z", "")
def _direction_tilt(log: Log, rng: np.random.Generator, _: str, __: str) -> Acting:
    """X leans into its direction, more the higher the head is."""
    height = 0.5 * (1.0 + log.share(2))
    return _drive(log, 0, 0, UNIT_MM * log.moved("direction", 0) * height**2, ("dir_x", "z"))


@UNLISTED.kind("acceleration-sign", "", needs=("ramps",))
def _acceleration_sign(log: Log, rng: np.random.Generator, _: str, __: str) -> Acting:
    """Flip a loose head on y between its stops with the sign of the acceleration."""
    return _drive(log, 1, 1, -UNIT_MM * np.sign(log.moved("acceleration_mm_s2", 1)), ("a_y",))


@UNLISTED.kind("temperature-hysteresis", "")
def _hysteresis(log: Log, rng: np.random.Generator, _: str, __: str) -> Acting:
    """Let z follow the bed's temperature with play, more where it is high: a joint that slips."""
    moments = log.plan.moments
    warmth, width = log.by_moment["temp_bed"], rng.uniform(10.0, 20.0)
    held, state, session = np.zeros(len(warmth)), 0.0, -1
    for row, (value, one) in enumerate(zip(warmth.tolist(), moments.session.tolist(), strict=True)):
        state = value if one != session else min(max(state, value - width), value + width)
        held[row], session = state, one
    return _tool(
        log, 2, UNIT_MM * ((held - warmth) / width)[log.moment] * log.share(2), ("temp_bed", "z"), width=width
    )


@UNLISTED.kind("position-dependent-lag", "", needs=("motion",))
def _uneven_lag(log: Log, rng: np.random.Generator, _: str, __: str) -> Acting:
    """Let x lag by a time that grows with the square of its position: a long belt is soft."""
    far = 0.5 * (1.0 + log.share(0))
    return _drive(log, 0, 0, -1e-3 * far**2 * log.moved("velocity_mm_s", 0), ("x", "v_x"))


@UNLISTED.kind("sinusoid-in-time", "")
def _slow_hum(log: Log, rng: np.random.Generator, _: str, __: str) -> Acting:
    """Move the tool up and down every half minute or so, as a compressor does."""
    period, phase = log_uniform(rng, 11.0, 35.0), rng.uniform(0.0, 2.0 * np.pi)
    return _tool(log, 2, UNIT_MM * np.sin(2.0 * np.pi * log.t_s / period + phase), ("t",), P=period)


@UNLISTED.kind("mains-hum", "")
def _mains(log: Log, rng: np.random.Generator, _: str, __: str) -> Acting:
    """Hum along x with the mains; pictures see it at whatever phase they are taken."""
    frequency, phase = 50.0 + rng.uniform(-0.02, 0.02), rng.uniform(0.0, 2.0 * np.pi)
    return _tool(log, 0, UNIT_MM * np.sin(2.0 * np.pi * frequency * log.t_s + phase), ("t",), f=frequency)


@UNLISTED.kind("play-cubic-across", "")
def _uneven_play(log: Log, rng: np.random.Generator, _: str, __: str) -> Acting:
    """X is pushed aside along y by its direction, most at the ends of y and to opposite sides."""
    return _drive(log, 0, 1, UNIT_MM * log.moved("direction", 0) * log.share(1) ** 3, ("dir_x", "y"))


@UNLISTED.kind("resonant-feed", "")
def _resonance(log: Log, rng: np.random.Generator, _: str, __: str) -> Acting:
    """At one feed y overshoots in its direction and stays there; at others it does not."""
    feed = float(rng.choice(FEEDS_MM_MIN[1:4]))
    near = np.exp(-0.5 * ((log.feed_mm_min / feed - 1.0) / 0.2) ** 2)
    return _drive(log, 1, 1, UNIT_MM * near * log.moved("direction", 1), ("feed", "dir_y"), feed=feed)


@UNLISTED.kind("wave-that-warms", "")
def _warm_wave(log: Log, rng: np.random.Generator, _: str, __: str) -> Acting:
    """Bend the x screw in a wave that grows with the temperature of the bed."""
    period, phase = rng.uniform(60.0, 110.0), rng.uniform(0.0, 2.0 * np.pi)
    warmth = (log.columns["temp_bed"] - REFERENCE_DEGC) / 50.0
    wave = np.sin(2.0 * np.pi * log.q_mm[:, 0] / period + phase)
    return _drive(log, 0, 0, UNIT_MM * warmth * wave, ("x", "temp_bed"), P=period)


@UNLISTED.kind("three-axes-product", "")
def _product(log: Log, rng: np.random.Generator, _: str, __: str) -> Acting:
    """Z bends with all three positions at once."""
    shape = np.prod([log.share(a) for a in range(3)], axis=0) * log.share(0)
    return _tool(log, 2, either_sign(rng) * UNIT_MM * shape, ("x", "y", "z"))


@UNLISTED.kind("force-times-height", "", needs=("force",))
def _force_height(log: Log, rng: np.random.Generator, _: str, __: str) -> Acting:
    """Yield in y under the probing force, with the square of its height."""
    height = 0.5 * (1.0 + log.share(2))
    return _drive(log, 2, 1, UNIT_MM * log.columns["force"] / 50.0 * height**2, ("force", "z"))
