"""Every state predicted from the others: whether the model with temperature in it holds where it has not looked."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from geoerr.errors import NotDeterminedError
from geoerr.fit import Fitted, frames_only
from geoerr.states.difference import Difference
from geoerr.states.functions import Estimate, Functions
from geoerr.states.joint import TemperatureFit, fit_temperature

# Half width of a 95 % interval in standard uncertainties.
_COVERAGE_95 = 1.959964


@dataclass(frozen=True, eq=False)
class LeftOut:
    """One state against its prediction from the others.

    Attributes
    ----------
    temperature_degc
        Of the state.
    is_extrapolation
        Whether it lies outside the temperatures of the others.
    fit
        The others' model, its terms chosen without this state.
    difference
        Measured minus predicted; its uncertainty is of both.
    fitted
        The state's own fit.
    """

    temperature_degc: float
    is_extrapolation: bool
    fit: TemperatureFit
    difference: Difference
    fitted: Fitted
    threads: int = 0

    @cached_property
    def rms_um(self) -> float | None:
        """Measured minus predicted error over the volume, root mean square length; None where not determined."""
        return None if self._volume is None else self._volume[0]

    @cached_property
    def rms_by_chance_um(self) -> float | None:
        """The same as noise alone would have it, of the state and of the prediction."""
        return None if self._volume is None else self._volume[1]

    @cached_property
    def coverage(self) -> float:
        """Share of the tables' values whose 95 % interval holds what was measured."""
        inside = [
            np.abs(one.value[one.std > 0.0]) <= _COVERAGE_95 * one.std[one.std > 0.0]
            for one in self.difference.by_name.values()
        ]
        return float(np.concatenate(inside).mean())

    @cached_property
    def predicted_rmse_um(self) -> float | None:
        """Root mean square of measured minus predicted points; only how the devices stand is fitted."""
        terms = self.difference.functions.with_values(self.difference.before.parameters)
        sightings = self.fitted.sightings
        return frames_only(self.fitted.machine, sightings, terms, threads=self.threads).figures.headline_um

    @property
    def own_rmse_um(self) -> float | None:
        """Root mean square of measured minus fitted points, of the state's own fit: the noise."""
        return self.fitted.figures.headline_um

    @cached_property
    def _volume(self) -> tuple[float, float] | None:
        try:
            volume = self.difference.volume()
        except NotDeterminedError:
            return None
        return volume.rms_um, volume.rms_by_chance_um

    def to_document(self) -> dict[str, Any]:
        """Give plain values for `--json`."""
        return {
            "temperature_degc": self.temperature_degc,
            "is_extrapolation": self.is_extrapolation,
            "rms_um": self.rms_um,
            "rms_by_chance_um": self.rms_by_chance_um,
            "coverage": self.coverage,
            "p_value": self.difference.p_value,
            "predicted_rmse_um": self.predicted_rmse_um,
            "own_rmse_um": self.own_rmse_um,
        }


def leave_one_out(
    functions: Functions,
    estimates: Mapping[float, Estimate],
    fits: Mapping[float, Fitted],
    reference_degc: float,
    *,
    threads: int = 0,
) -> tuple[LeftOut, ...]:
    """Predict every state from the others; nothing of fewer than three states: one cannot tell a slope."""
    if len(estimates) < 3:
        return ()
    found = []
    for temperature, estimate in estimates.items():
        others = {other: one for other, one in estimates.items() if other != temperature}
        fit = fit_temperature(functions, others, reference_degc, may_be_square=False)
        difference = Difference(
            f"predicted at {temperature:g} °C",
            f"measured at {temperature:g} °C",
            functions.with_determined_only,
            fit.at(temperature),
            estimate,
            threads,
        )
        found.append(
            LeftOut(temperature, fit.is_extrapolation(temperature), fit, difference, fits[temperature], threads)
        )
    return tuple(found)
