"""The residual by region in the volume: where its mean points in each box, beside how far it scatters."""

from __future__ import annotations

import itertools

import numpy as np
import plotly.graph_objects as go

from geoerr.diagnose import Comparison
from geoerr.diagnose.regions import Region
from geoerr.machine import AXES
from geoerr.report.figures import style
from geoerr.report.figures.style import Numbers
from geoerr.report.figures.volume import VOLUME_PX, aspect_of, polyline

# Share of a box's shortest edge that the longest mean is drawn as.
_LARGEST_DRAWN = 0.45
_BAR = {"title": {"text": "µm", "side": "top"}, "thickness": 14, "len": 0.7}
_HOVER = (
    "<b>%{customdata[7]:,} rows</b>, rms %{customdata[6]:.1f} µm<br>"
    "x: mean %{customdata[0]:.1f} ± %{customdata[3]:.1f} µm<br>"
    "y: mean %{customdata[1]:.1f} ± %{customdata[4]:.1f} µm<br>"
    "z: mean %{customdata[2]:.1f} ± %{customdata[5]:.1f} µm<extra></extra>"
)


def known_regions(comparison: Comparison) -> list[tuple[int, Region]]:
    """Give the regions that hold rows, each with its number."""
    return [(number, one) for number, one in enumerate(comparison.regions) if one.rmse_um is not None]


def magnification_of_means(comparison: Comparison) -> float:
    """Give the magnification that draws means as half of a box's shortest edge at most, spreads as all of it."""
    regions = [region for _, region in known_regions(comparison)]
    means_um, spreads_um = _numbers(regions, "mean_um"), np.nan_to_num(_numbers(regions, "std_um"))
    longest_um = max(np.linalg.norm(means_um, axis=1).max(initial=0.0), 0.5 * spreads_um.max(initial=0.0))
    longest_mm = float(longest_um) / style.UM_PER_MM
    edges = np.array([np.subtract(one.high_mm, one.low_mm) for one in regions]).reshape(-1)
    shortest_mm = float(edges[edges > 0.0].min(initial=np.inf))
    if longest_mm == 0.0 or not np.isfinite(shortest_mm):
        return 1.0
    return max(style.round_down_125(_LARGEST_DRAWN * shortest_mm / longest_mm), 1.0)


def residual_of_regions(comparison: Comparison, *, exaggeration: float = 1.0) -> go.Figure:
    """Draw the mean residual of each region as a stroke from its middle, with its spread as a cross.

    Parameters
    ----------
    comparison
        Regions without a row are drawn empty.
    exaggeration
        Times the magnification that draws the longest mean as about half of a box's shortest edge, and the longest
        spread as about all of it.

    Returns
    -------
    plotly.graph_objects.Figure
        Two traces: the means from the middles of regions, coloured by the region's rms, whose last number of
        `customdata` is that of the region; boxes and crosses of ± one standard deviation.
    """
    known = known_regions(comparison)
    regions = [region for _, region in known]
    middle = np.array([np.add(one.low_mm, one.high_mm) / 2.0 for one in regions]).reshape(-1, 3)
    mean_um, spread_um = _numbers(regions, "mean_um"), _numbers(regions, "std_um")
    rms_um = np.array([one.rmse_um for one in regions], dtype=np.float64)
    magnification = style.exaggerated(magnification_of_means(comparison), exaggeration)
    scale = magnification / style.UM_PER_MM
    told = np.column_stack([mean_um, spread_um, rms_um, [one.n for one in regions], [number for number, _ in known]])
    line = polyline(middle, middle + scale * mean_um)
    colors: dict[str, object] = {"color": np.repeat(rms_um, 3), "colorscale": "Viridis", "cmin": 0.0}
    colors["cmax"] = max(float(rms_um.max(initial=0.0)), 1e-6)
    figure = go.Figure(
        [
            go.Scatter3d(
                x=line[:, 0],
                y=line[:, 1],
                z=line[:, 2],
                mode="lines+markers",
                line={**colors, "width": 9, "showscale": True, "colorbar": _BAR},
                # Of a model without a mean left there are no strokes to be coloured.
                marker={**colors, "size": np.tile([7.0, 0.0, 0.0], len(regions)), "line": {"width": 0}},
                customdata=np.repeat(told, 3, axis=0),
                hovertemplate=_HOVER,
                name="mean",
            ),
            _frames(comparison.regions, middle, scale * spread_um),
        ]
    )
    return style.finish_volume(
        figure,
        "Residual by region of the volume",
        f"stroke: mean, magnified {magnification:,.0f} times; cross: ± one standard deviation; colour: rms",
        VOLUME_PX,
        aspect=aspect_of(np.array([corner for one in comparison.regions for corner in (one.low_mm, one.high_mm)])),
    )


def _frames(regions: tuple[Region, ...], middle_mm: Numbers, spread_mm: Numbers) -> go.Scatter3d:
    """Draw the edges of all boxes, and a cross of the spread in each that holds rows."""
    strokes = [edge for region in regions for edge in _edges(region)]
    n_edges = len(strokes)
    for place, own in zip(middle_mm, np.nan_to_num(spread_mm), strict=True):
        strokes += [(place - along, place + along) for along in np.diag(own)]
    ends = np.array(strokes).reshape(-1, 2, 3)
    line = polyline(ends[:, 0], ends[:, 1])
    return go.Scatter3d(
        x=line[:, 0],
        y=line[:, 1],
        z=line[:, 2],
        mode="lines",
        line={"color": ["#C8C8C8"] * (3 * n_edges) + [style.SKY] * (len(line) - 3 * n_edges), "width": 2},
        hoverinfo="skip",
        name="boxes and spread",
    )


def _edges(region: Region) -> list[tuple[Numbers, Numbers]]:
    corners = np.array([region.low_mm, region.high_mm])
    edges = []
    for axis, (first, second) in itertools.product(range(3), itertools.product(range(2), repeat=2)):
        begin = np.empty(3)
        others = [other for other in range(3) if other != axis]
        begin[others] = corners[[first, second], others]
        end = begin.copy()
        begin[axis], end[axis] = corners[0, axis], corners[1, axis]
        if end[axis] > begin[axis]:
            edges.append((begin, end))
    return edges


def _numbers(regions: list[Region], name: str) -> Numbers:
    """Give means or spreads, (n, 3); 0 along what was not measured."""
    return np.array([[getattr(one, name).get(axis, 0.0) for axis in AXES] for one in regions]).reshape(-1, 3)
