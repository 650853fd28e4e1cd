"""A machine that came out of square between sessions is named as such, and nothing else is."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import polars as pl
import pytest
from hidden_machine import Motion, Noise, Numbers, Plan, machine, measure, motion

from geoerr.cli.diagnose_text import diagnosis_lines
from geoerr.diagnose import Diagnosis, compare, diagnose
from geoerr.effects import catalogue
from geoerr.fit import FitOptions, fit_model, fit_terms
from geoerr.model import FitRecord, Model
from geoerr.observations import Lengths, Observations

WHITE = Noise(white=(2.0, 2.0, 2.0))
PLAN = Plan(n_points=16)
CHANGE_RAD = 60e-6
# The first session after it.
AFTER = 2


def knocked(moved: Motion) -> Numbers:
    """The Z column leans along Y from some session on."""
    return np.outer(1e3 * CHANGE_RAD * moved.q[:, 2] * (moved.session >= AFTER), [0.0, 1.0, 0.0])


def play(moved: Motion) -> Numbers:
    return np.outer(-0.5 * 10.0 * moved.d[:, 0], [1.0, 0.0, 0.0])


def leaning_with_warmth(moved: Motion) -> Numbers:
    """It leans with the bed's temperature, which differs from session to session."""
    return np.outer(1e3 * 3e-6 * (moved.bed - 20.0) * moved.q[:, 2], [0.0, 1.0, 0.0])


def observed(hidden: Numbers | float, moved: Motion) -> Observations:
    return measure(np.random.default_rng(5), moved, WHITE, hidden + np.zeros_like(moved.q))


def diagnosed(observations: Observations) -> Diagnosis:
    return diagnose(fit_terms(machine(), [observations], options=FitOptions(threads=1)), threads=1)


@cache
def moved() -> Motion:
    return motion(np.random.default_rng(4), PLAN)


def nearer_cameras(moved: Motion) -> Numbers:
    """The cameras are closer to each other from some session on, and all lengths are too long."""
    return 1e3 * CHANGE_RAD * moved.q * (moved.session >= AFTER)[:, None]


def assert_named_with_its_size(hidden: Callable[[Motion], Numbers], name: str, sign: float) -> None:
    found = diagnosed(observed(hidden(moved()), moved()))
    assert found.verdict == "missing"
    assert [str(one.reference) for one in found.found] == [name]
    held_out = found.found[0].held_out
    assert held_out is not None
    assert held_out.after_um < held_out.before_um
    for number, change in enumerate(found.found[0].term.coefficients, start=1):
        assert change.name.endswith(f"_{number}")
        assert abs(change.value - sign * CHANGE_RAD * (number >= AFTER)) < 4.0 * change.std
        assert change.std < 0.1 * CHANGE_RAD


def test_a_column_that_was_knocked_is_named_with_its_angle() -> None:
    """Seen from the work Z leans the other way. `tests/hard_cases` has a belt."""
    assert_named_with_its_size(knocked, "squareness-change:yz", -1.0)


def test_cameras_that_were_moved_are_no_temperature() -> None:
    """A temperature that differs between sessions was judged beside a drift estimated anew, and a change was not.

    A curve of the bed's took most of it, and what was left of the change had other sizes, of no standard error.
    """
    assert_named_with_its_size(nearer_cameras, "rig-scale-change", 1.0)


@pytest.mark.parametrize(
    ("hidden", "name", "sign"),
    [(knocked, "squareness-change:yz", -1.0), (leaning_with_warmth, "frame-tilt-thermal:yz@temp_bed", None)],
)
def test_two_sessions_tell_a_change_from_a_temperature_that_drifts_within_them(
    hidden, name: str, sign: float | None
) -> None:
    two = motion(np.random.default_rng(11), replace(PLAN, n_sessions=2))
    two = replace(two, session=two.session + AFTER - 1)
    found = diagnosed(observed(hidden(two), two))
    assert [str(one.reference) for one in found.found] == [name]
    assert found.verdict == "missing"
    if sign is not None:
        (change,) = found.found[0].term.coefficients
        assert abs(change.value - sign * CHANGE_RAD) < 4.0 * change.std


