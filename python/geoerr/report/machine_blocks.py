"""The machine, its measurements and its effects as tables, for a page of any kind."""

from __future__ import annotations

import math

import numpy as np

from geoerr.diagnose import Comparison
from geoerr.diagnose.labels import variable_label
from geoerr.machine import AXES
from geoerr.model import Model
from geoerr.model.effect_values import effect_values
from geoerr.model.fit_words import FIGURES, fit_sentences
from geoerr.observations import PIXELS
from geoerr.report.page import NOT_COMPUTABLE, Block, Paragraph, Table, as_sentence

_FRAMES = {
    "free": "any pose, fitted",
    "parallel": "parallel to the axes, offset fitted",
    "circle": "centre and mean radius fitted",
}
_UNKNOWN = "–"


def machine_blocks(model: Model) -> tuple[Block, ...]:
    """Show the axes with their ranges, on which side of the base they are, and where errors are known."""
    machine = model.machine
    measured = model.measured_range_mm
    rows = tuple(
        (
            axis.upper(),
            machine.side(axis),
            _span(machine.axes[axis].range_mm),
            _span(measured[axis]),
            machine.axes[axis].material or _UNKNOWN,
        )
        for axis in AXES
    )
    offset = ", ".join(f"{value:g}" for value in machine.tool_offset_mm)
    sentence = (
        f"{machine.name}: chain {machine.chain}, from the work (w) over the base (b) to the tool (t); tool point "
        f"({offset}) mm from the carriage; reference temperature {machine.reference_temperature_degc:g} °C."
    )
    header = ("axis", "carried on the side of the", "range, mm", "errors known, mm", "material")
    return Paragraph(sentence), Table("Axes", header, rows)


def data_blocks(comparison: Comparison) -> tuple[Block, ...]:
    """Show sessions, conditions, noise, and what took no part."""
    blocks: list[Block] = []
    if comparison.lengths is not None:
        blocks.append(Paragraph(f"{len(comparison.lengths)} measured lengths."))
    fitted = comparison.fitted
    if fitted is None:
        return tuple(blocks)
    sightings = fitted.sightings
    clock = sightings.numbers("t")
    rows = []
    for number, (name, kind) in enumerate(zip(sightings.sessions, sightings.frames, strict=True)):
        if kind == "lengths":
            continue
        own = sightings.session == number
        known = clock[own & np.isfinite(clock)]
        rows.append(
            (
                name,
                str(int(own.sum())),
                str(len(np.unique(sightings.pass_number[own]))),
                _FRAMES[kind],
                *(_span((float(values.min()), float(values.max()))) for values in sightings.commanded_mm[own].T),
                f"{float(np.ptp(known)) / 60.0:.1f}" if known.size else _UNKNOWN,
            )
        )
    header = ("session", "rows", "passes", "measuring frame", "x, mm", "y, mm", "z, mm", "minutes")
    blocks.append(Table("Sessions and circular runs", header, tuple(rows)))
    conditions = [
        (variable_label(name), f"{np.nanmin(values):.4g}", f"{np.nanmean(values):.4g}", f"{np.nanmax(values):.4g}")
        for name in sightings.free_columns
        for values in [sightings.numbers(name)]
        if name not in (*PIXELS, "t")
    ]
    if conditions:
        blocks.append(Table("Conditions", ("condition", "lowest", "mean", "highest"), tuple(conditions)))
    floor, noise = fitted.repeats.floor_um, fitted.split.noise_um
    if floor is not None:
        blocks.append(Paragraph(f"Noise floor, what repeats scatter: {floor:.2f} µm (all components together)."))
    elif noise is not None:
        said = "Nothing was measured twice under the same conditions; by the stated uncertainties noise is"
        blocks.append(Paragraph(f"{said} {noise:.2f} µm."))
    left_out = [(why, str(count)) for why, count in sightings.left_out.items()]
    outliers = len(fitted.outliers)
    if outliers:
        left_out.append(("gross errors: noise does not reach so far", str(outliers)))
    if left_out:
        blocks.append(Table("Rows that took no part", ("why", "rows"), tuple(left_out)))
    blocks += map(as_sentence, sightings.notes)
    return tuple(blocks)


def record_blocks(model: Model) -> tuple[Block, ...]:
    """Show what the model's file says of the data that it was fitted to."""
    record = model.record
    if record is None:
        return ()
    digest = f"; SHA-256 of the data {record.data_digest}" if record.data_digest else ""
    blocks: list[Block] = [
        Paragraph(f"The model was fitted to {record.n_rows} rows, {record.n_outliers} left out as gross{digest}.")
    ]
    blocks += map(as_sentence, fit_sentences(record.figures, record.noise))
    rows = tuple(
        (words, NOT_COMPUTABLE if math.isnan(record.figures[name]) else f"{record.figures[name]:.2f}")
        for name, words in FIGURES.items()
        if name in record.figures
    )
    if rows:
        blocks.append(Table("Figures of that fit", ("figure", "µm"), rows))
    return tuple(blocks)


def effect_blocks(model: Model) -> tuple[Block, ...]:
    """Show the terms beyond the classic errors, each value with its standard uncertainty; nothing without any."""
    said = effect_values(model)
    rows = [
        (term.id, term.title + (" (of the measuring rig: never compensated)" if term.is_rig else ""), *one)
        for term in model.terms
        for one in said.get(term.id, ())
    ]
    header = ("effect", "in words", "value ± standard uncertainty", "would physics give it")
    return (Table("Effects", header, tuple(rows)),) if rows else ()


def _span(span: tuple[float, float] | None) -> str:
    if span is None:
        return _UNKNOWN
    return f"{span[0]:g}" if span[0] == span[1] else f"{span[0]:g} – {span[1]:g}"
