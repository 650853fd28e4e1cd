"""What `add` and `remove` print: the figures before and after, the effect, and the story of the error so far."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

from geoerr.cli.fit_document import fit_document
from geoerr.cli.fit_text import effect_rows, figure_rows, not_determined_rows, quality_in_words
from geoerr.cli.options import note, note_left_out, note_set_aside, print_json
from geoerr.cli.text_tables import WIDTH, named_row, say, wrapped
from geoerr.diagnose.change import Change
from geoerr.diagnose.document import comparison_document
from geoerr.diagnose.error_scale import ErrorScale
from geoerr.files import null_for_nan
from geoerr.fit.result import CALIBRATION_UNKNOWNS
from geoerr.measurements import Measurements
from geoerr.model import HistoryEntry, Model, write_model
from geoerr.model.fit_words import NOT_SETTLED

_MOST_CELLS, _LEAST_CELLS = 44, 20
_FULL, _HELD_OUT, _FLOOR = "█", "░", "│"


def change_text(change: Change) -> list[str]:
    """Give the lines for the terminal."""
    after = change.after
    lines = [*figure_rows({"before": comparison_document(change.before), "after": comparison_document(after)}), ""]
    for sentence in quality_in_words(after):
        lines += wrapped(sentence)
    lines += effect_rows(after)
    record = change.result.model.record
    assert record is not None
    if record.not_determined:
        lines += ["", "not determined (unknown, not zero):", *not_determined_rows(record.not_determined)]
    lines += ["", *fall(record.history)]
    return lines


def fall(history: Sequence[HistoryEntry]) -> list[str]:
    """Draw the error from the first model to the last: in-sample full, held out hatched, the noise as a line."""
    steps = [("at first", history[0].figures_before)]
    steps += [(f"{'+' if one.action == 'added' else '−'} {one.reference}", one.figures_after) for one in history]
    errors_um = [figures[name] for _, figures in steps for name in ("rmse_um", "held_out_rmse_um")]
    noises_um = [noise for _, figures in steps if math.isfinite(noise := _noise_um(figures))]
    scale = ErrorScale.of(errors_um, noises_um[-1] if noises_um else None)
    texts = [_of_a_step(figures) for _, figures in steps]
    names, behind = (max(map(len, column)) for column in ([name for name, _ in steps], texts))
    # Indent, two spaces behind a name and one before the figures; the bar's own end has a cell.
    width = min(names, WIDTH - 6 - behind - _LEAST_CELLS)
    cells = min(WIDTH - 6 - behind - width, _MOST_CELLS)
    axis = ", logarithmic from the noise" if scale.is_logarithmic else ""
    lines = wrapped(f"the error, µm{axis} ({_FULL} residual rms, {_HELD_OUT} held out, {_FLOOR} noise):")
    for (name, figures), text in zip(steps, texts, strict=True):
        bar = _bar(figures["rmse_um"], figures["held_out_rmse_um"], _noise_um(figures), scale, cells)
        lines += named_row(name, width + 2, f"{bar} {text}", "  ")
    return lines


def _of_a_step(figures: Mapping[str, float]) -> str:
    held = figures["held_out_rmse_um"]
    return f"{figures['rmse_um']:.2f}" + (f", held out {held:.2f}" if math.isfinite(held) else "")


def _noise_um(figures: Mapping[str, float]) -> float:
    floor_um = figures["noise_floor_um"]
    return floor_um if math.isfinite(floor_um) else figures["noise_um"]


def _bar(inside: float, held: float, noise: float, scale: ErrorScale, width: int) -> str:
    def cells(value: float) -> int:
        return round(width * scale.share(value)) if math.isfinite(value) else 0

    bar = [_FULL] * cells(inside)
    bar += [_HELD_OUT] * max(cells(held) - len(bar), 0)
    bar += [" "] * (width + 1 - len(bar))
    if math.isfinite(noise) and 0.0 < noise <= scale.largest_um:
        bar[min(cells(noise), width)] = _FLOOR
    return "".join(bar)


def report_change(
    change: Change,
    start: Model,
    measured: Measurements,
    output: Path | None,
    inputs: Sequence[Path],
    *,
    has_rig: bool,
    as_json: bool,
    quiet: bool,
) -> None:
    """Write the changed model where one is asked for, and print what the change did.

    Parameters
    ----------
    change
        What was done.
    start
        The model as it was.
    measured
        What it was fitted to.
    output
        Where the new one goes.
    inputs
        Files that were read.
    has_rig
        Whether the calibration's uncertainty takes part.
    as_json, quiet
        As for every verb.
    """
    if not has_rig and start.record is not None and start.record.noise.get(CALIBRATION_UNKNOWNS, 0.0) > 0.0:
        note("note: the model was fitted with its calibration's uncertainty; it is lost here without --rig", quiet)
    if start.record is not None and not start.record.has_settled:
        note(f"warning: the model as it was: {NOT_SETTLED}", quiet)
    if output is not None:
        write_model(output, change.result.model)
    if as_json:
        print_json(null_for_nan(fit_document(change.result, change.before, output, inputs, measured.set_aside)))
        return
    for line in change_text(change):
        say(line)
    note_set_aside(measured.set_aside, quiet)
    note_left_out(change.after.sightings.left_out, quiet)
    if output is not None:
        note(f"model: {output}", quiet)
