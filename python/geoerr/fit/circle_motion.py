"""How the axes moved when a row of a circular test was taken, from the circle itself.

A ball bar is read in full motion, after a run-in on the same circle. So direction, travel and time since the last
reversal, speed and acceleration are those of a circle at a constant feed, also at the first rows of a run, whose
reversal lies before them:

| name | formula, arm = q − centre, φ = angle travelled since the axis reversed |
|---|---|
| `d` | sign of the speed; at the reversal itself that of the way back |
| `s` | R (1 − cos φ) = R + d · arm |
| `t_rev` | φ R / F |
| `v`, `a` | tangent · F, −(F/R)² · arm |

The axis that stands still has come from somewhere, on a long stroke and long ago: on a circle that is a constant.
"""

from __future__ import annotations

import numpy as np

from geoerr.commanded_circle import circle_through, plane_of
from geoerr.fit.sightings import Numbers, Sightings

# Commanded points farther from their circle than this share of its radius lie on none: told by the order of rows.
_OFF_CIRCLE = 1e-2
_FEWEST_POINTS = 4
# Of the axis that stands still: direction, travel, time since the reversal.
_RESTING = {"d": 1.0, "s": 100.0, "t_rev": 1e3, "v": 0.0, "a": 0.0}
# Slower than this share of the feed an axis is at its reversal.
_AT_REVERSAL = 1e-9
NAMES = ("d", "s", "t_rev", "v", "a")


def circle_motion(sightings: Sightings, times_s: Numbers, feed_mm_min: Numbers) -> dict[str, Numbers]:
    """Give `d s t_rev v a` by axis, each (n,), for rows of circular tests; NaN for all others.

    Parameters
    ----------
    times_s : (n,)
        Time, or the number of the row where there is none: gives the speed where there is no feed.
    feed_mm_min : (n,)
        NaN where it is not known.
    """
    n = len(sightings)
    found = {f"{name}_{axis}": np.full(n, np.nan) for name in NAMES for axis in "xyz"}
    is_circle = sightings.of_kind("circle")
    stated = np.nan_to_num(sightings.numbers("dir"))
    for number in np.unique(sightings.pass_number[is_circle]):
        rows = np.flatnonzero(sightings.pass_number == number)
        _one_pass(found, rows, sightings.commanded_mm[rows], stated[rows], times_s[rows], feed_mm_min[rows])
    return found


def _one_pass(
    found: dict[str, Numbers], rows: np.ndarray, q_mm: Numbers, stated: Numbers, times_s: Numbers, feed: Numbers
) -> None:
    span = np.ptp(q_mm, axis=0)
    first, second, third = plane_of(q_mm)
    plane = q_mm[:, [first, second]]
    if len(rows) < _FEWEST_POINTS or span[third] > _OFF_CIRCLE * float(span.max()):
        return
    centre, radius = circle_through(plane)
    arm = plane - centre
    distance = np.hypot(*arm.T)
    if not np.abs(distance - radius).max() <= _OFF_CIRCLE * radius:
        return
    angle = np.unwrap(np.arctan2(arm[:, 1], arm[:, 0]))
    travelled = float(angle[-1] - angle[0])
    sense = np.where(stated != 0.0, np.sign(stated), np.sign(travelled))
    if not sense.all():
        return
    time = float(times_s[-1] - times_s[0])
    mean_speed = radius * abs(travelled) / time if time > 0.0 else np.nan
    speed = np.where(np.isfinite(feed), feed / 60.0, mean_speed)
    tangent = sense[:, None] * np.column_stack([-arm[:, 1], arm[:, 0]]) / radius
    for name, value in _RESTING.items():
        found[f"{name}_{'xyz'[third]}"][rows] = value
    for place, index in enumerate((first, second)):
        own = arm[:, place]
        direction = np.where(np.abs(tangent[:, place]) > _AT_REVERSAL, np.sign(tangent[:, place]), -np.sign(own))
        since = np.arccos(np.clip(-direction * own / radius, -1.0, 1.0))
        columns = {
            "d": direction,
            "s": np.maximum(radius + direction * own, 0.0),
            "t_rev": since * radius / speed,
            "v": tangent[:, place] * speed,
            "a": -((speed / radius) ** 2) * own,
        }
        for name, values in columns.items():
            found[f"{name}_{'xyz'[index]}"][rows] = values
