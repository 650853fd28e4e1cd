"""Physical effects beside and instead of the classic errors, from the catalogue or from a user's file."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from fit_scenes import (
    CUBICS,
    Numbers,
    camera_near_base,
    fitted,
    measured_again,
    nine_lines_seen,
    points,
    replaced,
    term_of,
    value_of,
)
from scipy.integrate import solve_ivp
from virtual_machine import LENGTH_MM, machine_of

from geoerr.compensate.benefit import benefit_of
from geoerr.effects import catalogue, load_effects
from geoerr.fit import FitOptions, Fitted, fit_terms, result_of
from geoerr.machine import Axis, Machine
from geoerr.observations import Observations, observations_from_columns

MACHINE = machine_of("wZbXYt")
STD_MM = 2e-3


def x_runs(rng: np.random.Generator, error_mm: Numbers, q_mm: Numbers, **columns: object) -> Observations:
    """Tool against work along x by a camera nearly parallel to it, with an error along x and noise."""
    camera = camera_near_base(rng)
    q = np.column_stack([q_mm, np.zeros_like(q_mm), np.zeros_like(q_mm)])
    seen = (q + error_mm[:, None] * [1.0, 0.0, 0.0]) @ camera.turn.T + camera.shift_mm
    seen = seen + STD_MM * rng.normal(size=seen.shape)
    return points(
        q, np.zeros_like(q), seen, covariance_mm2=np.eye(3) * STD_MM**2, carrier=["relative"] * len(q), **columns
    )


def inner_of(result: Fitted, term_id: str, number: int = 0) -> tuple[float, float]:
    parameter = term_of(result, term_id).inner[number]
    return parameter.value, parameter.std


def is_near(found: tuple[float, float], true: float) -> bool:
    """Five standard errors: once in two million by chance."""
    return abs(found[0] - true) < 5.0 * found[1]


def there_and_back(n_passes: int, n_points: int, rng: np.random.Generator) -> tuple[Numbers, Numbers]:
    """Jittered positions of passes to and fro, and the direction of each row."""
    q, d = [], []
    for number in range(n_passes):
        way = 1 if number % 2 == 0 else -1
        q.append(np.sort(rng.uniform(0.0, LENGTH_MM, n_points))[::way])
        d.append(np.full(n_points, float(way)))
    return np.concatenate(q), np.concatenate(d)


def test_thermal_growth_with_a_lag() -> None:
    """A steel screw that follows its sensor by ten minutes, held at 120 mm; the lag by an integrator of its own."""
    rng = np.random.default_rng(700)
    q, d = there_and_back(12, 30, rng)
    t = 20.0 * np.arange(len(q))
    sensor = 20.0 + 15.0 * (1.0 - np.exp(-t / 1500.0)) + 4.0 * np.sin(t / 700.0) - 4.0 * np.sin(t[0] / 700.0)
    answer = solve_ivp(
        lambda time, y: (np.interp(time, t, sensor) - y) / 600.0,
        (t[0], t[-1]),
        [sensor[0]],
        t_eval=t,
        max_step=10.0,
        rtol=1e-9,
    )
    error = 11.5e-6 * (answer.y[0] - 20.0) * (q - 120.0) + 30e-6 * q
    observations = x_runs(rng, error, q, t=t, temp_screw=sensor, dir_x=d)
    growth = catalogue()["thermal-expansion"].term("x", "temp_screw", MACHINE, lagged=True)
    scale = catalogue()["scale"].term("x", None, MACHINE)
    result = fitted(MACHINE, observations, effects=[scale, growth], components="none")
    assert result.solved.converged
    assert is_near(value_of(result, growth.id), 11.5e-6)
    assert is_near(value_of(result, scale.id), 30e-6)
    by_name = {parameter.name: number for number, parameter in enumerate(growth.inner)}
    assert is_near(inner_of(result, growth.id, by_name["tau"]), 600.0)
    # The fixed point lies where growth is 0: the frame's own shift does not move with temperature.
    assert is_near(inner_of(result, growth.id, by_name["q_fixed"]), 120.0)
    assert result.split.lack_of_fit_p is not None
    assert result.split.lack_of_fit_p > 1e-4
    at_once = catalogue()["thermal-expansion"].term("x", "temp_screw", MACHINE)
    prompt = fitted(MACHINE, observations, effects=[scale, at_once], components="none")
    assert prompt.split.lack_of_fit_p is not None
    assert prompt.split.lack_of_fit_p < 1e-9


def test_what_states_no_uncertainty_settles_as_well() -> None:
    """Steps were held against a noise of a millimetre: from a size of 0 the period never moved."""
    rng = np.random.default_rng(702)
    q, d = there_and_back(10, 55, rng)
    seen = q + 3e-3 * np.sin(2.0 * np.pi * q / 5.0) - 0.5 * 9e-3 * d + 4e-4 * rng.normal(size=len(q))
    zero = np.zeros_like(q)
    columns = {"x": q, "y": zero, "z": zero, "mx": seen, "dir_x": d, "line": ["X"] * len(q)}
    plain = observations_from_columns(
        {**columns, "carrier": ["relative"] * len(q), "repeat": np.repeat(range(10), 55)}
    )
    effects = [catalogue()[name].term("x", None, MACHINE) for name in ("periodic", "backlash")]
    result = fitted(MACHINE, plain, effects=effects, components="none")
    assert result.not_determined == ()
    assert is_near(inner_of(result, "periodic:x"), 5.0)
    assert inner_of(result, "periodic:x")[1] < 1e-3
    assert is_near(value_of(result, "periodic:x"), 3e-3)
    assert is_near(value_of(result, "backlash:x"), 9e-3)
    # As with an uncertainty that is stated, and right.
    stated = observations_from_columns(
        {name: plain.frame[name] for name in plain.frame.columns if name != "file_row"} | {"sx": 4e-4}
    )
    other = fitted(MACHINE, stated, effects=effects, components="none")
    for name in ("periodic:x", "backlash:x"):
        assert abs(value_of(result, name)[0] - value_of(other, name)[0]) < 1e-3 * value_of(other, name)[1]


def test_backlash_beside_the_21() -> None:
    """Nine lines there and back: the gap, and none of it in the positioning."""
    rng = np.random.default_rng(701)
    _, forth = nine_lines_seen(rng, MACHINE, n_repeats=2, has_noise=False)
    way = np.where(forth.numbers("repeat")[:, 0] == 0, 1.0, -1.0)
    directions = {f"dir_{axis}": way for axis in "xyz"}
    # A backlash of x is there on every line: x came to where it stands from some side.
    on_tool = np.asarray(forth.texts("carrier")) == "tool"
    plain = fitted(MACHINE, forth)
    base = np.zeros((len(forth), 3))
    base[on_tool, 0] = -0.5 * 0.04 * way[on_tool]
    moved = measured_again(forth, base @ plain.solved.state.rotations[0].T + STD_MM * rng.normal(size=base.shape))
    backlash = [catalogue()["backlash"].term(axis, None, MACHINE) for axis in "xyz"]
    result = fitted(MACHINE, replaced(moved, **directions), effects=backlash)
    assert is_near(value_of(result, "backlash:x"), 0.04)
    assert is_near(value_of(result, "backlash:y"), 0.0)
    assert is_near(value_of(result, "backlash:z"), 0.0)
    for number, coefficient in enumerate(term_of(plain, "EXX").coefficients):
        assert is_near(value_of(result, "EXX", number), coefficient.value)


@pytest.mark.parametrize("period_mm", [2.0, 4.0, 8.0, 32.0, 40.0])
def test_the_period_of_a_periodic_error_is_found(period_mm: float) -> None:
    """240 points over 400 mm, 12 µm of wave in 2 µm of noise: there is no doubt about it."""
    rng = np.random.default_rng(702)
    q, d = there_and_back(4, 60, rng)
    error = 12e-3 * np.sin(2.0 * np.pi * q / period_mm + 0.7)
    term = catalogue()["periodic"].term("x", None, MACHINE)
    result = fitted(MACHINE, x_runs(rng, error, q, dir_x=d), effects=[term], components="none")
    assert is_near(inner_of(result, term.id), period_mm)
    # Phase and period trade places: amplitude alone is free of both.
    a, b = (value_of(result, term.id, number)[0] for number in (0, 1))
    assert np.hypot(a, b) == pytest.approx(12e-3, abs=5.0 * STD_MM * np.sqrt(2.0 / len(q)))
    assert result.split.lack_of_fit_p is not None
    assert result.split.lack_of_fit_p > 1e-4


def test_a_wave_beside_a_backlash_and_a_lag_of_the_servo() -> None:
    rng = np.random.default_rng(703)
    q, d = there_and_back(6, 50, rng)
    error = 8e-3 * np.sin(2.0 * np.pi * q / 40.0) - 0.5 * 0.03 * d
    effects = [catalogue()["periodic"].term("x", None, MACHINE), catalogue()["backlash"].term("x", None, MACHINE)]
    result = fitted(MACHINE, x_runs(rng, error, q, dir_x=d), effects=effects, components="none")
    assert is_near(inner_of(result, "periodic:x"), 40.0)
    assert is_near(value_of(result, "backlash:x"), 0.03)


OWN = """
[[effect]]
id = "own-gap"
title = "The gap, written by hand"
channel = "along"
axes = ["x", "y", "z"]
expression = "-(b/2)*d"
looks_like = "a gap"
source = "test"
[effect.coefficients.b]
unit = "mm"

