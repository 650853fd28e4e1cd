"""What `geoerr fit` prints: figures, effects, errors, what is not determined, gross outliers, history."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from geoerr.cli.fit_text import (
    effect_rows,
    error_rows,
    figure_rows,
    freedom_of,
    not_determined_rows,
    prediction_in_words,
    quality_in_words,
    scale_sentence,
)
from geoerr.cli.options import note, note_left_out, note_set_aside, note_without_rig
from geoerr.cli.text_tables import wrapped
from geoerr.diagnose.document import comparison_document
from geoerr.error_functions import ALL_NAMES
from geoerr.fit import Components, FitResult
from geoerr.fit.undetermined import iso_name
from geoerr.measurements import Measurements
from geoerr.summaries import counted

_MOST_OUTLIERS_NAMED = 8


@dataclass(frozen=True, eq=False)
class FitOutcome:
    """What the verb reports.

    Attributes
    ----------
    result
        The fit, and the one before it.
    measured
        The data.
    n_added
        How many effects were asked for.
    """

    result: FitResult
    measured: Measurements
    n_added: int

    @property
    def meaning_of_before(self) -> str:
        """Say which model the figures before are of."""
        return "the same model without the effects" if self.n_added else "a machine without errors"


def outlier_places(outcome: FitOutcome) -> list[str]:
    """Say where each outlier stands: file and row, as an editor shows it."""
    sightings = outcome.result.fitted.sightings
    file_rows = sightings.numbers("file_row")
    numbers = [sightings.numbers(name) for name in ("x", "y", "z", "mx", "my", "mz")]
    return [
        outcome.measured.place(int(file_rows[outlier.row]), [values[outlier.row] for values in numbers])
        for outlier in outcome.result.fitted.outliers
    ]


def outcome_lines(outcome: FitOutcome, components: Components) -> list[str]:
    """Give everything that the verb prints."""
    result, fitted = outcome.result, outcome.result.fitted
    machine = fitted.machine
    lines = wrapped(
        f"{machine.name} ({machine.chain}): {'no' if components == 'none' else components} components, "
        f"{counted(outcome.n_added, 'effect')}; {fitted.sightings.in_words()}, "
        f"{counted(fitted.n_determined, 'parameter')}"
    )
    before, after = comparison_document(result.before), comparison_document(fitted)
    lines += [
        "",
        *figure_rows({"before": before, "after": after}),
        f"(before: {outcome.meaning_of_before})",
        "",
    ]
    unseen_um = before["held_out_rmse_um"], after["held_out_rmse_um"]
    for sentence in (*quality_in_words(fitted), *prediction_in_words(unseen_um, outcome.meaning_of_before)):
        lines += wrapped(sentence)
    lines += effect_rows(fitted)
    classic = {iso_name(term.id) for term in fitted.terms if term.kind == "classic"}
    if classic:
        shown = [name for name in ALL_NAMES if name in classic]
        lines += ["", *error_rows(result.model.error_functions(), shown, freedom_of(fitted), "fitted as")]
        scales = scale_sentence(result.model.mean_scales())
        if scales is not None:
            lines += wrapped(scales)
    record = result.model.record
    assert record is not None
    if record.not_determined:
        lines += ["", "not determined (unknown, not zero):", *not_determined_rows(record.not_determined)]
    if fitted.outliers:
        lines += ["", "gross outliers, left out:", *_outlier_lines(outcome)]
    if len(record.history) > 1:
        lines += ["", "history (residual rms and held out, µm):"]
        for number, entry in enumerate(record.history, start=1):
            figures = [
                f"{entry.figures_before[name]:.2f} to {entry.figures_after[name]:.2f}"
                for name in ("rmse_um", "held_out_rmse_um")
            ]
            lines += wrapped(
                f"{number}. {entry.action} {entry.reference}: {', '.join(figures)}".replace("nan", "–"), "  "
            )
    return lines


def _outlier_lines(outcome: FitOutcome) -> list[str]:
    outliers = outcome.result.fitted.outliers
    lines = []
    for outlier, place in list(zip(outliers, outlier_places(outcome), strict=True))[:_MOST_OUTLIERS_NAMED]:
        at = ", ".join(f"{value:g}" for value in outlier.commanded_mm)
        size = ", ".join(f"{value:.0f}" for value in outlier.residual_um)
        lines += wrapped(f"{place}: " + f"at ({at}) mm, off by ({size}) µm".replace("-", "−"), "  ")
    if len(outliers) > _MOST_OUTLIERS_NAMED:
        lines.append(f"  and {len(outliers) - _MOST_OUTLIERS_NAMED} more")
    return lines


def print_notes(outcome: FitOutcome, rig: Path | None, quiet: bool) -> None:
    """Say on standard error what took no part."""
    note_set_aside(outcome.measured.set_aside, quiet)
    sightings = outcome.result.fitted.sightings
    note_left_out(sightings.left_out, quiet)
    for sentence in sightings.notes:
        note(f"note: {sentence}", quiet)
    if rig is None:
        note_without_rig(outcome.measured.points, quiet)
