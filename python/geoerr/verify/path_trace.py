"""How far the tool is from the programmed path all along it, before and after correction: kept, to be drawn."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from geoerr.drawing import drawn
from geoerr.model import Model
from geoerr.model.arrays import Triple
from geoerr.model.conditions import Conditions
from geoerr.summaries import number_text, summary_html, table_html
from geoerr.verify.path import PathResult, PathSamples, compare_paths

if TYPE_CHECKING:
    import plotly.graph_objects as go

Numbers = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class PathTrace:
    """Two programs along their path.

    Attributes
    ----------
    result
        The figures.
    distance_mm : (n,)
        Travelled along the programmed path.
    before_mm, after_mm : (n,)
        Distance of the tool from it, without and with compensation.
    intended_mm : (n, 3)
        Where the program means the tool to be.
    """

    result: PathResult
    distance_mm: Numbers
    before_mm: Numbers
    after_mm: Numbers
    intended_mm: Numbers

    def plot_error(self, tolerance_mm: float | None = None) -> go.Figure:
        """Draw the distance from the programmed path against what was travelled, and a tolerance."""
        return drawn("path_error", self.distance_mm, self.before_mm, self.after_mm, tolerance_mm)

    def plot_places(self) -> go.Figure:
        """Draw the path from above, before and after, coloured by the distance from the programmed path."""
        return drawn("path_places", self.intended_mm, self.before_mm, self.after_mm)

    def _repr_html_(self) -> str:
        """Show the figures before and after, for a notebook."""
        one = self.result
        rows = [
            ("largest error, µm", number_text(one.max_error_um_before), number_text(one.max_error_um_after)),
            ("error, µm rms", number_text(one.rms_um_before), number_text(one.rms_um_after)),
            ("moves", f"{one.moves_in:,}", f"{one.moves_out:,}"),
        ]
        return summary_html("Path", table_html(("", "before", "after"), rows))


def trace_paths(
    model: Model,
    before: str | Path,
    after: str | Path,
    *,
    at: Conditions | None = None,
    work_offset_mm: Triple | None = None,
    home_mm: Triple | None = None,
    firmware: str | None = None,
    still: Sequence[str] = (),
    sample_step_mm: float = 0.5,
    threads: int = 0,
) -> PathTrace:
    """Compare two programs as `compare_paths` does, and keep the error along the path, a few samples a millimetre."""
    samples: list[PathSamples] = []
    result = compare_paths(
        model,
        before,
        after,
        at=at,
        work_offset_mm=work_offset_mm,
        home_mm=home_mm,
        firmware=firmware,
        still=still,
        sample_step_mm=sample_step_mm,
        threads=threads,
        on_samples=samples.append,
    )
    return PathTrace(
        result,
        np.cumsum(_joined([one.weight_mm for one in samples])),
        _joined([one.before_mm for one in samples]),
        _joined([one.after_mm for one in samples]),
        _joined([one.intended_mm for one in samples]).reshape(-1, 3),
    )


def _joined(parts: list[Numbers]) -> Numbers:
    return np.concatenate(parts) if parts else np.zeros(0)
