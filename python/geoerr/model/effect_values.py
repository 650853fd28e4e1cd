"""Values of a model's effects in words, each with what physics says of it: for reports, notebooks and pages."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

from geoerr.effects.amplitudes import (
    Amplitude,
    amplitude_usual_words,
    amplitude_value_words,
    amplitudes_by_term,
    parts_of,
)
from geoerr.effects.plausible import plausible_words
from geoerr.effects.values import as_stated, bounded_value_words
from geoerr.terms import Term

if TYPE_CHECKING:
    from geoerr.model.model import Model


def effect_values(model: Model) -> dict[str, list[tuple[str, str]]]:
    """Give each value and amplitude of every term beyond the classic errors, by its id, with what physics says of it.

    What nobody fitted is as certain as it was stated. Of what nothing is known nothing is said: an empty text.
    """
    record = model.record
    amplitudes = {} if record is None else amplitudes_by_term(model.terms, record.covariance)
    return {
        term.id: list(_values(term, amplitudes.get(term.id, ()), is_fitted=record is not None))
        for term in model.terms
        if term.kind != "classic"
    }


def _values(term: Term, amplitudes: Sequence[Amplitude], *, is_fitted: bool) -> Iterator[tuple[str, str]]:
    parameters = (*term.coefficients, *term.inner)
    for parameter in parameters:
        if math.isnan(parameter.value):
            yield f"{parameter.label}: not fitted yet, {parameter.unit}".rstrip(" ,"), ""
            continue
        known = parameter if is_fitted and not parameter.is_fixed else as_stated(parameter)
        held = ", held" if parameter.is_fixed else ""
        words = None if parameter.name in parts_of(amplitudes) else plausible_words(known, term.inner, parameters)
        yield bounded_value_words(known, parameters) + held, words or ""
    for one in amplitudes:
        yield amplitude_value_words(one), amplitude_usual_words(one) or ""
