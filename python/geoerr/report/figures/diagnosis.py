"""A diagnosis in pictures: what each candidate is worth, and the curve of what has no name."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from geoerr.diagnose.circles import CircleDiagnosis
from geoerr.diagnose.diagnosis import Diagnosis
from geoerr.diagnose.findings import Finding
from geoerr.diagnose.labels import variable_label
from geoerr.errors import GeoerrError
from geoerr.fit.empirical import Curve
from geoerr.report.figures import style
from geoerr.summaries import listed

_ROW_PX, _OTHER_PX = 34, 70
_CURVE_PX, _SURFACE_PX = 420, 480
_FOUND, _TIED, _LEFT, _UNKNOWN = "found", "not told apart from it", "looked at and left", "without a name"
_COLORS = {_FOUND: style.BLUE, _TIED: style.ORANGE, _LEFT: "#AAAAAA", _UNKNOWN: style.PURPLE}


def diagnosis_bars(diagnosis: Diagnosis) -> go.Figure:
    """Draw what each candidate is worth, and beside it the held-out error without it and with it, where it is known.

    What was found comes first, in the order in which it was added, then the other candidates for the first. Hatched
    bars are the cameras' errors; the dashed line is the noise.

    Raises
    ------
    GeoerrError
        where the diagnosis has no candidate.
    """
    rows = _rows(diagnosis)
    if not rows:
        raise GeoerrError(
            "there is no candidate to draw: nothing was found that could be missing\n"
            "hint: the verdict is " + diagnosis.verdict
        )
    names = [name for name, *_ in rows]
    both = {"column_widths": [0.55, 0.45], "horizontal_spacing": 0.04, "shared_yaxes": True}
    titles = ("worth, µm rms", "held-out error, µm: without ○ and with ●")
    n_plots = 2 if has_held_out(diagnosis) else 1
    figure = make_subplots(cols=n_plots, subplot_titles=titles[:n_plots], **(both if n_plots == 2 else {}))
    for kind, color in _COLORS.items():
        own = [(name, worth, is_rig) for name, this, worth, is_rig, *_ in rows if this == kind]
        if not own:
            continue
        figure.add_trace(
            go.Bar(
                y=[name for name, *_ in own],
                x=[worth for _, worth, _ in own],
                orientation="h",
                marker={"color": color, "pattern": {"shape": ["/" if is_rig else "" for *_, is_rig in own]}},
                text=[f"{worth:.1f}" for _, worth, _ in own],
                textposition="outside",
                cliponaxis=False,
                name=kind,
                hovertemplate="%{y}: %{x:.2f} µm<extra></extra>",
            ),
            row=1,
            col=1,
        )
    noise = _add_held_out(figure, diagnosis, rows) if n_plots == 2 else ""
    figure.update_yaxes(autorange="reversed", showgrid=False, categoryorder="array", categoryarray=names)
    figure.update_xaxes(rangemode="tozero")
    largest = max((worth for _, _, worth, *_ in rows), default=1.0)
    figure.update_xaxes(range=[0.0, 1.15 * largest], row=1, col=1)
    figure.update_layout(bargap=0.35)
    return style.finish(
        figure,
        "What is missing, and what it is worth",
        f"By the part of it that the model cannot do itself. Hatched: the cameras' own.{noise}",
        style.HEADING_PX + style.LEGEND_PX + _OTHER_PX + 30 + _ROW_PX * max(len(rows), 3),
        above_plots_px=30,
        legend=True,
    )


def has_held_out(diagnosis: Diagnosis) -> bool:
    """Tell whether of any candidate the held-out error without it and with it is known: what was left has none."""
    return any(before_um is not None and after_um is not None for *_, before_um, after_um in _rows(diagnosis))


def _add_held_out(figure: go.Figure, diagnosis: Diagnosis, rows: Sequence[_Row]) -> str:
    """Draw the held-out errors and the noise, and say what the line of it is."""
    for name, kind, _, _, before_um, after_um in rows:
        if before_um is None or after_um is None:
            continue
        color = _COLORS[kind]
        figure.add_trace(
            go.Scatter(
                x=[before_um, after_um],
                y=[name, name],
                mode="lines+markers",
                line={"color": color, "width": 2},
                marker={"size": 11, "color": ["#FFFFFF", color], "line": {"color": color, "width": 2}},
                showlegend=False,
                hovertemplate="%{y}: %{x:.2f} µm<extra></extra>",
            ),
            row=1,
            col=2,
        )
    noise_um = diagnosis.noise_floor_um if diagnosis.noise_floor_um is not None else diagnosis.fitted.split.noise_um
    if noise_um is None:
        return ""
    figure.add_vline(x=noise_um, line={"color": style.INK, "dash": "dash", "width": 1.4}, row=1, col=2)
    return f" Dashed: noise {style.text_um(noise_um)}."


def circle_causes(diagnosis: CircleDiagnosis) -> go.Figure:
    """Draw the causes of circular tests by their part of what is more than noise, and the unexplained part."""
    rows = [(str(cause.reference), cause.percent or 0.0, _FOUND, cause.is_rig) for cause in diagnosis.ranked]
    rows.append(("unexplained", diagnosis.shares.percent_unexplained, _UNKNOWN, False))
    figure = go.Figure(
        go.Bar(
            y=[name for name, *_ in rows],
            x=[percent for _, percent, *_ in rows],
            orientation="h",
            marker={
                "color": [_COLORS[kind] for *_, kind, _ in rows],
                "pattern": {"shape": ["/" if is_rig else "" for *_, is_rig in rows]},
            },
            hovertemplate="%{y}: %{x:.1f} %<extra></extra>",
            showlegend=False,
        )
    )
    figure.update_yaxes(autorange="reversed", showgrid=False)
    percents = [percent for _, percent, *_ in rows]
    figure.add_trace(
        go.Scatter(
            y=[name for name, *_ in rows],
            # A cause that works against the others has a part below 0: left of its bar its number would stand on its
            # name, however wide the figure is.
            x=[max(percent, 0.0) for percent in percents],
            mode="text",
            text=[f" {percent:.0f} %".replace("-", "−") for percent in percents],
            textposition="middle right",
            cliponaxis=False,
            hoverinfo="skip",
            showlegend=False,
        )
    )
    low = min(0.0, 1.12 * min(percents))
    figure.update_xaxes(range=[low, 1.12 * max(percents) + 1e-9], title_text="%")
    return style.finish(
        figure,
        "What the circles are off by",
        f"Part of the mean square that is more than noise ({style.text_um(diagnosis.noise_um)}). "
        + ("Below 0: makes up for others. " if min(percents) < 0.0 else "")
        + "Hatched: the measuring device's own.",
        style.HEADING_PX + _OTHER_PX + _ROW_PX * max(len(rows), 3),
    )


def unknown_curve(diagnosis: Diagnosis) -> go.Figure:
    """Draw structure without a name: its curve with a 95 % band, or its surfaces over two variables or three.

    Raises
    ------
    GeoerrError
        where the diagnosis has none, or these data determine no curve of it.
    """
    unknown = diagnosis.unknown
    if unknown is None or unknown.curve is None:
        raise GeoerrError("there is no curve without a name to draw\nhint: the verdict is " + diagnosis.verdict)
    curve = unknown.curve
    # Where data have no time, what runs from row to row does so by the number of the row.
    has_time = bool(np.isfinite(diagnosis.fitted.sightings.numbers("t")).any())
    names = {name: "row" if name == "t" and not has_time else name for name in unknown.depends_on}
    titles = [variable_label(names.get(name, name)) for name in curve.variables]
    if curve.period is not None:
        titles = [f"{titles[0]}, one turn"]
    figure = _line(curve, titles[0]) if len(curve.variables) == 1 else _surfaces(curve, titles)
    return style.finish(
        figure,
        f"Along {unknown.component}, over {listed(list(names.values()))}: no known effect does this",
        f"An empirical {unknown.form}, without a cause: worth {style.text_um(unknown.worth_um)} rms.",
        _CURVE_PX if len(curve.variables) == 1 else _SURFACE_PX,
        legend=len(curve.variables) == 1,
    )


def _line(curve: Curve, title: str) -> go.Figure:
    at, value_um = curve.at[0], curve.value_um
    figure = go.Figure()
    figure.add_trace(style.band(at, value_um, style.COVERAGE_95 * curve.std_um, style.PURPLE, name="95 %"))
    figure.add_trace(
        go.Scatter(
            x=at,
            y=value_um,
            mode="lines+markers" if len(at) < 20 else "lines",
            line={"color": style.PURPLE, "width": 2},
            name="empirical",
            hovertemplate="%{x:.6g}: %{y:.2f} µm<extra></extra>",
        )
    )
    figure.update_xaxes(title_text=title)
    figure.update_yaxes(title_text=f"{curve.component}, µm")
    return figure


def _surfaces(curve: Curve, titles: Sequence[str]) -> go.Figure:
    """Draw a surface over two variables; of three at the lowest, middle and highest value of one."""
    cuts, heads = [curve], [titles[0]]
    if len(curve.variables) == 3:
        along = curve.cut_along
        at, name = curve.at[along], curve.variables[along]
        titles = [*titles[:along], *titles[along + 1 :]]
        places = sorted({0, len(at) // 2, len(at) - 1})
        cuts = [curve.cut(place) for place in places]
        heads = [f"{titles[0]} ({name} = {at[place]:.4g})".replace("-", "−") for place in places]
    largest = max(float(np.abs(curve.value_um).max()), 1e-9)
    figure = make_subplots(cols=len(cuts), shared_yaxes=True, horizontal_spacing=0.04)
    for column, (cut, head) in enumerate(zip(cuts, heads, strict=True), start=1):
        figure.add_trace(_surface(cut, largest), row=1, col=column)
        figure.update_xaxes(title_text=head, row=1, col=column)
    figure.update_yaxes(title_text=titles[1], col=1)
    return figure


def _surface(curve: Curve, largest_um: float) -> go.Contour:
    return go.Contour(
        x=curve.at[0],
        y=curve.at[1],
        z=curve.value_um.T,
        customdata=curve.std_um.T,
        colorscale="RdBu",
        reversescale=True,
        zmin=-largest_um,
        zmax=largest_um,
        ncontours=16,
        line={"width": 0.5},
        colorbar={"title": {"text": "µm", "side": "top"}, "thickness": 14},
        hovertemplate="(%{x:.6g}, %{y:.6g}): %{z:.2f} ± %{customdata:.2f} µm<extra></extra>",
    )


_Row = tuple[str, str, float, bool, float | None, float | None]


def _rows(diagnosis: Diagnosis) -> list[_Row]:
    """Give name, kind, worth, whether the cameras', held-out error without and with."""
    found = [_row(finding, _FOUND) for finding in diagnosis.found]
    names = {name for name, *_ in found}
    tied = {finding.reference for finding in diagnosis.not_told_apart}
    others = [
        _row(finding, _TIED if finding.reference in tied else _LEFT)
        for finding in diagnosis.candidates
        if str(finding.reference) not in names
    ]
    unknown = diagnosis.unknown
    if unknown is not None:
        held = unknown.held_out
        before_um, after_um = (None, None) if held is None else (held.before_um, held.after_um)
        found.append((f"unknown: {unknown.component} over {', '.join(unknown.depends_on)}", _UNKNOWN,
                      unknown.worth_um, False, before_um, after_um))  # fmt: skip
    return [row for row in (*found, *others) if math.isfinite(row[2])]


def _row(finding: Finding, kind: str) -> _Row:
    held = finding.held_out
    before_um, after_um = (None, None) if held is None else (held.before_um, held.after_um)
    return (str(finding.reference), kind, finding.worth_um, finding.is_rig, before_um, after_um)
