"""What the model can do itself is left open in an effect, and speaks neither for nor against it."""

import math

import pytest
from validation.hidden_effects.cases import development_seed
from validation.hidden_effects.generate import Hidden, generate

from geoerr.diagnose.asked import diagnose
from geoerr.fit import FitOptions, fit_terms


def test_sag_under_weights_that_change_is_named_by_what_the_weights_do() -> None:
    case = generate(development_seed(0), None, "mixed", "gauss-10", (Hidden("gravity-sag-load"),), 8.0, 3000)
    truth = case.truth[0]
    found = diagnose(fit_terms(case.machine, [case.observations], options=FitOptions(threads=1)), threads=1).found
    assert [str(one.reference) for one in found] == [f"gravity-sag:{truth.axis}"]
    values = {one.name: one for one in found[0].parameters}
    # A model with straightness and angles has the sag under the usual weight in it.
    assert math.isnan(values["k"].std)
    assert "curvature under the weight k is not determined by these data" in found[0].value_words
    assert found[0].to_document()["parameters"]["k"]["value"] is None
    assert values["k1"].value == pytest.approx(truth.parameters["k1"], abs=4.0 * values["k1"].std)
    assert values["k1"].std < 0.05 * abs(values["k1"].value)
