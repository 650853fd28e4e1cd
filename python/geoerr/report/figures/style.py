"""One look for all figures: colours that colour-blind readers tell apart, sizes that fit 1366 pixels."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

import numpy as np
import numpy.typing as npt
import plotly.graph_objects as go

from geoerr.error_functions import LI_NAMES
from geoerr.errors import GeoerrError

Numbers = npt.NDArray[np.float64]

# Okabe and Ito's palette: distinct with every common colour deficiency and in grey print.
BLUE = "#0072B2"
VERMILLION = "#D55E00"
GREEN = "#009E73"
PURPLE = "#CC79A7"
ORANGE = "#E69F00"
SKY = "#56B4E9"
BLACK = "#000000"
INK = "#222222"
GRID = "#DDDDDD"
SERIES = (BLUE, VERMILLION, GREEN, PURPLE, ORANGE, SKY, BLACK)

BEFORE = VERMILLION
AFTER = BLUE
TRUTH = BLACK
MEASURED = BLACK

UM_PER_MM = 1e3
MICRO = 1e6
# Half width of a 95 % interval in standard uncertainties.
COVERAGE_95 = 1.96

# Title and subtitle; one row of legend.
HEADING_PX = 62
LEGEND_PX = 28

_FONT = "system-ui, -apple-system, 'Segoe UI', Roboto, 'Liberation Sans', 'DejaVu Sans', sans-serif"
# Units stand in the titles of axes: a tick of "150µ" beside "µm" would have another one.
_NUMBERS = {"exponentformat": "none"}


def template() -> go.layout.Template:
    """Give the template that every figure carries; nothing of Plotly's own default remains."""
    axis = {
        "showline": True,
        "linecolor": "#888888",
        "gridcolor": GRID,
        "zeroline": True,
        "zerolinecolor": "#AAAAAA",
        "zerolinewidth": 1,
        "ticks": "outside",
        "ticklen": 4,
        "automargin": True,
        "title": {"standoff": 6},
        **_NUMBERS,
    }
    scene_axis = {"gridcolor": GRID, "backgroundcolor": "#FFFFFF", "showbackground": False, "linecolor": "#888888"}
    scene_axis |= _NUMBERS
    return go.layout.Template(
        layout={
            "font": {"family": _FONT, "size": 12, "color": INK},
            "title": {"x": 0.0, "xanchor": "left", "xref": "paper", "font": {"size": 16}},
            "paper_bgcolor": "#FFFFFF",
            "plot_bgcolor": "#FFFFFF",
            "colorway": list(SERIES),
            "xaxis": axis,
            "yaxis": axis,
            "scene": {"xaxis": scene_axis, "yaxis": scene_axis, "zaxis": scene_axis},
            "polar": {
                "bgcolor": "#FFFFFF",
                "angularaxis": {"gridcolor": GRID, "linecolor": "#888888"},
                "radialaxis": {**_NUMBERS, "gridcolor": GRID, "linecolor": "#888888"},
            },
            "legend": {"orientation": "h", "x": 0.0, "xanchor": "left", "yanchor": "bottom", "y": 1.0},
            "hoverlabel": {"font": {"family": _FONT}},
            "margin": {"l": 60, "r": 20, "t": 90, "b": 50},
        }
    )


def finish_volume(
    figure: go.Figure, title: str, subtitle: str, height_px: int, *, above_plots_px: int = 0, aspect: str = "data"
) -> go.Figure:
    """Finish a picture of the machine's volume: axes in mm, seen from the front, right and above; no legend."""
    finish(figure, title, subtitle, height_px, above_plots_px=above_plots_px, bottom_px=10)
    figure.update_scenes(
        xaxis_title_text="X, mm",
        yaxis_title_text="Y, mm",
        zaxis_title_text="Z, mm",
        aspectmode=aspect,
        camera={"eye": {"x": 1.45, "y": -1.7, "z": 1.05}, "center": {"x": 0.0, "y": 0.0, "z": -0.12}},
    )
    return figure.update_layout(showlegend=False, margin={"l": 10, "r": 10})


def finish(
    figure: go.Figure,
    title: str,
    subtitle: str,
    height_px: int,
    *,
    above_plots_px: int = 0,
    bottom_px: int = 50,
    legend: bool = False,
) -> go.Figure:
    """Put template, title, subtitle and size on a figure, in fixed bands of pixels so that nothing overlaps.

    Parameters
    ----------
    figure
        It is changed in place and returned.
    title, subtitle
        Two lines at the top left.
    height_px
        Of the whole figure; its width is the page's.
    above_plots_px
        Room kept between heading and plots, for subplot titles.
    bottom_px
        Room kept below the plots, for tick labels and axis titles.
    legend
        Whether a legend in one row stands between heading and subplot titles.
    """
    top_px = HEADING_PX + above_plots_px + (LEGEND_PX if legend else 0)
    figure.update_layout(
        template=template(),
        title={
            "text": f"<b>{title}</b>",
            "subtitle": {"text": subtitle, "font": {"size": 12, "color": "#555555"}},
            "yref": "container",
            "y": 1.0 - 14.0 / height_px,
            "yanchor": "top",
        },
        height=height_px,
        margin={"t": top_px, "b": bottom_px},
    )
    figure.update_annotations(font_size=13, selector={"yanchor": "bottom"})
    if legend:
        plot_px = height_px - top_px - bottom_px
        figure.update_layout(legend={"y": 1.0 + (above_plots_px + 2.0) / plot_px})
    return figure


