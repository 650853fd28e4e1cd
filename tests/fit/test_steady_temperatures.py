"""When what follows a temperature is counted from its mean: one question, of one term (`inner`) and of a search."""

from __future__ import annotations

import math

import numpy as np
import pytest

from geoerr.fit.owned import OWNED, are_owned
from geoerr.fit.steady import ends_and_middle, is_steady
from geoerr.terms import Parameter


def test_a_column_is_owned_where_the_fit_leaves_next_to_nothing_of_it() -> None:
    # In the basis (1, 0, 0), (0, 1, 0) a column of length 5 leaves what it has along the third direction.
    columns = np.array([[3.0, 4.0, 0.0], [3.0, 4.0, 0.2], [3.0, 4.0, 0.3]])
    squares, inside = (columns**2).sum(axis=1), columns[:, :2]
    left = columns[:, 2] ** 2 / squares
    assert list(left < OWNED) == [True, True, False]
    assert list(are_owned(squares, inside)) == [True, True, False]
    # Of several trials at once, each with its columns.
    assert are_owned(squares[None].repeat(2, axis=0), inside[None].repeat(2, axis=0)).tolist() == 2 * [
        [True, True, False]
    ]


def test_a_chamber_at_one_temperature_is_steady_and_a_bed_that_warms_up_is_not() -> None:
    for temperature, steady in ((100.0 + np.linspace(-3.0, 3.0, 50), True), (np.linspace(0.0, 40.0, 50), False)):
        assert bool(is_steady(temperature.var(), (temperature**2).mean())) is steady
    assert is_steady([1.0, 1.0], [100.0, 10.0]).tolist() == [True, False]


@pytest.mark.parametrize(
    ("parameter", "values"),
    [
        (Parameter("q_fixed", "mm", low=100.0, high=300.0), [100.0, 200.0, 300.0]),
        (Parameter("tau", "s", low=10.0, high=1000.0, spacing="log"), [10.0, 100.0, 1000.0]),
        (Parameter("tau", "s", 30.0, low=10.0, high=1000.0, spacing="log"), [30.0]),
        (Parameter("q_fixed", "mm", low=100.0, high=100.0), [100.0]),
    ],
)
def test_a_model_is_asked_at_ends_and_middle_of_a_range(parameter: Parameter, values: list[float]) -> None:
    assert ends_and_middle(parameter) == pytest.approx(values)
    assert parameter.middle == pytest.approx(values[len(values) // 2])


def test_what_has_no_range_has_no_middle() -> None:
    assert math.isnan(Parameter("b", "mm").middle)
    assert Parameter("b", "mm", 0.02).middle == 0.02
