"""How the error falls from model to model: in-sample, held out, down to the noise."""

from __future__ import annotations

import math
from collections.abc import Sequence

import plotly.graph_objects as go

from geoerr.diagnose import Diagnosis
from geoerr.diagnose.error_scale import ErrorScale
from geoerr.diagnose.stages import Stage
from geoerr.report.figures import style

_ROW_PX, _OTHER_PX = 46, 60
# A fit follows some of the noise in the rows that it sees, and misses the others by as much again.
_RIGHT_MODEL = "between a right model's residual and its held-out error"
# Figure of a stage, to what its bar is called, and its colour.
_BARS = (
    ("held_out_rmse_um", "held out: rows that the fit did not see", style.ORANGE),
    ("rmse_um", "residual: rows that it saw", style.BLUE),
)
# Of a logarithmic axis: shares of its length, and how many decades have ticks at 2 and 5 too.
_ROOM_BEFORE, _ROOM_BEHIND = 0.09, 0.12
_MOST_DECADES_OF_125 = 3.0
# Of a linear axis: its length beside the longest bar; the share of it that a figure takes, and the pixels that it has
# at most; pixels of a blank, and between the line of the noise and a figure.
_LINEAR_ROOM, _FIGURE_SHARE, _WIDEST_PX, _BLANK_PX, _GAP_PX = 1.15, 0.08, 700.0, 3.0, 6.0


def diagnosis_fall(diagnosis: Diagnosis) -> go.Figure:
    """Draw how the held-out error would fall if what a diagnosis found were added, one after the other."""
    noise = {"noise_floor_um": diagnosis.noise_floor_um}
    now = {"rmse_um": diagnosis.fitted.figures.headline_um, "held_out_rmse_um": diagnosis.held_out_rmse_um}
    found = [
        Stage(f"+ {one.reference}", {"held_out_rmse_um": one.held_out_rmse_after_um, **noise})
        for one in diagnosis.found
    ]
    return error_fall([Stage("the model as it is", {**now, **noise}), *found])


def error_fall(stages: Sequence[Stage], *, is_numbered: bool = False) -> go.Figure:
    """Draw a pair of bars for each model, residual and held out, and the noise, between those of a right one.

    Where errors differ too much for one linear axis (`ErrorScale`) it is logarithmic, and bars begin at the noise.

    Parameters
    ----------
    stages
        The models, one after the other.
    is_numbered
        Whether their names begin with numbers already; otherwise they are counted here.
    """
    names = [
        style.plain(stage.name if is_numbered else f"{number}. {stage.name}")
        for number, stage in enumerate(stages, start=1)
    ]
    noise_um = next((stage.noise_um for stage in reversed(stages) if stage.noise_um is not None), None)
    errors_um = [value for stage in stages for key, *_ in _BARS if (value := stage.figure(key)) is not None]
    scale = ErrorScale.of(errors_um, noise_um)
    figure = go.Figure()
    for key, name, color in _BARS:
        values = [stage.figure(key) for stage in stages]
        figure.add_trace(
            go.Bar(
                y=names,
                x=[None if value is None else value - scale.begin_um for value in values],
                base=scale.begin_um,
                orientation="h",
                marker={"color": color},
                text=["" if value is None else _figure_text(value, noise_um, scale) for value in values],
                textposition="outside",
                cliponaxis=False,
                name=name,
                customdata=values,
                hovertemplate="%{y}: %{customdata:,.2f} µm<extra></extra>",
            )
        )
    if noise_um is not None:
        figure.add_vline(x=noise_um, line={"color": style.INK, "dash": "dash", "width": 1.6})
    _set_axis(figure, scale)
    figure.update_yaxes(autorange="reversed", showgrid=False)
    figure.update_layout(bargap=0.25, barmode="group", legend={"traceorder": "reversed"})
    height_px = style.HEADING_PX + style.LEGEND_PX + _OTHER_PX + _ROW_PX * max(len(stages), 2)
    return style.finish(figure, "How the error falls", _explained(scale, noise_um), height_px, legend=True)


def _figure_text(value_um: float, noise_um: float | None, scale: ErrorScale) -> str:
    """Give the figure of a bar, behind the line of the noise where that would cross it."""
    text = style.text_um(value_um).removesuffix(" µm")
    if noise_um is None or scale.is_logarithmic:
        return text
    share = (noise_um - value_um) / (_LINEAR_ROOM * scale.largest_um)
    if not 0.0 <= share < _FIGURE_SHARE:
        return text
    return "\u00a0" * math.ceil((share * _WIDEST_PX + _GAP_PX) / _BLANK_PX) + text


def _set_axis(figure: go.Figure, scale: ErrorScale) -> None:
    if not scale.is_logarithmic:
        figure.update_xaxes(
            title_text="error, µm rms", range=[0.0, _LINEAR_ROOM * scale.largest_um], rangemode="tozero"
        )
        return
    low, high = math.log10(scale.least_um), math.log10(scale.largest_um)
    # Room for the figures: beyond the longest bar, and before what is below the noise.
    ends = low - _ROOM_BEFORE * (high - low), high + _ROOM_BEHIND * (high - low)
    steps = (1.0, 2.0, 5.0) if high - low < _MOST_DECADES_OF_125 else (1.0,)
    ticks = [step * 10.0**power for power in range(math.floor(ends[0]), math.ceil(ends[1])) for step in steps]
    figure.update_xaxes(
        type="log",
        range=ends,
        tickvals=ticks,
        ticktext=[f"{value:,.6g}" for value in ticks],
        title_text="error, µm rms, logarithmic",
    )


def _explained(scale: ErrorScale, noise_um: float | None) -> str:
    if noise_um is None:
        return "logarithmic axis" if scale.is_logarithmic else ""
    told = _RIGHT_MODEL
    if scale.begin_um == noise_um:
        told = "where bars begin on this logarithmic axis"
    return f"dashed: the noise, {style.text_um(noise_um)}, {told}"
