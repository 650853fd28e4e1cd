"""The difference of two states, function by function: value, uncertainty, and whether it is more than chance."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from geoerr.drawing import drawn
from geoerr.error_functions import LI_SQUARENESS, ErrorFunctions, is_angular
from geoerr.fit.sightings import Numbers
from geoerr.states.chance import Largest, Spread, Test, holm, largest_by_chance, whole_test
from geoerr.states.functions import Estimate, Functions, without_rounding
from geoerr.states.volume import N_GRID, VolumeDifference, volume_difference
from geoerr.summaries import p_words

if TYPE_CHECKING:
    import plotly.graph_objects as go


@dataclass(frozen=True, eq=False)
class FunctionDifference:
    """How one of the 21 differs.

    Attributes
    ----------
    name
        ISO name.
    position_mm : (n,)
        Of its axis; empty for a squareness.
    value, std : (n,)
        Second state minus first, mm or rad; of a squareness one number, ISO sign.
    half_width : (n,)
        Of the 95 % band that holds for all 21 functions and all their positions at once.
    test
        Of the whole function.
    p_value
        Of that test, corrected for looking at all functions (Holm).
    """

    name: str
    position_mm: Numbers
    value: Numbers
    std: Numbers
    half_width: Numbers
    test: Test
    p_value: float

    @property
    def is_beyond(self) -> npt.NDArray[np.bool_]:
        """Tell where (n,) the band leaves 0 out."""
        return np.asarray(np.abs(self.value) > self.half_width)

    @property
    def rms(self) -> float:
        """Root mean square of the value, mm or rad."""
        return float(np.sqrt(np.mean(self.value**2)))


@dataclass(frozen=True, eq=False)
class _Values:
    """All functions, one under the other: value (n,), its spread, standard uncertainty (n,)."""

    value: Numbers
    spread: Spread
    std: Numbers

    def of(self, own: slice | npt.NDArray[np.bool_]) -> tuple[Numbers, Spread]:
        """Give some of them."""
        spread = self.spread
        return self.value[own], replace(spread, root=spread.root[own], part=spread.part[own])


@dataclass(frozen=True, eq=False)
class Difference:
    """Second state minus first: of the 21 functions, and of the error over the volume.

    Origins and directions of the two measuring frames are free, as are where the work stands and how the tool is
    tilted: neither is a difference of the machine. Tables have that taken out by their gauge (DESIGN.md: positioning
    and angles 0 at the first point, straightness without a line, slopes are squareness), the map of the volume by the
    rigid motion that fits best.

    Attributes
    ----------
    first, second
        What is compared, in words.
    functions
        What both are made of.
    before, after
        Both estimates, independent of each other.
    """

    first: str
    second: str
    functions: Functions
    before: Estimate
    after: Estimate
    threads: int = 0

    def plot_errors(self) -> go.Figure:
        """Draw how each of the 21 errors differs."""
        return drawn("difference_curves", self)

    @cached_property
    def estimate(self) -> Estimate:
        """Difference of the parameters."""
        return self.after.minus(self.before, self.functions.places)

    @cached_property
    def _values(self) -> _Values:
        rows = self.functions.stacked
        value, spread = rows @ self.estimate.parameters, self.estimate.spread.through(rows)
        std = without_rounding(spread.std, self.functions.spans)
        known = (std > 0.0)[:, None]
        held = replace(spread, root=np.where(known, spread.root, 0.0), part=np.where(known, spread.part, 0.0))
        return _Values(np.where(known[:, 0], value, 0.0), held, std)

    @cached_property
    def test(self) -> Test:
        """One test of all that is comparable: whether the two states differ at all."""
        return whole_test(self._values.value, self._values.spread)

    @property
    def p_value(self) -> float:
        """Probability that two states of one unchanged machine differ as much."""
        return self.test.p_value

    @cached_property
    def largest_p_value(self) -> float:
        """Probability that some value of some function strays as far: sharper than `p_value` for one local change."""
        known = self._values.std > 0.0
        far = np.abs(self._values.value[known]) / self._values.std[known]
        return float(self._largest.p_value(far.max(keepdims=True, initial=0.0))[0])

    @cached_property
    def band_factor(self) -> float:
        """Half-width, in standard uncertainties, of 95 % bands that hold for all functions and positions at once."""
        return self._largest.quantile()

    @cached_property
    def _largest(self) -> Largest:
        _, spread = self._values.of(self._values.std > 0.0)
        return largest_by_chance(replace(spread, root=spread.root[:, None, :], part=spread.part[:, None, :]))

    @cached_property
    def errors(self) -> ErrorFunctions:
        """The difference as tables with standard uncertainties, as `write_errors` and figures take them."""
        note = f"difference, {self.second} minus {self.first}; {p_words(self.p_value)} that nothing differs"
        return self.functions.tables(self.estimate, "difference", (note,))

    @cached_property
    def by_name(self) -> dict[str, FunctionDifference]:
        """Each function's difference."""
        value, std = self._values.value, self._values.std
        spans = self.functions.spans
        tests = {name: whole_test(*self._values.of(own)) for name, own in spans.items()}
        corrected = holm([test.p_value for test in tests.values()])
        return {
            name: FunctionDifference(
                name,
                np.zeros(0) if name in LI_SQUARENESS else self.functions.position_mm[name[2].lower()],
                value[own],
                std[own],
                self.band_factor * std[own],
                tests[name],
                p_value,
            )
            for (name, own), p_value in zip(spans.items(), corrected, strict=True)
        }

    def volume(
        self,
        n_points: int = N_GRID,
        *,
        q_mm: npt.ArrayLike | None = None,
        offset_mm: npt.ArrayLike | None = None,
        without_growth: bool = False,
    ) -> VolumeDifference:
        """Give the difference of the error of the tool seen from the work, over the volume; see `VolumeDifference`.

        Parameters
        ----------
        n_points
            Points along each edge of the grid over the common range.
        q_mm : (n, 3)
            Positions instead of the grid: four or more, not in one plane.
        offset_mm : (3,)
            From the machine's tool point to the point that is followed.
        without_growth
            Whether the growth of each axis that fits best is taken off, too: what three scale factors leave.

        Raises
        ------
        NotDeterminedError
            where a function that moves the point is not determined, or the states share no volume.
        """
        return volume_difference(
            self.functions,
            self.before,
            self.after,
            self.estimate,
            n_points,
            q_mm,
            offset_mm,
            without_growth=without_growth,
            threads=self.threads,
        )

    def to_document(self) -> dict[str, Any]:
        """Give plain values for `--json`, µm and µrad."""
        return {
            "first": self.first,
            "second": self.second,
            "p_value": self.p_value,
            "chi_squared": self.test.chi_squared,
            "degrees_of_freedom": self.test.rank,
            "band_factor": self.band_factor,
            "functions": {name: _function_document(one) for name, one in self.by_name.items()},
            "not_determined": [{"name": item.name, "why": item.why} for item in self.functions.not_determined],
        }


def _function_document(one: FunctionDifference) -> dict[str, Any]:
    unit, factor = ("urad", 1e6) if is_angular(one.name) else ("um", 1e3)
    return {
        "position_mm": one.position_mm.tolist(),
        f"value_{unit}": (factor * one.value).tolist(),
        f"std_{unit}": (factor * one.std).tolist(),
        f"band_{unit}": (factor * one.half_width).tolist(),
        "chi_squared": one.test.chi_squared,
        "degrees_of_freedom": one.test.rank,
        "p_value": one.p_value,
    }
