"""What `add` and `remove` print: the figures before and after, the effect, and the story of the error so far."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from geoerr.cli.fit_text import figure_rows, parameter_rows, quality_in_words, wrapped
from geoerr.cli.options import note
from geoerr.diagnose.change import Change
from geoerr.diagnose.document import comparison_document
from geoerr.effects import plausible_match
from geoerr.fit.result import CALIBRATION_UNKNOWNS
from geoerr.model import HistoryEntry, Model
from geoerr.report.provenance import provenance_of_command

_BAR_WIDTH = 44
_FULL, _HELD_OUT, _FLOOR = "█", "░", "│"


def change_text(change: Change) -> list[str]:
    """Give the lines for the terminal."""
    after = change.after
    lines = [*figure_rows({"before": comparison_document(change.before), "after": comparison_document(after)}), ""]
    for sentence in quality_in_words(after):
        lines += wrapped(sentence, "")
    effects = [term for term in after.terms if term.kind != "classic"]
    if effects:
        lines += ["", "effects:", *parameter_rows(effects)]
    record = change.result.model.record
    assert record is not None
    lines += ["", *fall(record.history)]
    return lines


def fall(history: Sequence[HistoryEntry]) -> list[str]:
    """Draw the error from the first model to the last: in-sample full, held out hatched, the noise as a line."""
    steps = [("at first", history[0].figures_before)]
    steps += [(f"{'+' if one.action == 'added' else '−'} {one.reference}", one.figures_after) for one in history]
    largest = max(
        (value for _, figures in steps for value in (figures["rmse_um"], figures["held_out_rmse_um"]) if value > 0.0),
        default=1.0,
    )
    width = max(len(name) for name, _ in steps)
    lines = [f"the error, µm ({_FULL} residual rms, {_HELD_OUT} held out, {_FLOOR} noise):"]
    for name, figures in steps:
        inside, held = figures["rmse_um"], figures["held_out_rmse_um"]
        noise = figures["noise_floor_um"] if math.isfinite(figures["noise_floor_um"]) else figures["noise_um"]
        text = f"{inside:.2f}" + (f", held out {held:.2f}" if math.isfinite(held) else "")
        lines.append(f"  {name:<{width}}  {_bar(inside, held, noise, largest)} {text}")
    return lines


def _bar(inside: float, held: float, noise: float, largest: float) -> str:
    def cells(value: float) -> int:
        return round(_BAR_WIDTH * value / largest) if math.isfinite(value) else 0

    bar = [_FULL] * cells(inside)
    bar += [_HELD_OUT] * max(cells(held) - len(bar), 0)
    bar += [" "] * (_BAR_WIDTH + 1 - len(bar))
    if math.isfinite(noise) and 0.0 < noise <= largest:
        bar[min(cells(noise), _BAR_WIDTH)] = _FLOOR
    return "".join(bar)


def note_missing_calibration(model: Model, rig: Path | None, quiet: bool) -> None:
    """Say that a calibration that was part of the model's uncertainty is not part of the new one's."""
    if rig is None and model.record is not None and model.record.noise.get(CALIBRATION_UNKNOWNS, 0.0) > 0.0:
        note("note: the model was fitted with its calibration's uncertainty; it is lost here without --rig", quiet)


def change_document(change: Change, output: Path | None, inputs: Sequence[Path]) -> dict[str, Any]:
    """Give the document for `--json`: as `fit`'s."""
    document = change.result.to_document()
    for term in change.after.terms:
        for parameter in (*term.coefficients, *term.inner):
            match = plausible_match(parameter)
            entry = document["parameters"][f"{term.id}.{parameter.name}"]
            entry["plausible"] = None if match is None else match.what
    record = change.result.model.record
    assert record is not None
    return {
        "output": None if output is None else str(output),
        **document,
        "before": comparison_document(change.before),
        "after": comparison_document(change.after),
        "history": [
            {
                "action": entry.action,
                "effect": entry.reference,
                "before": dict(entry.figures_before),
                "after": dict(entry.figures_after),
            }
            for entry in record.history
        ],
        "provenance": provenance_of_command(inputs).to_document(),
    }
