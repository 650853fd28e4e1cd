"""What the model file says of the states that were measured, and what a program far from them is told."""

from __future__ import annotations

import numpy as np
import pytest
from hidden_machine import Noise, Plan, machine, measure, motion

from geoerr.errors import GeoerrError
from geoerr.fit import FitOptions, fit_model
from geoerr.model import Model
from geoerr.model.program_conditions import program_conditions


@pytest.fixture(scope="module")
def model() -> Model:
    rng = np.random.default_rng(3)
    moved = motion(rng, Plan(n_sessions=1, n_lines=20, n_points=12))
    table = measure(rng, moved, Noise(white=(2.0, 2.0, 2.0)), np.zeros_like(moved.q))
    effects = ["warm-up:z", "screw-heating:x", "camera-drift"]
    return fit_model(machine(), table, effects=effects, options=FitOptions(threads=1)).model


def test_how_long_it_ran_and_how_hard_it_worked_have_spans(model: Model) -> None:
    assert model.record is not None
    spans = model.record.covariate_spans
    assert set(spans) == {"t", "mean_v_x", "v_x"}
    assert spans["t"][0] >= 0.0
    assert spans["mean_v_x"][0] < 0.0 < spans["mean_v_x"][1]


@pytest.mark.parametrize(("name", "widths"), [("t", -1.0), ("t", 10.0), ("mean_v_x", 100.0)])
def test_a_state_far_from_what_was_measured_is_refused(model: Model, name: str, widths: float) -> None:
    """A program at t = -3000 s was corrected by 4.4 mm without a word."""
    assert model.record is not None
    low, high = model.record.covariate_spans[name]
    given = {one: 0.5 * sum(span) for one, span in model.record.covariate_spans.items()}
    assert program_conditions(model, given, extrapolates=False) == given
    given[name] = low + widths * (high - low)
    with pytest.raises(GeoerrError, match=f"{name} = .* is extrapolated"):
        program_conditions(model, given, extrapolates=False)
    assert program_conditions(model, given) == given
