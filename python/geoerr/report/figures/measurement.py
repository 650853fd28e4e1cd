"""How certain the measured points are: standard uncertainties and reprojection errors."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from geoerr.observations import Observations
from geoerr.report.figures import style

_HEIGHT_PX = 420


def measurement_residuals(observations: Observations, reprojection_px: npt.ArrayLike | None = None) -> go.Figure:
    """Draw the stated uncertainty of the points and how far their pictures are from where the points project to.

    Parameters
    ----------
    observations
        Measured points; `sx sy sz` or `cxx ...` give the boxes of the left plot, one for each target and component.
    reprojection_px : (n,)
        Reprojection error of each point; None leaves the right plot out.
    """
    with_pixels = reprojection_px is not None
    figure = make_subplots(
        rows=1,
        cols=2 if with_pixels else 1,
        horizontal_spacing=0.09,
        subplot_titles=["<b>Standard uncertainty of the points</b>", "<b>Reprojection error</b>"][: 1 + with_pixels],
    )
    covariance = observations.covariance_mm2
    targets = np.array([style.plain(name) or "target" for name in observations.texts("target")])
    if covariance is not None:
        deviations = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2)) * style.UM_PER_MM
        for component, (name, color) in enumerate(
            zip(("x", "y", "z"), (style.BLUE, style.ORANGE, style.GREEN), strict=True)
        ):
            seen = np.isfinite(deviations[:, component])
            figure.add_trace(
                go.Box(
                    x=targets[seen],
                    y=deviations[seen, component],
                    name=f"along the measuring frame's {name}",
                    marker={"color": color, "size": 3},
                    line={"width": 1.4},
                    boxpoints="outliers",
                ),
                row=1,
                col=1,
            )
    else:
        figure.add_annotation(
            text="<i>the file states no uncertainties</i>",
            x=0.5,
            y=0.5,
            xref="x domain",
            yref="y domain",
            showarrow=False,
        )
    figure.update_xaxes(title_text="target", type="category", row=1, col=1)
    figure.update_yaxes(title_text="µm", rangemode="tozero", row=1, col=1)
    if with_pixels:
        pixels = np.asarray(reprojection_px, dtype=np.float64)
        figure.add_trace(
            go.Histogram(
                x=pixels[np.isfinite(pixels)],
                nbinsx=40,
                marker={"color": style.SKY, "line": {"color": style.BLUE, "width": 1}},
                showlegend=False,
                hovertemplate="%{x} px: %{y} points<extra></extra>",
            ),
            row=1,
            col=2,
        )
        figure.update_xaxes(title_text="px", rangemode="tozero", row=1, col=2)
        figure.update_yaxes(title_text="points", row=1, col=2)
    figure.update_layout(boxmode="group")
    return style.finish(
        figure,
        "Measured points",
        f"{len(observations)} observations; box: quartiles, whiskers: 1.5 interquartile ranges",
        _HEIGHT_PX,
        above_plots_px=24,
        legend=covariance is not None,
    )
