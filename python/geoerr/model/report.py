"""A model in words and numbers, in the spirit of lmfit's fit reports: what is known, how well, and what is not."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from geoerr.error_functions import LI_NAMES, LINEAR_AND_ANGULAR, SQUARENESS, is_angular
from geoerr.machine import AXES
from geoerr.model.effect_values import effect_values
from geoerr.model.fit_words import FIGURES, NOT_SETTLED, OF_STATED, fit_sentences, other_figures
from geoerr.model.groups import POSITIONING
from geoerr.model.parameters import Correlation
from geoerr.summaries import by_reason
from geoerr.terms import Term

if TYPE_CHECKING:
    from geoerr.model.model import Model

WIDTH = 100
_UM_PER_MM = 1e3
_MICRO = 1e6
_MOST_CORRELATIONS = 12
_LEAST_CORRELATION = 0.8
_INDENT = "    "
# Of the record's `noise`, what stands in a sentence.
_SAID = frozenset({"scale", "scatter_um", "calibration_unknowns", OF_STATED})
# How a figure's name ends, and its unit on paper.
_SHOWN_UNITS = {"um": "µm", "urad": "µrad", "mm": "mm", "s": "s", "degc": "°C"}


def report_of(model: Model) -> str:
    """Give the report's text; see `Model.report`."""
    lines = ["[[Model]]", *_model(model)]
    if model.record is not None:
        lines += ["[[Data]]", *_data(model), "[[Fit]]", *_fit(model)]
    lines += ["[[Parameters]]", *_parameters(model)]
    if model.record is not None:
        lines += ["[[Correlations]]", *_correlations(model), "[[Not determined]]", *_not_determined(model)]
        lines += ["[[History]]", *_history(model)]
    return "\n".join(lines) + "\n"


def _model(model: Model) -> Iterator[str]:
    machine = model.machine
    yield from _wrapped(f"{machine.name}, {machine.chain}")
    if any(machine.tool_offset_mm):
        yield _INDENT + "tool offset " + ", ".join(f"{value:g}" for value in machine.tool_offset_mm) + " mm"
    if model.errors is not None:
        functions, squareness = len(model.errors.functions), len(model.errors.squareness)
        yield f"{_INDENT}tables: {functions} error functions and {squareness} squarenesses ({model.errors.method})"
    classic = sum(term.kind == "classic" for term in model.terms)
    effects = [term for term in model.terms if term.kind != "classic"]
    if model.terms:
        count = sum(len(term.coefficients) + len(term.inner) for term in model.terms)
        yield f"{_INDENT}terms: {classic} classic, {len(effects)} others, {count} parameters"
    for term in effects:
        yield from _wrapped(f"{term.id}: {term.title}" + (" (measuring rig)" if term.is_rig else ""))
    conditions = model.conditions
    if conditions:
        yield from _wrapped(f"predictions need {', '.join(conditions)}")
    if model.is_nominal:
        yield _INDENT + "no errors: the nominal machine"


def _data(model: Model) -> Iterator[str]:
    record = model.record
    assert record is not None
    digest = f", sha-256 {record.data_digest[:16]}" if record.data_digest else ""
    yield f"{_INDENT}{record.n_rows} rows, {record.n_outliers} outliers{digest}"
    spans = [f"{axis} {_span(record.range_mm[axis])} mm" for axis in AXES if axis in record.range_mm]
    if spans:
        yield from _wrapped("measured range: " + ", ".join(spans))
    for name, span in record.covariate_spans.items():
        yield from _wrapped(f"{name}: {_span(span)}")


def _fit(model: Model) -> Iterator[str]:
    record = model.record
    assert record is not None
    if not record.has_settled:
        yield from _wrapped(NOT_SETTLED)
    for sentence in fit_sentences(record.figures, record.noise):
        yield from _wrapped(sentence)
    stated = {f"noise, {name}": value for name, value in record.noise.items() if name not in _SAID}
    figures = {**record.figures, **stated}
    names = [*(name for name in FIGURES if name in figures), *other_figures(figures)]
    for name in names:
        if not math.isnan(figures[name]):
            yield from _wrapped(f"{_title(name)[0]}: {_of(figures, name)}")
    unknown = [_title(name)[0] for name in names if math.isnan(figures[name])]
    if unknown:
        yield from _wrapped(f"not computable: {'; '.join(unknown)}")
    if not figures:
        yield _INDENT + "no figures"


def _parameters(model: Model) -> Iterator[str]:
    yield from _curves(_known_part(model))
    values = effect_values(model)
    for term in model.terms:
        if term.kind != "classic":
            yield from _wrapped(term.id)
            for value, words in values[term.id]:
                yield from _wrapped(f"{value} ({words})" if words else value, 2)
        elif not _is_known(term):
            yield from _wrapped(f"{term.id}: {len(term.coefficients)} coefficients, not fitted yet")
    if model.errors is None and not model.terms:
        yield _INDENT + "none"


def _is_known(term: Term) -> bool:
    return not any(math.isnan(parameter.value) for parameter in term.coefficients + term.inner)


