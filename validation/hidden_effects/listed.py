"""Effects that the catalogue has, written from their physics. Signs: tool seen from the work.

Strengths here are those of a unit effect of some micrometres; `generate` scales them. Times are drawn as shares of
the session, lengths and periods in the ranges that machines have. Not made, because nothing in these plans can show
them: `homing-offset` and `tool-offset` (poses and constants absorb them), `rig-scale` (the axes' scales and the
targets' places do), the classic errors (they are the base), `outlier-pass` and `heat-haze` (noise, not displacement),
and what belongs to circular tests. What changes between sessions is in `changed`.
"""

from __future__ import annotations

import numpy as np
from validation.hidden_effects.chain import RELATIVE, Array, Displacements, levers, nothing, sides
from validation.hidden_effects.kinds import (
    AXES,
    PAIRS,
    Acting,
    Registry,
    across,
    direction_of,
    either_sign,
    index,
    joint,
    log_uniform,
)
from validation.hidden_effects.log import CENTRE_PX, FOCAL_PX, REFERENCE_DEGC, Log, followed

LISTED = Registry()
BODY_PLACES = ("x", "y", "z", "work-x", "work-y", "work-z")
SENSORS = ("temp_bed", "temp_bed_low", "temp_frame")
UNIT_MM = 0.01
UNIT_RAD = 3e-5


def _along(log: Log, axis: int, gained_mm: Array) -> Displacements:
    moved = nothing(log.n_rows)
    moved.delta_mm[:, axis, axis] = gained_mm
    return moved


def _session_length(log: Log) -> float:
    return float(log.t_s.max())


def _warmth(log: Log, covariate: str) -> Array:
    if "-" in covariate:
        first, second = covariate.split("-")
        return log.columns[first] - log.columns[second]
    return log.columns[covariate] - REFERENCE_DEGC


def _by_row(log: Log, by_moment: Array, tau_s: float, *, is_held: bool = False) -> Array:
    moments = log.plan.moments
    return followed(by_moment, moments.t_s, moments.starts(), tau_s, is_held=is_held)[log.moment]


def _lagged_warmth(log: Log, covariate: str, tau_s: float) -> Array:
    return _by_row(log, log.by_moment[covariate] - REFERENCE_DEGC, tau_s)


def _lag_time(log: Log, rng: np.random.Generator) -> float:
    return _session_length(log) * log_uniform(rng, 0.01, 0.08)


# --- reversal -----------------------------------------------------------------------------------------------------


@LISTED.kind("backlash", "backlash", axes=AXES)
def _backlash(log: Log, rng: np.random.Generator, axis: str, _: str) -> Acting:
    a, b = index(axis), UNIT_MM
    return Acting(_along(log, a, -0.5 * b * log.moved("direction", a)), {"b": b}, {}, (f"d_{axis}",), (joint(a, a),))


@LISTED.kind("backlash-position", "backlash-position", axes=AXES)
def _backlash_position(log: Log, rng: np.random.Generator, axis: str, _: str) -> Acting:
    a = index(axis)
    low, high = log.range_mm(a)
    slope = either_sign(rng) * UNIT_MM / (high - low) * 3.0
    # The play is smallest where the screw is least worn, somewhere along it.
    at = rng.uniform(low, high)
    b0 = -slope * at
    gap = b0 + slope * log.q_mm[:, a]
    moved = _along(log, a, -0.5 * log.moved("direction", a) * gap)
    return Acting(moved, {"b0": b0, "b1": slope}, {}, (f"d_{axis}", axis), (joint(a, a),))


def wound_up(direction: Array, travel: Array, session: Array, length_mm: float) -> Array:
    """Follow the wind-up of a drive with unit lost motion: −d/2 after a long stroke, filled with e^(−s/λ)."""
    result = np.zeros(len(direction))
    at_turn, last, last_sense, last_session = 0.0, 0.0, 0.0, -1
    for row, (sense, way, one) in enumerate(zip(direction.tolist(), travel.tolist(), session.tolist(), strict=True)):
        if one != last_session:
            # Homing was a long stroke.
            at_turn = -0.5 * sense
        elif sense != last_sense:
            at_turn = last
        full = -0.5 * sense
        last = full + (at_turn - full) * float(np.exp(-way / length_mm))
        last_sense, last_session = sense, one
        result[row] = last
    return result


