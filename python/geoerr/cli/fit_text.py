"""A fit in words and tables that fit the terminal: shared by the verbs that fit."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from geoerr.cli.text_tables import WIDTH, wrapped
from geoerr.diagnose.moments import moments_of
from geoerr.diagnose.words import alike_words
from geoerr.effects.amplitudes import Amplitude, amplitude_words, amplitudes_by_term, parts_of
from geoerr.effects.plausible import plausible_words
from geoerr.effects.values import bounded_value_words
from geoerr.error_functions import (
    LI_NAMES,
    ErrorFunction,
    ErrorFunctions,
    NotDetermined,
    Squareness,
    is_angular,
)
from geoerr.fit import Fitted
from geoerr.fit.begun_warm import begun_warm
from geoerr.fit.elsewhere import between_the_places
from geoerr.fit.from_nothing import SIGNIFICANCE, chance_of_nothing
from geoerr.fit.inner import other_periods
from geoerr.machine import AXES
from geoerr.model import MeanScale
from geoerr.model.fit_words import (
    FAR_BELOW_STATED,
    NOT_SETTLED,
    SHARED_WORDS,
    far_below_stated_words,
    lack_of_fit_words,
)
from geoerr.summaries import by_reason, p_words
from geoerr.terms import Term

# A held-out error that is larger by less is as large.
_WORSE = 1.1
_MICRO = 1e6
_UM_PER_MM = 1e3
_KINDS = {"bspline": "spline", "fourier": "waves", "linear": "linear elements", "quadratic": "quadratic elements"}
_DEGREES = {1: "line", 2: "parabola", 3: "cubic"}
_FIGURES = {
    "held out, rms": "held_out_rmse_um",
    "held out, as a right model would have it": "expected_held_out_rmse_um",
    "noise floor (what repeats scatter)": "noise_floor_um",
    "noise (repeats, or as stated)": "noise_um",
    "lack of fit (residual beyond the noise)": "lack_of_fit_um",
}
_ALWAYS_SHOWN = ("held_out_rmse_um", "noise_floor_um")
# Units in which a linear coefficient is read.


def freedom_of(fitted: Fitted) -> dict[str, str]:
    """Say for each error function what was fitted: `spline, 9 free`."""
    chosen = {choice.name: choice.n_free for choice in fitted.choices}
    words = {}
    for term in fitted.terms:
        basis = term.parts[0].basis
        if basis is None:
            continue
        kind = _KINDS.get(basis.kind) or _DEGREES.get(basis.degree or 0, f"polynomial of degree {basis.degree}")
        words[term.id] = f"{kind}, {chosen[term.id]:.3g} free" if term.id in chosen else kind
    return words


def error_rows(errors: ErrorFunctions, names: Iterable[str], last: Mapping[str, str], title: str) -> Iterator[str]:
    """Give the table of error functions and squarenesses.

    Parameters
    ----------
    errors
        What was found.
    names
        ISO names of the rows.
    last
        Name to the text of the last column; where there is none, what a table of points is over.
    title
        Of that column.
    """
    yield f"{'ISO':<5}{'Li':<6}{'from':>8}{'to':>8}{'peak-to-peak':>14}{'typ. ±':>8}  {title}"
    for name in names:
        row = _error_row(errors, name, last.get(name, ""))
        # What it is over stands below where an axis has long numbers.
        yield from [row.rstrip()] if len(row) <= WIDTH else wrapped(row)


def _error_row(errors: ErrorFunctions, name: str, last: str) -> str:
    head = f"{name:<5}{LI_NAMES[name]:<6}"
    unit, factor = ("µrad", _MICRO) if is_angular(name) else ("µm", _UM_PER_MM)
    table = errors.functions.get(name)
    if table is not None:
        value = table.value * factor
        low, high = float(value.min()), float(value.max())
        place = (
            last or f"{name[2].lower()} {table.position_mm[0]:g} to {table.position_mm[-1]:g} mm, {len(value)} points"
        )
        peak = f"{high - low:.1f} {unit}"
        return f"{head}{low:>8.1f}{high:>8.1f}{peak:>14}{_typical(table, factor):>8}  {place}"
    one = errors.squareness.get(name)
    if one is not None:
        return f"{head}{one.value_rad * factor:>8.1f}{'':>8}{unit:>14}{_uncertainty(one, factor):>8}"
    return f"{head}{'–':>8}{'–':>8}{'':>2}not determined"


def _typical(table: ErrorFunction, factor: float) -> str:
    """Root mean square of the standard uncertainties (the first point, 0 by convention, left out)."""
    if table.std is None or len(table.std) < 2 or not np.isfinite(table.std).all():
        return "–"
    return f"{float(np.sqrt(np.mean(table.std[1:] ** 2))) * factor:.1f}"


def _uncertainty(one: Squareness, factor: float) -> str:
    return "–" if one.std_rad is None or not math.isfinite(one.std_rad) else f"{one.std_rad * factor:.1f}"


def figure_rows(columns: Mapping[str, Mapping[str, Any]]) -> Iterator[str]:
    """Give error figures side by side: title of a column (`before`, `after`) to the figures of a fit."""
    documents = list(columns.values())
    has_points = any(any(figures["n_components"]) for figures in documents)
    has_radii = any(figures.get("n_radial") for figures in documents)
    yield _figure_row("figures in µm", list(columns))
    if has_points:
        yield _figure_row("residual, rms", [_figure(figures["rmse_um"]) for figures in documents])
        for place, axis in enumerate(AXES):
            each = [_figure(figures["rms_per_component_um"][place]) for figures in documents]
            yield _figure_row(f"  along {axis}", each)
    if has_radii:
        yield _figure_row(
            "residual of the radii, rms", [_figure(figures.get("radial_rms_um")) for figures in documents]
        )
    if any(figures.get("n_lengths") for figures in documents):
        yield _figure_row(
            "residual of the lengths, rms", [_figure(figures.get("length_rms_um")) for figures in documents]
        )
    for name, key in _FIGURES.items():
        values = [figures.get(key) for figures in documents]
        if key in _ALWAYS_SHOWN or any(value is not None for value in values):
            yield _figure_row(name, [_figure(value) for value in values])


def _figure_row(name: str, cells: Sequence[str]) -> str:
    return (f"{name:<44}" + "".join(f"{cell:>12}" for cell in cells)).rstrip()


def _figure(value: float | None) -> str:
    return "–" if value is None else f"{value:.2f}"


def quality_in_words(fitted: Fitted) -> list[str]:
    """Say what the residual is: noise, or more."""
    split, sightings = fitted.split, fitted.sightings
    p_value, beyond_um = (math.nan if v is None else v for v in (split.lack_of_fit_p, split.lack_of_fit_um))
    sentences = [lack_of_fit_words(p_value, beyond_um, split.is_from_repeats)]
    if fitted.shared_noise is not None:
        sentences.append(SHARED_WORDS)
    elif sightings.is_stated and fitted.scale > 1.0:
        sentences.append(
            f"the scatter is {fitted.scale:.2f} times what is stated: standard uncertainties are multiplied by that"
        )
    if fitted.share_of_stated < FAR_BELOW_STATED:
        sentences.append(far_below_stated_words(fitted.share_of_stated))
    if fitted.held_out.n_not_computable:
        sentences.append(
            f"{fitted.held_out.n_not_computable} rows could not be predicted with their pass left out: "
            "the other passes do not determine them"
        )
    if not fitted.solved.converged:
        sentences.append(NOT_SETTLED)
    return [*sentences, *between_the_places(fitted), *begun_warm(fitted, fitted.terms)]


def prediction_in_words(unseen_um: tuple[float | None, float | None], before: str) -> list[str]:
    """Say so where a model predicts what it did not see worse than another one does.

    `unseen_um` are held-out errors of that one, in words `before`, and of this.
    """
    known_um = [one for one in unseen_um if one is not None]
    if len(known_um) < 2 or not known_um[1] > _WORSE * known_um[0]:
        return []
    return [
        f"what it did not see the model predicts worse ({known_um[1]:.1f} µm) than {before} does ({known_um[0]:.1f} "
        "µm): there are few rows for so many numbers; measure more, or fit fewer (--components 12 or none), before a "
        "program is corrected by it"
    ]


def scale_sentence(scales: Mapping[str, MeanScale]) -> str | None:
    """Say the mean scale of each axis; None where none is known."""
    texts = [
        f"{axis} {with_std(scale.value * _MICRO, None if scale.std is None else scale.std * _MICRO)}"
        for axis, scale in scales.items()
    ]
    return f"mean scale, ×10⁻⁶: {', '.join(texts)}" if texts else None


def effect_rows(fitted: Fitted) -> Iterator[str]:
    """Give the effects of a fit: parameters, what is plausible about them, and whether the data show them at all."""
    effects = [term for term in fitted.terms if term.kind != "classic"]
    if not effects:
        return
    yield ""
    yield "effects:"
    chance = chance_of_nothing(fitted)
    unknown = {item.name: item.why for item in fitted.not_determined}
    amplitudes = amplitudes_by_term(fitted.terms, fitted.covariance)
    for term in effects:
        yield from _parameter_rows(term, fitted, amplitudes[term.id])
        if term.id in unknown:
            yield from wrapped(f"not determined: {unknown[term.id]}", "    ")
        elif chance.get(term.id, 0.0) > SIGNIFICANCE:
            yield f"    these data do not tell it from nothing ({p_words(chance[term.id])})"


def _parameter_rows(term: Term, fitted: Fitted, amplitudes: Sequence[Amplitude]) -> Iterator[str]:
    """Give a term's parameters: a moment on the clock of all sessions by its session, a period with those alike."""
    moments, alike = moments_of(term, fitted.sightings), other_periods(fitted, term)
    yield from wrapped(f"{term.id}: {term.title}" + (" (measuring rig)" if term.is_rig else ""), "  ")
    parameters = (*term.coefficients, *term.inner)
    for parameter in parameters:
        moment = moments.get(parameter.name)
        read = parameter if moment is None else replace(parameter, unit=moment.unit)
        words = None if moment is None else moment.words()
        if moment is None and parameter.name not in parts_of(amplitudes):
            words = plausible_words(parameter, term.inner, parameters)
        others = f", or {alike_words(alike[parameter.name], read.unit)}" if parameter.name in alike else ""
        yield from wrapped(
            bounded_value_words(read, parameters) + ("" if words is None else f" ({words})") + others, "    "
        )
    for one in amplitudes:
        yield from wrapped(amplitude_words(one), "    ")


def with_std(value: float, std: float | None) -> str:
    """Write a value to the second figure of its standard uncertainty."""
    if std is None or not (math.isfinite(std) and std > 0.0):
        return f"{value:.4g}".replace("-", "−")
    digits = 1 - math.floor(math.log10(std))
    if abs(value) < 1e-3 or digits > 6 or digits < -3:
        behind = max(digits + (math.floor(math.log10(abs(value))) if value else 0), 1)
        return f"{value:.{min(behind, 12)}e} ± {std:.1e}".replace("-", "−")
    return f"{value:.{max(digits, 0)}f} ± {std:.{max(digits, 0)}f}".replace("-", "−")


def not_determined_rows(items: Iterable[NotDetermined]) -> Iterator[str]:
    """Give what the data do not determine, grouped by reason."""
    with_li = {name: f"{name} ({li})" for name, li in LI_NAMES.items()}
    for why, names in by_reason((with_li.get(item.name, item.name), item.why) for item in items).items():
        yield from wrapped(f"{', '.join(names)}: {why}", "  ")
