"""A function that jumps between two temperatures is named, and predictions say how far off they may be."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from geoerr.model import load_model, write_model
from geoerr.states import States
from geoerr.states.functions import Estimate
from geoerr.states.joint import fit_temperature
from geoerr.states.shapes import shapes_of

TEMPERATURES = (20.0, 60.0, 90.0, 120.0)
ALPHA = 11.5e-6
JUMP_MM = 0.08


def drawn(states: States, jump_mm: float, seed: int) -> Mapping[float, Estimate]:
    """Draw four states of a machine whose x grows in proportion, and whose EYX bows all at once above 75 °C."""
    functions, rng = states.functions, np.random.default_rng(seed)
    shapes = {shape.key: shape.parameters for shape in shapes_of(functions, with_squares=True)}
    bow = shapes["EYX", 2, 1] / np.abs(functions.rows["EYX"] @ shapes["EYX", 2, 1]).max()
    one = states.states[0].estimate
    made = {}
    for at in TEMPERATURES:
        moved = ALPHA * (at - 20.0) * shapes["EXX", 1, 1] + jump_mm * (at > 75.0) * bow
        made[at] = replace(one, parameters=moved + one.root @ rng.standard_normal(one.root.shape[1]))
    return made


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_the_function_is_named_and_others_are_left_alone(states: States, seed: int) -> None:
    fit = fit_temperature(states.functions, drawn(states, JUMP_MM, seed), 20.0)
    assert fit.misfit.p_value < 1e-6
    assert list(fit.astray) == ["EYX"]
    assert fit.scale == 1.0
    steady = fit_temperature(states.functions, drawn(states, 0.0, seed), 20.0)
    assert not steady.astray
    assert not steady.beside_law.any()
    for temperature in (60.0, 75.0):
        table, same = (one.errors(temperature).functions for one in (fit, steady))
        # Off by half of the jump, and by no more than is said.
        assert np.abs(table["EYX"].value).max() < 3.5 * table["EYX"].std.max()
        assert table["EYX"].std.max() > 0.15 * JUMP_MM
        assert table["EXX"].std[-1] < 1.5 * same["EXX"].std[-1]


def test_nothing_is_found_elsewhere_because_of_it(states: States) -> None:
    """A search finds something by chance in one of twenty; three of fifteen have a probability of 4 %."""
    fits = [fit_temperature(states.functions, drawn(states, JUMP_MM, seed), 20.0) for seed in range(15)]
    assert sum(bool({shape.name for shape in fit.shapes} - {"EXX", "EYX"}) for fit in fits) <= 2


def test_nothing_is_named_where_all_follow_the_law(states: States) -> None:
    """Of 40 machines one in a hundred has a function named; two of them are one in 16."""
    named = [fit_temperature(states.functions, drawn(states, 0.0, 100 + seed), 20.0).astray for seed in range(40)]
    assert sum(bool(one) for one in named) <= 2


def test_the_model_file_knows_it(states: States, tmp_path: Path) -> None:
    """The model of the same machine with and without what one function was found to be off by."""
    fit = fit_temperature(states.functions, states.estimates, 20.0, shapes=[("EXX", 1, 1), ("EYY", 1, 1)])
    assert "EZZ" in fit.astray
    broken = replace(states)
    broken.__dict__["temperature_fit"] = fit
    write_model(tmp_path / "model.json", broken.model.model)
    model = load_model(tmp_path / "model.json")
    low, high = (np.array([states.functions.range_mm[axis][end] for axis in "xyz"]) for end in (0, 1))
    place = np.array([low, [low[0], low[1], high[2]]])
    std_mm = [
        np.sqrt(one.prediction_covariance_mm2(place, at={"temp": 60.0})[1, 2, 2])
        for one in (model, states.model.model)
    ]
    assert std_mm[0] > 10.0 * std_mm[1]
    # Left out, z grows by 23.4 µm per kelvin and metre: a root mean square of half of that at 120 °C, less a mean.
    assert std_mm[0] == pytest.approx(fit.errors(60.0).functions["EZZ"].std[-1], rel=0.3)
    text = " ".join(broken.report().split())
    assert "not in proportion to the temperature, or its square: EZZ" in text
    assert "measure more temperatures between" in text
    assert broken.to_document()["astray"][0]["name"] == "EZZ"
