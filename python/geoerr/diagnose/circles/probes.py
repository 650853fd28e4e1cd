"""Structure without a name: smooth functions of the angle, of one axis, of the sense, the feed and the time.

A probe is judged like a cause, against the same noise. What depends on position only is the same in both senses and
at every feed; what turns with the sense depends on the directions; the rest on feed or time.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geoerr.diagnose.circles.runs import Runs
from geoerr.fit.sightings import Numbers

_HARMONICS = (3, 6, 12)
_DEGREES = (3, 5, 8)
_TREND_DEGREES = (1, 3, 6)
# Rows of a run that a harmonic takes at least.
_ROWS_OF_A_HARMONIC = 6


@dataclass(frozen=True, eq=False)
class Probe:
    """A smooth dependence.

    Attributes
    ----------
    depends_on
        Names of its variables, sorted.
    component
        Axis along which it acts, or `r`.
    ways
        Columns (n, k) of rising freedom, in µm.
    """

    depends_on: tuple[str, ...]
    component: str
    ways: tuple[Numbers, ...]

    @property
    def n_trials(self) -> int:
        """Number of ways to write it."""
        return len(self.ways)


def probes_of(runs: Runs) -> list[Probe]:
    """Give all probes that the runs can carry."""
    found: list[Probe] = []
    feeds = np.where(np.isfinite(runs.feed_mm_min), runs.feed_mm_min, 1.0)[runs.run]
    has_feeds = len(runs.feeds()) > 1
    contrast = feeds / feeds.mean() - 1.0
    for plane in runs.planes:
        number = np.array([one == plane for one in runs.plane])
        inside = number[runs.run]
        both = runs.has_both_senses(plane)
        sense = runs.sense[runs.run].astype(np.float64)
        a, b = tuple(plane)
        most = min(len(runs) // max(runs.n_runs, 1) // _ROWS_OF_A_HARMONIC, max(_HARMONICS))
        orders = [order for order in _HARMONICS if order <= most] or [2]
        waves = [_waves(runs.angle_rad, order) * inside[:, None] for order in orders]
        directions = (f"d_{a}", f"d_{b}")
        found.append(Probe((a, b), "r", tuple(waves)))
        if both:
            turning = [np.column_stack([wave, inside]) * sense[:, None] for wave in waves]
            found.append(Probe(tuple(sorted((a, b, *directions))), "r", tuple(turning)))
        if has_feeds:
            found.append(Probe(tuple(sorted((a, b, "feed"))), "r", tuple(w * contrast[:, None] for w in waves)))
            if both:
                with_feed = tuple(wave * contrast[:, None] for wave in turning)
                found.append(Probe(tuple(sorted((a, b, "feed", *directions))), "r", with_feed))
        for place, axis in enumerate(plane):
            own = (np.cos, np.sin)[place](runs.angle_rad)
            other = (np.sin, np.cos)[place](runs.angle_rad)
            direction = sense * np.where(place == 0, -1.0, 1.0) * other
            shapes = [np.polynomial.legendre.legvander(own, degree) for degree in _DEGREES]
            along = tuple(own[:, None] * shape[:, 1:] * inside[:, None] for shape in shapes)
            found.append(Probe((axis,), axis, along))
            across = tuple(other[:, None] * shape[:, 1:] * inside[:, None] for shape in shapes)
            found.append(Probe((axis,), plane[1 - place], across))
            if both:
                gap = np.sign(direction)[:, None] * inside[:, None]
                turned = tuple(own[:, None] * shape * gap for shape in shapes)
                found.append(Probe((f"d_{axis}", axis), axis, turned))
    found.append(Probe(("t",), "r", tuple(_trends(runs, degree) for degree in _TREND_DEGREES)))
    return found


def _waves(angle: Numbers, order: int) -> Numbers:
    k = np.arange(2, order + 1)
    return np.concatenate([np.cos(np.outer(angle, k)), np.sin(np.outer(angle, k))], axis=1)


def _trends(runs: Runs, degree: int) -> Numbers:
    """Give smooth functions of the time within each run, each run its own."""
    columns = np.zeros((len(runs), degree * runs.n_runs))
    for number, own in enumerate(runs.slices):
        t = runs.travelled_rad[own]
        u = 2.0 * t / max(float(t[-1]), 1e-300) - 1.0
        columns[own, degree * number : degree * (number + 1)] = np.polynomial.legendre.legvander(u, degree)[:, 1:]
    return columns
