"""Plans that change the conditions: temperatures, time, use, load."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from geoerr.diagnose.advice.course import Course, along
from geoerr.diagnose.advice.measurement import Measurement, duration, uneven
from geoerr.diagnose.advice.menu_set_up import BAR_MINUTES, TARGETS_MINUTES, bar, from_the_floor, lines, marker
from geoerr.diagnose.advice.question import Question
from geoerr.diagnose.advice.situation import Situation
from geoerr.fit.sightings import Numbers
from geoerr.machine import AXES
from geoerr.summaries import listed

# A heated part approaches its end value by this time constant; what is not heated follows by a tenth.
_HEATING_S = 600.0
_FOLLOWS = 0.1
_HEAT_MINUTES, _COOL_MINUTES, _REST_MINUTES = 40.0, 40.0, 40.0
# One round of pictures in so many minutes while something changes.
_EVERY_MINUTES = 4.0
_N_POINTS = 4
# Where lines are run on while it heats, and so often before and after: that takes little. What was measured before
# temperatures went their own ways is thousands of rows in which candidates are one, and a few places every few
# minutes do not outweigh them. Before and after in so many minutes: on a slow machine a run is a quarter of an hour.
_MOST_RUNS, _RUNS_MINUTES = 4, 8.0
# Rounds are numbered from here where it cools.
_FIRST_COOLING = 1000
_WORK_MINUTES = 20.0
_IDLE_DUTY, _FULL_DUTY = 0.05, 0.95


def menu(situation: Situation, question: Question) -> Iterator[Measurement]:
    """Give the plans that change the conditions that candidates are functions of."""
    axes = question.axes
    names = tuple(name for name in situation.temperatures if name in question.variables)
    if names or question.follows_time:
        at_rest = rest(situation, axes)
        yield at_rest
        yield from _seen_otherwise(at_rest, situation, question)
    if question.follows_use:
        for axis in axes:
            yield work(situation, axis)
    for heated in [*((name,) for name in names), *([names] if len(names) > 1 else [])]:
        yield from _of_heat(situation, question, heated)
    for name, (usual, high) in situation.conditions.items():
        if name in question.variables and high > usual:
            yield changed(situation, axes, name, usual, high)


def _of_heat(situation: Situation, question: Question, heated: Sequence[str]) -> Iterator[Measurement]:
    """Give the plans that heat what some sensors sit on."""
    watched, run = warming(situation, question.axes, heated), warming(situation, question.axes, heated, runs_on=True)
    there_and_back = warming(situation, question.axes, heated, runs_on=True, cools=True)
    for warm in (watched, run):
        yield warm
        if question.scales_view:
            yield _with_bar(warm, situation)
    if question.follows_time or question.follows_use:
        yield there_and_back
    # Cameras and bodies move with time as well, and with use. What goes up for an hour time does, too; and what
    # few places show weighs less than what is run all the while.
    for warm in (watched, there_and_back):
        yield from _seen_otherwise(warm, situation, question)


def _seen_otherwise(plan: Measurement, situation: Situation, question: Question) -> Iterator[Measurement]:
    """Give a plan with what shows whether it is the cameras, or which of two bodies, that moved."""
    if question.moves_view and not situation.has_marker:
        yield _with_marker(plan, situation)
    if question.tells_bodies and situation.is_relative:
        yield _from_the_floor(plan, situation)


def rest(situation: Situation, axes: Sequence[str]) -> Measurement:
    """Watch a machine at rest, from its switching on, at even temperatures."""
    course = Course(situation)
    _rounds(course, axes, _REST_MINUTES)
    words = (
        f"Watch {_places(axes)} every {_EVERY_MINUTES:.0f} min for {duration(_REST_MINUTES)} from switching on, the "
        "machine resting in between and no temperature changing"
    )
    return Measurement(
        "rest", "the machine at rest over time", words, course.pictures(), situation.targets, _cold(situation, course)
    )


def work(situation: Situation, axis: str) -> Measurement:
    """Let an axis work hard, then rest, at even surrounding temperatures."""
    course = Course(situation)
    low, high = along(situation, axis, situation.middle_mm, np.array([0.0, 1.0]))
    lines(course, [axis])
    repeat = 1
    starts_s = course.t_s
    while course.t_s - starts_s < 60.0 * _WORK_MINUTES:
        begun_s = course.t_s
        while course.t_s - begun_s < 60.0 * _EVERY_MINUTES:
            course.go(low, situation.top_feed_mm_min)
            course.go(high, situation.top_feed_mm_min)
        _round(course, [axis], repeat)
        repeat += 1
    ends_s = course.t_s
    _rounds(course, [axis], _WORK_MINUTES, first=repeat)
    pictures = course.pictures()
    conditions = _cold(situation, course)
    if "duty" in conditions:
        is_working = (pictures.t_s > starts_s) & (pictures.t_s <= ends_s)
        conditions["duty"] = np.where(is_working, _FULL_DUTY, _IDLE_DUTY)
    words = (
        f"Run {axis} to and fro at {situation.top_feed_mm_min:g} mm/min for {duration(_WORK_MINUTES)}, then let it "
        f"rest as long, and watch {_N_POINTS} places of it every {_EVERY_MINUTES:.0f} min"
    )
    return Measurement(f"work:{axis}", f"hard use of {axis} and rest", words, pictures, situation.targets, conditions)


def warming(
    situation: Situation, axes: Sequence[str], heated: Sequence[str], *, runs_on: bool = False, cools: bool = False
) -> Measurement:
    """Heat what some sensors sit on, the others left cold; then let it cool, if asked for.

    A few places are watched while temperatures change, or the lines are run on: then heating and cooling together
    take the time of heating. What comes back with the temperature neither time nor the use of an axis does.
    """
    course = Course(situation)
    n_runs = _n_runs(situation, axes) if runs_on else 1
    heat_minutes, cool_minutes = (
        (0.5 * _HEAT_MINUTES, 0.5 * _COOL_MINUTES) if runs_on and cools else (_HEAT_MINUTES, _COOL_MINUTES)
    )
    go_on = _running if runs_on else _rounds
    for repeat in range(n_runs):
        lines(course, axes, " cold", repeat)
    heat_s = course.t_s
    go_on(course, axes, heat_minutes)
    for repeat in range(n_runs):
        lines(course, axes, " warm", repeat)
    cool_s = course.t_s
    if cools:
        go_on(course, axes, cool_minutes, first=_FIRST_COOLING)
    pictures = course.pictures()
    since = np.maximum(pictures.t_s - heat_s, 0.0)
    rise = -np.expm1(-since / _HEATING_S)
    if cools:
        later = pictures.t_s > cool_s
        top = -np.expm1(-(cool_s - heat_s) / _HEATING_S)
        rise = np.where(later, top * np.exp(-(pictures.t_s - cool_s) / _HEATING_S), rise)
    conditions = _cold(situation, course)
    for name, (cold, hot) in situation.temperatures.items():
        # What is not heated itself follows a little, and more slowly: half of it after the heating's own time.
        follows = rise if name in heated else _FOLLOWS * rise**2
        conditions[name] = cold + (hot - cold) * follows
    what = listed(
        [
            f"what {name} measures from {cold:.0f} to {hot:.0f} °C"
            for name, (cold, hot) in situation.temperatures.items()
            if name in heated
        ]
    )
    others = "" if len(heated) == len(situation.temperatures) else " (nothing else)"
    watching = f"watching {_places(axes)} every {_EVERY_MINUTES:.0f} min"
    meanwhile = "running on all the while" if runs_on else watching
    cooling = (
        f"let it cool for {duration(cool_minutes)}, running on"
        if runs_on
        else f"watch it cool for {duration(cool_minutes)}"
    )
    end = f", then {cooling}" if cools else ""
    often = "" if n_runs == 1 else f" {n_runs} times"
    words = (
        f"In one set-up: run {listed(list(axes))} there and back{often} cold, heat {what}{others} for "
        f"{duration(heat_minutes)}, {meanwhile}, and run the lines again{often} warm{end}"
    )
    name = f"warm{'-cool' if cools else ''}{'-on' if runs_on else ''}:{'+'.join(heated)}"
    title = f"another temperature of {listed(list(heated))}" + (", rising and falling" if cools else "")
    return Measurement(name, title, words, pictures, situation.targets, conditions)


def changed(situation: Situation, axes: Sequence[str], name: str, usual: float, high: float) -> Measurement:
    """Run lines with a covariate as usual and at its highest, by turns."""
    course = Course(situation)
    values: list[Numbers] = [np.full(course.n_pictures, usual)]
    for number in range(4):
        before = course.n_pictures
        lines(course, axes, repeat=number)
        values.append(np.full(course.n_pictures - before, high if number % 2 else usual))
    conditions = _cold(situation, course) | {name: np.concatenate(values)}
    words = f"Run {listed(list(axes))} there and back four times, with {name} {usual:g} and {high:g} by turns"
    return Measurement(
        f"changed:{name}", f"{name} changed by turns", words, course.pictures(), situation.targets, conditions
    )


def _rounds(course: Course, axes: Sequence[str], minutes: float, first: int = 0) -> None:
    """Look at a few places again and again while time goes by."""
    start_s = course.t_s
    number = first
    while course.t_s - start_s < 60.0 * minutes:
        begun_s = course.t_s
        _round(course, axes, number)
        number += 1
        course.wait(max(60.0 * _EVERY_MINUTES - (course.t_s - begun_s), 0.0))


def _n_runs(situation: Situation, axes: Sequence[str]) -> int:
    """Give how often lines are run in the time that there is for it, once at least."""
    course = Course(situation)
    begins_s = course.t_s
    lines(course, axes)
    return int(np.clip(60.0 * _RUNS_MINUTES // (course.t_s - begins_s), 1, _MOST_RUNS))


def _running(course: Course, axes: Sequence[str], minutes: float, first: int = 0) -> None:
    """Run lines without a break while time goes by."""
    start_s = course.t_s
    number = first
    while course.t_s - start_s < 60.0 * minutes:
        lines(course, axes, " run on", number)
        number += 1


def _round(course: Course, axes: Sequence[str], number: int) -> None:
    situation = course.situation
    for axis in axes:
        points = along(situation, axis, situation.middle_mm, uneven(_N_POINTS))
        course.go(points[0], situation.feed_mm_min)
        course.visit(points, situation.feed_mm_min, f"{axis.upper()} watched", number)


def _cold(situation: Situation, course: Course) -> dict[str, Numbers]:
    n = course.n_pictures
    return {name: np.full(n, cold) for name, (cold, _) in situation.temperatures.items()} | {
        name: np.full(n, usual) for name, (usual, _) in situation.conditions.items()
    }


def _places(axes: Sequence[str]) -> str:
    return f"{_N_POINTS} places of {listed(list(axes or AXES))}"


def _with_marker(plan: Measurement, situation: Situation) -> Measurement:
    words = f"Fix a marker to the machine's base, in every picture. {plan.words}"
    return replace(
        plan,
        name=f"marker+{plan.name}",
        title="a static reference marker",
        words=words,
        targets=(*plan.targets, marker(situation)),
        handling_minutes=TARGETS_MINUTES,
    )


def _from_the_floor(plan: Measurement, situation: Situation) -> Measurement:
    words = (
        "Set the cameras up on the floor, with a target on the tool, one on the work and a marker on the machine's "
        f"base, all in every picture. {plan.words}"
    )
    return replace(
        plan,
        name=f"floor+{plan.name}",
        title="both bodies seen from the floor",
        words=words,
        targets=from_the_floor(situation),
        is_from_the_floor=True,
        handling_minutes=TARGETS_MINUTES,
    )


def _with_bar(plan: Measurement, situation: Situation) -> Measurement:
    words = f"Stand a scale bar of Invar before the cameras, its two targets in every picture. {plan.words}"
    targets = (*plan.targets, *bar(situation))
    return replace(
        plan,
        name=f"scale-bar+{plan.name}",
        title="a static scale bar",
        words=words,
        targets=targets,
        n_on_bar=2,
        handling_minutes=BAR_MINUTES,
    )
