"""A fit as one JSON document: shared by the verbs that fit."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from geoerr.diagnose.document import comparison_document
from geoerr.effects import plausible_what
from geoerr.effects.amplitudes import amplitudes_by_term, parts_of
from geoerr.fit import FitResult, Fitted
from geoerr.fit.elsewhere import beyond_the_lines_document, beyond_the_lines_um, places_left_out
from geoerr.machine import AXES
from geoerr.model import HistoryEntry
from geoerr.report.provenance import provenance_of_command
from geoerr.tables import RowProblem


def fit_document(
    result: FitResult,
    before: Fitted,
    output: Path | None,
    inputs: Sequence[Path],
    set_aside: Sequence[RowProblem],
) -> dict[str, Any]:
    """Give what `--json` prints: the fit, the figures before and after, the history, where it comes from.

    Parameters
    ----------
    result
        The fit.
    before
        What its figures are held against.
    output
        The model that was written.
    inputs
        Files that were read.
    set_aside
        Rows of them that could not be used.
    """
    fitted, record = result.fitted, result.model.record
    assert record is not None
    document = result.to_document()
    amplitudes = amplitudes_by_term(fitted.terms, fitted.covariance)
    for term in fitted.terms:
        parts = parts_of(amplitudes[term.id])
        for parameter in (*term.coefficients, *term.inner):
            plausible = None if parameter.name in parts else plausible_what(parameter, term.inner)
            document["parameters"][f"{term.id}.{parameter.name}"]["plausible"] = plausible
    by_place = {axis: places_left_out(fitted, axis) for axis in AXES}
    return {
        "output": None if output is None else str(output),
        **document,
        "amplitudes": {name: [one.to_document() for one in own] for name, own in amplitudes.items() if own},
        "held_out_by_line_um": beyond_the_lines_document(beyond_the_lines_um(before, fitted)),
        "held_out_by_place_um": {axis: None if one is None else one.um() for axis, one in by_place.items()},
        "before": comparison_document(before),
        "after": comparison_document(fitted),
        "history": [_entry_document(entry) for entry in record.history],
        "set_aside": [str(problem) for problem in set_aside],
        "provenance": provenance_of_command(inputs).to_document(),
    }


def _entry_document(entry: HistoryEntry) -> dict[str, Any]:
    return {
        "action": entry.action,
        "effect": entry.reference,
        "before": dict(entry.figures_before),
        "after": dict(entry.figures_after),
    }
