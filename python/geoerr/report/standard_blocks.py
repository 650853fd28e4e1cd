"""What standards ask of a machine, as tables and pictures: circles, positioning of each axis, diagonals."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence

from geoerr.machine import AXES
from geoerr.model.in_model import in_order, not_in_model_words
from geoerr.report.ballbar import circular_test_blocks
from geoerr.report.figures import positioning_curves, predicted_circles, style
from geoerr.report.model_report import MeasuredLine, ModelReport, thinned
from geoerr.report.page import NOT_DETERMINED, NOT_KNOWN, Block, Figure, Heading, Paragraph, Table, as_sentence
from geoerr.summaries import number_text
from geoerr.verify.ballbar import CircularTestResult
from geoerr.verify.positioning import USUAL_RUNS, PositioningTest

_MOST_LINES = 12
_MOST_DRAWN = 6
_LETTERS = (
    "A accuracy, E systematic deviation, M range of the mean of both ways, R repeatability, B largest reversal, all "
    "of both ways; arrows: one way. Deviations are those of the point that was looked at."
)


def circle_blocks(results: Sequence[CircularTestResult]) -> tuple[Block, ...]:
    """Show the predicted circles side by side in a table and each in a picture; measured ones with their runs."""
    predicted = [one for one in results if not one.runs]
    blocks: list[Block] = []
    if predicted:
        caption = "Radial deviation round a circle in each plane, as the model has it, both ways round."
        blocks += [Figure(predicted_circles([one.before for one in predicted]), caption), _circle_table(predicted)]
        notes = dict.fromkeys(note for one in predicted for note in one.notes)
        blocks += map(as_sentence, notes)
        open_ones = predicted[0].assumed_zero
        if open_ones:
            said = f"Not determined or not in the model, and taken as 0 here: {', '.join(open_ones)}."
            blocks.append(Paragraph(said))
    for one in results:
        if one.runs:
            blocks += [Heading("Measured circles"), *circular_test_blocks(one)]
    return tuple(blocks)


def positioning_blocks(report: ModelReport) -> tuple[Block, ...]:
    """Show what was measured along each axis; of an axis without such a line what the model predicts, said so."""
    blocks: list[Block] = []
    lines = report.measured_lines
    if lines:
        shown = thinned(lines, _MOST_LINES)
        caption = f"Measured, µm; {_count(lines, shown)}of the lines that were run both ways"
        blocks += [
            _figure("Positioning, measured", shown, "mean of the runs and two standard deviations of a run"),
            _measured_table(caption, shown),
            *_alone_paragraphs(lines),
            Paragraph(_LETTERS),
        ]
        if any(one.test.n_runs < USUAL_RUNS for one in lines):
            blocks.append(
                Paragraph(
                    f"The standard asks for {USUAL_RUNS} runs each way; some lines have fewer. "
                    "One run tells neither A nor R."
                )
            )
    seen = {one.line.moving for one in lines}
    rest = {axis.upper(): test for axis, test in report.predicted_lines.items() if axis not in seen}
    if rest:
        why = (
            f"No line along {', '.join(rest)} was run both ways to five targets: what follows is the model's own "
            "prediction of the tool point, through the middle of the volume. A model does not scatter: there is "
            "neither A nor R."
        )
        figure = positioning_curves(rest, "Positioning, predicted", "by the model; no measurement of its own")
        blocks += [
            Paragraph(why),
            Figure(figure, "Positioning of the tool point as the model has it."),
            _predicted_table(rest),
            *_absent(rest.values()),
        ]
    nothing = [axis.upper() for axis in AXES if axis not in seen and axis not in report.predicted_lines]
    if nothing and blocks:
        text = (
            f"Of {', '.join(nothing)} nothing is said: no line was run both ways to five targets, and the model does"
        )
        blocks.append(Paragraph(f"{text} not tell."))
    return tuple(blocks)


def diagonal_blocks(report: ModelReport) -> tuple[Block, ...]:
    """Show the model's four space diagonals, and diagonals that were measured."""
    blocks: list[Block] = []
    if report.diagonals:
        figure = positioning_curves(
            report.diagonals,
            "Space diagonals, predicted",
            "by the model, of the tool point; P: that axis rises from the first corner, N: it falls",
        )
        rows = tuple(
            (
                name,
                f"{test.position_mm[-1]:.1f}",
                *(_um(value) for value in (test.systematic_um, *test.one_way_systematic_um)),
                _um(test.mean_um),
                _um(test.reversal_um),
                _known_to(test),
            )
            for name, test in report.diagonals.items()
        )
        header = ("diagonal", "length, mm", "E", "E↑", "E↓", "M", "B", "deviation known to ± (95 %)")
        blocks += [
            Figure(figure, "Deviation along each diagonal of the working volume."),
            Table("Predicted, µm", header, rows),
            *_absent(report.diagonals.values()),
            Paragraph(
                f"E_d = {style.text_um(report.diagonal_systematic_um or 0.0)}, the largest systematic deviation; "
                f"B_d = {style.text_um(report.diagonal_reversal_um or 0.0)}, the largest reversal. Diagonals that "
                "differ in pairs tell axes that are not square."
            ),
        ]
    if report.measured_diagonals:
        shown = thinned(report.measured_diagonals, _MOST_LINES)
        caption = f"Measured, µm; {_count(report.measured_diagonals, shown)}of the lines along several axes"
        blocks += [
            _figure("Diagonals, measured", shown, "mean of the runs and two standard deviations of a run"),
            _measured_table(caption, shown),
            *_alone_paragraphs(report.measured_diagonals),
        ]
    return tuple(blocks)