@LISTED.kind("reversal-windup", "reversal-windup", axes=AXES)
def _windup(log: Log, rng: np.random.Generator, axis: str, _: str) -> Acting:
    a, b, length = index(axis), UNIT_MM, log.value("lambda", log_uniform(rng, 1.5, 12.0))
    motion, session = log.motion, log.plan.moments.session
    shape = wound_up(motion.direction[:, a], motion.travel_mm[:, a], session, length)
    moved = _along(log, a, b * shape[log.moment])
    return Acting(moved, {"b": b}, {"lambda": length}, (f"d_{axis}", f"s_{axis}"), (joint(a, a),))


@LISTED.kind("reversal-spike", "reversal-spike", axes=AXES)
def _spike(log: Log, rng: np.random.Generator, axis: str, _: str) -> Acting:
    a, height, tau = index(axis), UNIT_MM, log.value("tau", log_uniform(rng, 0.8, 4.0))
    moved = _along(log, a, -height * log.moved("direction", a) * np.exp(-log.moved("since_reversal_s", a) / tau))
    return Acting(moved, {"A": height}, {"tau": tau}, (f"d_{axis}", "t"), (joint(a, a),))


@LISTED.kind("lateral-play", "lateral-play", axes=AXES)
def _lateral(log: Log, rng: np.random.Generator, axis: str, _: str) -> Acting:
    a, size = index(axis), UNIT_MM * direction_of(rng, 2)
    moved = nothing(log.n_rows)
    for b, gap in zip(across(a), size, strict=True):
        moved.delta_mm[:, a, b] = 0.5 * gap * log.moved("direction", a)
    linear = {f"l_{'xyz'[b]}": float(gap) for b, gap in zip(across(a), size, strict=True)}
    return Acting(moved, linear, {}, (f"d_{axis}",), tuple(joint(a, b) for b in across(a)))


@LISTED.kind("angular-reversal", "angular-reversal", axes=AXES)
def _angular_reversal(log: Log, rng: np.random.Generator, axis: str, _: str) -> Acting:
    a, size = index(axis), UNIT_RAD * direction_of(rng, 3)
    moved = nothing(log.n_rows)
    moved.epsilon_rad[:, a] = size * log.moved("direction", a)[:, None]
    linear = {f"c_{'xyz'[b]}": float(size[b]) for b in range(3)}
    return Acting(moved, linear, {}, (f"d_{axis}",), tuple(joint(a, b, is_angle=True) for b in range(3)))


@LISTED.kind("gantry-racking", "gantry-racking", axes=("x", "y"))
def _racking(log: Log, rng: np.random.Generator, axis: str, _: str) -> Acting:
    a = index(axis)
    other = 1 - a
    low, high = log.range_mm(other)
    slope = either_sign(rng) * 2.0 * UNIT_RAD / (high - low)
    middle = rng.uniform(low, high)
    moved = nothing(log.n_rows)
    moved.epsilon_rad[:, a, 2] = slope * (log.q_mm[:, other] - middle) * log.moved("direction", a)
    variables = (f"d_{axis}", "xyz"[other])
    return Acting(moved, {"c0": -slope * middle, "c1": slope}, {}, variables, (joint(a, 2, is_angle=True),))


# --- drives -------------------------------------------------------------------------------------------------------


def _wave(log: Log, rng: np.random.Generator, a: int, n_harmonics: int = 1) -> tuple[Array, float, dict[str, float]]:
    period = float(rng.choice([2.0, 4.0, 5.0, 8.0, 10.0, 32.0, 40.0])) * rng.uniform(0.97, 1.03)
    period = log.value("P", period)
    turn = 2.0 * np.pi * log.q_mm[:, a] / period
    shape, linear = np.zeros(log.n_rows), {}
    for harmonic in range(1, n_harmonics + 1):
        phase = rng.uniform(0.0, 2.0 * np.pi)
        size, which = UNIT_MM / harmonic, "" if harmonic == 1 else str(harmonic)
        sine, cosine = log.value(f"A{which}", size * np.cos(phase)), log.value(f"B{which}", size * np.sin(phase))
        shape = shape + sine * np.sin(harmonic * turn) + cosine * np.cos(harmonic * turn)
        linear |= {f"A{which}": sine, f"B{which}": cosine}
    return shape, period, linear


@LISTED.kind("periodic", "periodic", axes=AXES)
def _periodic(log: Log, rng: np.random.Generator, axis: str, _: str) -> Acting:
    a = index(axis)
    shape, period, linear = _wave(log, rng, a)
    return Acting(_along(log, a, shape), linear, {"P": period}, (axis,), (joint(a, a),))


