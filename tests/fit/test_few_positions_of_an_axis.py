"""Straightness of which nothing could be seen is not determined: 0 ± 0 would be certain of it."""

from __future__ import annotations

import numpy as np
import pytest

import geoerr
from geoerr.machine import Machine
from geoerr.observations import Observations, observations_from_columns

MACHINE = Machine.from_chain("wZbXYt", (300.0, 300.0, 200.0))
BOW_MM = 0.03


def along_x(n_positions: int, *, is_stated: bool) -> Observations:
    """There twice, of a bow across the axis, 4 µm of noise."""
    x = np.tile(np.linspace(0.0, 300.0, n_positions), 2)
    noise = np.random.default_rng(3).normal(0.0, 4e-3, (len(x), 3))
    bow = BOW_MM * (1.0 - (x / 150.0 - 1.0) ** 2)
    columns = {
        **{"x": x, "y": np.zeros(len(x)), "z": np.zeros(len(x)), "repeat": np.repeat([0.0, 1.0], n_positions)},
        **dict(zip(("mx", "my", "mz"), (np.column_stack([x, bow, 0.0 * x]) + noise).T, strict=True)),
    }
    stated = {f"s{axis}": np.full(len(x), 4e-3) for axis in "xyz"} if is_stated else {}
    return observations_from_columns(columns | stated)


@pytest.mark.parametrize(("n_positions", "is_stated"), [(2, True), (2, False), (3, False)])
def test_a_line_through_so_few_positions_says_nothing_of_straightness(n_positions: int, is_stated: bool) -> None:
    observations = along_x(n_positions, is_stated=is_stated)
    fitted = geoerr.fit_model(MACHINE, observations).model.error_functions()
    for errors in (fitted, geoerr.identify_joint(observations, MACHINE).errors):
        assert not {"EYX", "EZX"} & errors.functions.keys()
        reasons = {item.name: item.why for item in errors.not_determined}
        assert "positions on X" in reasons["EYX"]


@pytest.mark.parametrize("n_positions", [3, 5])
def test_where_something_is_left_beside_a_line_it_is_known_as_well_as_it_can_be(n_positions: int) -> None:
    observations = along_x(n_positions, is_stated=True)
    bow = geoerr.fit_model(MACHINE, observations).model.error_functions().functions["EYX"]
    middle = float(np.interp(150.0, bow.position_mm, bow.value))
    assert bow.std is not None
    assert abs(middle - BOW_MM) < 5.0 * float(bow.std.max())
    assert float(bow.std.max()) > 1e-3
