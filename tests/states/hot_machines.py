"""Machines whose three axes carry the tool, half the rows of one with a bed that moves; and of that kind."""

from __future__ import annotations

import numpy as np
import polars as pl
from validation.hidden_effects.machines import draw_machine
from validation.hot_and_cold import Hot, draw_heat, turned

from geoerr.observations import Observations

TEMPERATURES_DEGC = (20.0, 60.0, 120.0)


def gantry(seed: int) -> Hot:
    rng = np.random.default_rng(seed)
    machine, cold = draw_machine(rng, "wbXYZt")
    return Hot(machine, cold, draw_heat(rng))


def two_bodies(seed: int) -> Hot:
    """One whose bed moves, too."""
    rng = np.random.default_rng(seed)
    machine, cold = draw_machine(rng, "wYbXZt")
    return Hot(machine, cold, draw_heat(rng))


def seen_from_elsewhere(observations: Observations, seed: int) -> Observations:
    """Turn and shift the measuring frame; the stated uncertainties must be the same along all axes."""
    rng = np.random.default_rng(seed)
    moved = observations.measured_mm @ turned(rng.normal(0.0, 0.5, 3)).T + rng.uniform(-500.0, 500.0, 3)
    columns = {name: pl.Series(values) for name, values in zip(("mx", "my", "mz"), moved.T, strict=True)}
    return Observations(observations.frame.with_columns(**columns))