[[effect]]
id = "own-growth"
title = "Growth, written by hand"
channel = "along"
axes = ["x", "y", "z"]
expression = "alpha*T*(q - q_fixed)"
covariates = ["temp"]
looks_like = "growth"
source = "test"
[effect.coefficients.alpha]
unit = "1/K"
[effect.inner.q_fixed]
unit = "mm"
range = "around-axis"
"""


OWN_STEP = """
[[effect]]
id = "own-step"
channel = "along"
axes = ["x"]
expression = "A*step(q - p)"
[effect.coefficients.A]
unit = "mm"
[effect.inner.p]
unit = "mm"
range = "x"
"""


def test_a_users_effect_is_fitted_like_a_built_in_one(tmp_path: Path) -> None:
    path = tmp_path / "own.toml"
    path.write_text(OWN, encoding="utf-8")
    own = {effect.id: effect for effect in load_effects(path)}
    rng = np.random.default_rng(704)
    q, d = there_and_back(8, 25, rng)
    temperature = np.linspace(20.0, 35.0, len(q))
    error = 11.5e-6 * (temperature - 20.0) * (q - 90.0) - 0.5 * 0.03 * d
    observations = x_runs(rng, error, q, dir_x=d, temp_bed=temperature)
    built_in = [
        catalogue()["backlash"].term("x", None, MACHINE),
        catalogue()["thermal-expansion"].term("x", "temp_bed", MACHINE),
    ]
    users = [own["own-gap"].term("x", None, MACHINE), own["own-growth"].term("x", "temp_bed", MACHINE)]
    first = fitted(MACHINE, observations, effects=built_in, components="none")
    second = fitted(MACHINE, observations, effects=users, components="none")
    for one, two in zip(first.terms, second.terms, strict=True):
        assert (one.source, two.source) == ("built-in", "user")
        for a, b in zip((*one.coefficients, *one.inner), (*two.coefficients, *two.inner), strict=True):
            assert b.value == pytest.approx(a.value, rel=1e-12, abs=1e-300)
            assert b.std == pytest.approx(a.std, rel=1e-12, abs=1e-300)
    assert np.allclose(first.residual_mm, second.residual_mm, rtol=0.0, atol=1e-12)
    assert is_near(value_of(first, "thermal-expansion:x@temp_bed"), 11.5e-6)


def test_an_effect_that_the_data_cannot_see_is_not_determined() -> None:
    """A backlash of an axis that never turned, and a lag where nothing moved fast."""
    rng = np.random.default_rng(705)
    q, _ = there_and_back(1, 40, rng)
    effects = [catalogue()["scale"].term("x", None, MACHINE), catalogue()["backlash"].term("x", None, MACHINE)]
    result = fitted(MACHINE, x_runs(rng, 0.0 * q, q, dir_x=np.ones(len(q))), effects=effects, components="none")
    listed = {item.name: item.why for item in result.not_determined}
    assert set(listed) == {"backlash:x"}
    assert "the pose of the measuring frame" in listed["backlash:x"]


@pytest.mark.parametrize("what", ["nine lines", "waves"])
def test_threads_change_no_bit(what: str) -> None:
    rng = np.random.default_rng(706)
    if what == "nine lines":
        _, observations = nine_lines_seen(rng, MACHINE, n_repeats=8)
        results = [fitted(MACHINE, observations, threads=threads, bases=None) for threads in (1, 2, 8)]
    else:
        q, d = there_and_back(40, 60, rng)
        observations = x_runs(rng, 8e-3 * np.sin(2.0 * np.pi * q / 40.0), q, dir_x=d, t=np.arange(len(q)) * 5.0)
        term = catalogue()["periodic"].term("x", None, MACHINE)
        results = [
            fitted(MACHINE, observations, effects=[term], threads=threads, bases=CUBICS) for threads in (1, 2, 8)
        ]
    for other in results[1:]:
        assert [term.to_document() for term in other.terms] == [term.to_document() for term in results[0].terms]
        assert other.covariance.tobytes() == results[0].covariance.tobytes()
        assert other.residual_mm.tobytes() == results[0].residual_mm.tobytes()
        assert other.held_out.residual_mm.tobytes() == results[0].held_out.residual_mm.tobytes()
        assert other.figures == results[0].figures


def test_an_axis_with_its_zero_elsewhere() -> None:
    """Effects count q from where the formula says, also on an axis that runs from −200 to 200 mm."""
    machine = Machine("shifted", "wZbXYt", {axis: Axis((-200.0, 200.0)) for axis in "xyz"})
    rng = np.random.default_rng(707)
    q, d = there_and_back(4, 40, rng)
    q = q - 200.0
    term = catalogue()["scale"].term("x", None, machine)
    result = fitted(machine, x_runs(rng, 50e-6 * q, q, dir_x=d), effects=[term], components="none")
    assert is_near(value_of(result, "scale:x"), 50e-6)


def test_a_jump_is_in_one_session() -> None:
    """At 100 s of the second of three sessions; the first and the third have a 100th second without one."""
    rng = np.random.default_rng(707)
    q, _ = there_and_back(12, 30, rng)
    session = np.repeat([0, 1, 2], 120)
    t = 4.0 * (np.arange(360) % 120)
    jump = 0.02 * ((session == 1) & (t >= 100.0))
    result = fitted(
        MACHINE,
        x_runs(rng, 2e-5 * q + jump, q, session=[str(number) for number in session], t=t),
        effects=(catalogue()["lost-steps"].term("x", None, MACHINE, time_range_s=(0.0, 3 * 476.0)),),
        # Ten standard deviations, while nothing is known of a jump, are gross errors.
        is_robust=False,
    )
    assert is_near(value_of(result, "lost-steps:x"), 0.02)
    # Between the rows of 96 and 100 s, the first session's 476 s before them.
    assert 476.0 + 96.0 < inner_of(result, "lost-steps:x")[0] <= 476.0 + 100.0


def test_wind_up_begins_settled() -> None:
    """Three rows before the first motion, come from below as told: they stay, at what a long way leaves."""
    rng = np.random.default_rng(708)
    q = np.concatenate([np.full(3, 20.0), np.tile([20.5, 22.0, 60.0, 59.4, 58.0, 20.0], 8)])
    d = np.where(np.diff(q, prepend=0.0) >= 0.0, 1.0, -1.0)
    s, error = 1e3, []
    for row in range(len(q)):
        moved = abs(q[row] - q[row - 1]) if row else 0.0
        s = moved if row and d[row] != d[row - 1] else s + moved
        # Strokes of 40 mm at 1.5 mm are long: e^(−40/1.5) is a ten-billionth.
        error.append(-0.5 * 0.03 * d[row] * (1.0 - 2.0 * np.exp(-s / 1.5)))
    term = catalogue()["reversal-windup"].term("x", None, MACHINE)
    result = fitted(MACHINE, x_runs(rng, np.array(error), q, dir_x=d), effects=[term], components="none")
    assert len(result.sightings) == len(q)
    assert is_near(value_of(result, "reversal-windup:x"), 0.03)
    assert is_near(inner_of(result, "reversal-windup:x"), 1.5)
    assert np.abs(result.residual_mm[:3]).max() < 5.0 * STD_MM


def test_a_play_seen_from_one_side_is_not_determined_in_a_program_that_goes_both_ways() -> None:
    """All points lie off alike: a set-up, as long as nothing turns. A program does."""
    x = np.linspace(0.0, 400.0, 21)
    columns = {"x": np.tile(x, 3), "y": np.repeat([0.0, 100.0, 200.0], 21), "z": np.zeros(63), "dir_x": np.ones(63)}
    noise = 1e-3 * np.random.default_rng(8).normal(size=(63, 3))
    columns |= {f"m{axis}": columns[axis] + noise[:, place] for place, axis in enumerate("xyz")}
    play = catalogue()["backlash"].term("x", None, MACHINE)
    model = result_of(
        fit_terms(
            MACHINE, [observations_from_columns(columns)], effects=[play], options=FitOptions(components="none")
        )
    ).model
    (term,) = model.machine_terms
    assert np.isnan(term.coefficients[0].std)
    places = [[100.0, 50.0, 0.0], [300.0, 50.0, 0.0]]
    assert model.is_determined_at(places, at={"d_x": 1.0}).all()
    both = model.is_determined_at(places, at={"d_x": np.array([1.0, -1.0])})
    assert both.tolist() == [[False, True, True]] * 2
    benefit = benefit_of(model, ((0.0, 400.0), (0.0, 200.0), (0.0, 0.0)), {})
    assert benefit is not None
    assert benefit.share_not_determined == 1.0


def test_an_inner_parameter_that_nothing_tells_is_named_and_has_no_error(tmp_path: Path) -> None:
    """A step lies between two positions: nobody can say where."""
    path = tmp_path / "own.toml"
    path.write_text(OWN_STEP, encoding="utf-8")
    (effect,) = load_effects(path)
    x = np.tile(np.arange(0.0, 401.0, 100.0), 12)
    columns = {"x": x, "y": np.zeros(60), "z": np.zeros(60), "mx": x + 0.02 * (x > 150.0)}
    columns["mx"] = columns["mx"] + 1e-3 * np.random.default_rng(9).normal(size=60)
    fit = fit_terms(
        MACHINE,
        [observations_from_columns(columns)],
        effects=[effect.term("x", None, MACHINE)],
        options=FitOptions(components="none"),
    )
    (term,) = fit.terms
    assert term.coefficients[0].value == pytest.approx(0.02, abs=2e-3)
    assert term.coefficients[0].std < 2e-3
    assert np.isnan(term.inner[0].std)
    assert [one.name for one in fit.not_determined] == ["own-step:x"]