def _circle_table(results: Sequence[CircularTestResult]) -> Table:
    rows = tuple(
        (
            one.before[0].circle.plane,
            f"{one.before[0].circle.radius_mm:g}",
            ", ".join(f"{value:g}" for value in one.before[0].circle.center_mm),
            *(_um(trace.circular_deviation_mm * style.UM_PER_MM) for trace in one.before),
            *(_um((trace.fitted.radius_mm - trace.circle.radius_mm) * style.UM_PER_MM) for trace in one.before[:1]),
        )
        for one in results
    )
    header = ("plane", "radius, mm", "centre (x, y, z), mm", "G counter-clockwise", "G clockwise", "radius deviation")
    return Table("Circular deviation G of the model, and of the mean radius, µm", header, rows)


def _measured_table(caption: str, lines: Sequence[MeasuredLine]) -> Table:
    rows = []
    for one in lines:
        test = one.test
        one_way = test.one_way_repeatability_um or (None, None)
        values = (test.accuracy_um, test.systematic_um, *test.one_way_systematic_um, test.mean_um)
        more = (test.repeatability_um, *one_way, test.reversal_um, test.mean_reversal_um)
        counts = (str(len(test.position_mm)), str(test.n_runs))
        rows.append((_name(one), _ends(one), *counts, *map(_um, (*values, *more))))
    header = ("line", "from – to, mm", "targets", "runs", "A", "E", "E↑", "E↓", "M", "R", "R↑", "R↓", "B", "mean B")
    return Table(caption, header, tuple(rows))


def _alone_paragraphs(lines: Sequence[MeasuredLine]) -> list[Paragraph]:
    """Say which lines have readings that are most likely mistakes in their figures, and what they do to them."""
    said = []
    for one in lines:
        if not one.n_alone:
            continue
        they = "1 reading stands" if one.n_alone == 1 else f"{one.n_alone} readings stand"
        text = (
            f"{_name(one)}: {they} alone, far from all around and found again by no other run. The standard takes "
            "every reading, and the figures above do"
        )
        rest = one.without_alone
        if rest is not None:
            values = zip(
                "AERB",
                (rest.accuracy_um, rest.systematic_um, rest.repeatability_um, rest.reversal_um),
                strict=True,
            )
            figures = ", ".join(f"{letter} {_um(value)}" for letter, value in values if value is not None)
            text += f"; without {'it' if one.n_alone == 1 else 'them'}, µm: {figures}"
        said.append(Paragraph(f"{text}."))
    return said


def _predicted_table(tests: Mapping[str, PositioningTest]) -> Table:
    rows = tuple(
        (
            name,
            *(_um(value) for value in (test.systematic_um, *test.one_way_systematic_um, test.mean_um)),
            *(_um(value) for value in (test.reversal_um, test.mean_reversal_um)),
            _known_to(test),
        )
        for name, test in tests.items()
    )
    header = ("axis", "E", "E↑", "E↓", "M", "B", "mean B", "deviation known to ± (95 %)")
    return Table("Predicted, µm", header, rows)


def _absent(tests: Iterable[PositioningTest]) -> list[Block]:
    """Say which errors that move these lines the model does not have: how well they are known nobody knows then."""
    names = in_order(name for test in tests for name in test.not_in_model)
    return [as_sentence(not_in_model_words(names))] if names else []


def _known_to(test: PositioningTest) -> str:
    known_um = test.known_to_um
    if known_um is not None and test.not_in_model:
        return NOT_KNOWN
    return NOT_DETERMINED if known_um is not None and math.isnan(known_um) else _um(known_um)


def _figure(title: str, lines: Sequence[MeasuredLine], subtitle: str) -> Figure:
    drawn = thinned(lines, _MOST_DRAWN)
    caption = "Deviation from the command at each target, forwards and backwards."
    if len(drawn) < len(lines):
        caption += f" {len(drawn)} of {len(lines)} lines are drawn."
    return Figure(positioning_curves({_name(one): one.test for one in drawn}, title, subtitle), caption)


def _name(one: MeasuredLine) -> str:
    """Name a line by its axes, and by what the data call it; its place, where several have one name."""
    line = one.line
    still = [
        f"{axis} {value:g}"
        for axis, value in zip(AXES, line.start_mm.tolist(), strict=True)
        if axis not in line.moving
    ]
    told = [
        text for text in (line.line, line.target, f"session {line.session}" if line.session != "0" else "") if text
    ]
    place = f" at {', '.join(still)} mm" if still else ""
    return f"{line.moving.upper()}{place}" + (f" ({', '.join(told)})" if told else "")


def _ends(one: MeasuredLine) -> str:
    first, last = one.ends_mm
    if len(one.line.moving) == 1:
        axis = AXES.index(one.line.moving)
        return f"{_place(first[axis])} – {_place(last[axis])}"
    return " – ".join(f"({', '.join(map(_place, end))})" for end in (first, last))


def _place(position_mm: float) -> str:
    """Show a place to the micrometre: what an encoder adds says nothing here."""
    return f"{round(float(position_mm), 3) + 0.0:g}"


def _count(lines: Sequence[MeasuredLine], shown: Sequence[MeasuredLine]) -> str:
    return "" if len(shown) == len(lines) else f"{len(shown)} of {len(lines)} "


def _um(value: float | None) -> str:
    return number_text(value, 1)
