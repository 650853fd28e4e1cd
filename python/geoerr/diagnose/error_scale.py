"""The scale that errors of a story are drawn on: linear, or logarithmic from the noise where they differ too much."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

# Of errors that differ by more a linear bar of the least is no longer than its figure is wide.
LARGEST_LINEAR_RATIO = 20.0


@dataclass(frozen=True)
class ErrorScale:
    """Where bars begin and end.

    Attributes
    ----------
    begin_um
        0 of a linear scale; of a logarithmic one the noise, so that a bar says how many times the noise an error is.
    least_um, largest_um
        Of what is drawn, errors and `begin_um`.
    """

    begin_um: float
    least_um: float
    largest_um: float

    @classmethod
    def of(cls, errors_um: Sequence[float], noise_um: float | None) -> ErrorScale:
        """Choose it for errors; one that is 0, and an unknown noise, decide nothing."""
        positive_um = [value for value in errors_um if value > 0.0]
        least_um, largest_um = min(positive_um, default=1.0), max(positive_um, default=1.0)
        if largest_um <= LARGEST_LINEAR_RATIO * least_um:
            return cls(0.0, 0.0, largest_um)
        begin_um = noise_um if noise_um is not None and 0.0 < noise_um < largest_um else least_um
        return cls(begin_um, min(begin_um, least_um), largest_um)

    @property
    def is_logarithmic(self) -> bool:
        """Whether equal lengths are equal ratios."""
        return self.begin_um > 0.0

    def share(self, error_um: float) -> float:
        """Give the length of an error's bar as a share of the longest; 0 for what is below where bars begin."""
        if not self.is_logarithmic:
            return error_um / self.largest_um
        return math.log(max(error_um / self.begin_um, 1.0)) / math.log(self.largest_um / self.begin_um)
