"""Everything that a user could measure next on this machine, as plans for the axes in question."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from geoerr.diagnose.advice import menu_conditions, menu_set_up
from geoerr.diagnose.advice.course import Course, along
from geoerr.diagnose.advice.measurement import Measurement, feeds_words, tidy, uneven
from geoerr.diagnose.advice.question import Question
from geoerr.diagnose.advice.situation import Situation
from geoerr.fit.sightings import SAME_POSITION_MM, Numbers
from geoerr.machine import AXES
from geoerr.summaries import listed

_N_POINTS = 25
# Four feeds from a twentieth of the highest one.
_SLOWEST = 1.0 / 20.0
_SLOWEST_MM_MIN = 60.0
# A fast run that is repeated for the cameras' sake is repeated so often at most.
_MOST_SWEEPS = 4
# Distances from a reversal, mm, and the strokes between reversals.
_CLOSE_MM = (0.1, 0.3, 1.0, 3.0)
_STROKES_MM = (5.0, 10.0, 20.0)
_WINDOW_MM, _N_FINE = 25.0, 36
_N_ROUND = 48
# Pictures within a ramp, and runs there and back.
_RAMP_PICTURES, _RAMP_RUNS = 2.0, 8


def menu(situation: Situation, question: Question) -> Iterator[Measurement]:
    """Give every plan that varies what some candidate is a function of.

    Circular tests where nothing else was measured.
    """
    if situation.is_circular:
        yield from _circular_tests(situation)
        return
    yield from _speeds(situation, question)
    yield from _ways(situation, question)
    yield diagonals(situation)
    yield from menu_set_up.menu(situation, question)
    yield from menu_conditions.menu(situation, question)


def _speeds(situation: Situation, question: Question) -> Iterator[Measurement]:
    axes = question.axes
    if situation.is_in_motion and question.follows_speed:
        yield at_rest(situation, axes)
        for plane in _planes(axes):
            yield circles(situation, plane)
    if situation.is_in_motion and question.follows_acceleration:
        for axis in axes:
            yield ramps(situation, axis)
    if question.follows_speed:
        for some in [*((axis,) for axis in axes), *([axes] if len(axes) > 1 else [])]:
            yield four_feeds(situation, some)


def _ways(situation: Situation, question: Question) -> Iterator[Measurement]:
    for axis in question.axes:
        if question.follows_direction or question.follows_time:
            yield there_back_back_there(situation, axis)
        if question.follows_travel:
            yield short_reversals(situation, axis)
        if question.follows_direction:
            yield one_sided(situation, axis)
        if axis in question.variables:
            yield fine_pitch(situation, axis)


def feeds_of(situation: Situation) -> list[float]:
    """Give four feeds, slow to fast, none beyond the highest that the machine is known to run at."""
    top = situation.top_feed_mm_min
    slowest = min(max(top * _SLOWEST, _SLOWEST_MM_MIN), 0.5 * top)
    return sorted({*(tidy(float(feed)) for feed in np.geomspace(slowest, top, 4)[:-1]), top})


def at_rest(situation: Situation, axes: Sequence[str]) -> Measurement:
    """Stop for every picture."""
    course, feed = Course(situation), situation.feed_mm_min
    for axis in axes:
        points = along(situation, axis, situation.middle_mm, uneven(_N_POINTS))
        course.go(points[0], feed)
        course.visit(points, feed, f"{axis.upper()} at rest")
        course.visit(points[-2::-1], feed, f"{axis.upper()} at rest")
    way = listed([f"{axis} {_range(situation, axis)}" for axis in axes])
    words = f"Run {way} there and back, {_at_rest()}"
    return Measurement("at-rest", "points at rest", words, course.pictures(), situation.targets)


def four_feeds(situation: Situation, axes: Sequence[str]) -> Measurement:
    """Go there and back at four feeds."""
    course, feeds = Course(situation), feeds_of(situation)
    for axis in axes:
        points = along(situation, axis, situation.middle_mm, uneven(_N_POINTS))
        for feed in feeds:
            course.go(points[0], situation.feed_mm_min)
            there_and_back(course, points, feed, f"{axis.upper()} at {feed:g}")
    way = listed([f"{axis} {_range(situation, axis)}" for axis in axes])
    return Measurement(
        f"feeds:{''.join(axes)}",
        f"four feeds along {listed(list(axes))}",
        f"Run {way} there and back at {feeds_words(feeds)}, {_how(situation)}",
        course.pictures(),
        situation.targets,
    )


def there_and_back(course: Course, points_mm: Numbers, feed_mm_min: float, line: str, first: int = 0) -> None:
    """Take points there and back: in motion where pictures are, as often as the cameras need to see the points."""
    situation = course.situation
    if not situation.is_in_motion:
        course.visit(points_mm, feed_mm_min, line, first)
        course.visit(points_mm[-2::-1], feed_mm_min, line, first)
        return
    way = float(np.linalg.norm(points_mm[-1] - points_mm[0]))
    seen = 60.0 * way / feed_mm_min / situation.interval_s
    n_sweeps = int(np.clip(np.ceil(len(points_mm) / max(seen, 1.0)), 1, _MOST_SWEEPS))
    course.look(line, first)
    for number in range(n_sweeps):
        course.sweep(points_mm[1:], feed_mm_min, line, first + number)
        course.sweep(points_mm[-2::-1], feed_mm_min, line, first + number)


def there_back_back_there(situation: Situation, axis: str) -> Measurement:
    """Let drift and direction have nothing in common."""
    course, feed = Course(situation), situation.feed_mm_min
    points = along(situation, axis, situation.middle_mm, uneven(_N_POINTS))
    for number in range(2):
        for sense, way in enumerate((points, points[::-1], points[::-1], points)):
            course.go(way[0], feed)
            course.visit(way, feed, f"{axis.upper()} ABBA", 4 * number + sense)
    words = f"Run {axis} {_range(situation, axis)} in the order there, back, back, there, twice over, {_at_rest()}"
    return Measurement(
        f"abba:{axis}", "the order there, back, back, there", words, course.pictures(), situation.targets
    )


def short_reversals(situation: Situation, axis: str) -> Measurement:
    """Take points close after reversals, of short strokes and at two feeds."""
    course = Course(situation)
    unit = np.eye(3)[AXES.index(axis)]
    low, high = along(situation, axis, situation.middle_mm, np.array([0.0, 1.0]))
    length = float(np.ptp(situation.span_mm[AXES.index(axis)]))
    fast = situation.feed_mm_min
    feeds = [tidy(fast / 4.0), fast]
    strokes = [stroke for stroke in _STROKES_MM if stroke < 0.3 * length] or [0.3 * length]
    repeat = 0
    for feed in feeds:
        for share in (0.15, 0.5, 0.85):
            # The strokes lead down from where they begin: on a short axis the lowest of the places has to be higher.
            start = along(situation, axis, situation.middle_mm, np.array([max(share, max(strokes) / length)]))[0]
            # Pictures wherever the axis turns: without them nobody knows the travel since.
            way_in = np.array([start - 0.15 * length * unit, start])
            course.visit(way_in, situation.feed_mm_min, f"{axis.upper()} reversals", repeat)
            for stroke in strokes:
                close = np.array([*(close for close in _CLOSE_MM if close < 0.5 * stroke), 0.5 * stroke, stroke])
                for sense in (-1.0, 1.0):
                    turn = course.at_mm.copy()
                    # What reaches the very end of the axis is not to pass it by its rounding.
                    points = np.clip(turn + sense * close[:, None] * unit, low, high)
                    course.visit(points, feed, f"{axis.upper()} reversals", repeat)
                    repeat += 1
    words = (
        f"Reverse {axis} at three places after strokes of {listed([f'{s:g}' for s in strokes])} mm, "
        f"at {feeds_words(feeds)}, and look {listed([f'{c:g}' for c in _CLOSE_MM])} mm after each reversal, halfway "
        "and at its end"
    )
    return Measurement(
        f"short-reversals:{axis}",
        f"points close after reversals of {axis}",
        words,
        course.pictures(),
        situation.targets,
    )


def one_sided(situation: Situation, axis: str) -> Measurement:
    """Approach every point from below, twice; then from above, twice."""
    course, feed = Course(situation), situation.feed_mm_min
    points = along(situation, axis, situation.middle_mm, uneven(_N_POINTS))
    room = _room_mm(situation)
    ends = []
    for sense, way in enumerate((points, points[::-1])):
        before = np.clip(way[0] + 0.2 * (way[0] - way[1]), *room)
        if np.abs(before - way[0]).max() <= SAME_POSITION_MM:
            # What was measured ends where the travel ends: nothing comes to that point from outside.
            before = way[0]
            ends.append(f"the {'highest' if sense else 'lowest'}")
        for number in range(2):
            course.go(way[0], feed)
            course.go(before, feed)
            course.visit(way, feed, f"{axis.upper()} from {'above' if sense else 'below'}", number)
    but = f" ({listed(ends)} as the travel allows)" if ends else ""
    words = (
        f"Run {axis} {_range(situation, axis)} with every point{but} approached from below, twice, then from above, "
        "twice"
    )
    return Measurement(
        f"one-sided:{axis}", f"one-sided approach along {axis}", words, course.pictures(), situation.targets
    )


def fine_pitch(situation: Situation, axis: str) -> Measurement:
    """Take uneven steps of less than a millimetre in three windows."""
    course, feed = Course(situation), situation.feed_mm_min
    low, high = situation.span_mm[AXES.index(axis)]
    window = min(_WINDOW_MM, 0.3 * (high - low))
    for number, share in enumerate((0.0, 0.5, 1.0)):
        first = low + share * (high - low - window)
        shares = (first + window * uneven(_N_FINE) - low) / (high - low)
        points = along(situation, axis, situation.middle_mm, shares)
        course.go(points[0], feed)
        course.visit(points, feed, f"{axis.upper()} fine {number + 1}")
        course.visit(points[-2::-1], feed, f"{axis.upper()} fine {number + 1}")
    words = (
        f"Take {_N_FINE} points in uneven steps of {window / (_N_FINE - 1):.1f} mm on average, there and back, in "
        f"three windows of {window:g} mm at the ends and in the middle of {axis}"
    )
    return Measurement(
        f"fine-pitch:{axis}", f"fine uneven steps of {axis}", words, course.pictures(), situation.targets
    )


def ramps(situation: Situation, axis: str) -> Measurement:
    """Take points in ramps that are slow enough for the cameras, and at constant speed between them."""
    course = Course(situation)
    low, high = along(situation, axis, situation.middle_mm, np.array([0.0, 1.0]))
    length = float(high[AXES.index(axis)] - low[AXES.index(axis)])
    ramp_s = _RAMP_PICTURES * situation.interval_s
    # Half of the way is at constant speed.
    top_mm_s = min(situation.top_feed_mm_min / 60.0, 0.5 * length / ramp_s)
    acceleration = tidy(top_mm_s / ramp_s)
    course.go(low, situation.feed_mm_min)
    course.look(f"{axis.upper()} ramps")
    for number in range(_RAMP_RUNS):
        course.ramp(high, top_mm_s, acceleration, f"{axis.upper()} ramps", number)
        course.ramp(low, top_mm_s, acceleration, f"{axis.upper()} ramps", number)
    words = (
        f"Set the acceleration of {axis} to {acceleration:g} mm/s², so low that the cameras see its ramps, run it "
        f"{_range(situation, axis)} there and back {_RAMP_RUNS} times at {60.0 * top_mm_s:.0f} mm/min without a stop "
        f"on the way, a picture every {situation.interval_s:.1f} s; feed is the speed at each picture's moment"
    )
    return Measurement(f"ramps:{axis}", f"points in the ramps of {axis}", words, course.pictures(), situation.targets)


def diagonals(situation: Situation) -> Measurement:
    """Run the four space diagonals there and back."""
    course, feed = Course(situation), situation.feed_mm_min
    low, length = situation.span_mm[:, 0], np.ptp(situation.span_mm, axis=1)
    for number in range(4):
        turned = np.array([False, bool(number & 1), bool(number & 2)])
        shares = uneven(_N_POINTS)[:, None]
        points = low + length * np.where(turned, 1.0 - shares, shares)
        course.go(points[0], feed)
        course.visit(points, feed, f"D{number + 1}")
        course.visit(points[-2::-1], feed, f"D{number + 1}")
    words = f"Run the four space diagonals there and back, {_at_rest()}"
    return Measurement("diagonals", "points off the axis lines", words, course.pictures(), situation.targets)


def circles(situation: Situation, plane: str) -> Measurement:
    """Take circles in both senses at two feeds, points in motion."""
    course = Course(situation)
    feeds = [tidy(situation.feed_mm_min / 4.0), situation.feed_mm_min]
    places = [AXES.index(axis) for axis in plane]
    radius = 0.4 * float(np.ptp(situation.span_mm[places], axis=1).min())
    for feed in feeds:
        for sense in (1, -1):
            points = _round(situation.middle_mm, radius, plane, sense)
            course.go(points[0], situation.feed_mm_min)
            line = f"{plane.upper()} circle {'+' if sense > 0 else '-'} at {feed:g}"
            course.look(line)
            course.sweep(points[1:], feed, line)
    words = f"Run a circle of {radius:.0f} mm in {plane} in both senses at {feeds_words(feeds)}, points in motion"
    return Measurement(
        f"circles:{plane}",
        f"circles in both senses at two feeds in {plane}",
        words,
        course.pictures(),
        situation.targets,
    )


def _circular_tests(situation: Situation) -> Iterator[Measurement]:
    plane, radius = situation.plane, situation.radius_mm
    usual = situation.feed_mm_min
    slow, slower = tidy(usual / 4.0), tidy(usual / 16.0)
    both = f"Run the circle of {radius:.0f} mm in {plane} in both senses"
    yield _runs(
        situation, "circle-senses", "both senses of the circle", both, [(usual, sense, 0.0) for sense in (1, -1)]
    )
    for name, feeds in (("circle-feeds", [slow, usual]), ("circle-many-feeds", [slower, slow, usual])):
        runs = [(feed, sense, 0.0) for feed in feeds for sense in (1, -1)]
        yield _runs(situation, name, "the circle at other feeds", f"{both} at {feeds_words(feeds)}", runs)
    moved = [(usual, sense, shift) for shift in (0.0, 0.5) for sense in (1, -1)]
    words = f"{both}, then with the centre half a radius further along both"
    yield _runs(situation, "circle-centres", "a second centre of the circle", words, moved)
    words = f"Run three circles of {radius:.0f} mm in {plane} on end in each sense"
    runs = [(usual, sense, 0.0) for sense in (1, -1)]
    yield _runs(situation, "circle-on-end", "three circles on end", words, runs, n_rounds=3)


def _runs(
    situation: Situation,
    name: str,
    title: str,
    words: str,
    runs: Sequence[tuple[float, int, float]],
    n_rounds: int = 1,
) -> Measurement:
    """Make circular tests: each run of feed, sense and shift of the centre (radii) is a session of its own."""
    course = Course(situation, is_oriented=False)
    ranges = np.array([situation.machine.axes[axis].range_mm for axis in AXES])
    for number, (feed, sense, shift) in enumerate(runs):
        if number:
            course.next_session()
        inside = [AXES.index(axis) for axis in situation.plane]
        centre = situation.centre_mm.copy()
        centre[inside] += shift * situation.radius_mm
        room = np.array([ranges[:, 0] + situation.radius_mm, ranges[:, 1] - situation.radius_mm])
        centre[inside] = np.clip(centre, np.minimum(*room), np.maximum(*room))[inside]
        points = _round(centre, situation.radius_mm, situation.plane, sense)
        course.go(points[0], feed)
        for again in range(n_rounds):
            course.sweep(points[1:], feed, f"run {number + 1}", again)
    return Measurement(name, title, words, course.pictures(), situation.targets, is_circular=True)


def _round(centre_mm: Numbers, radius_mm: float, plane: str, sense: int) -> Numbers:
    angle = 2.0 * np.pi * sense * np.arange(_N_ROUND + 1) / _N_ROUND
    first, second = (np.eye(3)[AXES.index(axis)] for axis in plane)
    return np.asarray(centre_mm + radius_mm * (np.cos(angle)[:, None] * first + np.sin(angle)[:, None] * second))


def _planes(axes: Sequence[str]) -> list[str]:
    planes = [first + second for first in AXES for second in AXES if first < second]
    inside = [plane for plane in planes if set(plane) <= set(axes)]
    return inside or [plane for plane in planes if set(plane) & set(axes)][:1]


def _room_mm(situation: Situation) -> Numbers:
    """Give where the machine can go, (2, 3) from low to high: its range, and wherever else it was."""
    ranges = np.array([situation.machine.axes[axis].range_mm for axis in AXES])
    span = situation.span_mm
    return np.array([np.minimum(ranges[:, 0], span[:, 0]), np.maximum(ranges[:, 1], span[:, 1])])


def _range(situation: Situation, axis: str) -> str:
    low, high = situation.span_mm[AXES.index(axis)]
    return f"from {low:.0f} to {high:.0f} mm"


def _how(situation: Situation) -> str:
    return f"{_N_POINTS} points each" + (", pictures in motion" if situation.is_in_motion else "")


def _at_rest() -> str:
    return f"{_N_POINTS} points each, pictures at rest"
