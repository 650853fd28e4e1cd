"""Rows beside reversals: what the record does not tell of them makes no names, and narrow spikes still show there."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt
import polars as pl
import pytest

from geoerr.diagnose.circles import diagnose_circles
from geoerr.diagnose.circles.causes import suspects_of
from geoerr.diagnose.circles.held_out import held_out_square, without_idle
from geoerr.diagnose.circles.names import Names
from geoerr.diagnose.circles.runs import Runs, checked, runs_of
from geoerr.diagnose.circles.state import State
from geoerr.diagnose.circles.undecided import after_entry, beside_reversals
from geoerr.diagnose.comparison import compare
from geoerr.effects import catalogue
from geoerr.machine import Machine
from geoerr.model import Model
from geoerr.observations import CircularTest

Numbers = npt.NDArray[np.float64]
MODEL = Model(Machine.from_chain("wZbXYt", (400.0, 400.0, 300.0)))
R_MM, CENTRE_MM = 100.0, np.array([200.0, 210.0, 0.0])
BOTH = ((1, 600.0), (-1, 600.0), (1, 2400.0), (-1, 2400.0))


def travel(theta: Numbers, sense: int) -> tuple[Numbers, Numbers]:
    """Give X's direction, and its angle since it reversed."""
    since = np.mod(sense * theta, np.pi)
    return -np.where(np.mod(sense * theta, 2.0 * np.pi) < np.pi, 1.0, -1.0), since


def backlash(theta: Numbers, sense: int, feed: float) -> Numbers:
    return -9.0 * travel(theta, sense)[0] * np.cos(theta)


def windup_from_rest(theta: Numbers, sense: int, feed: float) -> Numbers:
    """15 µm within 1 mm; at its first row each run has been standing on the side to which it goes."""
    direction, since = travel(theta, sense)
    turned = sense * (theta - theta[0])
    filled = np.where(turned < np.pi / 2.0, 0.0, 2.0 * np.exp(-R_MM * (1.0 - np.cos(since)) / 1.0))
    return -7.5 * direction * (1.0 - filled) * np.cos(theta)


def spike(theta: Numbers, sense: int, feed: float) -> Numbers:
    """It fades within a third of a degree."""
    direction, since = travel(theta, sense)
    return -6.0 * direction * np.exp(-since * R_MM / (feed / 60.0) / 0.03) * np.cos(theta)


def stick_slip(speed_mm_s: float) -> Callable[[Numbers, int, float], Numbers]:
    """12 µm at rest that fade as X runs faster."""

    def radius(theta: Numbers, sense: int, feed: float) -> Numbers:
        running = np.abs(feed / 60.0 * np.sin(theta))
        return -6.0 * travel(theta, sense)[0] * np.exp(-running / speed_mm_s) * np.cos(theta)

    return radius


def backlash_and_servo(theta: Numbers, sense: int, feed: float) -> Numbers:
    """X lags 0.3 ms behind Y besides."""
    lag_um = -0.3e-3 * 1e3 * (-sense * feed / 60.0 * np.sin(theta))
    return backlash(theta, sense, feed) + lag_um * np.cos(theta)


def circular(
    radius: Callable[[Numbers, int, float], Numbers],
    passes: tuple[tuple[int, float], ...] = BOTH,
    *,
    start: float = 0.3,
    off: float = 0.0,
    n: int = 720,
    seed: int = 0,
) -> CircularTest:
    """Run circles whose record is turned by `off` (rad)."""
    rng = np.random.default_rng(seed)
    frames = []
    for sense, feed in passes:
        theta = sense * (start + np.arange(n) * 2.0 * np.pi / n)
        um = radius(theta, sense, feed) + 14.0 * np.cos(theta) + 0.5 * rng.standard_normal(n)
        said = theta + off
        columns = {"line": ["XY"] * n, "dir": [sense] * n, "feed": [feed] * n, "z": np.zeros(n)}
        columns |= {"x": CENTRE_MM[0] + R_MM * np.cos(said), "y": CENTRE_MM[1] + R_MM * np.sin(said)}
        frames.append(pl.DataFrame(columns | {"r": R_MM + 1e-3 * um}))
    return CircularTest(pl.concat(frames), ("memory",))


def names_of(test: CircularTest) -> list[str]:
    return [str(one.reference) for one in diagnose_circles(MODEL, test).found]


def runs_from(test: CircularTest) -> Runs:
    usable, problems, notes = checked((test,))
    return runs_of(compare(MODEL, *usable).points, problems, notes)


def test_a_record_that_is_turned_by_a_row_makes_no_names() -> None:
    assert names_of(circular(backlash, off=np.radians(0.45))) == ["backlash:x"]


