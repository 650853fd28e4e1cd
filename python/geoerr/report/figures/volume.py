"""Residuals in the machine's volume: strokes or dots at the commanded positions, and the volume's own shape."""

from __future__ import annotations

import colorsys
from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt
import plotly.graph_objects as go

from geoerr.diagnose import Comparison
from geoerr.diagnose.components import is_position
from geoerr.report.figures import style
from geoerr.report.figures.style import Numbers

Look = Literal["length", "magnitude", "direction"]

VOLUME_PX = 620
MOST_POINTS = 20_000
# Strokes that lie over all others: more of them than this say no more.
MOST_MARKED = 2_000
# Share of the volume's diagonal that the largest residual is drawn as.
_LARGEST_DRAWN = 0.12
# What the hues of `direction_colors` stand for.
DIRECTIONS = "red +X, lime +Y, cyan −X, violet −Y; light +Z, dark −Z"
_TITLES = {
    "length": "Residual in the volume",
    "magnitude": "Size of the residual in the volume",
    "direction": "Direction of the residual in the volume",
}
_COLORED = {
    "length": "its length",
    "magnitude": "its length",
    "direction": f"its direction ({DIRECTIONS})",
}
# Least span of an axis, as a share of the diagonal, that is still seen true to scale.
_FLAT = 0.02
# Size in pixels of the dot of the largest residual, and of the least.
_DOT_PX = (2.0, 11.0)
_HOVER = (
    "at (%{customdata[0]:.1f}, %{customdata[1]:.1f}, %{customdata[2]:.1f}) mm<br>"
    "residual (%{customdata[3]:.1f}, %{customdata[4]:.1f}, %{customdata[5]:.1f}) µm<extra></extra>"
)


@dataclass(frozen=True, eq=False)
class Volume:
    """Places and residuals that are drawn, and how far the residuals are magnified.

    Attributes
    ----------
    rows : (m,)
        Rows of the comparison.
    at_mm, error_mm : (m, 3)
        Their places and residuals.
    magnification
        Of the residuals.
    """

    rows: npt.NDArray[np.int64]
    at_mm: Numbers
    error_mm: Numbers
    magnification: float

    @property
    def length_um(self) -> Numbers:
        """Length of the residuals, (m,)."""
        return np.asarray(np.linalg.norm(self.error_mm, axis=1) * style.UM_PER_MM)


def volume_of(comparison: Comparison, *, exaggeration: float = 1.0, most_points: int = MOST_POINTS) -> Volume:
    """Take what is drawn of a comparison.

    Parameters
    ----------
    comparison
        Circular tests and lengths in it have no residual in the volume.
    exaggeration
        Times the magnification that draws the largest residual as about a tenth of the volume.
    most_points
        Of more rows every k-th is drawn.
    """
    fitted = comparison.points
    rows = style.thinned(fitted.solved.used & is_position(fitted), most_points)
    at = places_mm(comparison)[rows]
    error = np.where(fitted.sightings.is_measured, fitted.residual_mm, 0.0)[rows]
    largest = float(np.linalg.norm(error, axis=1).max(initial=0.0))
    diagonal = float(np.linalg.norm(np.ptp(at, axis=0))) if len(at) else 1.0
    room = diagonal if diagonal > 0.0 else 1.0
    factor = 1.0 if largest == 0.0 else max(style.round_down_125(_LARGEST_DRAWN * room / largest), 1.0)
    return Volume(rows, at, error, style.exaggerated(factor, exaggeration))


def places_mm(comparison: Comparison) -> Numbers:
    """Give where each row's target is, (n, 3): commanded, with the target's offset where the tool carries it."""
    sightings = comparison.points.sightings
    return np.asarray(sightings.commanded_mm + np.where((sightings.carrier == 1)[:, None], 0.0, sightings.offset_mm))


def residual_volume(volume: Volume, look: Look) -> go.Figure:
    """Draw residuals as strokes coloured by length or direction, or as dots whose size and colour are the length."""
    colors = _colors(volume, look)
    trace = _dots(volume, colors) if look == "magnitude" else _strokes(volume, colors)
    figure = go.Figure([trace, _places(volume)])
    return style.finish_volume(
        figure,
        _TITLES[look],
        f"{len(volume.rows)} rows; magnified {volume.magnification:,.0f} times; colour: {_COLORED[look]}",
        VOLUME_PX,
        aspect=aspect_of(volume.at_mm),
    )


def aspect_of(at_mm: Numbers) -> str:
    """Give how axes are drawn about places (n, 3): true to scale, or a cube where all lie in a plane or on a line."""
    spans = np.ptp(at_mm, axis=0) if len(at_mm) else np.zeros(3)
    return "data" if spans.min() > _FLAT * float(np.linalg.norm(spans)) else "cube"


