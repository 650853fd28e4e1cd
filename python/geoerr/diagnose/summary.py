"""A comparison, a diagnosis and a change as small tables for a notebook."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from geoerr.diagnose.spread_trends import spreads_to_tell
from geoerr.diagnose.words import chance_words
from geoerr.fit import figures_document
from geoerr.model.fit_words import FIGURES
from geoerr.summaries import capitalised, facts_html, number_text, p_text, sentences_html, summary_html, table_html

if TYPE_CHECKING:
    from geoerr.diagnose.change import Change
    from geoerr.diagnose.circles.diagnosis import CircleDiagnosis
    from geoerr.diagnose.comparison import Comparison
    from geoerr.diagnose.diagnosis import Diagnosis
    from geoerr.fit import Fitted

_FREEDOM = {
    "own": "the data that the model was fitted to",
    "refit": "other data, fitted anew",
    "held": "other data; the model's numbers stay as they are",
}
_WORST_LINES, _MOST_TRENDS = 8, 5


def comparison_html(comparison: Comparison) -> str:
    """Show how far a model is off, on which lines most, and what the residual follows."""
    parts = [facts_html({"model": comparison.model.machine.name, "held against": _FREEDOM[comparison.freedom]})]
    if comparison.fitted is not None:
        lines = [part for part in comparison.by_line if part.rmse_um is not None]
        lines.sort(key=lambda part: -(part.rmse_um or 0.0))
        trends = [one for one in comparison.trends[:_MOST_TRENDS] if one.worth_um > 0.0]
        parts += [
            facts_html(_figures(comparison.fitted)),
            table_html(
                ("line, worst first", "rms, µm", "rows"),
                [(part.name, number_text(part.rmse_um), str(part.figures.n)) for part in lines[:_WORST_LINES]],
            ),
            table_html(
                ("the residual follows", "along", "worth, µm"),
                [(one.variable, one.component, number_text(one.worth_um)) for one in trends],
            ),
            table_html(
                ("its size follows", "along", "rms, µm"),
                [
                    (one.variable, one.component, f"{number_text(one.least_um)} to {number_text(one.most_um)}")
                    for one in spreads_to_tell(comparison.spread_trends, 0.0)[:_MOST_TRENDS]
                ],
            ),
        ]
    if comparison.lengths is not None:
        rms_um, n = comparison.lengths.rms_um, len(comparison.lengths)
        parts.append(facts_html({"lengths": f"{n}, {number_text(rms_um)} µm rms"}))
    return summary_html("Comparison", *parts)


def diagnosis_html(diagnosis: Diagnosis) -> str:
    """Show the verdict, what was found with its worth, and the nearest candidates."""
    facts = {
        "verdict": diagnosis.verdict,
        "that nothing is missing": chance_words(diagnosis.p_value),
        "held out": f"{number_text(diagnosis.held_out_rmse_um)} µm",
        "noise floor": f"{number_text(diagnosis.noise_floor_um)} µm",
    }
    found = {str(one.reference) for one in diagnosis.found}
    tied = {str(one.reference) for one in diagnosis.not_told_apart}
    listed = [*diagnosis.found, *(one for one in diagnosis.candidates if str(one.reference) not in found)]
    rows = [
        (
            "found" if str(one.reference) in found else "tied" if str(one.reference) in tied else "looked at",
            str(one.reference),
            number_text(one.worth_um),
            p_text(one.p_value),
            number_text(one.held_out_rmse_after_um),
            "; ".join(one.value_words),
        )
        for one in listed
    ]
    header = ("", "effect", "worth, µm", "p", "held out with it, µm", "values")
    sentence = diagnosis.sentence
    return summary_html(
        "Diagnosis",
        sentences_html(f"{capitalised(sentence)}.", *(f"{capitalised(note)}." for note in diagnosis.notes)),
        facts_html(facts),
        table_html(header, rows),
    )


def circle_diagnosis_html(diagnosis: CircleDiagnosis) -> str:
    """Show the causes of a circle's deviation, and its runs."""
    causes = [
        ("" if one.percent is None else f"{one.percent:.0f} %", str(one.reference), number_text(one.worth_um))
        for one in diagnosis.ranked
    ]
    runs = [
        (run.name, run.plane.upper(), *(number_text(value) for value in (run.circular_deviation_um, run.rest_um)))
        for run in diagnosis.runs
    ]
    return summary_html(
        "Diagnosis of circular tests",
        facts_html({"verdict": diagnosis.verdict, "that nothing is missing": chance_words(diagnosis.p_value)}),
        table_html(("part", "cause", "worth, µm"), causes),
        table_html(("run", "plane", "G (ISO 230-4), µm", "rest, µm"), runs),
    )


def change_html(change: Change) -> str:
    """Show the error before and after a change, on the same rows."""
    before, after = (_figures(fitted) for fitted in (change.before, change.after))
    names: Iterable[str] = dict.fromkeys((*before, *after))
    rows = [(name, before.get(name, "–"), after.get(name, "–")) for name in names]
    history = () if change.result.model.record is None else change.result.model.record.history
    told = [f"{history[-1].action} {history[-1].reference}: {history[-1].title}"] if history else []
    return summary_html("Change", sentences_html(*told), table_html(("", "before", "after"), rows))


def _figures(fitted: Fitted) -> dict[str, str]:
    figures = figures_document(fitted)
    return {
        words: f"{number_text(figures[name])} µm" for name, words in FIGURES.items() if figures.get(name) is not None
    }
