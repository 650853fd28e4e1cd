"""Measurements that cannot tell some effects apart: too few feeds, places, targets or temperatures that differ."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from validation.hidden_effects.chain import RELATIVE, Array
from validation.hidden_effects.plans import Pass, Plan, in_time, limits_mm, seen

from geoerr.machine import Machine


@dataclass(frozen=True)
class Limits:
    """What a measurement lacks.

    Attributes
    ----------
    feed_mm_min
        The only feed.
    is_moving
        Whether pictures are taken in motion.
    closest_mm
        No point lies nearer than this to where its axis turned, but for the turning point itself.
    n_targets
        On the tool, seen from the work.
    temperatures
        `cold`: none changes; `together`: the frame's follows the bed's at once.
    """

    name: str
    feed_mm_min: float = 3000.0
    is_moving: bool = False
    closest_mm: float = 0.2
    n_targets: int = 3
    temperatures: str = "cold"


N_POINTS = 15


def limited_plan(rng: np.random.Generator, machine: Machine, limits: Limits, n_rows: int) -> Plan:
    """Draw lines along the axes at random places, there and back, in three sessions."""
    low, high = limits_mm(machine)
    n_lines = max(12, round(n_rows / (2 * N_POINTS)))
    passes: list[Pass] = []
    for line in range(n_lines):
        axis = line % 3
        points = np.tile(low + (high - low) * rng.random(3), (N_POINTS, 1))
        points[:, axis] = _spaced(rng, low[axis], high[axis], limits.closest_mm)
        session = 3 * line // n_lines
        way_back = points[-2::-1]
        passes += [
            Pass(session, f"L{line}", 0, False, points, limits.feed_mm_min, limits.is_moving),
            Pass(session, f"L{line}", 0, True, way_back, limits.feed_mm_min, limits.is_moving),
        ]
    moments = in_time(rng, passes)
    of_line = rng.integers(0, limits.n_targets, len(passes))[moments.pass_number]
    targets = [(RELATIVE, one, np.flatnonzero(of_line == one)) for one in range(limits.n_targets)]
    return Plan(limits.name, moments, seen(rng, machine, targets), is_seen_by_cameras=False)


def _spaced(rng: np.random.Generator, low: float, high: float, closest_mm: float) -> Array:
    """Give places from end to end; those beside the ends are as near as may be, or a little further."""
    first = closest_mm * rng.uniform(1.0, 1.5, 2)
    inner = np.linspace(low + first[0], high - first[1], N_POINTS - 2)
    step = inner[1] - inner[0]
    inner[1:-1] += 0.3 * step * rng.uniform(-1.0, 1.0, N_POINTS - 4)
    return np.concatenate([[low], inner, [high]])


def limited_temperatures(limits: Limits, sensors: dict[str, Array]) -> dict[str, Array]:
    """Give what sensors show where temperatures do not change, or change together."""
    room = {name: float(values[0]) for name, values in sensors.items()}
    if limits.temperatures == "cold":
        return {name: np.full_like(values, room[name]) for name, values in sensors.items()}
    bed = sensors["temp_bed"]
    frame = np.round(room["temp_frame"] + 0.4 * (bed - room["temp_bed"]), 3)
    return {"temp_bed": bed, "temp_frame": frame}
