"""One source of uncertainty, and what it does to a predicted error."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from geoerr.budget.columns import Predictor
from geoerr.errors import GeometryError
from geoerr.model.arrays import Numbers

Kind = Literal["A", "B"]
Distribution = Literal["normal", "rectangular", "ball"]


@dataclass(frozen=True, eq=False)
class Piece:
    """A part of a source; pieces add up to it, with their correlations.

    Attributes
    ----------
    by_parameter
        (m, k) its part of the source's root.
    std, unit
        Its own standard uncertainty; NaN where it is of many kinds.
    """

    by_parameter: Numbers
    std: float
    unit: str


@dataclass(frozen=True, eq=False)
class Source:
    """One independent source. It acts in one of three ways, and its covariance is that of k independent unit numbers.

    Attributes
    ----------
    name, what
        Short, and in words.
    kind
        GUM's type of evaluation: A by statistics of observations, B by other knowledge.
    distribution
        Of the unit numbers: normal (Student's t where `dof` is finite), rectangular, or `ball`: a vector of any
        direction whose length is uniform.
    std, unit
        Its standard uncertainty in its own unit.
    dof
        Degrees of freedom of `std`; infinite where it counts as exact.
    by_parameter
        (m, k): through the model's parameters.
    everywhere_mm
        (3, k): the same at every place.
    condition
        Name and standard uncertainty of a condition of the prediction.
    is_of_part
        Whether it is in a compensated part only, and not in the prediction.
    pieces
        What it consists of.
    """

    name: str
    what: str
    kind: Kind
    distribution: Distribution
    std: float
    unit: str
    dof: float = math.inf
    by_parameter: Numbers | None = None
    everywhere_mm: Numbers | None = None
    condition: tuple[str, float] | None = None
    is_of_part: bool = False
    pieces: Mapping[str, Piece] = field(default_factory=dict)

    def root_mm(self, predictor: Predictor, q_mm: Numbers, by_parameter: Numbers) -> Numbers:
        """Give R (n, 3, k) with R Rᵀ the covariance of the error at places (n, 3); `by_parameter` (n, 3, m)."""
        if self.by_parameter is not None:
            return by_parameter @ self.by_parameter
        if self.condition is not None:
            return predictor.by_condition(q_mm, *self.condition)[:, :, None]
        if self.everywhere_mm is None:
            raise GeometryError(f"the source {self.name} acts nowhere")
        return np.broadcast_to(self.everywhere_mm, (len(q_mm), *self.everywhere_mm.shape))

    def draw(self, rng: np.random.Generator, n_trials: int, size: int) -> Numbers:
        """Draw unit numbers (n_trials, size) as the distribution has them (Supplement 1, 6.4)."""
        if self.distribution == "rectangular":
            return rng.uniform(-math.sqrt(3.0), math.sqrt(3.0), (n_trials, size))
        unit = rng.standard_normal((n_trials, size))
        if self.distribution == "ball":
            length = 3.0 * rng.uniform(0.0, 1.0, (n_trials, 1))
            return np.asarray(length * unit / np.linalg.norm(unit, axis=1, keepdims=True))
        if math.isfinite(self.dof):
            unit *= np.sqrt(self.dof / rng.chisquare(self.dof, (n_trials, 1)))
        return unit