@pytest.mark.parametrize(
    ("hidden", "name"), [(play, "backlash:x"), (leaning_with_warmth, "frame-tilt-thermal:yz@temp_bed")]
)
def test_what_is_an_effect_is_no_change_of_the_machine(hidden, name: str) -> None:
    found = diagnosed(observed(hidden(moved()), moved()))
    assert [str(one.reference) for one in found.found] == [name]
    assert found.verdict == "missing"


def test_what_a_session_without_a_sensor_shows_is_seen() -> None:
    """It was left out of the search for the sake of that sensor, and nothing was missing in the others."""
    observations = observed(3.0 * knocked(moved()) * (moved().session >= AFTER + 1)[:, None], moved())
    frame = observations.frame
    is_last = pl.col("session") == frame["session"][-1]
    frame = frame.with_columns(pl.when(is_last).then(None).otherwise(pl.col("temp_frame")).alias("temp_frame"))
    found = diagnosed(replace(observations, frame=frame))
    assert [str(one.reference) for one in found.found] == ["squareness-change:yz"]
    n_unread = int(frame["temp_frame"].is_null().sum())
    assert any(f"without {n_unread} rows of unknown temperature nothing is missing" in note for note in found.notes)


def seen_um(moved: Motion) -> float:
    """Give what a column that leans moves points by, less the rigid motion that fits it best."""
    lean = np.outer(1e3 * CHANGE_RAD * moved.q[:, 2], [0.0, 1.0, 0.0])
    axes = np.broadcast_to(np.eye(3), (len(lean), 3, 3))
    turns = np.cross(np.eye(3)[None], moved.q[:, None, :]).transpose(0, 2, 1)
    rigid = np.concatenate([axes, turns], axis=2).reshape(-1, 6)
    left = lean.reshape(-1) - rigid @ np.linalg.lstsq(rigid, lean.reshape(-1))[0]
    return float(np.sqrt((left.reshape(-1, 3) ** 2).sum(axis=1).mean()))


def test_beside_a_held_model_the_difference_is_told_and_no_effect_to_add() -> None:
    """`geoerr add` was offered for an error that the model has, which it cannot determine a second time."""
    before = fit_model(machine(), observed(0.0, moved())).model
    later = motion(np.random.default_rng(8), replace(PLAN, n_sessions=1))
    found = diagnose(before, observed(knocked(replace(later, session=later.session + AFTER)), later), threads=1)
    first = found.found[0]
    assert str(first.reference) == "squareness:yz"
    assert first.in_model
    (value,) = first.term.coefficients
    assert abs(abs(value.value) - CHANGE_RAD) < 4.0 * value.std
    # Its worth is what no frame takes over, however unsure the model is of it.
    assert first.worth_um == pytest.approx(seen_um(later), rel=0.1)
    assert not any("geoerr add" in line for line in diagnosis_lines(found, "geoerr diagnose", ""))


def test_a_model_with_a_change_holds_later_measurements_as_its_last_session_was() -> None:
    fitted = fit_model(machine(), observed(knocked(moved()), moved()), effects=["squareness-change:yz"]).model
    later = motion(np.random.default_rng(8), replace(PLAN, n_sessions=1))
    # On the whole new file the column leans as since the knock, whatever its session is called.
    leaning = np.outer(1e3 * CHANGE_RAD * later.q[:, 2], [0.0, 1.0, 0.0])
    found = diagnose(fitted, observed(leaning, later), threads=1)
    assert found.verdict == "nothing-missing"
    back = diagnose(fitted, observed(0.0, later), threads=1)
    assert str(back.found[0].reference) == "squareness:yz"
    (angle,) = back.found[0].term.coefficients
    assert abs(abs(angle.value) - CHANGE_RAD) < 5.0 * angle.std


def test_lengths_are_compared_with_the_machine_as_its_last_session_was() -> None:
    change = catalogue()["scale-change"].term("x", None, machine(), sessions=("0", "1", "2")).with_values([0.0, 1e-3])
    record = FitRecord(1e-12 * np.eye(2), np.zeros((2, 0)), covariate_spans={"session": (0.0, 2.0)})
    ends = {"x1": [0.0], "y1": [10.0], "z1": [10.0], "x2": [100.0], "y2": [10.0], "z2": [10.0], "measured": [100.1]}
    compared = compare(Model(machine(), None, (change,), record), Lengths(pl.DataFrame({"feature": ["a"]} | ends)))
    assert compared.lengths is not None
    assert compared.lengths.rms_um < 1e-6