def plain(text: str, most: int | None = None) -> str:
    """Give a text from a file for a figure: Plotly takes `<b>` and `&lt;` for mark-up. Of more letters the first."""
    shown = text if most is None or len(text) <= most else f"{text[: most - 1].rstrip()}…"
    return escape(shown, quote=False)


def with_symbol(name: str) -> str:
    """Give an ISO name with Li's symbol beside it: `EYX  δ<sub>yx</sub>`."""
    symbol, _, index = LI_NAMES[name].partition("_")
    return f"<b>{name}</b>  {symbol}<sub>{index}</sub>"


def band(x: Numbers, middle: Numbers, half_width: Numbers, color: str, **more: object) -> go.Scatter:
    """Draw a filled band `middle ± half_width`."""
    return go.Scatter(
        x=np.concatenate([x, x[::-1]]),
        y=np.concatenate([middle + half_width, (middle - half_width)[::-1]]),
        # Of few points Plotly would draw each as a dot, as if it had been measured.
        mode="lines",
        fill="toself",
        fillcolor=transparent(color, 0.22),
        line={"width": 0},
        hoverinfo="skip",
        **more,
    )


def say_instead(figure: go.Figure, row: int, column: int, lines: Sequence[str], *, from_top: bool = False) -> None:
    """Say in a panel why it has no curve; it has no ticks either, for there is nothing to be read off them.

    Parameters
    ----------
    figure
        Of `make_subplots`; it is changed in place.
    row, column
        Of the panel.
    lines
        What is said; marked up as Plotly has it.
    from_top
        Whether they begin at the panel's upper edge and use the room of its ticks, where the panel is low.
    """
    figure.add_annotation(
        text="<br>".join(lines),
        x=0.5,
        y=1.0 if from_top else 0.5,
        xref="x domain",
        yref="y domain",
        xanchor="center",
        yanchor="top" if from_top else "middle",
        showarrow=False,
        font={"size": 11, "color": "#555555"},
        row=row,
        col=column,
    )
    # A panel without a trace is none to Plotly: it draws no axes, and what is said in it elsewhere.
    figure.add_trace(go.Scatter(x=[], y=[], showlegend=False, hoverinfo="skip"), row=row, col=column)
    blank = {"showticklabels": False, "ticks": "", "showgrid": False, "zeroline": False}
    figure.update_xaxes(**blank, showline=not from_top, row=row, col=column)
    figure.update_yaxes(**blank, showline=not from_top, row=row, col=column)


def transparent(color: str, opacity: float) -> str:
    """Turn `#RRGGBB` into an `rgba(...)` with the given opacity."""
    red, green, blue = (int(color[start : start + 2], 16) for start in (1, 3, 5))
    return f"rgba({red},{green},{blue},{opacity:g})"


def text_um(value_um: float) -> str:
    """Write a length in µm with the digits that a reader needs."""
    if value_um < 0.01:
        return "below 0.01 µm"
    digits = 0 if value_um >= 1000.0 else 1 if value_um >= 10.0 else 2
    return f"{value_um:,.{digits}f} µm"


def up_to_um(value_um: float) -> str:
    """Write `up to 12.3 µm`, or `less than` the last digit of `text_um`: not `up to below` it."""
    text = text_um(value_um)
    return f"less than {text.removeprefix('below ')}" if text.startswith("below") else f"up to {text}"


def round_up_125(value: float) -> float:
    """Round a positive number up to 1, 2 or 5 times a power of ten."""
    power = 10.0 ** np.floor(np.log10(value))
    return float(next(step * power for step in (1.0, 2.0, 5.0, 10.0) if step * power >= value * (1.0 - 1e-12)))


def round_down_125(value: float) -> float:
    """Round a positive number down to 1, 2 or 5 times a power of ten."""
    power = 10.0 ** np.floor(np.log10(value))
    return float(next(step * power for step in (5.0, 2.0, 1.0) if step * power <= value * (1.0 + 1e-12)))


def exaggerated(magnification: float, times: float) -> float:
    """Give a magnification times what was asked for.

    Raises
    ------
    GeoerrError
        for what magnifies nothing.
    """
    if not 0.0 < times < np.inf:
        raise GeoerrError(f"exaggeration is {times!r}\nhint: give a number above 0; 2 draws all twice as long as 1")
    return magnification * times


def thinned(shown: npt.NDArray[np.bool_], most_points: int) -> npt.NDArray[np.int64]:
    """Give the rows that are drawn of those that are `shown` (n,): all, or of very many every k-th."""
    rows = np.flatnonzero(shown)
    return rows[:: max(-(-len(rows) // most_points), 1)]