def explained_strokes(volume: Volume, at_mm: Numbers, explained_um: Numbers | None) -> go.Scatter3d:
    """Draw what an effect would explain, (n, 3) of all rows, where the volume draws rows; None draws nothing."""
    rows = volume.rows if explained_um is not None else np.zeros(0, dtype=np.int64)
    moved_mm = np.zeros((len(rows), 3)) if explained_um is None else explained_um[rows] / style.UM_PER_MM
    return marked_strokes(
        at_mm[rows], moved_mm, volume.magnification, style.ORANGE, "would be explained", most=MOST_MARKED
    )


def marked_strokes(
    at_mm: Numbers, moved_mm: Numbers, magnification: float, color: str, name: str, *, most: int = MOST_MARKED
) -> go.Scatter3d:
    """Draw thick strokes of one colour over the others: rows that were chosen, or what an effect would explain."""
    kept = style.thinned(np.ones(len(at_mm), dtype=bool), most)
    line = polyline(at_mm[kept], at_mm[kept] + magnification * moved_mm[kept])
    return go.Scatter3d(
        x=line[:, 0],
        y=line[:, 1],
        z=line[:, 2],
        mode="lines",
        line={"color": color, "width": 6},
        hoverinfo="skip",
        name=name,
    )


def direction_colors(error_mm: Numbers) -> list[str]:
    """Give a colour (`#RRGGBB`) for the direction of each vector (n, 3): hue in the XY plane, lightness along Z."""
    colors = []
    for x, y, z in error_mm.tolist():
        size = float(np.sqrt(x * x + y * y + z * z))
        hue = float(np.arctan2(y, x)) / (2.0 * np.pi) % 1.0
        up = z / size if size > 0.0 else 0.0
        level = colorsys.hls_to_rgb(hue, 0.5 + 0.3 * up, float(np.sqrt(max(1.0 - up * up, 0.0))))
        colors.append("#" + "".join(f"{round(255.0 * part):02X}" for part in level))
    return colors


def _colors(volume: Volume, look: Look) -> dict[str, object]:
    if look == "direction":
        return {"color": direction_colors(volume.error_mm)}
    length_um = volume.length_um
    return {
        "color": length_um,
        "colorscale": "Viridis",
        "cmin": 0.0,
        "cmax": max(float(length_um.max(initial=0.0)), 1e-6),
        "showscale": True,
        "colorbar": {"title": {"text": "µm", "side": "top"}, "thickness": 14, "len": 0.7},
    }


def _strokes(volume: Volume, colors: dict[str, object]) -> go.Scatter3d:
    line = polyline(volume.at_mm, volume.at_mm + volume.magnification * volume.error_mm)
    shown = colors["color"]
    each = [name for name in shown for _ in range(3)] if isinstance(shown, list) else np.repeat(np.asarray(shown), 3)
    return go.Scatter3d(
        x=line[:, 0],
        y=line[:, 1],
        z=line[:, 2],
        mode="lines",
        line={**colors, "color": each, "width": 4},
        customdata=np.repeat(_told(volume), 3, axis=0),
        hovertemplate=_HOVER,
        name="residual",
    )


def _dots(volume: Volume, colors: dict[str, object]) -> go.Scatter3d:
    length_um = volume.length_um
    share = length_um / max(float(length_um.max(initial=0.0)), 1e-9)
    return go.Scatter3d(
        x=volume.at_mm[:, 0],
        y=volume.at_mm[:, 1],
        z=volume.at_mm[:, 2],
        mode="markers",
        marker={**colors, "size": _DOT_PX[0] + (_DOT_PX[1] - _DOT_PX[0]) * share, "line": {"width": 0}},
        customdata=_told(volume),
        hovertemplate=_HOVER,
        name="residual",
    )


def _places(volume: Volume) -> go.Scatter3d:
    return go.Scatter3d(
        x=volume.at_mm[:, 0],
        y=volume.at_mm[:, 1],
        z=volume.at_mm[:, 2],
        mode="markers",
        marker={"size": 1.5, "color": "#B8B8B8"},
        hoverinfo="skip",
        name="commanded",
    )


def _told(volume: Volume) -> Numbers:
    return np.column_stack([volume.at_mm, volume.error_mm * style.UM_PER_MM, volume.rows])


def polyline(begin: Numbers, end: Numbers) -> Numbers:
    """Join strokes from (n, 3) to (n, 3) into one line (3 n, 3) with NaN between them."""
    strokes = np.full((len(begin), 3, 3), np.nan)
    strokes[:, 0], strokes[:, 1] = begin, end
    return strokes.reshape(-1, 3)
