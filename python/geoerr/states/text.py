"""States in words: what differs, what is more than chance, what follows temperature, and whether that predicts."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator
from typing import TYPE_CHECKING

from geoerr.effects.plausible import plausible_words
from geoerr.effects.values import value_words
from geoerr.error_functions import LI_NAMES, is_angular
from geoerr.errors import NotDeterminedError
from geoerr.states.difference import Difference
from geoerr.summaries import p_text, p_words

if TYPE_CHECKING:
    from geoerr.states.states import States

WIDTH = 80
_SIGNIFICANCE = 0.05
_PER_MILLION = 1e6
_UM_PER_MM = 1e3


def states_report(states: States) -> str:
    """Give the report's text, at most eighty columns wide."""
    first, last = states.temperatures_degc[0], states.temperatures_degc[-1]
    lines = textwrap.wrap(
        f"{states.machine.name} ({states.machine.chain}) at "
        + ", ".join(f"{value:g}" for value in states.temperatures_degc)
        + f" °C: {len(states.functions.names)} of 21 errors comparable",
        WIDTH,
        subsequent_indent="  ",
    )
    lines += [
        "",
        *difference_lines(states.difference(first, last)),
        "",
        *_temperature_lines(states),
        "",
        *_left_out_lines(states),
    ]
    for sentence in (*states.notes, *states.model.notes, *_not_determined(states)):
        lines += _wrapped(sentence)
    return "\n".join(lines) + "\n"


def difference_lines(difference: Difference) -> list[str]:
    """Say how two states differ: over the volume, and function by function."""
    lines = [f"[{difference.second} minus {difference.first}]"]
    test = difference.test
    lines += _wrapped(f"{_chance(test.p_value)} (χ² = {test.chi_squared:.0f} with {test.rank} degrees of freedom)")
    lines += _wrapped("free, and so no difference: pose of the measuring frame, set-up of the work, tilt of the tool")
    try:
        volume = difference.volume()
    except NotDeterminedError as error:
        lines += _wrapped(str(error).splitlines()[0])
    else:
        lines += _wrapped(
            f"over the volume {volume.rms_um:.1f} µm rms, {_UM_PER_MM * volume.length_mm.max():.1f} µm at most; two "
            f"states that do not differ show {volume.rms_by_chance_um:.1f} µm; beyond chance at "
            f"{int(volume.is_beyond.sum())} of {len(volume.is_beyond)} places; three scale factors would leave "
            f"{difference.volume(without_growth=True).rms_um:.1f} µm rms"
        )
    lines += ["", "  error           rms  at most  band ±           p"]
    for name, one in difference.by_name.items():
        unit, factor = ("µrad", _PER_MILLION) if is_angular(name) else ("µm  ", _UM_PER_MM)
        mark = "  beyond chance" if one.p_value < _SIGNIFICANCE else ""
        lines.append(
            f"  {name}  {LI_NAMES[name]:<5}{factor * one.rms:>8.1f} {factor * abs(one.value).max():>8.1f} "
            f"{factor * one.half_width.max():>7.1f} {unit} {p_text(one.p_value):>8}{mark}"
        )
    return lines


def _temperature_lines(states: States) -> Iterator[str]:
    fit, model = states.temperature_fit, states.model
    reference = states.machine.reference_temperature_degc
    yield f"[one model: {states.covariate} less {reference:g} °C]"
    if not model.temperature_terms:
        yield "  nothing follows temperature beyond chance"
    for term in model.temperature_terms:
        for parameter in term.coefficients:
            words = plausible_words(parameter, beside=term.coefficients)
            yield from _wrapped(
                f"{term.id}: {value_words(parameter, term.coefficients)}" + (f" ({words})" if words else "")
            )
    yield from _wrapped(
        f"what the states show beyond these: {_chance(fit.misfit.p_value)}"
        + ("" if fit.scale == 1.0 else f"; uncertainties are multiplied by {fit.scale:.2f}")
    )
    if len(fit.temperatures_degc) < 3 and model.temperature_terms:
        yield from _wrapped(
            "two temperatures cannot tell growth in proportion from other growth: it is assumed, to a fifth of it in "
            "100 K in the tables between and beyond (the model file counts noise only); measure a third"
        )
    if fit.astray:
        named = ", ".join(f"{name} ({p_words(p_value)})" for name, p_value in fit.astray.items())
        yield from _wrapped(
            f"not in proportion to the temperature, or its square: {named}; between and beyond the temperatures that "
            "were measured its uncertainty, in the model file too, counts by how much: measure more temperatures "
            "between"
        )


def _left_out_lines(states: States) -> Iterator[str]:
    yield "[each temperature predicted from the others]"
    if not states.left_out:
        yield "  needs three temperatures: one that is left out leaves a line through two"
        return
    yield "                   over the volume,  measured points,  errors"
    yield "                        µm rms            µm rms       inside"
    yield "      °C             off  by chance    off   own fit     95 %           p"
    for one in states.left_out:
        kind = "beyond " if one.is_extrapolation else "between"
        p_value = p_text(one.difference.p_value)
        volume = f"{_number(one.rms_um):>7}{_number(one.rms_by_chance_um):>11}"
        points = f"{_number(one.predicted_rmse_um):>7}{_number(one.own_rmse_um):>10}"
        judged = f"{100.0 * one.coverage:>7.1f} %{p_value:>12}"
        yield f"  {one.temperature_degc:>6.1f}  {kind}{volume}{points}{judged}"


def _not_determined(states: States) -> list[str]:
    names = [item.name for item in states.functions.not_determined]
    return [f"not determined in every state, and not compared: {', '.join(names)}"] if names else []


def _chance(p_value: float) -> str:
    return f"chance alone does as much with {p_words(p_value)}"


def _number(value: float | None) -> str:
    return "–" if value is None else f"{value:.1f}"


def _wrapped(sentence: str) -> list[str]:
    return textwrap.wrap(sentence, WIDTH, initial_indent="  ", subsequent_indent="    ")
