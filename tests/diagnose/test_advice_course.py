"""What plans command: inside the travel, in the time that the moves take, each as its words say."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from advice_machine import lines_at_one_feed, machine, measure

from geoerr.diagnose.advice.by_hand import home_again
from geoerr.diagnose.advice.course import Course
from geoerr.diagnose.advice.measurement import Measurement, duration, tidy, uneven
from geoerr.diagnose.advice.menu import feeds_of, four_feeds, menu, one_sided, ramps, short_reversals
from geoerr.diagnose.advice.menu_conditions import warming, work
from geoerr.diagnose.advice.planned import planned
from geoerr.diagnose.advice.question import Question, question_of
from geoerr.diagnose.advice.situation import Situation, situation_of
from geoerr.diagnose.space import space_of
from geoerr.effects import catalogue
from geoerr.fit import FitOptions, fit_terms
from geoerr.fit.start import KINDS
from geoerr.machine import Axis
from geoerr.observations import CARRIERS

EVERYTHING = Question(
    ("x", "y", "z"),
    frozenset({"x", "y", "d_x", "s_x", "v_x", "a_x", "t_rev_x", "mean_v_x", "t", "temp_bed", "temp_frame", "load"}),
    frozenset({"EXX", "EAX", "rig-scale", "rig-tx", "rig-depth", "target-x"}),
)
# Questions without temperatures, and of two bodies of which only the difference was seen.
COLD = replace(EVERYTHING, variables=EVERYTHING.variables - {"temp_bed", "temp_frame"})
BODIES = replace(EVERYTHING, channels=frozenset({"tool-x", "work-x"}))


def _everything(situation: Situation) -> list[Measurement]:
    """Give every plan of the menu that any question has, each once."""
    (seen,) = situation.targets
    relative = replace(situation, targets=(replace(seen, carrier=CARRIERS.index("relative")),))
    plans = [*menu(situation, EVERYTHING), *menu(situation, COLD), *menu(relative, BODIES)]
    return list({plan.name: plan for plan in plans}.values())


@pytest.fixture(scope="module")
def situation() -> Situation:
    log = lines_at_one_feed(np.random.default_rng(1), n_lines=2, n_points=6)
    n = len(log)
    log.columns |= {
        "temp_bed": np.linspace(20.0, 50.0, n),
        "temp_frame": np.full(n, 21.0),
        "load": np.where(np.arange(n) % 2, 2.0, 0.0),
    }
    table = measure(log, lambda log: 0.0 * log.q, 1)
    fitted = fit_terms(machine(), [table], options=FitOptions(components="none", threads=1, is_robust=False))
    return situation_of(fitted, space_of(fitted, threads=1).noise)


def test_a_move_takes_the_time_of_its_trapezium(situation: Situation) -> None:
    own = replace(situation, acceleration_mm_s2=500.0, dwell_s=2.0)
    course = Course(own, is_oriented=False)
    before = course.t_s
    # 100 mm at 50 mm/s: 2 s, and 0.1 s to speed up and slow down.
    course.go(course.at_mm + np.array([100.0, 0.0, 0.0]), 3000.0)
    assert course.t_s - before == pytest.approx(2.1)
    # 1 mm is too short for that speed: up and down in 2 √(1/500).
    before = course.t_s
    course.go(course.at_mm + np.array([0.0, 1.0, 0.0]), 3000.0)
    assert course.t_s - before == pytest.approx(2.0 * np.sqrt(1.0 / 500.0))
    before = course.t_s
    course.look("L")
    assert course.t_s - before == pytest.approx(2.0)
    assert course.direction.tolist() == [1, 1, 1]
    course.go(course.at_mm - np.array([0.0, 1.0, 0.0]), 3000.0)
    assert course.direction.tolist() == [1, -1, 1]


def test_a_run_in_motion_takes_as_many_pictures_as_the_cameras_can(situation: Situation) -> None:
    own = replace(situation, acceleration_mm_s2=None, interval_s=0.5, dwell_s=1.0)
    course = Course(own, is_oriented=False)
    course.at_mm = np.array([0.0, 200.0, 200.0])
    points = np.column_stack([np.linspace(10.0, 300.0, 30), np.full((30, 2), 200.0)])
    course.sweep(points, 3000.0, "L")
    taken = course.pictures()
    # 25 mm in half a second: every third point, and the last one at rest.
    assert taken.is_moving.tolist() == [True] * 10 + [False]
    np.testing.assert_allclose(taken.q_mm[:-1, 0], points[:-1:3, 0])
    np.testing.assert_allclose(taken.t_s[:-1], taken.q_mm[:-1, 0] / 50.0)
    assert taken.t_s[-1] == pytest.approx(300.0 / 50.0 + 1.0)
    # Another run takes others.
    course.go(np.array([0.0, 200.0, 200.0]), 3000.0)
    course.sweep(points, 3000.0, "L", 1)
    assert course.pictures().q_mm[11, 0] == points[1, 0]


def test_every_plan_stays_inside_what_was_measured_and_goes_forward_in_time(situation: Situation) -> None:
    for question in (EVERYTHING, COLD):
        names = [plan.name for plan in menu(situation, question)]
        assert len(set(names)) == len(names)
    plans = _everything(situation)
    names = [plan.name for plan in plans]
    kinds = {name.split(":")[0] for name in names}
    assert {
        *("at-rest", "circles", "feeds", "abba", "short-reversals", "one-sided", "fine-pitch", "diagonals"),
        *(
            "second-lever",
            "moved-cameras",
            "scale-bar",
            "rest",
            "marker+rest",
            "work",
            "warm",
            "warm-on",
            "warm-cool-on",
        ),
        *("marker+warm", "scale-bar+warm", "floor+rest", "floor+warm", "floor+warm-cool-on", "changed", "ramps"),
    } <= kinds
    low, high = situation.span_mm.T
    for plan in plans:
        pictures = plan.pictures
        # The way in before a line may begin a step outside what was measured; no picture is taken there.
        assert (pictures.q_mm >= low - 1e-6).all(), plan.name
        assert (pictures.q_mm <= high + 1e-6).all(), plan.name
        for session in np.unique(pictures.session):
            assert (np.diff(pictures.t_s[pictures.session == session]) > 0.0).all(), plan.name
        assert all(len(values) == len(pictures) for values in plan.conditions.values()), plan.name
        assert plan.minutes(2) == pytest.approx(plan.handling_minutes + 2.0 * pictures.minutes)
        assert plan.text().endswith(duration(plan.minutes())), plan.name
        rows = planned(situation, plan)
        assert len(rows.sightings) == len(pictures) * len(plan.targets)


def _of_size(situation: Situation, span_mm: np.ndarray, more_mm: float) -> Situation:
    """Give a machine of another size, whose axes go a little further than what was measured."""
    ranges = {axis: Axis((low - more_mm, high + more_mm)) for axis, (low, high) in zip("xyz", span_mm, strict=True)}
    return replace(
        situation,
        machine=replace(situation.machine, axes=ranges),
        span_mm=span_mm,
        # A circular test in the corner that further centres lead away from.
        plane="xy",
        radius_mm=0.25 * float(np.ptp(span_mm[:2], axis=1).min()),
        centre_mm=0.75 * span_mm[:, 1] + 0.25 * span_mm[:, 0],
    )


@pytest.mark.parametrize("more_mm", [0.0, 0.05])
@pytest.mark.parametrize(
    "span_mm",
    [
        *([[0.0, length]] * 3 for length in (0.4, 1.0, 2.9, 10.0, 20.0, 30.0, 50.0, 66.7, 100.0, 400.0, 3000.0)),
        [[-900.0, -600.0], [300.0, 700.0], [-700.0, -400.0]],
        [[-33.3, -12.7], [1000.1, 1007.4], [-0.7, 2000.0]],
    ],
    ids=str,
)
def test_no_plan_leads_a_machine_of_any_size_out_of_its_travel(
    situation: Situation, span_mm: list[list[float]], more_mm: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    own = _of_size(situation, np.array(span_mm), more_mm)
    places: list[np.ndarray] = []

    def remember(course: Course, name: str, value: object) -> None:
        object.__setattr__(course, name, value)
        if name == "at_mm":
            # Pictures or not: the machine is sent there.
            places.append(np.asarray(value))

    monkeypatch.setattr(Course, "__setattr__", remember)
    plans = [*_everything(own), *menu(replace(own, is_circular=True), EVERYTHING)]
    assert {"short-reversals", "one-sided", "circle-centres"} <= {plan.name.split(":")[0] for plan in plans}
    low, high = own.span_mm.T
    for plan in plans:
        pictures = plan.pictures
        more = more_mm if plan.is_circular else 0.0
        assert (pictures.q_mm >= low - more - 1e-9).all(), plan.name
        assert (pictures.q_mm <= high + more + 1e-9).all(), plan.name
    assert len(places) > sum(len(plan.pictures) for plan in plans) // 2
    assert (np.array(places) >= low - more_mm - 1e-9).all()
    assert (np.array(places) <= high + more_mm + 1e-9).all()


def test_strokes_of_a_short_axis_are_whole(situation: Situation) -> None:
    plan = short_reversals(_of_size(situation, np.array([[100.0, 120.0]] * 3), 0.0), "x")
    own = np.array([line == "X reversals" for line in plan.pictures.line])
    x = plan.pictures.q_mm[own, 0]
    turns = np.flatnonzero(np.diff(np.sign(np.diff(x)))) + 1
    strokes = np.abs(np.diff(x[turns]))
    # At two feeds and three places: down by 5 mm from where the axis came up to, and up again, as on any machine.
    assert (np.abs(strokes - 5.0) < 1e-9).sum() >= 6
    assert x.min() == 100.0


def test_an_end_of_the_travel_is_not_approached_from_outside(situation: Situation) -> None:
    whole = one_sided(_of_size(situation, np.array([[0.0, 400.0]] * 3), 0.0), "x")
    roomy = one_sided(_of_size(situation, np.array([[0.0, 400.0]] * 3), 10.0), "x")
    assert "every point (the lowest and the highest as the travel allows) approached from below" in whole.words
    assert "every point approached from below" in roomy.words
    np.testing.assert_array_equal(whole.pictures.q_mm, roomy.pictures.q_mm)
    below = np.array([line == "X from below" for line in roomy.pictures.line])
    assert (roomy.pictures.direction[below, 0] == 1).all()
    # To the very end the machine comes from inside, and the rows say so; to every other point it comes as it should.
    at_end = whole.pictures.q_mm[below, 0] == 0.0
    assert (whole.pictures.direction[below, 0] == np.where(at_end, -1, 1)).all()


def test_a_bar_at_one_temperature_says_nothing_of_what_follows_one(situation: Situation) -> None:
    assert "scale-bar" in {plan.name for plan in menu(situation, COLD)}
    names = {plan.name for plan in menu(situation, EVERYTHING)}
    assert "scale-bar" not in names
    assert "scale-bar+warm:temp_bed" in names


def test_a_look_from_the_floor_has_a_pose_of_its_own(situation: Situation) -> None:
    plan = next(plan for plan in _everything(situation) if plan.name == "floor+rest")
    rows = planned(replace(situation, kind=KINDS["parallel"]), plan)
    assert rows.poses.kinds.tolist() == [KINDS["free"]]
    assert [CARRIERS[target.carrier] for target in plan.targets] == ["tool", "work", "base"]
    # Where the target on the work and the marker sit nobody knows beforehand: three numbers each.
    assert rows.own.shape[2] == 6


def test_every_plan_is_in_the_documentation(situation: Situation) -> None:
    page = (Path(__file__).parents[2] / "docs" / "next_measurement.md").read_text(encoding="utf-8")
    plans = [*_everything(situation), *menu(replace(situation, is_circular=True), EVERYTHING)]
    kinds = {plan.name.split(":")[0] for plan in plans}
    assert [kind for kind in kinds if f"`{re.sub('[+].*', '+...', kind)}`" not in page] == []


def test_pictures_in_ramps_have_the_speed_and_place_of_their_moment(situation: Situation) -> None:
    own = replace(situation, interval_s=0.5, dwell_s=1.0)
    course = Course(own, is_oriented=False)
    course.at_mm = np.array([100.0, 200.0, 200.0])
    # Two seconds to 20 mm/s, five at it, two to a stop: 20 + 100 + 20 mm.
    course.ramp(np.array([240.0, 200.0, 200.0]), 20.0, 10.0, "L")
    taken = course.pictures()
    t, x, speed = taken.t_s[:-1], taken.q_mm[:-1, 0] - 100.0, taken.feed_mm_min[:-1] / 60.0
    np.testing.assert_allclose(np.diff(t), 0.5)
    left = 9.0 - t
    expected = np.where(t < 2.0, 5.0 * t**2, np.where(left < 2.0, 140.0 - 5.0 * left**2, 20.0 * (t - 1.0)))
    np.testing.assert_allclose(x, expected)
    np.testing.assert_allclose(speed, np.minimum(20.0, 10.0 * np.minimum(t, left)))
    assert taken.is_moving.tolist() == [True] * len(t) + [False]
    assert taken.t_s[-1] == pytest.approx(10.0)
    # Between two pictures of a ramp the speed changes by the acceleration, which rows show.
    plan = ramps(situation, "x")
    inside = plan.pictures.is_moving
    change = np.abs(np.diff(plan.pictures.feed_mm_min[inside]) / 60.0 / np.diff(plan.pictures.t_s[inside]))
    largest = float(re.search(r"to ([\d.]+) mm/s²", plan.words)[1])  # type: ignore[index]
    assert np.median(change[change > 0.9 * largest]) == pytest.approx(largest)
    assert (change > 0.9 * largest).sum() >= 16


def test_homing_is_between_lines_that_are_the_same(situation: Situation) -> None:
    plan = home_again(situation, ["x", "y"], 2)
    pictures = plan.pictures
    homed = np.array([line.endswith("homed") for line in pictures.line])
    n = int(homed.sum()) // 2
    assert plan.n_sessions == 1
    assert homed[-2 * n :].all()
    # The same places before and after, each time.
    for again in (pictures.q_mm[-2 * n : -n], pictures.q_mm[-3 * n : -2 * n]):
        np.testing.assert_allclose(again, pictures.q_mm[-n:])
    assert (pictures.t_s[[-2 * n, -n]] - pictures.t_s[[-2 * n - 1, -n - 1]] > 30.0).all()
    assert pictures.direction[-n, 0] == 1


def test_directions_are_those_of_the_moves(situation: Situation) -> None:
    for plan in (short_reversals(situation, "x"), four_feeds(situation, ["y"])):
        pictures = plan.pictures
        step = np.diff(pictures.q_mm, axis=0)
        moved = step != 0.0
        np.testing.assert_array_equal(np.sign(step)[moved], pictures.direction[1:][moved])


def test_four_feeds_are_none_beyond_what_the_machine_has_run_at(situation: Situation) -> None:
    for top in (500.0, 1500.0, 6000.0, 30_000.0):
        feeds = feeds_of(replace(situation, top_feed_mm_min=top))
        assert len(feeds) == 4
        assert feeds == sorted(feeds)
        assert feeds[-1] == top
        assert feeds[0] <= 0.15 * top


def test_what_is_heated_gets_hot_and_the_rest_hardly(situation: Situation) -> None:
    plan = warming(situation, ["z"], ["temp_bed"], cools=True)
    bed, frame = plan.conditions["temp_bed"], plan.conditions["temp_frame"]
    assert bed[0] == 20.0
    # Forty minutes are four time constants of ten.
    assert bed.max() == pytest.approx(50.0 - 30.0 * np.exp(-4.0), abs=0.5)
    assert bed[-1] < 25.0
    assert frame.max() - frame.min() == pytest.approx(0.1 * 20.0, rel=0.1)
    assert "heat what temp_bed measures from 20 to 50 °C (nothing else)" in plan.words
    assert "temp_frame" not in plan.words


def test_lines_that_are_run_on_while_it_warms_and_cools_take_no_longer(situation: Situation) -> None:
    watched = warming(situation, ["z"], ["temp_bed"])
    run = warming(situation, ["z"], ["temp_bed"], runs_on=True)
    back = warming(situation, ["z"], ["temp_bed"], runs_on=True, cools=True)
    assert [plan.name for plan in (watched, run, back)] == [
        "warm:temp_bed",
        "warm-on:temp_bed",
        "warm-cool-on:temp_bed",
    ]
    for plan in (run, back):
        assert plan.minutes() < 1.25 * watched.minutes()
        assert len(plan.pictures) > 4 * len(watched.pictures)
        assert np.diff(plan.pictures.t_s).max() < 60.0
        # Every run is a pass of its own.
        assert np.bincount(plan.pictures.pass_number).max() <= 13
    assert "for 40 min, running on all the while, and run the lines again 4 times warm" in run.words
    # On a machine that takes its time a run is enough before and after.
    slow = warming(replace(situation, dwell_s=30.0), ["z"], ["temp_bed"], runs_on=True)
    assert "run z there and back cold, heat" in slow.words
    assert slow.minutes() < 100.0
    assert "for 20 min, running on all the while" in back.words
    assert back.words.endswith("warm, then let it cool for 20 min, running on")
    bed = back.conditions["temp_bed"]
    assert bed.max() > 20.0 + 0.8 * 30.0
    assert bed[-1] < 20.0 + 0.2 * 30.0


def test_hard_use_is_use(situation: Situation) -> None:
    plan = work(situation, "x")
    # Between two rounds the axis runs for four minutes.
    gaps = np.diff(plan.pictures.t_s)
    assert (gaps > 200.0).sum() >= 5
    assert plan.minutes() > 40.0


def test_uneven_steps_show_every_period() -> None:
    at = 25.0 * uneven(36)
    assert at[0] == 0.0
    assert at[-1] == 25.0
    steps = np.diff(at)
    assert steps.min() > 0.0
    assert steps.max() < 4.0 * steps.min()
    # Sine and cosine of any period from two mean steps up are no constant and not each other.
    for period in np.geomspace(1.5, 25.0, 60):
        angle = 2.0 * np.pi * at / period
        columns = np.column_stack([np.ones(36), np.sin(angle), np.cos(angle)])
        assert np.linalg.svd(columns / 6.0, compute_uv=False)[-1] > 0.3


def test_feeds_and_durations_as_people_write_them() -> None:
    assert [tidy(feed) for feed in (74.0, 812.0, 2210.0, 6100.0)] == [80.0, 800.0, 2000.0, 6000.0]
    assert [duration(minutes) for minutes in (0.2, 12.3, 119.0, 150.0)] == ["1 min", "12 min", "119 min", "2.5 h"]


def test_a_question_is_what_its_candidates_are_about() -> None:
    terms = [
        catalogue()[name].term(axis, covariate, machine())
        for name, axis, covariate in (("thermal-drift", "work-z", "temp_bed"), ("reversal-windup", "x", None))
    ]
    question = question_of(terms)
    assert question.axes == ("x", "z")
    assert question.follows_travel
    assert not question.follows_time
    assert not question.moves_view
    assert question_of([catalogue()["camera-drift"].term(None, None, machine())]).moves_view
