"""Measured lengths of a workpiece held against a model: |P(end) − P(start)|, with no frame to fit.

The distance between two points that the machine made does not depend on where the piece lies when it is measured.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import polars as pl

from geoerr.errors import GeoerrError
from geoerr.fit.sightings import Numbers
from geoerr.model import Model
from geoerr.observations import Lengths

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


def compare_lengths(model: Model, tables: Sequence[Lengths], *, threads: int = 0) -> LengthComparison:
    """Hold a model against lengths.

    Raises
    ------
    GeoerrError
        naming the conditions that the model needs and the table has no column for.
    """
    frame = pl.concat([table.frame for table in tables], how="diagonal_relaxed")
    absent = [name for name in model.conditions if name not in frame.columns]
    if absent:
        raise GeoerrError(
            f"the lengths have no column {absent[0]!r}, which the model needs\n"
            f"hint: add it, with the value while the piece was made; the columns are {', '.join(frame.columns)}"
        )
    conditions = {name: frame[name].cast(pl.Float64).fill_null(np.nan).to_numpy() for name in model.conditions}
    known = np.all([np.isfinite(values) for values in conditions.values()], axis=0) if conditions else None
    n_lacking = 0
    if known is not None and not known.all():
        n_lacking = int((~known).sum())
        frame = frame.filter(pl.Series(known))
        conditions = {name: values[known] for name, values in conditions.items()}
    if not frame.height:
        raise GeoerrError(f"no length has all that the model needs: {', '.join(conditions)}")
    ends = [
        np.column_stack([frame[name].cast(pl.Float64).to_numpy() for name in names]).astype(np.float64)
        for names in _ENDS
    ]
    made = [model.tool_from_work(np.ascontiguousarray(end), at=conditions, threads=threads) for end in ends]
    return LengthComparison(
        frame,
        np.linalg.norm(ends[1] - ends[0], axis=1),
        np.linalg.norm(made[1] - made[0], axis=1),
        np.asarray(frame["measured"].cast(pl.Float64).to_numpy(), dtype=np.float64),
        n_lacking,
    )