def _known_part(model: Model) -> Model:
    """Give the model as it is, or without its record and what is yet to be fitted."""
    if model.has_values:
        return model
    return replace(model, terms=tuple(term for term in model.terms if _is_known(term)), record=None)


def _curves(model: Model) -> Iterator[str]:
    tables, scales = model.error_functions(), model.mean_scales()
    for name in LINEAR_AND_ANGULAR:
        function = tables.functions.get(name)
        if function is None:
            continue
        factor, unit = (_MICRO, "µrad") if is_angular(name) else (_UM_PER_MM, "µm")
        size = float(np.ptp(function.value)) * factor
        std = None if function.std is None else float(np.median(function.std)) * factor
        text = f"{name}  {LI_NAMES[name]:<6} peak to peak {_with_std(size, std)} {unit}"
        scale = scales.get(name[2].lower()) if name in POSITIONING else None
        if scale is not None:
            std = None if scale.std is None else scale.std * _MICRO
            text = f"{text:<50} mean scale {_with_std(scale.value * _MICRO, std)} ×10⁻⁶"
        yield _INDENT + text
    for name in SQUARENESS:
        squareness = tables.squareness.get(name)
        if squareness is not None:
            std = None if squareness.std_rad is None else squareness.std_rad * _MICRO
            value = _with_std(squareness.value_rad * _MICRO, std)
            yield f"{_INDENT}{name} {LI_NAMES[name]:<6} squareness   {value} µrad"


def _correlations(model: Model) -> Iterator[str]:
    """Give the strongest pair of each pair of terms."""
    found: dict[frozenset[str], Correlation] = {}
    for item in model.correlations(_LEAST_CORRELATION):
        found.setdefault(frozenset(name.rpartition(".")[0] for name in (item.first, item.second)), item)
    for item in list(found.values())[:_MOST_CORRELATIONS]:
        yield from _wrapped(f"{item.first}, {item.second}: {'−' if item.value < 0.0 else '+'}{abs(item.value):.3f}")
    if len(found) > _MOST_CORRELATIONS:
        yield f"{_INDENT}and {len(found) - _MOST_CORRELATIONS} more pairs of terms above {_LEAST_CORRELATION:g}"
    if not found:
        yield f"{_INDENT}none above {_LEAST_CORRELATION:g}"


def _not_determined(model: Model) -> Iterator[str]:
    record = model.record
    assert record is not None
    also = model.error_functions().not_determined if model.has_values else ()
    # The record and the tables may name the same thing.
    named = dict.fromkeys((item.name, item.why) for item in (*record.not_determined, *also))
    for why, names in by_reason(named).items():
        yield from _wrapped(f"{', '.join(names)}: {why}")
    directions = record.null_space.shape[1]
    if directions:
        noun = "direction" if directions == 1 else "directions"
        yield from _wrapped(
            f"{directions} {noun} of the parameters that the data leave free: a prediction that follows one of them "
            "means nothing (is_determined_at tells where)"
        )
    elif not record.not_determined and not also:
        yield _INDENT + "nothing: the data determine every parameter"


def _history(model: Model) -> Iterator[str]:
    record = model.record
    assert record is not None
    for number, entry in enumerate(record.history, start=1):
        yield from _wrapped(f"{number}. {entry.action} {entry.reference}: {entry.title}")
        for name in dict.fromkeys((*entry.figures_before, *entry.figures_after)):
            before, after = (_of(figures, name) for figures in (entry.figures_before, entry.figures_after))
            yield from _wrapped(f"{_title(name)[0]}: {before}, then {after}", 2)
    if not record.history:
        yield _INDENT + "fitted once"


def _of(figures: Mapping[str, float], name: str) -> str:
    value = figures.get(name, math.nan)
    return "not computable" if math.isnan(value) else f"{value:.4g} {_title(name)[1]}".rstrip()


def _title(name: str) -> tuple[str, str]:
    """Split a figure's name into words and unit: `stated_rmse_um` is `stated rmse`, `µm`."""
    head, _, last = name.rpartition("_")
    if head and last in _SHOWN_UNITS:
        return FIGURES.get(name, head.replace("_", " ")), _SHOWN_UNITS[last]
    return name.replace("_", " "), ""


def _span(span: tuple[float, float]) -> str:
    return f"{span[0]:g} to {span[1]:g}"


def _with_std(value: float, std: float | None) -> str:
    """Write a length in micrometres, or the like: to the second figure of its uncertainty, at most two decimals."""
    if std is None or not std > 0.0:
        size = abs(value)
        return _signed(value, 2 if size < 10.0 else 1 if size < 1000.0 else 0)
    digits = min(max(1 - math.floor(math.log10(std)), 0), 2)
    return f"{_signed(value, digits)} ± {std:.{digits}f}"


def _signed(value: float, digits: int) -> str:
    return f"{value:.{digits}f}".replace("-", "−")


def _wrapped(text: str, level: int = 1) -> Iterator[str]:
    indent = _INDENT * level
    printable = "".join(letter if letter.isprintable() else "?" for letter in text)
    yield from textwrap.wrap(
        printable, WIDTH, initial_indent=indent, subsequent_indent=indent + "  ", break_on_hyphens=False
    )
