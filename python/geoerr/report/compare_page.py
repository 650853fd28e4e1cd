"""The page of a comparison: how far a model is off, and where, in tables and pictures."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from geoerr.diagnose import Comparison, LengthComparison, Part, SpreadTrend, Trend
from geoerr.diagnose.components import LENGTH, RADIUS, is_circle, is_length
from geoerr.diagnose.spread_trends import spreads_to_tell
from geoerr.machine import AXES
from geoerr.report.figures import residual_of_regions, residuals, style, variable_label
from geoerr.report.page import (
    NOT_COMPUTABLE,
    Block,
    Figure,
    Maker,
    Paragraph,
    Progress,
    Section,
    Table,
    made,
    write_report,
)
from geoerr.report.provenance import Provenance
from geoerr.summaries import capitalised, p_text

_MOST_TRENDS = 4
_MOST_WORST = 20
# What would be written as 0.
_LEAST_WORTH_UM = 0.005
_FREEDOM = {
    "own": "These are the data that the model was fitted to: its own numbers take part.",
    "refit": "The model's numbers were fitted to these data.",
    "held": "The model's numbers stay as they are; only where each measuring frame stands is fitted.",
}


def write_comparison_page(
    path: str | Path,
    comparison: Comparison,
    document: Mapping[str, Any],
    provenance: Provenance,
    progress: Progress | None = None,
) -> None:
    """Write the page, whole or not at all.

    Parameters
    ----------
    path
        HTML to write.
    comparison
        What is drawn.
    document
        Its figures, as `to_document` gives them.
    provenance
        For the last section.
    progress
        Called with the steps done and their number.
    """
    title = f"{comparison.model.machine.name}: model against measurements"
    sections = comparison_sections(comparison, document, progress)
    notes = () if comparison.fitted is None else comparison.fitted.sightings.notes
    said = [*comparison_sentences(comparison, document), *(f"{capitalised(note)}." for note in notes)]
    write_report(path, title, said, sections, provenance)


def comparison_sentences(comparison: Comparison, document: Mapping[str, Any]) -> list[str]:
    """Say how far the model is off, and how much of that is noise."""
    sentences = [_FREEDOM[comparison.freedom], f"Residual {style.text_um(comparison.rmse_um)} rms."]
    for name, key in (("Held out", "held_out_rmse_um"), ("Noise floor", "noise_floor_um")):
        value = document[key]
        sentences.append(f"{name}: {NOT_COMPUTABLE if value is None else style.text_um(value)}.")
    return sentences


def comparison_sections(
    comparison: Comparison, document: Mapping[str, Any], progress: Progress | None = None
) -> list[Section]:
    """Show how far the model is off, where, along what, and the worst places; lengths by themselves."""
    makers: list[Maker] = []
    if comparison.fitted is not None:
        makers = [
            lambda: _how_far(comparison),
            lambda: _where(comparison),
            lambda: _what_it_follows(comparison),
            lambda: [Section("Worst places", (_worst_table(comparison, document["worst"]),))],
        ]
    lengths = comparison.lengths
    if lengths is not None:
        makers.append(lambda: [Section("Lengths", (_length_table(lengths),))])
    return made(makers, progress)


def _how_far(comparison: Comparison) -> list[Section]:
    blocks: list[Block] = [
        Figure(
            residuals.residual_histogram(comparison), "Residuals component by component, beside the noise of repeats."
        )
    ]
    blocks += [
        _part_table(title, parts)
        for title, parts in (
            ("By line", comparison.by_line),
            ("By direction of approach", comparison.by_direction),
            ("By target", comparison.by_target),
            ("By session", comparison.by_session),
        )
        if len(parts) > 1
    ]
    return [Section("How far the model is off", tuple(blocks))]


def _where(comparison: Comparison) -> list[Section]:
    if len(comparison.regions) < 2 or not any(component.name in AXES for component in comparison.components):
        return []
    where: tuple[Block, ...] = (
        Figure(residuals.residual_vectors(comparison), "Residuals at their commanded positions, by length."),
        Figure(residuals.residual_directions(comparison), "The same by direction: clusters are what is missing."),
        Figure(residual_of_regions(comparison), "By region of the volume: mean, and ± one standard deviation."),
        Figure(residuals.residual_by_region(comparison), "Mean, spread and number of rows by region."),
    )
    return [Section("Where it is off", where)]


def _what_it_follows(comparison: Comparison) -> list[Section]:
    named = list(dict.fromkeys(trend.variable for trend in comparison.trends))[:_MOST_TRENDS]
    follows: list[Block] = [
        Figure(residuals.residual_against(comparison, name), f"The residual over {_words(name)}.") for name in named
    ]
    if len(named) > 1:
        follows.append(
            Figure(
                residuals.residual_against(comparison, named[1], named[0]),
                f"The residual over {_words(named[1])}, coloured by {_words(named[0])}: a loop is what one variable "
                "leaves open.",
            )
        )
    shown = [trend for trend in comparison.trends if trend.worth_um >= _LEAST_WORTH_UM]
    table: Block = Paragraph("Nothing varies in these data.")
    if shown:
        table = _trend_table(shown)
    elif comparison.trends:
        table = Paragraph("The residual follows nothing that was looked at.")
    spreads = spreads_to_tell(comparison.spread_trends, _LEAST_WORTH_UM)
    tables: list[Block] = [table, *([_spread_table(spreads)] if spreads else [])]
    told = {(one.variable, one.component) for one in shown[:_MOST_TRENDS]}
    told |= {(one.variable, one.component) for one in spreads[:_MOST_TRENDS]}
    tables += [_bin_table(trend) for trend in comparison.trends if (trend.variable, trend.component) in told]
    return [Section("What the residual follows", (*tables, *follows))]


def _part_table(title: str, parts: Sequence[Part]) -> Table:
    rows = tuple(
        (
            part.name,
            "–" if part.rmse_um is None else f"{part.rmse_um:.2f}",
            str(part.figures.n),
            ", ".join(f"{name} {_number(value)}" for name, value in part.mean_um.items()),
        )
        for part in parts
    )
    return Table(title, ("", "rms, µm", "rows", "mean, µm"), rows)


def _trend_table(trends: Sequence[Trend]) -> Table:
    rows = tuple((variable_label(trend.variable), trend.component, f"{trend.worth_um:.2f}") for trend in trends)
    return Table(
        "Largest first, over pixels last: how much the means of bins differ, rms",
        ("over", "component", "worth, µm"),
        rows,
    )


def _spread_table(spreads: Sequence[SpreadTrend]) -> Table:
    rows = tuple(
        (
            variable_label(one.variable),
            one.component,
            f"{one.least_um:.2f}",
            f"{one.most_um:.2f}",
            "within runs" if one.is_within_runs else "about the mean",
            p_text(one.p_value, 1),
        )
        for one in spreads
    )
    return Table(
        "What its size follows about the mean of each bin, and within runs, surest first",
        ("over", "component", "least rms, µm", "most, µm", "", "p"),
        rows,
    )


def _bin_table(trend: Trend) -> Table:
    rows = tuple(
        (
            f"{one.low:.6g}",
            f"{one.high:.6g}",
            str(one.n),
            _number(one.mean_um),
            "–" if math.isnan(one.std_error_um) else f"{one.std_error_um:.2f}",
            f"{one.rms_um:.2f}",
        )
        for one in trend.bins
    )
    header = ("from", "to", "rows", "mean, µm", "its standard error", "rms, µm")
    return Table(f"{capitalised(trend.component)} over {variable_label(trend.variable)}", header, rows)


def _worst_table(comparison: Comparison, worst: Sequence[Mapping[str, Any]]) -> Table:
    """Show the worst rows; what a radius or a length is off by is no component of a position."""
    fitted = comparison.points
    kinds = {RADIUS: is_circle(fitted), LENGTH: is_length(fitted)}
    off = []
    for row, one in zip(comparison.worst[:_MOST_WORST].tolist(), worst, strict=False):
        kind = next((name for name, own in kinds.items() if own[row]), None)
        values = one["residual_um"]
        off.append(dict(zip(AXES, values, strict=True)) if kind is None else {kind: values[0]})
    names = [name for name in (*AXES, *kinds) if any(own.get(name) is not None for own in off)]
    rows = tuple(
        (
            str(one["line"]),
            *(f"{one[axis]:.6g}" for axis in AXES),
            *("–" if own.get(name) is None else _number(own[name]) for name in names),
        )
        for one, own in zip(worst, off, strict=False)
    )
    header = ("line", *(f"{axis}, mm" for axis in AXES), *(f"residual {name}, µm" for name in names))
    return Table("Rows with the longest residuals", header, rows)


def _length_table(lengths: LengthComparison) -> Table:
    groups = lengths.by("group") or {"all": (lengths.rms_um, len(lengths))}
    rows = tuple((name or "no group", f"{rms_um:.2f}", str(n)) for name, (rms_um, n) in groups.items())
    return Table("Measured minus predicted length, rms", ("group", "rms, µm", "lengths"), rows)


def _words(variable: str) -> str:
    """Name a variable without its unit, which the axis has."""
    return variable_label(variable).partition(",")[0]


def _number(value: float) -> str:
    # What rounds to 0 has no sign.
    return f"{round(value, 1) + 0.0:+.1f}".replace("-", "−")
