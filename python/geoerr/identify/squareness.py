"""Squareness: the included angle of two axes' directions of travel minus 90° (Li §4.3).

The directions are those of the carriage origins (l = 0), in one session's measuring frame, of the tool relative to
the work: a bed target's travel is reversed before the angle is taken. A line that a carrying axis has turned (on
`wZbXYt` a Y line at another x measures S_xy + ε_zx(x)) has been turned back; where that axis's angle is unknown, two
lines still make an angle if both were taken at the same position of it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from geoerr.identify.axis import AxisFunctions
from geoerr.identify.frames import SessionFrame
from geoerr.identify.linear import Linear, Numbers
from geoerr.identify.transverse import SlopeKey
from geoerr.identify.uncertainty import Noise
from geoerr.machine import AXES

# The pair of axes of each squareness, by ISO name.
PAIRS = {"EC0Y": ("x", "y"), "EB0Z": ("x", "z"), "EA0Z": ("y", "z")}


@dataclass(frozen=True)
class IncludedAngle:
    """S of one pair of axes: value (one, rad, included angle minus 90°) and the sessions that it comes from."""

    angle: Linear
    sessions: tuple[str, ...]


def included_angle(
    pair: tuple[str, str],
    axes: Mapping[str, AxisFunctions],
    frames: Mapping[str, SessionFrame],
    noise: Noise,
) -> IncludedAngle | None:
    """Find S of a pair of axes; sessions are averaged with the weights of their uncertainties.

    To first order S = −(slope of the one towards the other + slope of the other towards the one); the value is the
    exact angle between the two directions.
    """
    if any(axis not in axes for axis in pair):
        return None
    found: list[tuple[str, Linear]] = []
    for session, frame in frames.items():
        if frame.base_from_measured is None or not set(pair) <= frame.axes:
            continue
        keys = _comparable(pair, axes, session)
        if keys is not None:
            found.append((session, _angle(pair, keys, axes, frame)))
    if not found:
        return None
    weights = _weights([angle for _, angle in found], noise)
    total = found[0][1].transformed(np.array([[weights[0]]]))
    for (_, angle), weight in zip(found[1:], weights[1:], strict=True):
        total = total + angle.transformed(np.array([[weight]]))
    return IncludedAngle(total, tuple(session for session, _ in found))


def _comparable(
    pair: tuple[str, str], axes: Mapping[str, AxisFunctions], session: str
) -> tuple[SlopeKey, SlopeKey] | None:
    """Choose the slopes of the two axes towards each other that the same unknown rotations turn, the fewest first."""
    first, second = pair
    towards_second = _keys(axes[first], session, AXES.index(second))
    towards_first = _keys(axes[second], session, AXES.index(first))
    both = [(one, other) for one in towards_second for other in towards_first if one.turned_by == other.turned_by]
    return min(both, key=lambda keys: (len(keys[0].turned_by), keys), default=None)


def _keys(functions: AxisFunctions, session: str, component: int) -> list[SlopeKey]:
    return [key for key in functions.slopes if key.session == session and key.component == component]


def _angle(
    pair: tuple[str, str],
    keys: tuple[SlopeKey, SlopeKey],
    axes: Mapping[str, AxisFunctions],
    frame: SessionFrame,
) -> Linear:
    slopes = [axes[axis].slopes[key] for axis, key in zip(pair, keys, strict=True)]
    directions = [_direction(axis, key, axes[axis], frame) for axis, key in zip(pair, keys, strict=True)]
    cosine = float(np.clip(directions[0] @ directions[1], -1.0, 1.0))
    first_order = (slopes[0] + slopes[1]).transformed(np.array([[-1.0]]))
    return first_order.with_value(np.array([-np.arcsin(cosine)]))


def _direction(axis: str, key: SlopeKey, functions: AxisFunctions, frame: SessionFrame) -> Numbers:
    """Give an axis's direction at the carriage origin, in base components."""
    rotation = frame.base_from_measured
    assert rotation is not None
    direction = rotation @ frame.direction[axis]
    for component in range(3):
        # The slope across the pair hardly matters; where several are known, that with the same parked axes is meant.
        candidates = _keys(functions, key.session, component)
        chosen = [one for one in candidates if one == key] or [
            one for one in candidates if one.component != key.component
        ]
        if chosen:
            direction[component] += float(functions.slopes[min(chosen)].value[0])
    return np.asarray(direction / np.linalg.norm(direction))


def _weights(angles: Sequence[Linear], noise: Noise) -> Numbers:
    std = [noise.std_of(angle) for angle in angles]
    variances = np.array([1.0 if one is None else max(float(one[0]) ** 2, 1e-24) for one in std])
    weights = 1.0 / variances
    return np.asarray(weights / weights.sum())
