"""A model, its record and its history as small tables for a notebook."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

from geoerr.machine import AXES
from geoerr.model.effect_values import effect_values
from geoerr.model.fit_words import FIGURES
from geoerr.summaries import by_reason, facts_html, number_text, sentences_html, span_text, summary_html, table_html

if TYPE_CHECKING:
    from geoerr.model.model import Model
    from geoerr.model.record import FitRecord, HistoryEntry

_HISTORY = ("", "effect", "in words", "residual, µm", "held out, µm")


def model_html(model: Model) -> str:
    """Show what a model is made of, how well it is known, and how it came about."""
    facts = {"machine": f"{model.machine.name}, {model.machine.chain}"}
    if model.errors is not None:
        facts["tables"] = (
            f"{len(model.errors.functions)} error functions, {len(model.errors.squareness)} squarenesses"
        )
    effects = [term for term in model.terms if term.kind != "classic"]
    if model.terms:
        facts["terms"] = f"{len(model.terms) - len(effects)} classic, {len(effects)} others"
    if model.is_nominal:
        facts["errors"] = "none: the nominal machine"
    if model.conditions:
        facts["predictions need"] = ", ".join(model.conditions)
    rows = [(name, *one) for name, values in effect_values(model).items() for one in values]
    parts = [facts_html(facts), table_html(("effect", "value", "would physics give it"), rows)]
    if model.record is not None:
        parts.append(record_parts(model.record))
    return summary_html("Model", *parts)


def record_html(record: FitRecord) -> str:
    """Show what a fit knows besides the values."""
    return summary_html("Record of a fit", record_parts(record))


def history_html(history: Sequence[HistoryEntry]) -> str:
    """Show effects that were added and taken away, with the error before and after."""
    return summary_html("History", _steps(history))


def record_parts(record: FitRecord) -> str:
    """Give data, figures, what is not determined, and the history, as HTML."""
    facts = {"data": f"{record.n_rows} rows, {record.n_outliers} outliers"}
    spans = [f"{axis} {span_text(*record.range_mm[axis])} mm" for axis in AXES if axis in record.range_mm]
    if spans:
        facts["measured range"] = ", ".join(spans)
    facts |= {name: span_text(*span) for name, span in record.covariate_spans.items()}
    facts |= {
        words: f"{record.figures[name]:.2f} µm"
        for name, words in FIGURES.items()
        if name in record.figures and not math.isnan(record.figures[name])
    }
    reasons = by_reason((item.name, item.why) for item in record.not_determined)
    unknown = [(", ".join(names), why) for why, names in reasons.items()]
    return facts_html(facts) + table_html(("not determined", "why"), unknown) + _steps(record.history)


def _steps(history: Sequence[HistoryEntry]) -> str:
    if not history:
        return sentences_html("Nothing was added to it or taken from it since it was fitted.")
    rows = [
        (
            entry.action,
            entry.reference,
            entry.title,
            *(
                " → ".join(number_text(figures.get(name)) for figures in (entry.figures_before, entry.figures_after))
                for name in ("rmse_um", "held_out_rmse_um")
            ),
        )
        for entry in history
    ]
    return table_html(_HISTORY, rows)
