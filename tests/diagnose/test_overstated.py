"""Uncertainties that are stated too large make no function stiffer, nor what it cannot follow an effect."""

import numpy as np
import polars as pl
import pytest
from hidden_machine import Noise, Plan, machine, measure, motion

from geoerr.diagnose.asked import diagnose
from geoerr.fit import FitOptions, Fitted, fit_terms
from geoerr.observations import Observations

WHITE_UM = (10.0, 10.0, 15.0)


def _fitted(times: float, seed: int = 2) -> Fitted:
    rng = np.random.default_rng(seed)
    rows = measure(rng, motion(rng, Plan()), Noise(white=WHITE_UM))
    stated = {f"s{axis}": pl.lit(1e-3 * times * um) for axis, um in zip("xyz", WHITE_UM, strict=True)}
    return fit_terms(machine(), [Observations(rows.frame.with_columns(**stated))], options=FitOptions(threads=1))


@pytest.mark.parametrize("times", [3.0, 8.0, 25.0])
def test_functions_are_as_fine_as_with_what_is_right(times: float) -> None:
    right, large = _fitted(1.0), _fitted(times)
    assert large.scatter == pytest.approx(1.0 / times, rel=0.03)
    # The standard errors stay those that the table states.
    assert large.unit == 1.0
    assert [one.name for one in large.choices] == [one.name for one in right.choices]
    others = sum(one.n_free != two.n_free for one, two in zip(large.choices, right.choices, strict=True))
    # The bound of the scatter is 2 % above it: a choice that was a matter of so little may be another one.
    assert others <= 2
    assert large.held_out.figures.rmse_um == pytest.approx(right.held_out.figures.rmse_um, rel=2e-3)


def test_nothing_is_missing_where_nothing_is() -> None:
    for times in (8.0, 25.0):
        assert diagnose(_fitted(times), threads=1).verdict == "nothing-missing"


def test_what_is_stated_right_stays_its_own_measure() -> None:
    assert _fitted(1.0).scatter == 1.0
    assert _fitted(0.3).scatter == _fitted(0.3).unit > 2.0
