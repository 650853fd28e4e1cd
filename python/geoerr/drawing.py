"""The one door through which an object draws itself: the figure of `report` by its name, loaded when it is asked for.

Methods called `plot_...` use it, and nothing else does: the room of an object neither imports pictures nor knows how
they are made. Tests hold every name to a figure that there is.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import plotly.graph_objects as go


def drawn(figure: str, *subject: Any, **choices: Any) -> go.Figure:
    """Draw a figure of `geoerr.report.figures` of this name."""
    return getattr(importlib.import_module("geoerr.report.figures"), figure)(*subject, **choices)
