"""A few waves that many knots could follow are named, and added with few knots; what is smooth keeps its knots."""

import numpy as np
import pytest
from hidden_machine import LENGTH_MM, Noise, Plan, machine, measure, motion

from geoerr.diagnose.change import add_effect
from geoerr.diagnose.diagnosis import diagnose
from geoerr.fit import FitOptions, fit_model
from geoerr.fit.wavy import without_waves
from geoerr.observations import Observations

PERIOD_MM = LENGTH_MM / 6.3


def observed(wave_um: float) -> Observations:
    rng = np.random.default_rng(8)
    moved = motion(rng, Plan())
    hidden = np.outer(wave_um * np.sin(2.0 * np.pi * moved.q[:, 0] / PERIOD_MM + 0.4), [1.0, 0.0, 0.0])
    hidden[:, 0] += 15.0 * np.sin(2.0 * np.pi * moved.q[:, 0] / (0.75 * LENGTH_MM) + 1.0)
    return measure(rng, moved, Noise(white=(3.0, 3.0, 4.0)), hidden)


def test_what_is_smooth_keeps_its_knots() -> None:
    result = fit_model(machine(), observed(0.0), options=FitOptions(threads=1))
    assert without_waves(result.fitted) is None


def test_waves_that_knots_follow_are_named_and_added_with_few_knots() -> None:
    observations = observed(8.0)
    result = fit_model(machine(), observations, options=FitOptions(threads=1))
    knots = {term.id: len(term.coefficients) for term in result.fitted.terms}
    plain = without_waves(result.fitted)
    assert plain is not None
    fewer = {term.id: len(term.coefficients) for term in plain if len(term.coefficients) < knots[term.id]}
    assert set(fewer) == {"EXX"}
    found = diagnose(result.fitted, threads=1).found
    assert [str(one.reference) for one in found] == ["periodic:x"]
    change = add_effect(result.model, observations, reference="periodic:x", threads=1)
    (added,) = [term for term in change.after.terms if term.id == "periodic:x"]
    for period in (*found[0].term.inner, *added.inner):
        assert period.value == pytest.approx(PERIOD_MM, abs=4.0 * period.std)
        assert period.std < 0.01 * PERIOD_MM
    assert {term.id: len(term.coefficients) for term in change.after.terms}["EXX"] == fewer["EXX"]
