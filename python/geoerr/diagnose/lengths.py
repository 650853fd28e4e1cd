"""Measured lengths of a workpiece held against a model: |P(end) − P(start)|, with no frame to fit."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import polars as pl

from geoerr.fit import Fitted, Sightings
from geoerr.fit.lengths import other_ends
from geoerr.fit.sightings import Numbers

_UM_PER_MM = 1e3
_ENDS = (("x1", "y1", "z1"), ("x2", "y2", "z2"))


@dataclass(frozen=True, eq=False)
class LengthComparison:
    """Lengths and how far the model's are off.

    Attributes
    ----------
    frame
        The table with the rows that have all that the model needs, in order.
    nominal_mm, predicted_mm, measured_mm : (n,)
        Of nominal end points, by the model, by the measurement.
    n_lacking
        Rows left out: a condition is empty.
    """

    frame: pl.DataFrame
    nominal_mm: Numbers
    predicted_mm: Numbers
    measured_mm: Numbers
    n_lacking: int

    def __len__(self) -> int:
        return len(self.measured_mm)

    @property
    def residual_um(self) -> Numbers:
        """Measured minus predicted, (n,)."""
        return (self.measured_mm - self.predicted_mm) * _UM_PER_MM

    @property
    def rms_um(self) -> float:
        """Root mean square of the residuals."""
        return float(np.sqrt(np.mean(self.residual_um**2)))

    @property
    def noise_floor_um(self) -> float | None:
        """Pooled standard deviation of lengths that were measured, or made, more than once; None without such."""
        keys = np.column_stack([self._column(name) for name in (*_ENDS[0], *_ENDS[1])])
        _, group = np.unique(np.round(keys / 1e-5), axis=0, return_inverse=True)
        count = np.bincount(group.ravel())
        mean = np.bincount(group.ravel(), weights=self.residual_um) / count
        dof = int((count - 1).sum())
        if dof == 0:
            return None
        deviation = self.residual_um - mean[group.ravel()]
        return float(np.sqrt(deviation @ deviation / dof))

    def by(self, column: str) -> dict[str, tuple[float, int]]:
        """Give the root mean square (µm) and the number of lengths for each value of a column of texts."""
        if column not in self.frame.columns:
            return {}
        names = np.asarray([value or "" for value in self.frame[column].cast(pl.String).to_list()])
        return {
            name: (float(np.sqrt(np.mean(self.residual_um[names == name] ** 2))), int((names == name).sum()))
            for name in dict.fromkeys(names.tolist())
        }

    def _column(self, name: str) -> Numbers:
        return np.asarray(self.frame[name].cast(pl.Float64).to_numpy())


def lengths_of(fitted: Fitted, given: Sightings) -> LengthComparison | None:
    """Take the lengths out of a fit; None where there are none.

    Parameters
    ----------
    given
        What was measured, with the rows that lack a condition.
    """
    first, rows = other_ends(fitted.sightings)
    n_given = len(other_ends(given)[1])
    if not n_given:
        return None
    ends_mm = [fitted.sightings.commanded_mm[own] for own in (first, rows)]
    columns = [
        pl.Series(name, own[:, number])
        for names, own in zip(_ENDS, ends_mm, strict=True)
        for number, name in enumerate(names)
    ]
    measured_mm = fitted.sightings.measured_mm[rows, 0]
    return LengthComparison(
        fitted.sightings.table[rows].drop("x", "y", "z").with_columns(columns),
        np.linalg.norm(ends_mm[1] - ends_mm[0], axis=1),
        measured_mm - fitted.residual_mm[rows, 0],
        measured_mm,
        n_given - len(rows),
    )
