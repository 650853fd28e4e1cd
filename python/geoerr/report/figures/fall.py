"""How the error falls from model to model: in-sample, held out, down to the noise."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import plotly.graph_objects as go

from geoerr.diagnose import Diagnosis
from geoerr.model import HistoryEntry
from geoerr.report.figures import style

_ROW_PX, _OTHER_PX = 46, 60


@dataclass(frozen=True)
class Stage:
    """One model of a story.

    Attributes
    ----------
    name
        What was done to get it.
    figures
        `rmse_um`, `held_out_rmse_um`, `noise_floor_um`, `noise_um`; NaN or absent where not computable.
    """

    name: str
    figures: Mapping[str, float | None]

    def figure(self, name: str) -> float | None:
        """Give a figure; None where it is not computable."""
        value = self.figures.get(name)
        return value if value is not None and math.isfinite(value) else None

    @property
    def noise_um(self) -> float | None:
        """The noise: what repeats scatter, else what is stated."""
        floor = self.figure("noise_floor_um")
        return floor if floor is not None else self.figure("noise_um")


def stages_of(history: Sequence[HistoryEntry]) -> tuple[Stage, ...]:
    """Tell the story that a model's own history holds; none where nothing was added or removed."""
    if not history:
        return ()
    steps = [
        Stage(f"{'+' if entry.action == 'added' else '−'} {entry.reference}", entry.figures_after)
        for entry in history
    ]
    return (Stage("at first", history[0].figures_before), *steps)


def diagnosis_fall(diagnosis: Diagnosis) -> go.Figure:
    """Draw how the held-out error would fall if what a diagnosis found were added, one after the other."""
    noise = {"noise_floor_um": diagnosis.noise_floor_um}
    now = {"rmse_um": diagnosis.fitted.figures.headline_um, "held_out_rmse_um": diagnosis.held_out_rmse_um}
    found = [
        Stage(f"+ {one.reference}", {"held_out_rmse_um": one.held_out_rmse_after_um, **noise})
        for one in diagnosis.found
    ]
    return error_fall([Stage("the model as it is", {**now, **noise}), *found])


def error_fall(stages: Sequence[Stage]) -> go.Figure:
    """Draw a pair of bars for each model, residual and held out, and the noise that no model gets below."""
    names = [f"{number}. {stage.name}" for number, stage in enumerate(stages, start=1)]
    figure = go.Figure()
    for name, key, color in (
        ("held out: rows that the fit did not see", "held_out_rmse_um", style.ORANGE),
        ("residual: rows that it saw", "rmse_um", style.BLUE),
    ):
        values = [stage.figure(key) for stage in stages]
        figure.add_trace(
            go.Bar(
                y=names,
                x=values,
                orientation="h",
                marker={"color": color},
                text=["" if value is None else f"{value:.1f}" for value in values],
                textposition="outside",
                cliponaxis=False,
                name=name,
                hovertemplate="%{y}: %{x:.2f} µm<extra></extra>",
            )
        )
    noises = [stage.noise_um for stage in stages if stage.noise_um is not None]
    if noises:
        figure.add_vline(x=noises[-1], line={"color": style.INK, "dash": "dash", "width": 1.6})
    largest = max((value for stage in stages for key in ("rmse_um", "held_out_rmse_um")
                   if (value := stage.figure(key)) is not None), default=1.0)  # fmt: skip
    figure.update_yaxes(autorange="reversed", showgrid=False)
    figure.update_xaxes(title_text="error, µm rms", range=[0.0, 1.15 * largest], rangemode="tozero")
    figure.update_layout(bargap=0.25, barmode="group", legend={"traceorder": "reversed"})
    noise = "" if not noises else f"dashed: the noise, {style.text_um(noises[-1])}; no model gets below it"
    height_px = style.HEADING_PX + style.LEGEND_PX + _OTHER_PX + _ROW_PX * max(len(stages), 2)
    return style.finish(figure, "How the error falls", noise, height_px, legend=True)
