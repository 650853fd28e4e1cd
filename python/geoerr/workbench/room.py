"""How far the axes of the volume reach: as far as any mark could, so that no mark moves the picture."""

from __future__ import annotations

import numpy as np
import plotly.graph_objects as go

from geoerr.diagnose.components import is_position
from geoerr.fit.sightings import Numbers
from geoerr.machine import AXES
from geoerr.report.figures.volume import places_mm
from geoerr.workbench.session import Seen

# Share of its length that an axis has beside what is drawn, as Plotly leaves it.
_BESIDE = 1.0 / 32.0


def ranges_mm(figure: go.Figure, seen: Seen, magnification: float) -> dict[str, list[float]]:
    """Give from where to where each axis reaches, X, Y, Z; none where nothing is drawn along one.

    Parameters
    ----------
    figure
        What is drawn.
    magnification
        Of the residuals of marked rows, which may be any; 0 where only their places are marked.
    """
    points = seen.comparison.points
    rows = points.solved.used & is_position(points)
    begin = places_mm(seen.comparison)[rows]
    moved = np.where(points.sightings.is_measured, points.residual_mm, 0.0)[rows]
    ranges = {}
    for index, axis in enumerate(AXES):
        drawn = [np.asarray(trace[axis], dtype=np.float64) for trace in figure.data if trace.type == "scatter3d"]
        every = np.concatenate([*drawn, begin[:, index], begin[:, index] + magnification * moved[:, index]])
        ends = _ends(every)
        if ends is not None:
            ranges[axis] = ends
    return ranges


def _ends(values_mm: Numbers) -> list[float] | None:
    known = values_mm[np.isfinite(values_mm)]
    beside_mm = _BESIDE * float(np.ptp(known)) if known.size else 0.0
    return [float(known.min()) - beside_mm, float(known.max()) + beside_mm] if beside_mm > 0.0 else None
