"""One component along one axis, there and back a few times, as a laser interferometer sees it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from geoerr.machine import AXES, Axis, Machine
from geoerr.observations import Observations, observations_from_columns

Numbers = npt.NDArray[np.float64]

LENGTH_MM = 400.0
MACHINE = Machine("bench", "wbXYZt", {axis: Axis((0.0, LENGTH_MM)) for axis in AXES}, tool_offset_mm=(0.0, 0.0, 0.0))


@dataclass(frozen=True, eq=False)
class LaserRun:
    """Rows of a run along X, in the order in which they were measured."""

    x_mm: Numbers
    # Which way the axis went, 1 or −1.
    direction: Numbers
    repeat: Numbers

    def observed(self, error_um: Numbers) -> Observations:
        """Give what a laser shows of this error along X."""
        n = len(self.x_mm)
        return observations_from_columns(
            {
                "line": ["x"] * n,
                "repeat": self.repeat,
                "carrier": ["relative"] * n,
                "x": self.x_mm,
                "y": np.full(n, 200.0),
                "z": np.full(n, 100.0),
                **{f"t{axis}": np.zeros(n) for axis in AXES},
                "dir_x": self.direction,
                "mx": self.x_mm + 1e-3 * error_um,
            }
        )


def laser_run(places_mm: Numbers, n_repeats: int) -> LaserRun:
    """Go to these places, there and back, so many times."""
    n_places = len(places_mm)
    return LaserRun(
        np.tile(np.concatenate([places_mm, places_mm[::-1]]), n_repeats),
        np.tile(np.repeat([1.0, -1.0], n_places), n_repeats),
        np.repeat(np.arange(n_repeats, dtype=np.float64), 2 * n_places),
    )


def draw_laser_run(rng: np.random.Generator, *, n_repeats: int, n_places: int, uneven_mm: float) -> LaserRun:
    """Draw a run whose places, all but the last, are moved up by as much at most, so that no period hides in them."""
    there = np.linspace(0.0, LENGTH_MM, n_places) + np.append(rng.uniform(0.0, uneven_mm, n_places - 1), 0.0)
    return laser_run(there, n_repeats)
