"""Ties that the advised measurement breaks and the same again does not, simulated by the tests' own arithmetic."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import polars as pl
import pytest
from advice_machine import Hidden, Log, again, joined, lines_at_one_feed, machine, measure, planned_log

from geoerr.diagnose.advice import Advice, Adviser, adviser_of, separation_for
from geoerr.diagnose.advice.by_hand import by_hand
from geoerr.diagnose.advice.situation import situation_of
from geoerr.diagnose.findings import Separation
from geoerr.diagnose.space import space_of
from geoerr.effects import catalogue
from geoerr.fit import FitOptions, fit_terms
from geoerr.observations import CircularTest, read_circular_test
from geoerr.terms import Term

X, Z = np.eye(3)[0], np.eye(3)[2]
# A difference of χ² by which a likelihood is e³ times another's: less is a tie.
TOLD_APART = 6.0
SIZE_UM = 4.0
FEED_MM_S = 25.0


def term(reference: str) -> Term:
    effect, checked = catalogue().resolve(reference)
    return effect.term(checked.axis, checked.covariate, machine())


def adviser(log: Log, hidden: Hidden, names: tuple[str, ...], seed: int, drift: Hidden | None = None) -> Adviser:
    fitted = fit_terms(machine(), [measure(log, hidden, seed, drift=drift)], options=FitOptions(threads=1))
    return adviser_of(fitted, [term(name) for name in names])


def carried_out(log: Log, advice: Advice) -> Log:
    parts, first = [log], int(log.session.max()) + 1
    for plan, times in advice.measurements:
        parts.append(planned_log(plan, times, first))
        first += times * plan.n_sessions
    return joined(*parts)


def lead(own: Adviser, truth: str, advice: Advice) -> float:
    """By how much the truth is better than every other one but those that contain it."""
    others = [n for n, name in enumerate(own.names) if name != truth and (truth, name) not in advice.contained]
    return float(own.gains[own.names.index(truth)] - own.gains[others].max())


def _backlash(log: Log) -> np.ndarray:
    return -SIZE_UM * log.d[:, :1] * X


def _lag(log: Log) -> np.ndarray:
    return -SIZE_UM / FEED_MM_S * log.speed[:, :1] * X


def _stick_slip(log: Log) -> np.ndarray:
    slower = np.exp(-(np.abs(log.speed[:, :1]) - FEED_MM_S) / 20.0)
    return -SIZE_UM * log.d[:, :1] * slower * X


def _windup(log: Log) -> np.ndarray:
    """e → −b·d/2 over 3 mm of travel after each reversal, from where it was."""
    travel, result, at_reversal = log.travel, np.zeros(len(log)), 0.0
    for row in range(len(log)):
        aim = -SIZE_UM * log.d[row, 0]
        if row == 0 or log.session[row] != log.session[row - 1]:
            at_reversal = aim
        elif log.d[row, 0] != log.d[row - 1, 0]:
            at_reversal = result[row - 1]
        result[row] = aim + (at_reversal - aim) * np.exp(-travel[row] / 3.0)
    return result[:, None] * X


REVERSALS = ("backlash:x", "lag:x", "stick-slip:x", "reversal-windup:x")


@pytest.mark.parametrize(
    ("truth", "hidden"),
    list(zip(REVERSALS, (_backlash, _lag, _stick_slip, _windup), strict=True)),
    ids=REVERSALS,
)
def test_what_looks_alike_at_one_feed_is_told_apart_by_the_advice(truth: str, hidden: Hidden) -> None:
    log = lines_at_one_feed(np.random.default_rng(103))
    first = adviser(log, hidden, REVERSALS, 3)
    advice = first.separation()
    assert advice.plan is not None
    assert advice.minutes is not None
    assert advice.minutes < 60.0
    assert advice.separated_share is not None
    assert advice.separated_share >= 0.9
    # Backlash is wind-up over no travel, and stick-slip that no speed ends.
    assert ("backlash:x", "reversal-windup:x") in advice.contained
    assert first.gains.max() - first.gains.min() < 20.0
    after = adviser(carried_out(log, advice), hidden, REVERSALS, 3)
    assert lead(after, truth, advice) > TOLD_APART


def test_as_much_of_the_same_again_leaves_the_tie() -> None:
    log = lines_at_one_feed(np.random.default_rng(103))
    first = adviser(log, _backlash, REVERSALS, 3)
    advice = first.separation()
    assert advice.same_again_delta_chi2 is not None
    assert advice.same_again_delta_chi2 < TOLD_APART
    more = adviser(joined(log, again(log)), _backlash, REVERSALS, 3)
    assert lead(more, "backlash:x", advice) < TOLD_APART


def _warming(log: Log) -> Log:
    log.columns["temp_bed"] = 20.0 + 30.0 * log.t / log.t.max()
    return log


def test_thermal_drift_and_cameras_that_drift_are_told_apart_by_a_static_marker() -> None:
    log = _warming(lines_at_one_feed(np.random.default_rng(5), is_moving=False))
    names = ("thermal-drift:z@temp_bed", "camera-drift")

    def cameras(log: Log) -> np.ndarray:
        return 0.01 * log.t[:, None] * Z

    def nothing(log: Log) -> np.ndarray:
        return 0.0 * log.q

    first = adviser(log, nothing, names, 1, drift=cameras)
    advice = first.separation()
    assert advice.text == "a static reference marker"
    assert [plan.name for plan, _ in advice.measurements] == ["marker+warm-cool-on:temp_bed"]
    after = adviser(carried_out(log, advice), nothing, names, 1, drift=cameras)
    assert lead(after, "camera-drift", advice) > TOLD_APART


def _circle(senses: tuple[int, ...], error: Callable[..., tuple[np.ndarray, np.ndarray]], path: str) -> CircularTest:
    rng, frames = np.random.default_rng(1), []
    n, radius, feed = 120, 100.0, 1500.0
    for number, sense in enumerate((*senses, *senses)):
        angle = sense * 2.0 * np.pi * np.arange(n) / n + 0.1
        cosine, sine = np.cos(angle), np.sin(angle)
        x, y = 200.0 + radius * cosine, 200.0 + radius * sine
        along = error(y - 200.0, -sense * sine * feed / 60.0, sense * cosine * feed / 60.0)
        r = radius + 1e-3 * (along[0] * cosine + along[1] * sine + rng.normal(size=n))
        columns = {"x": x, "y": y, "z": np.full(n, 200.0), "r": r, "feed": np.full(n, feed)}
        frames.append(pl.DataFrame(columns).with_columns(line=pl.lit(f"c{number}"), dir=pl.lit(sense)))
    pl.concat(frames).write_csv(path)
    return read_circular_test(path)


def _shear(y: np.ndarray, _vx: np.ndarray, _vy: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return -0.04 * y, 0.0 * y


def test_squareness_and_servo_mismatch_are_told_apart_by_both_senses(tmp_path: object) -> None:
    names = ("squareness:xy", "servo-mismatch:xy")
    options = FitOptions(threads=1, components="none")
    path = f"{tmp_path}/circle.csv"
    fitted = fit_terms(machine(), [_circle((1,), _shear, path)], options=options)
    own = adviser_of(fitted, [term(name) for name in names])
    assert abs(own.gains[0] - own.gains[1]) < 1e-3 * own.gains[0]
    advice = own.separation()
    assert advice.text == "both senses of the circle"
    assert advice.same_again_delta_chi2 is not None
    assert advice.same_again_delta_chi2 < 0.01
    both = fit_terms(machine(), [_circle((1, -1), _shear, path)], options=options)
    after = adviser_of(both, [term(name) for name in names])
    assert after.gains[0] > after.gains[1] + 100.0


def test_what_acts_through_the_lever_is_told_apart_by_other_levers() -> None:
    log = lines_at_one_feed(np.random.default_rng(6), n_lines=6, is_moving=False)
    log.offset[:] = np.array([0.0, 0.0, -100.0])
    own = adviser(log, lambda log: -5.0 * log.d[:, :1] * X, ("backlash:x", "angular-reversal:x"), 2)
    # The lever is the target's offset, or where the axes that the carriage carries stand: both vary it.
    titles = {one.text for one in own.separation().alternatives} | {own.separation().text}
    assert "targets at other offsets" in titles


def test_what_is_too_small_to_be_told_apart_falls_back_on_the_catalogue() -> None:
    log = lines_at_one_feed(np.random.default_rng(7), n_lines=4, n_points=8)
    table = measure(log, lambda log: 0.0 * log.q, 7)
    fitted = fit_terms(machine(), [table], options=FitOptions(threads=1, components="none"))
    space = space_of(fitted, threads=1)
    terms = [term("backlash:x"), term("stick-slip:x")]
    found = separation_for(space, terms, margin=1e9)
    assert isinstance(found, Separation)
    assert not isinstance(found, Advice)
    assert found.text == "a sweep of feeds"
    # Of a pair that the catalogue knows nothing of it is said that nothing would do.
    unknown = separation_for(space, [term("backlash:x"), term("squareness:yz")], margin=1e9)
    assert isinstance(unknown, Advice)
    assert unknown.plan is None
    assert "no measurement known here would tell backlash:x and squareness:yz apart" in unknown.text


def test_a_jump_is_told_apart_by_homing_and_the_course_is_laid_out() -> None:
    log = lines_at_one_feed(np.random.default_rng(8), n_lines=4, n_points=8, is_moving=False)
    since = (log.session == 0) & (log.t > 70.0)
    table = measure(log, lambda _: 40.0 * since[:, None] * X, 8)
    fitted = fit_terms(machine(), [table], options=FitOptions(threads=1, components="none"))
    lost, knocked = term("lost-steps:x"), term("step")
    lost = lost.with_values([0.04], [71.0])
    knocked = knocked.with_values([0.04, *[0.0] * 5], [71.0])
    found = separation_for(space_of(fitted, threads=1), [lost, knocked])
    assert isinstance(found, Advice)
    assert found.text == "homing again"
    assert [(plan.name, times) for plan, times in found.measurements] == [("home-again", 1)]
    assert found.minutes == found.measurements[0][0].minutes()
    assert "run x there and back" in str(found.plan)
    assert "What lost-steps:x did is gone after homing; what anything else did stays" in str(found.plan)
    # Homing that is itself in doubt is done again and again.
    homing = term("homing-offset:x")
    often = by_hand(situation_of(fitted, space_of(fitted, threads=1).noise), [homing, term("tool-offset")])
    assert often is not None
    assert "3 times over" in often.plan
    assert f"What {homing.id} does is another after each homing" in often.plan
    assert by_hand(situation_of(fitted, space_of(fitted, threads=1).noise), [term("backlash:x")]) is None


def _yielding(log: Log) -> np.ndarray:
    """A tenth of a micrometre for each mm/s² by which the speed changes from picture to picture, both in motion."""
    speed, result = log.speed[:, 0], np.zeros(len(log))
    for row in range(1, len(log)):
        if log.session[row] == log.session[row - 1] and log.moving[row] and log.moving[row - 1]:
            result[row] = -0.1 * (speed[row] - speed[row - 1]) / (log.t[row] - log.t[row - 1])
    return result[:, None] * X


def test_ramps_tell_what_follows_the_acceleration() -> None:
    """At one feed only the turns show it, as they show a spike; in slow ramps it is all the way."""
    log = lines_at_one_feed(np.random.default_rng(9), n_lines=4, feed=3000.0)
    # A picture every 0.6 s.
    log.t *= 0.2
    names = ("acceleration:x", "reversal-spike:x")
    first = adviser(log, _yielding, names, 9)
    assert first.gains.max() - first.gains.min() < 20.0
    advice = first.separation()
    assert [plan.name for plan, _ in advice.measurements] == ["ramps:x"]
    after = adviser(carried_out(log, advice), _yielding, names, 9)
    assert lead(after, "acceleration:x", advice) > TOLD_APART


def _one_course(log: Log) -> Log:
    """Let the frame's temperature follow the bed's at once, as where one heater warms both."""
    share = log.t / log.t.max()
    log.columns |= {"temp_bed": 20.0 + 50.0 * share, "temp_frame": 20.0 + 20.0 * share}
    return log


def _growing(log: Log) -> np.ndarray:
    """Growth of X by a millionth a kelvin of the bed, from its lower end."""
    return 1e-3 * (log.columns["temp_bed"][:, None] - 20.0) * log.q[:, :1] * X


GROWTH = ("thermal-expansion:x@temp_bed", "thermal-expansion:x@temp_frame")


@pytest.fixture(scope="module")
def one_course() -> Log:
    """Many lines: rows in which both temperatures are one outweigh few in which they are not."""
    return _one_course(lines_at_one_feed(np.random.default_rng(21), n_lines=400, is_moving=False))


def test_what_is_told_apart_is_no_longer_alike_either_however_many_rows_there_were(one_course: Log) -> None:
    first = adviser(one_course, _growing, GROWTH, 21)
    assert first.correlations().min() > 0.999
    advice = first.separation()
    assert advice.minutes is not None
    assert advice.minutes < 60.0
    assert advice.still_alike == ()
    expected = first.correlations(advice.measurements)
    assert expected[0, 1] < 0.9
    after = adviser(carried_out(one_course, advice), _growing, GROWTH, 21).correlations()
    # What comes out is what was expected.
    np.testing.assert_allclose(after, expected, atol=0.02)


def test_what_stays_alike_is_told(one_course: Log) -> None:
    """A few places watched while it warms tell the two apart, and leave them alike."""
    advice = adviser(one_course, _growing, GROWTH, 21).separation(most_minutes=50.0)
    assert advice.is_enough
    assert {pair[:2] for pair in advice.still_alike} == {GROWTH, GROWTH[::-1]}
    assert all(0.95 < correlation < 1.0 for _, _, correlation in advice.still_alike)
    assert "their correlation stays above 0.95 all the same: thermal-expansion:x@temp_bed and" in str(advice.plan)


def test_a_plan_in_which_lines_are_run_again_and_again_runs_them_while_it_warms(one_course: Log) -> None:
    plans = {plan.name: plan for plan in adviser(one_course, _growing, GROWTH, 21).plans}
    watched, run = plans["warm:temp_bed"], plans["warm-on:temp_bed"]
    assert "watching 4 places of x every 4 min" in watched.words
    assert "4 times cold, heat what temp_bed measures" in run.words
    assert "running on all the while" in run.words
    # In minutes it is no more than the three further runs cold and warm.
    assert run.pictures.minutes < watched.pictures.minutes + 12.0
    gaps_s = np.diff(run.pictures.t_s)
    assert gaps_s.max() < 60.0
    assert np.diff(watched.pictures.t_s).max() > 120.0
