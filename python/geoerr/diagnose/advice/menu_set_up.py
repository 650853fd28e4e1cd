"""Plans that change what is seen rather than what is done: targets, markers, cameras, a length standard."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from geoerr.diagnose.advice.course import Course, along
from geoerr.diagnose.advice.measurement import Measurement, uneven
from geoerr.diagnose.advice.question import Question
from geoerr.diagnose.advice.situation import Situation, Target
from geoerr.observations import CARRIERS
from geoerr.summaries import listed

_N_POINTS = 13
# How far from the first target the further ones sit.
_LEVER_MM = 120.0
_BAR_MM = 300.0
# What it takes to set cameras up again.
_SET_UP_MINUTES = 15.0
# To fix targets or a marker, and to stand up a bar.
TARGETS_MINUTES, BAR_MINUTES = 10.0, 10.0
_BASE = CARRIERS.index("base")


def menu(situation: Situation, question: Question) -> Iterator[Measurement]:
    """Give the plans that bring into play where the candidates act."""
    moving = [target for target in situation.targets if target.carrier != _BASE]
    if question.turns and moving:
        for axis in question.axes:
            yield second_lever(situation, axis, moving[0])
    if question.stays_in_view:
        yield moved_cameras(situation, question.axes)
    # What a scale follows has to change while the bar is in view: at which temperature the cameras' was right nobody
    # knows.
    if question.scales_view and not question.variables & set(situation.temperatures):
        yield with_bar(situation, question.axes)


def lines(course: Course, axes: Sequence[str], name: str = "", repeat: int = 0, n_points: int = _N_POINTS) -> None:
    """Run every axis there and back, through the middle, at rest."""
    situation = course.situation
    for axis in axes:
        points = along(situation, axis, situation.middle_mm, uneven(n_points))
        course.go(points[0], situation.feed_mm_min)
        course.visit(points, situation.feed_mm_min, f"{axis.upper()}{name}", repeat)
        course.visit(points[-2::-1], situation.feed_mm_min, f"{axis.upper()}{name}", repeat)


def second_lever(situation: Situation, axis: str, target: Target) -> Measurement:
    """Look at targets at other distances from the carriage while an axis runs."""
    course = Course(situation)
    for repeat in range(2):
        lines(course, [axis], repeat=repeat)
    others = [
        Target(target.carrier, target.offset_mm + _LEVER_MM * np.eye(3)[number], target.whitening)
        for number in range(3)
    ]
    words = (
        f"Fix three more targets {_LEVER_MM:.0f} mm from the present one along x, y and z, and run {axis} there and "
        f"back twice, {_N_POINTS} points each, all targets in every picture"
    )
    return Measurement(
        f"second-lever:{axis}",
        "targets at other offsets",
        words,
        course.pictures(),
        (*situation.targets, *others),
        handling_minutes=TARGETS_MINUTES,
    )


def moved_cameras(situation: Situation, axes: Sequence[str]) -> Measurement:
    """Repeat lines with the cameras turned, and moved to the side and away."""
    course = Course(situation)
    lines(course, axes)
    for _ in range(2):
        course.next_session(_SET_UP_MINUTES)
        lines(course, axes)
    depth = float((situation.rotation @ situation.middle_mm + situation.translation_mm)[2])
    aside = 0.3 * float(np.ptp(situation.span_mm, axis=1).max())
    set_ups = np.array(
        [
            [[0.0, 0.0, 0.0], [0.0, 0.0, 0.0]],
            [[0.0, 0.0, 0.5 * np.pi], [0.0, 0.0, 0.0]],
            [[0.0, 0.0, 0.0], [aside, 0.0, 0.1 * depth]],
        ]
    )
    words = (
        f"Run {listed(list(axes))} there and back, turn the cameras by 90 degrees about the work, repeat, then put "
        "them back, a third of what they see to the side and a tenth further away, and repeat"
    )
    return Measurement(
        "moved-cameras", "another place of the cameras", words, course.pictures(), situation.targets, set_ups=set_ups
    )


def marker(situation: Situation) -> Target:
    """Give a marker on the machine's base: beside the middle of the travel, as well seen as the other targets."""
    beside = 0.6 * float(np.ptp(situation.span_mm[0]))
    place = situation.middle_mm + np.array([beside, 0.0, 0.0])
    return Target(_BASE, place, situation.targets[0].whitening)


def from_the_floor(situation: Situation) -> tuple[Target, ...]:
    """Give what cameras on the floor would see instead of the difference of two bodies: each, and the base."""
    seen = situation.targets[0]
    on_work = Target(CARRIERS.index("work"), situation.middle_mm, seen.whitening)
    return Target(CARRIERS.index("tool"), seen.offset_mm, seen.whitening), on_work, marker(situation)


def bar(situation: Situation) -> tuple[Target, ...]:
    """Give two targets on a bar of known length that stands on the base."""
    whitening = situation.targets[0].whitening
    places = situation.middle_mm + np.outer([-0.5, 0.5], [_BAR_MM, 0.0, 0.0])
    return tuple(Target(_BASE, place, whitening) for place in places)


def with_bar(situation: Situation, axes: Sequence[str]) -> Measurement:
    """Hold a scale bar before the cameras in every picture."""
    course = Course(situation)
    lines(course, axes)
    words = (
        f"Stand a scale bar of {_BAR_MM:.0f} mm before the cameras and run {listed(list(axes))} there and "
        "back with its two targets in every picture"
    )
    return Measurement(
        "scale-bar",
        "a length standard",
        words,
        course.pictures(),
        (*situation.targets, *bar(situation)),
        n_on_bar=2,
        handling_minutes=BAR_MINUTES,
    )