@LISTED.kind("periodic-harmonics", "periodic", axes=AXES)
def _periodic_harmonics(log: Log, rng: np.random.Generator, axis: str, _: str) -> Acting:
    a = index(axis)
    shape, period, linear = _wave(log, rng, a, 2)
    return Acting(_along(log, a, shape), linear, {"P": period}, (axis,), (joint(a, a),))


@LISTED.kind("screw-wobble", "screw-wobble", axes=AXES)
def _wobble(log: Log, rng: np.random.Generator, axis: str, _: str) -> Acting:
    a = index(axis)
    moved = nothing(log.n_rows)
    period = log.value("P", float(rng.choice([2.0, 4.0, 5.0, 8.0, 10.0])) * rng.uniform(0.97, 1.03))
    turn, phase = 2.0 * np.pi * log.q_mm[:, a] / period, rng.uniform(0.0, 2.0 * np.pi)
    # A bent screw carries its nut round: an ellipse in the plane across.
    flat = rng.uniform(0.3, 1.0)
    linear = {}
    for b, size, ahead in zip(across(a), (UNIT_MM, flat * UNIT_MM), (0.0, 0.5 * np.pi), strict=True):
        sine = log.value(f"A_{'xyz'[b]}", size * np.cos(phase + ahead))
        cosine = log.value(f"B_{'xyz'[b]}", size * np.sin(phase + ahead))
        moved.delta_mm[:, a, b] = sine * np.sin(turn) + cosine * np.cos(turn)
        linear |= {f"A_{'xyz'[b]}": sine, f"B_{'xyz'[b]}": cosine}
    return Acting(moved, linear, {"P": period}, (axis,), tuple(joint(a, b) for b in across(a)))


