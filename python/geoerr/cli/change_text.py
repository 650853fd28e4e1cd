"""What `add` and `remove` print: the figures before and after, the effect, and the story of the error so far."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

from geoerr.cli.fit_document import fit_document
from geoerr.cli.fit_text import effect_rows, figure_rows, not_determined_rows, quality_in_words
from geoerr.cli.options import note, note_left_out, note_set_aside, print_json
from geoerr.cli.text_tables import WIDTH, named_row, say, wrapped
from geoerr.diagnose.change import Change
from geoerr.diagnose.document import comparison_document
from geoerr.diagnose.error_scale import ErrorScale
from geoerr.diagnose.stages import Stage, stages_of
from geoerr.files import null_for_nan
from geoerr.fit.elsewhere import beyond_the_lines_um, beyond_the_lines_words
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
    missed_um = beyond_the_lines_um(change.before, after)
    for sentence in (*quality_in_words(after), *([] if missed_um is None else [beyond_the_lines_words(missed_um)])):
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
    stages = stages_of(history)
    errors_um = [_number(stage, name) for stage in stages for name in ("rmse_um", "held_out_rmse_um")]
    noises_um = [stage.noise_um for stage in stages if stage.noise_um is not None]
    scale = ErrorScale.of(errors_um, noises_um[-1] if noises_um else None)
    texts = [_of_a_stage(stage) for stage in stages]
    names, behind = (max(map(len, column)) for column in ([stage.name for stage in stages], texts))
    # Indent, two spaces behind a name and one before the figures; the bar's own end has a cell.
    width = min(names, WIDTH - 6 - behind - _LEAST_CELLS)
    cells = min(WIDTH - 6 - behind - width, _MOST_CELLS)
    axis = ", logarithmic from the noise" if scale.is_logarithmic else ""
    lines = wrapped(f"the error, µm{axis} ({_FULL} residual rms, {_HELD_OUT} held out, {_FLOOR} noise):")
    for stage, text in zip(stages, texts, strict=True):
        noise_um = math.nan if stage.noise_um is None else stage.noise_um
        bar = _bar(_number(stage, "rmse_um"), _number(stage, "held_out_rmse_um"), noise_um, scale, cells)
        lines += named_row(stage.name, width + 2, f"{bar} {text}", "  ")
    return lines


def _of_a_stage(stage: Stage) -> str:
    held = _number(stage, "held_out_rmse_um")
    return f"{_number(stage, 'rmse_um'):.2f}" + (f", held out {held:.2f}" if math.isfinite(held) else "")


def _number(stage: Stage, name: str) -> float:
    value = stage.figure(name)
    return math.nan if value is None else value


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
