"""Machines whose three axes carry the tool, half the rows of one with a bed that moves; and of that kind."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import polars as pl
from validation.hidden_effects.chain import Displacements
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


@dataclass(frozen=True)
class Warming(Hot):
    """One that is still colder when a session begins, and warm in the end."""

    colder_k: float = 0.0

    def row_degc(self, temperature_degc: float, n_rows: int) -> np.ndarray:
        """Give the temperature of each row; what is as cold as the room is steady."""
        colder = self.colder_k if temperature_degc > 20.0 else 0.0
        return temperature_degc - colder * np.exp(-3.0 * np.arange(n_rows) / n_rows)

    def moved(self, q_mm: np.ndarray, temperature_degc: float) -> Displacements:
        """Give all errors at positions (n, 3), each at its own temperature: what heat does is in proportion."""
        cold, warm = (self.cold.at(self.machine, q_mm) for _ in range(2))
        warm = self.heat.at(self.machine, q_mm, 120.0, warm)
        share = (self.row_degc(temperature_degc, len(q_mm)) - 20.0) / 100.0
        cold.delta_mm[:] += share[:, None, None] * (warm.delta_mm - cold.delta_mm)
        cold.epsilon_rad[:] += share[:, None, None] * (warm.epsilon_rad - cold.epsilon_rad)
        cold.squareness_rad[:] += share[:, None] * (warm.squareness_rad - cold.squareness_rad)
        return cold


def seen_from_elsewhere(observations: Observations, seed: int) -> Observations:
    """Turn and shift the measuring frame; the stated uncertainties must be the same along all axes."""
    rng = np.random.default_rng(seed)
    moved = observations.measured_mm @ turned(rng.normal(0.0, 0.5, 3)).T + rng.uniform(-500.0, 500.0, 3)
    columns = {name: pl.Series(values) for name, values in zip(("mx", "my", "mz"), moved.T, strict=True)}
    return Observations(observations.frame.with_columns(**columns))
