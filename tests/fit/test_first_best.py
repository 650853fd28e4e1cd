"""Of trial values that explain the same but for round-off the first is taken."""

from __future__ import annotations

import numpy as np
import pytest

from geoerr.fit.ties import first_best


@pytest.mark.parametrize(
    ("gains", "expected"),
    [
        ([1.0, 2.0, 2.0 * (1.0 + 1e-12)], 1),
        ([1.0, 2.0 * (1.0 + 1e-12), 2.0], 1),
        ([1.0, 2.0, 2.001], 2),
        ([-3.0, -2.0, -2.0 * (1.0 - 1e-12)], 1),
        ([-np.inf, 5.0, -np.inf], 1),
        ([-np.inf, -np.inf], 0),
        ([0.0, 0.0], 0),
    ],
)
def test_the_first_of_what_is_one_but_for_round_off(gains: list[float], expected: int) -> None:
    assert first_best(np.array(gains)) == expected


def test_of_forms_that_explain_the_same_the_simplest_is_taken() -> None:
    gains = np.array([5.0, 4.0, 5.0 * (1.0 - 1e-12), 5.0])
    assert first_best(gains, np.array([3, 1, 1, 1])) == 2
    assert first_best(gains, np.array([1, 1, 1, 1])) == 0
