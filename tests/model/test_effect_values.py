"""Values of a model's effects in words: the same in every report, and those of a fit."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from fitted_models import REFERENCE, backlash, drawn_record, expansion
from model_machines import machine

from geoerr.effects import catalogue
from geoerr.effects.amplitudes import amplitude_words, amplitudes_by_term
from geoerr.model import Model
from geoerr.model.document import document_of, model_from_document
from geoerr.model.effect_values import effect_values
from geoerr.terms import Parameter, Term


def at_the_end_of_its_range() -> Term:
    """Growth whose fixed point is somewhere outside the axis: alpha would be another with the right one."""
    return expansion(11.6e-6, 400.0, 1e-7)


def test_beside_a_bound_no_report_calls_a_value_plausible() -> None:
    model = Model(machine(), None, (at_the_end_of_its_range(),), drawn_record((at_the_end_of_its_range(),)))
    words = "not to be compared with known values: q_fixed is at the end of its range"
    assert effect_values(model)[REFERENCE] == [
        ("alpha = 11.60 ± 0.10 ×10⁻⁶/K", words),
        ("q_fixed = 400 mm, the end of its range; ± of the others hold for it alone", ""),
    ]
    for text in (" ".join(model.report().split()), model._repr_html_()):
        assert words in text
        assert "plausible" not in text


def test_what_was_stated_is_not_left_open_by_any_data() -> None:
    assert effect_values(Model(machine(), None, (expansion(), backlash()))) == {
        REFERENCE: [("alpha = 11.7 ×10⁻⁶/K", "plausible: steel has 11.5"), ("q_fixed = 120 mm", "")],
        "backlash:y": [("b = 20 µm", "")],
    }


def test_of_a_wave_the_amplitude_is_judged() -> None:
    term = catalogue()["periodic"].term("x", None, machine())
    values = {"A": 6e-3, "B": 1e-3, "P": 8.0}
    known = [
        tuple(replace(one, value=values[one.name], std=1e-4) for one in own)
        for own in (term.coefficients, term.inner)
    ]
    term = replace(term, coefficients=known[0], inner=known[1])
    record = drawn_record((term,))
    (amplitude,) = amplitudes_by_term((term,), record.covariance)[term.id]
    said = effect_values(Model(machine(), None, (term,), record))[term.id]
    assert [words for _, words in said[:2]] == ["", ""]
    value, words = said[-1]
    assert f"{value} ({words})" == amplitude_words(amplitude)
    assert words.startswith("usual")


@pytest.mark.parametrize("sign", [0, 1, -1])
def test_a_sign_that_physics_does_not_give_is_said_of_a_model_that_was_read(sign: int) -> None:
    term = replace(backlash(), coefficients=(Parameter("b", "mm", -0.02, 0.001, sign=sign),))
    model = Model(machine(), None, (term,), replace(drawn_record((term,)), covariance=np.array([[1e-6]])))
    (again,) = model_from_document(document_of(model), "model.json").terms
    assert again.coefficients[0].sign == sign
    words = effect_values(replace_terms(model, again))["backlash:y"][0][1]
    assert words == ("not physical: it cannot be negative" if sign > 0 else "")


def replace_terms(model: Model, *terms: Term) -> Model:
    return Model(model.machine, None, terms, model.record)