def _jump(log: Log, rng: np.random.Generator) -> tuple[Array, float, float]:
    """Give when something jumps for good, in the middle of a pass: rows behind it, its time, and its session.

    The next session is set up anew: what jumped in one is no jump in another.
    """
    moments = log.plan.moments
    lengths = np.bincount(moments.pass_number)
    chosen = int(rng.choice(np.flatnonzero(lengths >= min(5, lengths.max()))))
    rows = np.flatnonzero(moments.pass_number == chosen)
    before = int(rng.integers(len(rows) // 3, 2 * len(rows) // 3))
    t0 = float(0.5 * (moments.t_s[rows[before]] + moments.t_s[rows[before + 1]]))
    session = int(moments.session[rows[0]])
    return 1.0 * ((log.session == session) & (log.t_s >= t0)), t0, float(session)


@LISTED.kind("lost-steps", "lost-steps", axes=AXES, off_axis=False)
def _lost_steps(log: Log, rng: np.random.Generator, axis: str, _: str) -> Acting:
    a = index(axis)
    behind, t0, session = _jump(log, rng)
    jump = either_sign(rng) * 3.0 * UNIT_MM
    inner = {"t0": t0, "session": session}
    return Acting(_along(log, a, jump * behind), {"A": jump}, inner, ("t",), (joint(a, a),))


# --- motion -------------------------------------------------------------------------------------------------------


@LISTED.kind("lag", "lag", axes=AXES, needs=("motion",))
def _lag(log: Log, rng: np.random.Generator, axis: str, _: str) -> Acting:
    a, tau = index(axis), 1e-3
    return Acting(
        _along(log, a, -tau * log.moved("velocity_mm_s", a)), {"tau": tau}, {}, (f"v_{axis}",), (joint(a, a),)
    )


@LISTED.kind("servo-mismatch", "servo-mismatch", axes=PAIRS, needs=("motion",))
def _mismatch(log: Log, rng: np.random.Generator, pair: str, _: str) -> Acting:
    a, b = index(pair[0]), index(pair[1])
    late = 1e-3 * either_sign(rng)
    moved = _along(log, a, -0.5 * late * log.moved("velocity_mm_s", a))
    moved.delta_mm[:, b, b] = 0.5 * late * log.moved("velocity_mm_s", b)
    return Acting(moved, {"dtau": late}, {}, (f"v_{pair[0]}", f"v_{pair[1]}"), (joint(a, a), joint(b, b)))


@LISTED.kind("radial-shrink", "radial-shrink", axes=AXES, needs=("ramps",))
def _shrink(log: Log, rng: np.random.Generator, axis: str, _: str) -> Acting:
    a, k = index(axis), 1e-4
    moved = _along(log, a, k * log.moved("acceleration_mm_s2", a))
    return Acting(moved, {"k": k}, {}, (f"a_{axis}",), (joint(a, a),))


@LISTED.kind("acceleration", "acceleration", axes=AXES, needs=("ramps",))
def _yielding(log: Log, rng: np.random.Generator, axis: str, _: str) -> Acting:
    a, c = index(axis), 1e-4
    moved = _along(log, a, -c * log.moved("acceleration_mm_s2", a))
    return Acting(moved, {"c": c}, {}, (f"a_{axis}",), (joint(a, a),))


@LISTED.kind("stick-slip", "stick-slip", axes=AXES, needs=("motion",))
def _stick_slip(log: Log, rng: np.random.Generator, axis: str, _: str) -> Acting:
    a, b, speed = index(axis), 2.0 * UNIT_MM, log.value("v_s", log_uniform(rng, 5.0, 60.0))
    gone = np.exp(-np.abs(log.moved("velocity_mm_s", a)) / speed)
    moved = _along(log, a, -0.5 * b * log.moved("direction", a) * gone)
    return Acting(moved, {"b_s": b}, {"v_s": speed}, (f"d_{axis}", f"v_{axis}"), (joint(a, a),))


@LISTED.kind("timing", "timing", needs=("motion",), off_axis=False)
def _timing(log: Log, rng: np.random.Generator, _: str, __: str) -> Acting:
    late = 1e-3
    moved = nothing(log.n_rows)
    # The axes themselves have gone on: exact, whatever carries the target.
    moved.late_mm[:] = late * log.motion.velocity_mm_s[log.moment]
    return Acting(moved, {"dt": late}, {}, ("v_x", "v_y", "v_z"), ("motion-x", "motion-y", "motion-z"))


# --- heat ---------------------------------------------------------------------------------------------------------


def _expansion(log: Log, rng: np.random.Generator, axis: str, warmth: Array) -> tuple[Displacements, float, float]:
    a = index(axis)
    low, high = log.range_mm(a)
    alpha, fixed = 3e-6, log.value("q_fixed", rng.uniform(low, high))
    return _along(log, a, alpha * warmth * (log.q_mm[:, a] - fixed)), alpha, fixed


@LISTED.kind("thermal-expansion", "thermal-expansion", axes=AXES, covariates=SENSORS)
def _thermal_expansion(log: Log, rng: np.random.Generator, axis: str, covariate: str) -> Acting:
    moved, alpha, fixed = _expansion(log, rng, axis, _warmth(log, covariate))
    a = index(axis)
    return Acting(moved, {"alpha": alpha}, {"q_fixed": fixed}, (covariate, axis), (joint(a, a),))


@LISTED.kind("thermal-expansion-lagged", "thermal-expansion", axes=AXES, covariates=SENSORS)
def _thermal_expansion_lagged(log: Log, rng: np.random.Generator, axis: str, covariate: str) -> Acting:
    tau = log.value("tau", _lag_time(log, rng))
    moved, alpha, fixed = _expansion(log, rng, axis, _lagged_warmth(log, covariate, tau))
    a = index(axis)
    return Acting(moved, {"alpha": alpha}, {"q_fixed": fixed, "tau": tau}, (covariate, axis), (joint(a, a),))


def _body(log: Log, place: str, moved_mm: Array) -> tuple[Displacements, str]:
    moved = nothing(log.n_rows)
    if place.startswith("work-"):
        moved.work_mm[:, index(place[-1])] = moved_mm
        return moved, place
    moved.tool_mm[:, index(place)] = moved_mm
    return moved, f"tool-{place}"


@LISTED.kind("thermal-drift", "thermal-drift", axes=BODY_PLACES, covariates=SENSORS)
def _thermal_drift(log: Log, rng: np.random.Generator, place: str, covariate: str) -> Acting:
    k = either_sign(rng) * 1e-3
    moved, channel = _body(log, place, k * _warmth(log, covariate))
    return Acting(moved, {"k": k}, {}, (covariate,), (channel,))


@LISTED.kind("thermal-drift-lagged", "thermal-drift", axes=BODY_PLACES, covariates=SENSORS)
def _thermal_drift_lagged(log: Log, rng: np.random.Generator, place: str, covariate: str) -> Acting:
    k, tau = either_sign(rng) * 1e-3, log.value("tau", _lag_time(log, rng))
    moved, channel = _body(log, place, k * _lagged_warmth(log, covariate, tau))
    return Acting(moved, {"k": k}, {"tau": tau}, (covariate,), (channel,))


@LISTED.kind("nozzle-growth", "thermal-drift", axes=("z",), covariates=("temp_nozzle",), needs=("temp_nozzle",))
def _nozzle(log: Log, rng: np.random.Generator, place: str, covariate: str) -> Acting:
    alpha, length = 17e-6, rng.uniform(20.0, 60.0)
    moved, channel = _body(log, place, -alpha * length * _warmth(log, covariate))
    return Acting(moved, {"k": -alpha * length}, {}, (covariate,), (channel,))


@LISTED.kind("warm-up", "warm-up", axes=BODY_PLACES)
def _warm_up(log: Log, rng: np.random.Generator, place: str, _: str) -> Acting:
    size = either_sign(rng) * 3.0 * UNIT_MM
    tau = log.value("tau", _session_length(log) * log_uniform(rng, 0.03, 0.2))
    moved, channel = _body(log, place, size * -np.expm1(-log.t_s / tau))
    return Acting(moved, {"A": size}, {"tau": tau}, ("t",), (channel,))


@LISTED.kind("warm-up-two", "warm-up", axes=BODY_PLACES)
def _warm_up_two(log: Log, rng: np.random.Generator, place: str, _: str) -> Acting:
    size = either_sign(rng) * 2.0 * UNIT_MM
    tau = log.value("tau", _session_length(log) * log_uniform(rng, 0.015, 0.05))
    ratio, second = log.value("ratio", rng.uniform(5.0, 15.0)), rng.uniform(0.5, 1.5)
    first, second = log.value("A", size), log.value("B", second * size)
    slow = -np.expm1(-log.t_s / (ratio * tau))
    moved, channel = _body(log, place, first * -np.expm1(-log.t_s / tau) + second * slow)
    return Acting(moved, {"A": first, "B": second}, {"tau": tau, "ratio": ratio}, ("t",), (channel,))


@LISTED.kind("screw-heating", "screw-heating", axes=AXES)
def _screw_heating(log: Log, rng: np.random.Generator, axis: str, _: str) -> Acting:
    a, tau, k = index(axis), log.value("tau", max(60.0, _lag_time(log, rng))), 1e-5
    fixed = log.value("q_fixed", rng.uniform(*log.range_mm(a)))
    heat = _by_row(log, np.abs(log.motion.mean_velocity_mm_s[:, a]), tau, is_held=True)
    moved = _along(log, a, k * heat * (log.q_mm[:, a] - fixed))
    return Acting(moved, {"k": k}, {"tau": tau, "q_fixed": fixed}, (axis, f"v_{axis}", "t"), (joint(a, a),))


@LISTED.kind("screw-heating-duty", "screw-heating", axes=AXES, covariates=("duty",), needs=("duty",))
def _screw_heating_duty(log: Log, rng: np.random.Generator, axis: str, covariate: str) -> Acting:
    a, tau, k = index(axis), log.value("tau", max(60.0, _lag_time(log, rng))), 2e-4
    fixed = log.value("q_fixed", rng.uniform(*log.range_mm(a)))
    moved = _along(log, a, k * _by_row(log, log.by_moment["duty"], tau) * (log.q_mm[:, a] - fixed))
    return Acting(moved, {"k": k}, {"tau": tau, "q_fixed": fixed}, (axis, covariate, "t"), (joint(a, a),))


def _guided(log: Log, moved: Displacements, a: int, b: int, path_mm: Array, slope: Array) -> str:
    """Lead a carriage along a bent way: off it by `path_mm` along b, and turned with its tangent.

    Its own travel is −q and its own motion −δ, −ε on the work side; the tangent e_a turns by ε × e_a = dδ/dq on the
    tool side and by minus that on the work side.
    """
    about = 3 - a - b
    turned = np.cross(np.eye(3)[about], np.eye(3)[a])[b]
    side = 1.0 if a in sides(log.machine.chain)[0] else -1.0
    moved.delta_mm[:, a, b] += path_mm
    moved.epsilon_rad[:, a, about] += side * slope / turned
    return joint(a, about, is_angle=True)


@LISTED.kind(
    "thermal-bending", "thermal-bending", axes=AXES, covariates=("temp_bed", "temp_frame", "temp_bed-temp_bed_low")
)
def _bending(log: Log, rng: np.random.Generator, axis: str, covariate: str) -> Acting:
    a, warmth = index(axis), _warmth(log, covariate)
    low, high = log.range_mm(a)
    q, length = log.q_mm[:, a] - low, high - low
    moved, size = nothing(log.n_rows), 1e-8 * direction_of(rng, 2)
    linear, channels = {}, []
    for b, kappa in zip(across(a), size, strict=True):
        angle = _guided(
            log, moved, a, b, kappa * warmth * q * (length - q) / 2, kappa * warmth * (length - 2 * q) / 2
        )
        linear[f"kappa_{'xyz'[b]}"] = float(kappa)
        channels += [joint(a, b), angle]
    return Acting(moved, linear, {}, (covariate, axis), tuple(channels))


@LISTED.kind("bed-bow", "bed-bow", axes=("work-z",), covariates=("temp_bed_low-temp_bed",))
def _bow(log: Log, rng: np.random.Generator, _: str, covariate: str) -> Acting:
    alpha, thickness = 2e-6, 6.0
    bed = log.bed_mm()
    (x_low, x_high), (y_low, y_high) = log.range_mm(0), log.range_mm(1)
    x_c, y_c = rng.uniform(0.3, 0.7, 2) * (x_high - x_low, y_high - y_low) + (x_low, y_low)
    x_c, y_c = log.value("x_c", x_c), log.value("y_c", y_c)
    moved = nothing(log.n_rows)
    square = (bed[:, 0] - x_c) ** 2 + (bed[:, 1] - y_c) ** 2
    moved.work_mm[:, 2] = alpha * _warmth(log, covariate) * square / (2 * thickness)
    inner = {"h": thickness, "x_c": x_c, "y_c": y_c}
    return Acting(moved, {"alpha": alpha}, inner, (covariate, "bed_x", "bed_y"), ("work-z",))


@LISTED.kind("frame-tilt-thermal", "frame-tilt-thermal", axes=PAIRS, covariates=(*SENSORS, "temp_bed-temp_bed_low"))
def _frame_tilt(log: Log, rng: np.random.Generator, pair: str, covariate: str) -> Acting:
    k = either_sign(rng) * 1e-6
    moved = nothing(log.n_rows)
    moved.squareness_rad[:, PAIRS.index(pair)] = k * _warmth(log, covariate)
    return Acting(moved, {"k": k}, {}, (covariate, pair[1]), (f"S_{pair}",))


@LISTED.kind("angular-thermal", "angular-thermal", axes=AXES, covariates=SENSORS)
def _angular_thermal(log: Log, rng: np.random.Generator, axis: str, covariate: str) -> Acting:
    a, size = index(axis), 1e-6 * direction_of(rng, 3)
    moved = nothing(log.n_rows)
    moved.epsilon_rad[:, a] = size * _warmth(log, covariate)[:, None]
    linear = {f"k_{'xyz'[b]}": float(size[b]) for b in range(3)}
    return Acting(moved, linear, {}, (covariate,), tuple(joint(a, b, is_angle=True) for b in range(3)))


@LISTED.kind("target-expansion", "target-expansion", covariates=SENSORS, off_axis=False)
def _target_expansion(log: Log, rng: np.random.Generator, _: str, covariate: str) -> Acting:
    alpha = 2e-6
    moved = nothing(log.n_rows)
    moved.target_mm[:] = alpha * _warmth(log, covariate)[:, None] * log.plan.rows.offset_mm
    return Acting(moved, {"alpha": alpha}, {}, (covariate, "tx", "ty", "tz"), ("target-x", "target-y", "target-z"))


# --- structure ----------------------------------------------------------------------------------------------------


@LISTED.kind("gravity-sag-load", "gravity-sag", axes=("x", "y"), covariates=("load",), needs=("load",))
def _sag(log: Log, rng: np.random.Generator, axis: str, covariate: str) -> Acting:
    a = index(axis)
    low, high = log.range_mm(a)
    q, length = log.q_mm[:, a] - low, high - low
    per_weight = UNIT_MM / length**3
    own = rng.uniform(1.0, 4.0)
    bent = per_weight * (own + log.columns[covariate])
    side = 1.0 if a in sides(log.machine.chain)[0] else -1.0
    moved = nothing(log.n_rows)
    # A cantilever under the weight at its end: F q³/3EI down, and the slope there.
    angle = _guided(log, moved, a, 2, -side * bent * q**3 / 3, -side * bent * q**2 / 2)
    return Acting(moved, {"k": own * per_weight, "k1": per_weight}, {}, (axis, covariate), (joint(a, 2), angle))


@LISTED.kind("cross-coupling", "cross-coupling", axes=("x*y", "x*z", "y*x", "y*z", "z*x", "z*y"), off_axis=False)
def _coupling(log: Log, rng: np.random.Generator, pair: str, _: str) -> Acting:
    a, b = index(pair[0]), index(pair[2])
    u, w = log.share(a), log.share(b)
    moved = nothing(log.n_rows)
    linear = {}
    for direction in range(3):
        # A way whose bend depends on where the other carriage stands: nothing that a lever makes of an angle.
        sizes = UNIT_MM * direction_of(rng, 3)
        for name, size, powers in zip(("c21", "c12", "c22"), sizes, ((2, 1), (1, 2), (2, 2)), strict=True):
            if not _is_rigid(log.machine.chain, (a, b), powers, direction):
                moved.delta_mm[:, a, direction] += size * u ** powers[0] * w ** powers[1]
                linear[f"{name}_{'xyz'[direction]}"] = float(size)
    return Acting(moved, linear, {}, (pair[0], pair[2]), tuple(joint(a, direction) for direction in range(3)))


def _is_rigid(chain: str, axes: tuple[int, int], powers: tuple[int, int], direction: int) -> bool:
    """Tell whether errors of the single axes move one target, seen from the work, by u^p·w^q of two positions."""
    q = np.random.default_rng(0).uniform(-1.0, 1.0, (100, 3))
    sign, lever = levers(chain, np.full(len(q), RELATIVE), q, np.zeros((len(q), 3)))
    own = q[:, :, None] ** np.arange(4)
    turned = np.cross(np.eye(3)[None, None], lever[:, :, None])
    angles = sign[:, :, None, None, None] * turned[..., None] * own[:, :, None, None]
    places = np.einsum("bc,naj->nabcj", np.eye(3), sign[:, :, None] * own)
    columns = np.concatenate([np.moveaxis(one, 3, 1).reshape(3 * len(q), -1) for one in (places, angles)], axis=1)
    wanted = np.zeros((len(q), 3))
    wanted[:, direction] = q[:, axes[0]] ** powers[0] * q[:, axes[1]] ** powers[1]
    left = wanted.ravel() - columns @ np.linalg.lstsq(columns, wanted.ravel(), rcond=1e-10)[0]
    return bool(np.linalg.norm(left) < 1e-6 * np.linalg.norm(wanted))


@LISTED.kind("load-deflection", "load-deflection", axes=AXES, covariates=("force",), needs=("force",))
def _deflection(log: Log, rng: np.random.Generator, axis: str, covariate: str) -> Acting:
    c = either_sign(rng) * 2e-4
    moved, channel = _body(log, axis, c * log.columns[covariate])
    return Acting(moved, {"c": c}, {}, (covariate,), (channel,))


# --- rig ----------------------------------------------------------------------------------------------------------

RIG_VECTOR = tuple(f"rig-{name}" for name in ("tx", "ty", "tz", "rx", "ry", "rz"))


def _knocked(
    log: Log, rng: np.random.Generator, course: Array, names: tuple[str, str], scale: float = 1.0
) -> tuple[Displacements, dict[str, float]]:
    """Move and turn the cameras: the point moves by shift + turn × p_c, of which the parameters are `scale`."""
    shift, turn = UNIT_MM * direction_of(rng, 3), 2.0 * UNIT_RAD * direction_of(rng, 3)
    # The stand turns about its foot, not about the lens: the middle of the volume stays nearly where it is.
    shift = shift - np.cross(turn, log.in_camera_mm.mean(axis=0))
    linear = {
        f"{name}_{'xyz'[b]}": log.value(f"{name}_{'xyz'[b]}", scale * size[b])
        for name, size in zip(names, (shift, turn), strict=True)
        for b in range(3)
    }
    shift, turn = np.array([*linear.values()]).reshape(2, 3) / scale
    moved = nothing(log.n_rows)
    moved.rig_mm[:] = course[:, None] * (shift + np.cross(turn, log.in_camera_mm))
    return moved, linear


@LISTED.kind("camera-drift", "camera-drift", needs=("cameras",), off_axis=False)
def _camera_drift(log: Log, rng: np.random.Generator, _: str, __: str) -> Acting:
    length = _session_length(log)
    moved, linear = _knocked(log, rng, log.t_s / length, ("k", "c"), 1.0 / length)
    return Acting(moved, linear, {}, ("t",), RIG_VECTOR)


@LISTED.kind("camera-drift-settling", "camera-drift", needs=("cameras",), off_axis=False)
def _camera_settling(log: Log, rng: np.random.Generator, _: str, __: str) -> Acting:
    # A stand settles in a minute or more, however short the session.
    tau = log.value("tau", max(60.0, _session_length(log) * log_uniform(rng, 0.03, 0.2)))
    moved, linear = _knocked(log, rng, -np.expm1(-log.t_s / tau), ("A", "C"))
    return Acting(moved, linear, {"tau": tau}, ("t",), RIG_VECTOR)


@LISTED.kind("step", "step", needs=("cameras",), off_axis=False)
def _step(log: Log, rng: np.random.Generator, _: str, __: str) -> Acting:
    behind, t0, session = _jump(log, rng)
    moved, linear = _knocked(log, rng, behind, ("A", "c"))
    return Acting(moved, linear, {"t0": t0, "session": session}, ("t",), RIG_VECTOR)


@LISTED.kind("rig-scale-thermal", "rig-scale-thermal", covariates=SENSORS, needs=("cameras",), off_axis=False)
def _rig_scale_thermal(log: Log, rng: np.random.Generator, _: str, covariate: str) -> Acting:
    k = either_sign(rng) * 1e-6
    moved = nothing(log.n_rows)
    moved.rig_mm[:] = k * _warmth(log, covariate)[:, None] * log.in_camera_mm
    return Acting(moved, {"k": k}, {}, (covariate,), ("rig-scale",))


@LISTED.kind("rig-depth", "rig-depth", needs=("cameras",), off_axis=False)
def _rig_depth(log: Log, rng: np.random.Generator, _: str, __: str) -> Acting:
    k1, k2 = 1e-4 * either_sign(rng), 1e-7 * rng.uniform(0.5, 2.0) * either_sign(rng)
    place = log.in_camera_mm
    moved = nothing(log.n_rows)
    # A focal length that is off stretches depth; a vergence that is off shifts disparity, 1/z_c, by a constant.
    moved.rig_mm[:, 2] = k1 * place[:, 2]
    moved.rig_mm[:] += k2 * place[:, 2, None] * place
    return Acting(moved, {"k1": k1, "k2": k2}, {}, (), ("rig-depth", "rig-disparity"))


@LISTED.kind("rig-distortion", "rig-distortion", needs=("cameras",), off_axis=False)
def _rig_distortion(log: Log, rng: np.random.Generator, _: str, __: str) -> Acting:
    pixels = log.pixels()
    u, v = pixels["u_left"] - CENTRE_PX[0], pixels["v_left"] - CENTRE_PX[1]
    k1 = either_sign(rng) * 2e-4
    # Residual of the radial term: the ray's slope is off by k₁r²·(u, v), here with u, v in 1000 px.
    radial = k1 * ((u / 1000) ** 2 + (v / 1000) ** 2)
    moved = nothing(log.n_rows)
    depth = log.in_camera_mm[:, 2]
    moved.rig_mm[:, 0], moved.rig_mm[:, 1] = depth * radial * u / 1000, depth * radial * v / 1000
    inner = {"u_0": CENTRE_PX[0], "v_0": CENTRE_PX[1]}
    return Acting(moved, {"k1": k1}, inner, ("u_left", "v_left"), ("rig-ray-x", "rig-ray-y"))


@LISTED.kind("rig-pixel-locking", "rig-pixel-locking", needs=("cameras",), off_axis=False)
def _locking(log: Log, rng: np.random.Generator, _: str, __: str) -> Acting:
    pixels, size = log.pixels(), 0.02 / FOCAL_PX
    depth = log.in_camera_mm[:, 2]
    moved, linear = nothing(log.n_rows), {}
    # Sub-pixel corners are drawn towards pixel centres, alike along rows and columns.
    for b, column in enumerate(("u_left", "v_left")):
        moved.rig_mm[:, b] = -size * depth * np.sin(2 * np.pi * pixels[column])
        linear[f"A_{'xy'[b]}"] = -size
    return Acting(moved, linear, {}, ("u_left", "v_left"), ("rig-ray-x", "rig-ray-y"))
