"""The residual by region of the volume: mean, spread and count in each cell of a grid, as mrcal's regional view.

A mean that is not 0 is an error that the model does not have; a count that is low is a place where nobody looked.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np

from geoerr.diagnose.components import components_of
from geoerr.fit import Fitted
from geoerr.fit.figures import figures_of
from geoerr.fit.sightings import SAME_POSITION_MM
from geoerr.machine import AXES

CELLS = 3


@dataclass(frozen=True)
class Region:
    """A box of commanded positions.

    Attributes
    ----------
    low_mm, high_mm
        Its corners; an axis that never moved has one and the same number in both.
    n
        Rows in it that take part.
    rmse_um
        None where it holds no row.
    mean_um, std_um
        Component to mean and standard deviation (n − 1; NaN of one row).
    """

    low_mm: tuple[float, float, float]
    high_mm: tuple[float, float, float]
    n: int
    rmse_um: float | None
    mean_um: dict[str, float]
    std_um: dict[str, float]


def regions_of(fitted: Fitted, cells: int = CELLS) -> tuple[Region, ...]:
    """Cut the commanded range of each axis that moved into `cells` equal parts (2 gives octants); empty ones too."""
    q_mm = fitted.sightings.commanded_mm
    used = fitted.solved.used
    low, high = q_mm.min(axis=0), q_mm.max(axis=0)
    counts = [cells if high[axis] - low[axis] > SAME_POSITION_MM else 1 for axis in range(3)]
    cell = np.zeros((len(q_mm), 3), dtype=np.int64)
    for axis, count in enumerate(counts):
        if count > 1:
            share = (q_mm[:, axis] - low[axis]) / (high[axis] - low[axis])
            cell[:, axis] = np.minimum((share * count).astype(np.int64), count - 1)
    components = components_of(fitted)
    regions = []
    for place in itertools.product(*(range(count) for count in counts)):
        rows = (cell == np.array(place)).all(axis=1) & used
        corners = [
            tuple(
                float(low[axis] + (place[axis] + end) / counts[axis] * (high[axis] - low[axis])) for axis in range(3)
            )
            for end in (0, 1)
        ]
        values = {one.name: one.residual_um[rows & one.is_known] for one in components}
        regions.append(
            Region(
                _three(corners[0]),
                _three(corners[1]),
                int(rows.sum()),
                figures_of(fitted.sightings, fitted.residual_mm, rows).headline_um if rows.any() else None,
                {name: float(own.mean()) for name, own in values.items() if own.size},
                {
                    name: float(own.std(ddof=1)) if own.size > 1 else float("nan")
                    for name, own in values.items()
                    if own.size
                },
            )
        )
    return tuple(regions)


def region_name(region: Region) -> str:
    """Say where a region is: the spans of the axes that moved."""
    spans = [
        f"{axis} {low:.4g} to {high:.4g}".replace("-", "−")
        for axis, low, high in zip(AXES, region.low_mm, region.high_mm, strict=True)
        if high > low
    ]
    return ", ".join(spans) if spans else "one place"


def _three(values: tuple[float, ...]) -> tuple[float, float, float]:
    return values[0], values[1], values[2]