@pytest.mark.parametrize("seed", range(3))
def test_play_that_is_read_at_the_very_reversal_is_no_wind_up(seed: int) -> None:
    """There the axis has not turned yet: 8 rows of 720 lie on the other side."""

    def not_turned(theta: Numbers, sense: int, feed: float) -> Numbers:
        return -3.0 * travel(theta - sense * 1e-6, sense)[0] * np.cos(theta)

    assert names_of(circular(not_turned, start=0.0, n=180, seed=seed)) == ["backlash:x"]


def test_wind_up_is_told_whether_a_circle_is_entered_from_rest_or_not() -> None:
    (found,) = diagnose_circles(MODEL, circular(windup_from_rest, start=0.004, n=360)).found
    assert str(found.reference) == "reversal-windup:x"
    assert {one.name: one.value for one in found.parameters} == pytest.approx({"b": 15e-3, "lambda": 1.0}, rel=0.1)


def test_a_spike_that_shows_beside_reversals_alone_is_found() -> None:
    test = circular(spike, ((1, 1200.0), (-1, 1200.0)), start=0.1)
    diagnosis = diagnose_circles(MODEL, test)
    assert [str(one.reference) for one in diagnosis.found] == ["reversal-spike:x"]


def test_all_rows_are_in_the_figures_and_what_decided_nothing_is_said() -> None:
    diagnosis = diagnose_circles(MODEL, circular(windup_from_rest, start=0.004, n=360))
    assert [run.n_rows for run in diagnosis.runs] == [360] * 4
    (note,) = [note for note in diagnosis.notes if "decided nothing" in note]
    assert note.startswith(f"{len(diagnosis.searched.whole) - len(diagnosis.searched.runs)} rows beside a reversal")


@pytest.mark.parametrize(("sense", "start"), [(1, 0.005), (-1, 0.005), (1, 0.3), (-1, 0.3)])
def test_rows_that_decide_nothing(sense: int, start: float) -> None:
    runs = runs_from(circular(backlash, ((sense, 600.0),), start=start, n=360))
    for some in (runs, runs.without(np.arange(len(runs)) == 0)):
        degrees = np.degrees(some.angle_rad)
        beside = np.abs(degrees - 90.0 * np.rint(degrees / 90.0)) < 1.001
        assert np.array_equal(beside_reversals(some), beside)
        # Nothing has reversed within 12 degrees before 0.3 rad.
        assert after_entry(some).sum() == (12 - (len(some) < len(runs)) if start < 0.1 else 0)


def test_what_one_corner_alone_says_is_not_named_beside_others() -> None:
    def cornered(theta: Numbers, sense: int, feed: float) -> Numbers:
        """Backlash of X, and a bump behind one of the reversals of Y."""
        return backlash(theta, sense, feed) + 6.0 * np.exp(-0.5 * ((np.mod(theta, 2.0 * np.pi) - 1.65) / 0.03) ** 2)

    runs = runs_from(circular(cornered, ((1, 600.0),), n=360))
    suspects, _ = suspects_of(runs, catalogue())
    state = State(runs, suspects)
    names = Names(state, state.bench.chance(*state.context([])[:1], state.n))
    found = []
    for name in ("backlash:x", "reversal-spike:y"):
        basis, left = state.context(found)
        judged = state.bench.judge(basis, left, state.n)
        own = next(one for one in judged if str(suspects[one.what].reference) == name)
        found.append(names._settled(own, basis, left, 0.0))
    assert state.evidence(found[1], found[:1])[0] > 0.0
    assert held_out_square(state, found) > held_out_square(state, found[:1])
    assert without_idle(state, found) == (found[:1], found[1:])


@pytest.mark.parametrize("speed_mm_s", [5.0, 15.0])
def test_stick_slip_has_its_speed_wherever_a_run_is_fast_enough_to_end_it(speed_mm_s: float) -> None:
    diagnosis = diagnose_circles(MODEL, circular(stick_slip(speed_mm_s), n=180))
    (found,) = diagnosis.found
    assert str(found.reference) == "stick-slip:x"
    for parameter, expected in zip(found.parameters, (0.012, speed_mm_s), strict=True):
        assert abs(parameter.value - expected) < 3.5 * parameter.std
    assert diagnosis.verdict == "missing"


def test_a_speed_that_no_run_reaches_is_said_to_be_a_bound() -> None:
    passes = ((1, 1800.0), (-1, 1800.0))
    (found,) = diagnose_circles(MODEL, circular(stick_slip(33.0), passes, n=180)).found
    assert (found.parameters[1].value, found.parameters[1].std) == (30.0, 0.0)
    assert "gone at 30.000 mm/s (the end of its range; ± of the others hold for it alone)" in found.words()


def test_backlash_beside_a_servo_mismatch_is_not_taken_for_stick_slip_that_nothing_ends() -> None:
    diagnosis = diagnose_circles(MODEL, circular(backlash_and_servo, n=180))
    assert {str(one.reference) for one in diagnosis.found} == {"backlash:x", "servo-mismatch:xy"}
    assert diagnosis.verdict == "missing"
