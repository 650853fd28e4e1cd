"""The picture of the falling error: bars as the figures say, and the noise that no model gets below."""

from __future__ import annotations

import math

import pytest

from geoerr.model import HistoryEntry
from geoerr.report.figures import Stage, error_fall, stages_of, variable_label


def figures(rmse: float, held: float, floor: float = math.nan) -> dict[str, float]:
    return {"rmse_um": rmse, "held_out_rmse_um": held, "noise_floor_um": floor, "noise_um": 3.0}


def test_every_model_has_its_two_bars_and_the_last_ones_noise_is_drawn() -> None:
    stages = [Stage("at first", figures(40.0, 45.0)), Stage("+ backlash:x", figures(10.0, math.nan, 4.0))]
    figure = error_fall(stages)
    held, residual = figure.data
    assert list(residual.x) == [40.0, 10.0]
    assert list(held.x) == [45.0, None]
    assert residual.y[1] == "2. + backlash:x"
    assert figure.layout.shapes[0].x0 == 4.0
    assert "4.00 µm" in figure.layout.title.subtitle.text


def test_without_repeats_the_stated_noise_is_drawn() -> None:
    assert error_fall([Stage("at first", figures(40.0, 45.0))]).layout.shapes[0].x0 == 3.0


def test_a_models_history_is_a_story() -> None:
    history = [
        HistoryEntry("backlash:x", "Backlash", figures(40.0, 45.0), figures(20.0, 25.0)),
        HistoryEntry("scale:y", "Scale", figures(20.0, 25.0), figures(22.0, 24.0), action="removed"),
    ]
    assert [stage.name for stage in stages_of(history)] == ["at first", "+ backlash:x", "− scale:y"]
    assert [stage.figure("rmse_um") for stage in stages_of(history)] == [40.0, 20.0, 22.0]
    assert stages_of([]) == ()


@pytest.mark.parametrize(
    ("name", "label"),
    [
        ("y", "y, mm"),
        ("temp_bed", "temp_bed, °C"),
        ("s_x", "travel of x since it turned round, mm"),
        ("d_z", "direction of approach in z, −1 or +1"),
        ("load", "load"),
        ("s_own", "s_own"),
    ],
)
def test_axes_name_variables_with_their_unit(name: str, label: str) -> None:
    assert variable_label(name) == label
