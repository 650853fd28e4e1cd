"""Residuals component by component: x, y, z of the base frame, radii of circular tests, and lengths."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geoerr.fit import Fitted
from geoerr.fit.lengths import is_told
from geoerr.fit.sightings import Numbers
from geoerr.machine import AXES

RADIUS = "radius"
LENGTH = "length"
UM_PER_MM = 1e3


@dataclass(frozen=True, eq=False)
class Component:
    """One component of the residuals.

    Attributes
    ----------
    name
        `x`, `y`, `z`, `radius` or `length`.
    residual_um : (n,)
        Measured minus predicted; NaN where it was not measured or the row takes no part. Of a length at its second
        end, and NaN at its first.
    """

    name: str
    residual_um: Numbers

    @property
    def is_known(self) -> np.ndarray:
        """Rows that have it, (n,)."""
        return np.asarray(np.isfinite(self.residual_um))


def is_circle(fitted: Fitted) -> np.ndarray:
    """Tell which rows are radii of circular tests, (n,)."""
    return fitted.sightings.of_kind("circle")


def is_length(fitted: Fitted) -> np.ndarray:
    """Tell which rows are ends of measured lengths, (n,)."""
    return fitted.sightings.of_kind("lengths")


def is_position(fitted: Fitted) -> np.ndarray:
    """Tell which rows are positions that a device saw, (n,): a radius and a length point nowhere in the volume."""
    return np.asarray(~(is_circle(fitted) | is_length(fitted)))


def components_of(fitted: Fitted) -> tuple[Component, ...]:
    """Give the components that were measured in any row that takes part."""
    circle, of_lengths = is_circle(fitted), is_length(fitted)
    used = fitted.solved.used
    residual_um = fitted.residual_mm * UM_PER_MM
    found = []
    for index, axis in enumerate(AXES):
        seen = fitted.sightings.is_measured[:, index] & used & is_position(fitted)
        found.append(Component(axis, np.where(seen, residual_um[:, index], np.nan)))
    found.append(Component(RADIUS, np.where(circle & used, residual_um[:, 0], np.nan)))
    second_end = of_lengths & is_told(fitted.sightings)[:, 0]
    found.append(Component(LENGTH, np.where(second_end & used, residual_um[:, 0], np.nan)))
    return tuple(component for component in found if component.is_known.any())
