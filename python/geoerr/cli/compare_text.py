"""A comparison in words and tables that fit the terminal."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from geoerr.cli.fit_text import figure_rows, quality_in_words
from geoerr.cli.options import note, note_left_out, note_set_aside
from geoerr.cli.text_tables import named_row, wrapped
from geoerr.diagnose import Comparison, LengthComparison, Part, Region, SpreadTrend, Trend
from geoerr.diagnose.labels import variable_meaning
from geoerr.diagnose.regions import region_name
from geoerr.diagnose.spread_trends import spreads_to_tell
from geoerr.machine import AXES
from geoerr.measurements import Measurements
from geoerr.model.fit_words import noise_words
from geoerr.observations import PIXELS
from geoerr.summaries import counted, p_words

_MOST_LINES = 12
_MOST_NAMED = 5
_MOST_TRENDS = 3
_MOST_REGIONS = 5
# Below this share of the residual a trend is not worth a table.
_LEAST_SHARE = 0.1
_MEANINGS = {
    "own": "these are the data that the model was fitted to: its own numbers take part",
    "refit": "the model's numbers were fitted to these data (--refit)",
    "held": "the model's numbers stay as they are; only where each measuring frame stands is fitted",
}
_SIGNIFICANCE = 0.01


def comparison_lines(comparison: Comparison, document: Mapping[str, Any], places: Mapping[int, str]) -> list[str]:
    """Give everything that the verb prints.

    Parameters
    ----------
    comparison
        What is reported.
    document
        Its figures, as `to_document` gives them.
    places
        Where the worst rows stand, by number of the row.
    """
    machine = comparison.model.machine
    lines = wrapped(f"{machine.name} ({machine.chain}): {_data_in_words(comparison)}")
    fitted = comparison.fitted
    lines += [*wrapped(_MEANINGS[comparison.freedom]), "", *figure_rows({"": document})]
    if fitted is not None:
        lines += [*_expected(comparison), *_set_up(comparison), ""]
        for sentence in _quality(comparison):
            lines += wrapped(sentence)
        lines += _part_table("by line, worst first", comparison.by_line, is_sorted=True)
        lines += _part_table("by direction of approach", comparison.by_direction)
        lines += _part_table("by what carries the target", comparison.by_carrier)
        lines += _part_table("by target, worst first", comparison.by_target, is_sorted=True)
        lines += _part_table("by session", comparison.by_session, is_sorted=True)
        lines += _region_table(comparison.regions)
        lines += _trend_tables(comparison)
        lines += ["", "worst places:", *_named(comparison, comparison.worst[:_MOST_NAMED].tolist(), places)]
        left_out = np.flatnonzero(~fitted.solved.used).tolist()
        if left_out:
            lines += ["", f"left out as gross errors ({counted(len(left_out), 'row')}):"]
            lines += _named(comparison, left_out[:_MOST_NAMED], places)
    if comparison.lengths is not None:
        lines += _lengths(comparison.lengths)
    return lines


def _data_in_words(comparison: Comparison) -> str:
    return comparison.whole.sightings.in_words()


def _expected(comparison: Comparison) -> Iterator[str]:
    if comparison.expected_rmse_um is not None:
        yield f"{'residual, as a right model would have it':<44}{comparison.expected_rmse_um:>12.2f}"


def _set_up(comparison: Comparison) -> Iterator[str]:
    set_up = comparison.set_up
    if set_up is None:
        return
    yield "rms of all numbers, with the measuring frame"
    yield f"{'  as it is in the file':<44}{set_up.as_measured_um:>12.2f}"
    yield f"{'  shifted':<44}{set_up.shifted_um:>12.2f}"
    if not math.isclose(set_up.shifted_um, set_up.turned_um, rel_tol=1e-6):
        yield f"{'  shifted and turned':<44}{set_up.turned_um:>12.2f}"


def _quality(comparison: Comparison) -> list[str]:
    fitted = comparison.points
    sentences = quality_in_words(fitted)
    p_value = comparison.lack_of_fit_p
    if comparison.own_uncertainty is not None and p_value is not None:
        # The model is not these data's: what its own uncertainty accounts for is no lack of fit.
        sentences[0] = (
            f"the model lacks something: the residual is more than noise and its own uncertainty ({p_words(p_value)})"
            if p_value < _SIGNIFICANCE
            else noise_words(p_value, "noise and the model's own uncertainty")
        )
    return sentences


def _part_table(title: str, parts: Sequence[Part], *, is_sorted: bool = False) -> Iterator[str]:
    if len(parts) < 2:
        return
    ordered = sorted(parts, key=lambda part: -(part.rmse_um or 0.0)) if is_sorted else parts
    yield ""
    yield f"{title + ', µm':<30}{'rms':>9}{'rows':>8}  mean"
    for part in ordered[:_MOST_LINES]:
        figure = "–" if part.rmse_um is None else f"{part.rmse_um:.2f}"
        yield f"  {_short(part.name, 27):<28}{figure:>9}{part.figures.n:>8}  {_means(part.mean_um)}"
    if len(ordered) > _MOST_LINES:
        yield f"  and {len(ordered) - _MOST_LINES} more"


def _region_table(regions: Sequence[Region]) -> Iterator[str]:
    held = [region for region in regions if region.n]
    if len(held) < 2:
        return
    worst = sorted(held, key=lambda region: -(region.rmse_um or 0.0))
    yield ""
    yield f"{'by region, worst first, µm':<30}{'rms':>9}{'rows':>8}  mean"
    for region in worst[:_MOST_REGIONS]:
        figures = f"{region.rmse_um:>9.2f}{region.n:>8}  {_means(region.mean_um)}"
        yield from named_row(region_name(region), 28, figures, "  ")
    rest = [f"{len(worst) - _MOST_REGIONS} more"] if len(worst) > _MOST_REGIONS else []
    if len(held) < len(regions):
        rest.append(f"nothing measured in {len(regions) - len(held)} of {len(regions)}")
    if rest:
        yield ("  and " if len(worst) > _MOST_REGIONS else "  ") + "; ".join(rest)


def _trend_tables(comparison: Comparison) -> Iterator[str]:
    least = _LEAST_SHARE * comparison.rmse_um
    shown: list[Trend] = []
    for trend in comparison.trends:
        # One table a variable, and one of variables that part the rows alike.
        known = any(other.variable == trend.variable or _is_same(other, trend) for other in shown)
        if trend.worth_um >= least and not known:
            shown.append(trend)
    spreads = spreads_to_tell(comparison.spread_trends, least)[:_MOST_TRENDS]
    yield ""
    if not shown:
        whose = "mean of the residual" if spreads else "residual"
        yield f"the {whose} follows nothing in these data by more than a tenth of itself"
    else:
        yield from _of_means(comparison, shown)
    yield from _of_spreads(comparison, spreads, shown[:_MOST_TRENDS])


def _of_means(comparison: Comparison, shown: Sequence[Trend]) -> Iterator[str]:
    behind = ", pixels last" if any(trend.variable in PIXELS for trend in comparison.trends) else ""
    yield from wrapped(
        f"what the residual follows (mean ± standard error of its bins, their rms, µm), the largest first{behind}:"
    )
    for trend in shown[:_MOST_TRENDS]:
        over = f"{_along(trend.component)} over {trend.variable} ({variable_meaning(trend.variable)})"
        yield from wrapped(f"{over}: worth {trend.worth_um:.2f} µm", "  ")
        yield from _bins(trend)
    rest = [
        f"{trend.component} over {trend.variable} ({variable_meaning(trend.variable)}) {trend.worth_um:.1f}"
        for trend in shown[_MOST_TRENDS:]
    ]
    if rest:
        yield from wrapped(f"then, in µm: {'; '.join(rest[:_MOST_LINES])}", "  ")


def _about(spread: SpreadTrend) -> str:
    """Say what a size is about: offsets of runs are in it, or they are not."""
    return "within runs" if spread.is_within_runs else "about the mean"


def _of_spreads(comparison: Comparison, spreads: Sequence[SpreadTrend], shown: Sequence[Trend]) -> Iterator[str]:
    for one in spreads:
        yield from wrapped(
            f"its size follows {one.variable} ({variable_meaning(one.variable)}), {_along(one.component)}: "
            f"{one.least_um:.1f} to {one.most_um:.1f} µm rms {_about(one)} ({p_words(one.p_value, 1)})"
        )
        of_it = next(
            each for each in comparison.trends if (each.variable, each.component) == (one.variable, one.component)
        )
        # The bins of those that are shown above are known.
        if of_it not in shown:
            yield from _bins(of_it)


def _along(component: str) -> str:
    return f"along {component}" if component in AXES else component


def _bins(trend: Trend) -> Iterator[str]:
    for one in trend.bins:
        span = f"{one.low:.6g}" if one.low == one.high else f"{one.low:.6g} to {one.high:.6g}"
        error = "–" if math.isnan(one.std_error_um) else f"{one.std_error_um:.2f}"
        yield f"    {span:<28}{_signed(one.mean_um, 2):>10} ± {error:<8}{one.rms_um:>8.2f} rms{one.n:>8} rows"


def _is_same(one: Trend, other: Trend) -> bool:
    return [(each.n, each.mean_um) for each in one.bins] == [(each.n, each.mean_um) for each in other.bins]


def _named(comparison: Comparison, rows: Sequence[int], places: Mapping[int, str]) -> Iterator[str]:
    fitted = comparison.points
    sightings = fitted.sightings
    lines = sightings.texts("line") if "line" in sightings.table.columns else [""] * len(sightings)
    is_circle, is_length = sightings.of_kind("circle"), sightings.of_kind("lengths")
    for row in rows:
        at = ",\u00a0".join(f"{value:g}" for value in sightings.commanded_mm[row]).replace("-", "−")
        seen = sightings.is_measured[row]
        values = [value if known else math.nan for value, known in zip(fitted.residual_mm[row], seen, strict=True)]
        if is_circle[row]:
            off = f"radius {_signed(1e3 * values[0], 1)} µm"
        elif is_length[row]:
            off = f"length {_signed(1e3 * values[0], 1)} µm"
        else:
            off = (
                "off by ("
                + ",\u00a0".join("–" if math.isnan(v) else _signed(1e3 * v, 1) for v in values)
                + ")\u00a0µm"
            )
        name = f"line {lines[row]}, " if lines[row] else ""
        text = f"{places.get(row, f'row {row + 1}')}: {name}at ({at}) mm, {off}"
        yield from wrapped(text, "  ")


def _lengths(lengths: LengthComparison) -> Iterator[str]:
    yield ""
    yield f"{'lengths, µm: rms, and the worst':<44}{lengths.rms_um:>12.2f}"
    for name, (rms_um, n) in lengths.by("group").items():
        yield f"  {_short(name or 'no group', 40):<42}{rms_um:>12.2f}{n:>8} lengths"
    order = sorted(range(len(lengths)), key=lambda row: -abs(lengths.residual_um[row]))
    for row in order[:_MOST_NAMED]:
        feature = str(lengths.frame["feature"][row] or "a length")
        yield f"  {_short(feature, 40):<42}{_signed(float(lengths.residual_um[row]), 2):>12}"


def _means(mean_um: Mapping[str, float]) -> str:
    return ", ".join(f"{name} {_signed(value, 1)}" for name, value in mean_um.items())


def _signed(value: float, digits: int) -> str:
    return f"{value:+.{digits}f}".replace("-", "−")


def _short(text: str, width: int) -> str:
    return text if len(text) <= width else text[: width - 1] + "…"


def places_of(comparison: Comparison, measured: Measurements) -> dict[int, str]:
    """Say where the rows that are named stand: file and row, as an editor shows it."""
    if comparison.fitted is None:
        return {}
    sightings = comparison.fitted.sightings
    left_out = np.flatnonzero(~comparison.fitted.solved.used).tolist()
    file_rows = sightings.numbers("file_row")
    numbers = [sightings.numbers(name) for name in ("x", "y", "z", "mx", "my", "mz")]
    of_no_points = {"circle": "the circle", "lengths": "the lengths"}
    kinds = [of_no_points.get(sightings.frames[number]) for number in sightings.session]
    return {
        row: measured.place(int(file_rows[row]), [values[row] for values in numbers])
        if kinds[row] is None
        else f"row {int(file_rows[row])} of {kinds[row]}"
        for row in (*comparison.worst[:_MOST_NAMED].tolist(), *left_out[:_MOST_NAMED])
    }


def print_notes(comparison: Comparison, measured: Measurements, quiet: bool) -> None:
    """Say on standard error what took no part."""
    note_set_aside(measured.set_aside, quiet)
    note_left_out(comparison.whole.sightings.left_out, quiet)
    for sentence in comparison.whole.sightings.notes:
        note(f"note: {sentence}", quiet)
