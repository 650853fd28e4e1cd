"""Positioning along lines that are run both ways: deviations at the targets, forwards and backwards."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from geoerr.report.figures import style
from geoerr.verify.positioning import PositioningTest

_COLUMNS = 2
_ROW_PX, _OTHER_PX = 250, 60
_TITLE_PX = 26
_GAP_PX = 92
# Of a name above a plot where the figure is as narrow as paper makes it; tables have all of it.
_MOST_LETTERS = 58
# Half the last digit that is printed.
_LEAST_UM = 0.05


def positioning_curves(tests: Mapping[str, PositioningTest], title: str, subtitle: str) -> go.Figure:
    """Draw each line's mean deviation at its targets, forwards and backwards, with two standard deviations of a run.

    Parameters
    ----------
    tests
        By the name that stands above each.
    title, subtitle
        Heading of the figure.

    Returns
    -------
    plotly.graph_objects.Figure
        Deviations count from the first target, forwards.
    """
    columns = min(_COLUMNS, max(len(tests), 1))
    rows = -(-len(tests) // columns)
    height_px = style.HEADING_PX + style.LEGEND_PX + _TITLE_PX + _OTHER_PX + _ROW_PX * rows + _GAP_PX * (rows - 1)
    plots_px = height_px - style.HEADING_PX - style.LEGEND_PX - _TITLE_PX - _OTHER_PX
    figure = make_subplots(
        rows=rows,
        cols=columns,
        subplot_titles=[style.plain(name, _MOST_LETTERS) for name in tests],
        vertical_spacing=_GAP_PX / plots_px if rows > 1 else 0.0,
        horizontal_spacing=0.09,
    )
    for number, test in enumerate(tests.values()):
        place = {"row": number // columns + 1, "col": number % columns + 1}
        for name, mean_um, std_um, color, symbol in (
            ("forwards", test.up_um, test.up_std_um, style.BLUE, "triangle-right"),
            ("backwards", test.down_um, test.down_std_um, style.VERMILLION, "triangle-left"),
        ):
            bars = {"type": "data", "array": 2.0 * std_um, "thickness": 1.0, "width": 3}
            figure.add_trace(
                go.Scatter(
                    x=test.position_mm,
                    y=mean_um - test.up_um[0],
                    error_y=bars if bool(np.isfinite(std_um).all()) else None,
                    mode="lines+markers",
                    line={"color": color, "width": 1.5},
                    marker={"size": 6, "symbol": symbol},
                    name=name,
                    legendgroup=name,
                    showlegend=number == 0,
                    hovertemplate="%{x:.5g} mm: %{y:.2f} µm<extra>" + name + "</extra>",
                ),
                **place,
            )
        figure.update_xaxes(title_text="along the line, mm", **place)
        figure.update_yaxes(title_text="deviation, µm", range=_range_um(test), **place)
    return style.finish(
        figure, title, subtitle, height_px, above_plots_px=_TITLE_PX, bottom_px=_OTHER_PX, legend=True
    )


def _range_um(test: PositioningTest) -> list[float] | None:
    """Give the ends of an axis on which what tables call 0.0 is a line at 0; None where the axis finds its own."""
    deviation_um = np.concatenate([test.up_um, test.down_um]) - test.up_um[0]
    return None if np.nanmax(np.abs(deviation_um)) > _LEAST_UM else [-_LEAST_UM, _LEAST_UM]
