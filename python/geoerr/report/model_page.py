"""The report of a model: everything that is known of a machine on one page, as a metrologist reads it."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from pathlib import Path

from geoerr.diagnose.circles import CircleDiagnosis
from geoerr.effects import Effect
from geoerr.files import check_written
from geoerr.model import Model
from geoerr.model.called import check_tables, one_or_several
from geoerr.model.fit_words import NOT_SETTLED, SETTLE
from geoerr.model.in_model import not_in_model_words
from geoerr.observations import CircularTest, Lengths, MeasuredTable, Observations
from geoerr.report import model_report as parts
from geoerr.report.budget_page import budget_sections, budget_sentences
from geoerr.report.compare_page import comparison_sections, comparison_sentences
from geoerr.report.diagnosis_page import (
    circle_diagnosis_sections,
    circle_diagnosis_sentences,
    diagnosis_sections,
    diagnosis_sentences,
)
from geoerr.report.error_tables import error_function_table, not_determined, squareness_table
from geoerr.report.figures import error_curves, error_fall, error_field, style
from geoerr.report.machine_blocks import data_blocks, effect_blocks, machine_blocks, record_blocks
from geoerr.report.model_report import ModelReport, Stated, model_report
from geoerr.report.page import (
    NOT_COMPUTABLE,
    Block,
    Figure,
    Maker,
    Paragraph,
    Progress,
    Section,
    Table,
    as_one,
    as_sentence,
    made,
    write_report,
)
from geoerr.report.provenance import Provenance, provenance_of_call
from geoerr.report.standard_blocks import circle_blocks, diagonal_blocks, positioning_blocks
from geoerr.summaries import capitalised


def write_model_report(
    path: str | Path,
    model: Model,
    observations: Sequence[MeasuredTable] | MeasuredTable = (),
    *,
    at: Stated | None = None,
    search: bool = True,
    effects: Sequence[Effect] = (),
    provenance: Provenance | None = None,
    threads: int = 0,
) -> ModelReport:
    """Write all that is known of a machine as one self-contained page, whole or not at all.

    Parameters
    ----------
    path
        HTML to write; the same input gives the same bytes.
    model
        Any: fitted, of tables, or the machine without errors.
    observations
        Measurements to hold it against: one table, or several.
    at
        Conditions of the predictions; a temperature that is not stated is the machine's reference temperature.
    search
        Whether to look for what the model lacks, too.
    effects
        Your own, for the search.
    provenance
        For the last section; None: this call, and the files that the tables were read from.
    threads
        0 = all cores.

    Returns
    -------
    ModelReport
        Every number on the page.

    Raises
    ------
    GeoerrError
        for a stated condition that the model does not follow, and measurements that cannot be compared with it.
    """
    check_written(path, model, Model, "write_model_report(path, model)")
    tables = one_or_several(observations)
    if tables:
        check_tables(tables, "write_model_report(path, model, observations)", Observations, CircularTest, Lengths)
    gathered = model_report(model, *tables, at=at, search=search, effects=effects, threads=threads)
    sources = [source for table in tables for source in table.sources]
    write_model_page(path, gathered, provenance or provenance_of_call("geoerr.write_model_report", sources))
    return gathered


def write_model_page(
    path: str | Path, report: ModelReport, provenance: Provenance, progress: Progress | None = None
) -> None:
    """Write the page of what was gathered, whole or not at all; `progress` is called with steps done and number."""
    title = f"{report.model.machine.name}: what is known of its errors"
    write_report(path, title, report_sentences(report), model_sections(report, progress), provenance)


def report_sentences(report: ModelReport) -> list[str]:
    """Say the most important of it in a few sentences."""
    sentences = []
    record = report.model.record
    if record is not None and not record.has_settled:
        sentences.append(f"{capitalised(NOT_SETTLED)}: {SETTLE}.")
    if report.assumed:
        degc = report.model.machine.reference_temperature_degc
        sentences.append(
            f"Predictions are for {' = '.join([*report.assumed, f'{degc:g} °C'])}, the machine's reference "
            "temperature, where nothing else is stated."
        )
    if report.comparison is not None:
        sentences += comparison_sentences(report.comparison, report.comparison_document)[1:]
    if report.diagnosis is not None:
        said = (
            circle_diagnosis_sentences(report.diagnosis)
            if isinstance(report.diagnosis, CircleDiagnosis)
            else diagnosis_sentences(report.diagnosis)
        )
        sentences.append(said[0])
    sentences += _circle_sentences(report)
    if report.diagonal_systematic_um is not None:
        sentences.append(
            f"As the model has them, space diagonals deviate by {style.up_to_um(report.diagonal_systematic_um)} "
            f"(E_d, ISO 230-6){_known_to(report)}."
        )
    # Of a prediction that lacks whole axes the uncertainty would be that of a part of it.
    if report.budget is not None and report.has_field:
        sentences += budget_sentences(report.budget)
    if report.not_determined:
        count, names = len(report.not_determined), ", ".join(report.not_determined)
        are = "is" if count == 1 else "are"
        them = "it" if count == 1 else "them"
        sentences.append(f"{count} of the 21 errors {are} not determined; predictions take {them} as 0: {names}.")
    if report.not_in_model:
        sentences.append(f"{capitalised(not_in_model_words(report.not_in_model))}.")
    return sentences or ["The machine, without any errors, and nothing measured of it."]


def _known_to(report: ModelReport) -> str:
    """Say how well the model knows the diagonals: a figure that is smaller than that says nothing of the machine."""
    if report.model.record is not None and any(one.not_in_model for one in report.diagonals.values()):
        return "; how well is not known, for errors that move them are not in the model"
    known = [one.known_to_um for one in report.diagonals.values()]
    stated = [value for value in known if value is not None and math.isfinite(value)]
    return f", which it knows to ± {style.text_um(max(stated))} (95 %)" if stated else ""


def _circle_sentences(report: ModelReport) -> list[str]:
    """Give the largest circular deviation that was measured, and that the model has."""
    measured = [run.measured for one in report.circles for run in one.runs]
    predicted = [
        trace
        for one in report.circles
        for trace in one.before
        if not report.model.is_nominal
        and parts.unknown_needed(report.model, report.errors, trace.circle.plane.lower()) is None
    ]
    sentences = []
    for what, traces in (
        ("Measured circles deviate", measured),
        ("As the model has them, circles deviate", predicted),
    ):
        if traces:
            deviation_um = max(trace.circular_deviation_mm for trace in traces) * style.UM_PER_MM
            sentences.append(f"{what} by {style.up_to_um(deviation_um)} (G, ISO 230-4).")
    return sentences


def model_sections(report: ModelReport, progress: Progress | None = None) -> list[Section]:
    """Make the sections in the order in which a machine is judged: what it is, how far off, why, how sure."""
    model, comparison, errors = report.model, report.comparison, report.errors
    makers: list[Maker] = [
        _maker(parts.MACHINE, lambda: machine_blocks(model)),
        _maker(parts.DATA, lambda: (*(() if comparison is None else data_blocks(comparison)), *record_blocks(model))),
        _maker(parts.ERRORS, lambda: _error_blocks(report)),
        _maker("Effects beyond the 21 errors", lambda: effect_blocks(model)),
        _maker(parts.FIELD, lambda: _field_blocks(report)),
        _maker(parts.CIRCLES, lambda: circle_blocks(report.circles)),
        _maker(parts.POSITIONING, lambda: positioning_blocks(report)),
        _maker(parts.DIAGONALS, lambda: diagonal_blocks(report)),
        lambda: _comparison(report),
        lambda: _judgement(report),
        _maker(parts.NOT_DETERMINED, lambda: () if errors is None else not_determined(errors, report.not_in_model)),
        _maker("Not in this report", lambda: _left_out(report)),
    ]
    return made(makers, progress)


def _maker(title: str, blocks: Callable[[], Sequence[Block]]) -> Maker:
    """Make one section of blocks; none of no blocks."""
    return lambda: [Section(title, tuple(found))] if (found := blocks()) else []


def _comparison(report: ModelReport) -> list[Section]:
    """Make the section of how far measurements are from the model."""
    if report.comparison is None:
        return []
    document = report.comparison_document
    said = Paragraph(" ".join(comparison_sentences(report.comparison, document)))
    return [as_one(parts.COMPARISON, comparison_sections(report.comparison, document), said)]


def _judgement(report: ModelReport) -> list[Section]:
    """Make the sections of what is missing, how the error fell, and how sure the model is."""
    sections = []
    if isinstance(report.diagnosis, CircleDiagnosis):
        told = [Paragraph(sentence) for sentence in circle_diagnosis_sentences(report.diagnosis)]
        sections.append(as_one(parts.DIAGNOSIS, circle_diagnosis_sections(report.diagnosis), *told))
    elif report.diagnosis is not None:
        told = [Paragraph(" ".join(diagnosis_sentences(report.diagnosis)))]
        sections.append(as_one(parts.DIAGNOSIS, diagnosis_sections(report.diagnosis), *told))
    if report.stages:
        sections.append(Section(parts.STORY, _story_blocks(report)))
    if report.budget is not None and report.volume is not None:
        said = Paragraph(" ".join(budget_sentences(report.budget)))
        sections.append(as_one(parts.BUDGET, budget_sections(report.budget, report.volume), said))
    return sections


def _error_blocks(report: ModelReport) -> tuple[Block, ...]:
    if report.errors is None or not (report.errors.functions or report.errors.squareness):
        return ()
    if not report.errors.functions:
        return (
            Paragraph("The model has none of the 18 functions along axes; circular tests alone do not tell them."),
            squareness_table(report.errors, absent=report.not_in_model),
            *map(as_sentence, report.errors.notes),
        )
    caption = "Error functions over their axis, with 95 % intervals where the model knows them; squareness last."
    return (
        Figure(error_curves(report.errors, absent=report.not_in_model), caption),
        error_function_table(report.errors, absent=report.not_in_model),
        squareness_table(report.errors, absent=report.not_in_model),
        *map(as_sentence, report.errors.notes),
    )


def _field_blocks(report: ModelReport) -> tuple[Block, ...]:
    if not report.has_field:
        return ()
    figure = error_field(report.predicted_by, at=report.prediction_conditions)
    blocks: list[Block] = [Figure(figure, "Where the machine puts the points of a grid over its working volume.")]
    if report.not_determined:
        blocks.append(Paragraph(f"Not determined, and taken as 0 here: {', '.join(report.not_determined)}."))
    if report.not_in_model:
        blocks.append(as_sentence(not_in_model_words(report.not_in_model)))
    return tuple(blocks)


def _story_blocks(report: ModelReport) -> tuple[Block, ...]:
    record = report.model.record
    assert record is not None
    rows = tuple(
        (
            f"{number}",
            entry.action,
            entry.reference,
            entry.title,
            *(
                _change(entry.figures_before.get(name), entry.figures_after.get(name))
                for name in ("rmse_um", "held_out_rmse_um")
            ),
        )
        for number, entry in enumerate(record.history, start=1)
    )
    header = ("step", "", "effect", "in words", "residual, µm rms", "held out, µm rms")
    caption = "Each effect that was added or taken away: the error of the same rows before and after."
    return Figure(error_fall(report.stages), caption), Table("Steps", header, rows)


def _left_out(report: ModelReport) -> tuple[Block, ...]:
    rows = tuple(("; ".join(names), why) for why, names in report.left_out_by_reason.items())
    return (Table("Left out", ("what", "why"), rows),) if rows else ()


def _change(before: float | None, after: float | None) -> str:
    texts = [NOT_COMPUTABLE if value is None or math.isnan(value) else f"{value:.2f}" for value in (before, after)]
    return " → ".join(texts)
