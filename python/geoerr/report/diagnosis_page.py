"""The page of a diagnosis: the verdict, what it rests on in tables and pictures, and what was not looked for."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from geoerr.diagnose.circles import CircleDiagnosis
from geoerr.diagnose.diagnosis import Diagnosis
from geoerr.diagnose.findings import Finding, Unknown
from geoerr.diagnose.words import chance_words
from geoerr.effects import Effect
from geoerr.report.figures import diagnosis as figures
from geoerr.report.figures import style
from geoerr.report.page import NOT_COMPUTABLE, Block, Figure, Paragraph, Section, Table, as_sentence, write_report
from geoerr.report.provenance import Provenance
from geoerr.summaries import by_reason, capitalised, p_text

_UNKNOWN = "–"


def write_diagnosis_page(path: str | Path, diagnosis: Diagnosis, provenance: Provenance) -> None:
    """Write the page, whole or not at all."""
    title = f"{diagnosis.fitted.machine.name}: what is missing"
    write_report(path, title, diagnosis_sentences(diagnosis), diagnosis_sections(diagnosis), provenance)


def diagnosis_sentences(diagnosis: Diagnosis) -> list[str]:
    """Say the verdict, how sure it is, and what error there is now."""
    sentence = diagnosis.sentence
    sentences = [f"{capitalised(sentence)}."]
    chance = chance_words(diagnosis.p_value)
    if chance not in sentence:
        sentences.append(f"That nothing is missing: {chance}.")
    for name, value in (("Held out", diagnosis.held_out_rmse_um), ("Noise floor", diagnosis.noise_floor_um)):
        sentences.append(f"{name}: {NOT_COMPUTABLE if value is None else style.text_um(value)}.")
    if any(finding.is_rig for finding in diagnosis.found):
        sentences.append("An error of the cameras is explained, and never compensated in a program.")
    sentences += [f"{capitalised(note)}." for note in diagnosis.notes]
    return sentences


def write_circle_diagnosis_page(path: str | Path, diagnosis: CircleDiagnosis, provenance: Provenance) -> None:
    """Write the page of circular tests, whole or not at all."""
    title = f"{diagnosis.fitted.machine.name}: circular tests"
    sections = circle_diagnosis_sections(diagnosis)
    write_report(path, title, circle_diagnosis_sentences(diagnosis), sections, provenance)


def circle_diagnosis_sentences(diagnosis: CircleDiagnosis) -> list[str]:
    """Say what was found on the circles, how sure that is, and how much of the trace it is."""
    shares, sentence = diagnosis.shares, diagnosis.sentence
    return [
        f"{capitalised(sentence)}.",
        f"That nothing is missing: {chance_words(diagnosis.p_value)}.",
        f"The trace is {style.text_um(shares.total**0.5)} rms, its causes {style.text_um(shares.explained**0.5)}, "
        f"unexplained {style.text_um(shares.rest**0.5)}, noise {style.text_um(diagnosis.noise_um)}.",
        *(as_sentence(note).text for note in diagnosis.notes),
    ]


def circle_diagnosis_sections(diagnosis: CircleDiagnosis) -> list[Section]:
    """Show the causes with their parts, each in words, and the runs."""
    caption = "Each cause's part of what is more than noise."
    sections = [Section("What the circles are off by", (Figure(figures.circle_causes(diagnosis), caption),))]
    for cause in diagnosis.ranked:
        texts = [f"{cause.words()}.", *_advice(cause.effect)]
        separation = cause.separate_by
        if separation is not None:
            texts.append(f"These runs cannot tell it apart; what would: {separation.plan or separation.text}.")
        sections.append(Section(f"{cause.effect.title}: {cause.reference}", tuple(map(Paragraph, texts))))
    if diagnosis.unknown is not None:
        sections.append(Section("What has no name", (Paragraph(f"{diagnosis.unknown.words()}."),)))
    rows = tuple(
        (
            run.name,
            run.plane.upper(),
            f"{run.sense:+d}",
            _number(run.feed_mm_min),
            f"{run.circular_deviation_um:.2f}",
            f"{run.explained_um:.2f}",
            f"{run.rest_um:.2f}",
        )
        for run in diagnosis.runs
    )
    header = ("run", "plane", "sense", "feed, mm/min", "G (ISO 230-4), µm", "of the causes, µm", "rest, µm")
    sections.append(Section("Runs", (Table("Circular deviation", header, rows),)))
    if diagnosis.not_offered:
        sections.append(Section("What was not looked for", (_by_reason(diagnosis.not_offered),)))
    return sections


def diagnosis_sections(diagnosis: Diagnosis) -> list[Section]:
    """Show the ranking, each finding, its rivals, what has no name, and what was not looked for."""
    sections = []
    if diagnosis.candidates or diagnosis.unknown is not None:
        held_out = ", and the held-out error without it and with it" if figures.has_held_out(diagnosis) else ""
        caption = f"What each candidate is worth{held_out}."
        sections.append(
            Section(
                "What it is worth",
                (Figure(figures.diagnosis_bars(diagnosis), caption), _ranking(diagnosis)),
            )
        )
    for finding in diagnosis.found:
        sections.append(Section(f"{finding.effect.title}: {finding.reference}", _blocks(finding)))
    for finding in diagnosis.found:
        rivals = diagnosis.tied_with(finding)
        if rivals:
            which = finding.reference if len(diagnosis.found) > 1 else "it"
            sections.append(Section(f"What these data cannot tell from {which}", _rivals(rivals)))
    left = [(str(one.reference), one.left_because) for one in diagnosis.candidates if one.left_because]
    if left:
        sections.append(Section("What was looked at and left", (_by_reason(left),)))
    if diagnosis.asked_words:
        # An effect's name begins them, which is not written large.
        asked = tuple(Paragraph(f"{words}.") for words in diagnosis.asked_words)
        sections.append(Section("What was asked for by itself", asked))
    if diagnosis.unknown is not None:
        sections.append(Section("What has no name", _unknown(diagnosis, diagnosis.unknown)))
    if diagnosis.between_passes.stands_out:
        text = as_sentence(diagnosis.between_passes.words())
        sections.append(Section("What does not come back from pass to pass", (text,)))
    if diagnosis.not_offered:
        sections.append(Section("What was not looked for", (_by_reason(diagnosis.not_offered),)))
    return sections


def _by_reason(reasons: Sequence[tuple[str, str]]) -> Table:
    """Name effects by the reason why they are not among what was found."""
    rows = tuple((why, ", ".join(effects)) for why, effects in by_reason(reasons).items())
    return Table("By the reason", ("why", "effects"), rows)


def _ranking(diagnosis: Diagnosis) -> Table:
    names = {finding.reference for finding in diagnosis.found}
    others = [finding for finding in diagnosis.candidates if finding.reference not in names]
    rows = tuple(
        (
            str(finding.reference),
            f"{finding.worth_um:.2f}",
            p_text(finding.p_value),
            _number(None if finding.held_out is None else finding.held_out.before_um),
            _number(finding.held_out_rmse_after_um),
            "; ".join(finding.value_words),
        )
        for finding in (*diagnosis.found, *others)
    )
    header = ("effect", "worth, µm", "p", "held out without, µm", "with, µm", "values")
    return _without_empty_columns(Table("In the order of finding, then best first", header, rows))


def _without_empty_columns(table: Table) -> Table:
    """Leave out the columns of numbers of which none is known."""
    known = [column for column in range(len(table.header)) if any(row[column] != _UNKNOWN for row in table.rows)]
    rows = tuple(tuple(row[column] for column in known) for row in table.rows)
    return Table(table.caption, tuple(table.header[column] for column in known), rows)


def _blocks(finding: Finding) -> tuple[Block, ...]:
    return tuple(Paragraph(text) for text in (f"{finding.words()}.", *_advice(finding.effect)))


def _advice(effect: Effect) -> list[str]:
    """Give cause and remedy; a user's own effect need not say either."""
    said = {"Cause": effect.cause, "What to do": effect.remedy}
    return [f"{what}: {text}." for what, text in said.items() if text]


def _rivals(rivals: Sequence[Finding]) -> tuple[Paragraph, ...]:
    """Describe what is tied, and what would tell it: one measurement for all of it is said once."""
    said = [f"{rival.words()}." for rival in rivals]
    apart = dict.fromkeys(rival.separate_by.words for rival in rivals if rival.separate_by is not None)
    return tuple(Paragraph(text) for text in (*said, *(f"What would tell it: {words}." for words in apart)))


def _unknown(diagnosis: Diagnosis, unknown: Unknown) -> tuple[Block, ...]:
    blocks: list[Block] = [Paragraph(f"{unknown.words()}.")]
    if unknown.curve is not None:
        added = f"It can be added to the model as a {unknown.form} without a cause."
        if unknown.own is not None:
            added = "This is what the model's own curve over the same leaves."
        caption = f"What has no name: it {unknown.shape}. {capitalised(unknown.std_words or '')}. {added}"
        blocks.append(Figure(figures.unknown_curve(diagnosis), caption))
    return tuple(blocks)


def _number(value: float | None) -> str:
    return _UNKNOWN if value is None else f"{value:.2f}"
