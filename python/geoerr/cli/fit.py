"""`geoerr fit`: observations to the volumetric model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer

from geoerr.cli.effect_options import Form, Lag, Lagging, way_of
from geoerr.cli.fit_text import (
    counted,
    error_rows,
    figure_rows,
    freedom_of,
    not_determined_rows,
    parameter_rows,
    quality_in_words,
    scale_sentence,
    wrapped,
)
from geoerr.cli.measurements import Measurements, read_measurements
from geoerr.cli.options import (
    JsonFlag,
    MachineFile,
    QuietFlag,
    RigFile,
    Threads,
    calibration,
    check_output,
    note,
    note_set_aside,
    null_for_nan,
    print_json,
)
from geoerr.cli.progress import progress_bar
from geoerr.diagnose import comparison_document
from geoerr.effects import load_catalogue, plausible_match
from geoerr.error_functions import ALL_NAMES
from geoerr.fit import Components, FitOptions, FitResult, Fitted, fit_model
from geoerr.fit.undetermined import iso_name
from geoerr.machine import read_machine
from geoerr.model import HistoryEntry, write_model
from geoerr.report.provenance import provenance_of_command

_MOST_OUTLIERS_NAMED = 8


class ComponentsChoice(StrEnum):
    """Classic errors of the model."""

    LI = "21"
    DOBARIYA = "12"
    NONE = "none"


def register(app: typer.Typer) -> None:
    """Add the verb."""
    app.command("fit")(fit)


def fit(
    observations: Annotated[
        list[Path],
        typer.Argument(
            metavar="OBS...", help="Measured points, circular tests (.csv, .parquet; - is standard input)."
        ),
    ],
    machine: MachineFile,
    output: Annotated[Path | None, typer.Option("--output", "-o", help="model.json to write.")] = None,
    components: Annotated[
        ComponentsChoice,
        typer.Option("--components", help="Classic errors: Li's 21, Dobariya's 12 (no angles), or none."),
    ] = ComponentsChoice.LI,
    effects: Annotated[
        list[Path] | None, typer.Option("--effects", help="A .toml of your own effects; may be repeated.")
    ] = None,
    add: Annotated[
        list[str] | None,
        typer.Option("--add", metavar="ID[:AXIS][@COVARIATE]", help="An effect to fit along; may be repeated."),
    ] = None,
    lag: Lag = Lagging.AUTO,
    form: Form = None,
    tangent: Annotated[
        bool, typer.Option("--tangent", help="Straightness is the integral of the angle (Li Eq. 19).")
    ] = False,
    rig: RigFile = None,
    as_json: JsonFlag = False,
    quiet: QuietFlag = False,
    threads: Threads = 0,
) -> None:
    """Fit the volumetric model: all observations, all errors and any effects at once."""
    if tangent and components is not ComponentsChoice.LI:
        raise typer.BadParameter("follows from the angles, which only --components 21 has", param_hint="--tangent")
    effect_files = effects or []
    inputs = [*observations, machine, *effect_files, *([rig] if rig is not None else [])]
    check_output(output, inputs)
    described = read_machine(machine)
    measured = read_measurements(observations)
    sensitivity, covariance = calibration(rig, measured.points)
    added = add or []
    options = FitOptions(components=components.value, follows_tangent=tangent, threads=threads)
    with progress_bar("fit", quiet) as advance:
        result = fit_model(
            described,
            *measured.tables,
            effects=added,
            known=load_catalogue(effect_files),
            way=way_of(lag, form),
            options=options,
            rig_sensitivity=sensitivity,
            rig_covariance=covariance,
            on_progress=advance,
        )
    if output is not None:
        write_model(output, result.model)
    outcome = _Outcome(result, result.before, measured, len(added))
    if as_json:
        print_json(null_for_nan(_document(outcome, output, inputs)))
        return
    for line in _text(outcome, components.value):
        typer.echo(line)
    _print_notes(outcome, rig, quiet)
    if output is not None:
        note(f"model: {output}", quiet)


@dataclass(frozen=True, eq=False)
class _Outcome:
    """What the verb reports: the fit, the one before it, the data, the effects that were asked for."""

    result: FitResult
    before: Fitted
    measured: Measurements
    n_added: int

    @property
    def meaning_of_before(self) -> str:
        """Say which model the figures before are of."""
        return "the same model without the effects" if self.n_added else "a machine without errors"


def _document(outcome: _Outcome, output: Path | None, inputs: Sequence[Path]) -> dict[str, Any]:
    result, fitted = outcome.result, outcome.result.fitted
    document = result.to_document()
    for term in fitted.terms:
        for parameter in (*term.coefficients, *term.inner):
            match = plausible_match(parameter)
            entry = document["parameters"][f"{term.id}.{parameter.name}"]
            entry["plausible"] = None if match is None else match.what
    for entry, place in zip(document["outliers"], _outlier_places(outcome), strict=True):
        entry["place"] = place
    record = result.model.record
    assert record is not None
    return {
        "output": None if output is None else str(output),
        **document,
        "before": comparison_document(outcome.before),
        "after": comparison_document(fitted),
        "history": [_entry_document(entry) for entry in record.history],
        "set_aside": [str(problem) for problem in outcome.measured.set_aside],
        "provenance": provenance_of_command(inputs).to_document(),
    }


def _entry_document(entry: HistoryEntry) -> dict[str, Any]:
    return {
        "action": entry.action,
        "effect": entry.reference,
        "before": dict(entry.figures_before),
        "after": dict(entry.figures_after),
    }


def _outlier_places(outcome: _Outcome) -> list[str]:
    """Say where each outlier stands: file and row, as an editor shows it."""
    sightings = outcome.result.fitted.sightings
    file_rows = sightings.numbers("file_row")
    numbers = [sightings.numbers(name) for name in ("x", "y", "z", "mx", "my", "mz")]
    return [
        outcome.measured.place(int(file_rows[outlier.row]), [values[outlier.row] for values in numbers])
        for outlier in outcome.result.fitted.outliers
    ]


def _text(outcome: _Outcome, components: Components) -> list[str]:
    result, fitted = outcome.result, outcome.result.fitted
    machine = fitted.machine
    lines = [
        f"{machine.name} ({machine.chain}): {'no' if components == 'none' else components} components, "
        f"{counted(outcome.n_added, 'effect')}; {counted(len(fitted.sightings), 'row')} in "
        f"{counted(fitted.sightings.n_passes, 'pass')}, {counted(fitted.n_parameters, 'parameter')}",
        "",
        *figure_rows({"before": comparison_document(outcome.before), "after": comparison_document(fitted)}),
        f"(before: {outcome.meaning_of_before})",
        "",
    ]
    for sentence in quality_in_words(fitted):
        lines += wrapped(sentence, "")
    effects = [term for term in fitted.terms if term.kind != "classic"]
    if effects:
        lines += ["", "effects:", *parameter_rows(effects)]
    classic = {iso_name(term.id) for term in fitted.terms if term.kind == "classic"}
    if classic:
        shown = [name for name in ALL_NAMES if name in classic]
        lines += ["", *error_rows(result.model.error_functions(), shown, freedom_of(fitted), "fitted as")]
        scales = scale_sentence(result.model.mean_scales())
        if scales is not None:
            lines += wrapped(scales, "")
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
            lines += wrapped(f"{number}. {entry.action} {entry.reference}: {', '.join(figures)}".replace("nan", "–"))
    return lines


def _outlier_lines(outcome: _Outcome) -> list[str]:
    outliers = outcome.result.fitted.outliers
    lines = []
    for outlier, place in list(zip(outliers, _outlier_places(outcome), strict=True))[:_MOST_OUTLIERS_NAMED]:
        at = ", ".join(f"{value:g}" for value in outlier.commanded_mm)
        size = ", ".join(f"{value:.0f}" for value in outlier.residual_um)
        lines += wrapped(f"{place}: " + f"at ({at}) mm, off by ({size}) µm".replace("-", "−"))
    if len(outliers) > _MOST_OUTLIERS_NAMED:
        lines.append(f"  and {len(outliers) - _MOST_OUTLIERS_NAMED} more")
    return lines


def _print_notes(outcome: _Outcome, rig: Path | None, quiet: bool) -> None:
    note_set_aside(outcome.measured.set_aside, quiet)
    sightings = outcome.result.fitted.sightings
    for why, count in sightings.left_out.items():
        note(f"left out: {count} rows ({why})", quiet)
    for sentence in sightings.notes:
        note(f"note: {sentence}", quiet)
    points = outcome.measured.points
    if rig is None and points is not None and "u_left" in points.frame.columns:
        note("note: the calibration's uncertainty is not included (--rig)", quiet)
