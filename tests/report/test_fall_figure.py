"""The picture of the falling error: bars as the figures say, and the noise, between those of a right model."""

from __future__ import annotations

import math

import pytest

from geoerr.cli.change_text import fall
from geoerr.diagnose.error_scale import LARGEST_LINEAR_RATIO, ErrorScale
from geoerr.diagnose.stages import Stage, stages_of
from geoerr.model import HistoryEntry
from geoerr.report.figures import error_fall, variable_label


def figures(rmse: float, held: float, floor: float = math.nan) -> dict[str, float]:
    return {"rmse_um": rmse, "held_out_rmse_um": held, "noise_floor_um": floor, "noise_um": 3.0}


def test_every_model_has_its_two_bars_and_the_last_ones_noise_is_drawn() -> None:
    stages = [Stage("at first", figures(40.0, 45.0)), Stage("+ backlash:x", figures(10.0, math.nan, 4.0))]
    figure = error_fall(stages)
    held, residual = figure.data
    assert list(residual.x) == [40.0, 10.0]
    assert list(held.x) == [45.0, None]
    assert residual.y[1] == "2. + backlash:x"
    assert error_fall(stages, is_numbered=True).data[0].y == ("at first", "+ backlash:x")
    assert figure.layout.shapes[0].x0 == 4.0
    # A fit follows some of the noise in the rows that it sees: a right model's residual is less.
    assert figure.layout.title.subtitle.text == (
        "dashed: the noise, 4.00 µm, between a right model's residual and its held-out error"
    )


def test_the_line_of_the_noise_crosses_no_figure() -> None:
    stages = [Stage("at first", figures(25.0, 26.0, 4.0)), Stage("+ backlash:x", figures(3.8, 4.2, 4.0))]
    held, residual = error_fall(stages).data
    assert residual.text[0] == "25.0"
    # The bar ends before the line: its figure stands behind it.
    assert residual.text[1].lstrip("\u00a0") == "3.80"
    assert residual.text[1].startswith("\u00a0")
    assert held.text[1] == "4.20"


@pytest.mark.parametrize("noise_um", [1.0, math.nan])
def test_beside_a_millimetre_micrometres_are_told_apart_on_a_logarithmic_axis(noise_um: float) -> None:
    story = [(1043.0, 1043.0), (11.3, 12.6), (0.94, 1.06)]
    stages = [Stage("step", {"rmse_um": r, "held_out_rmse_um": h, "noise_um": noise_um}) for r, h in story]
    figure = error_fall(stages)
    axis = figure.layout.xaxis
    assert axis.type == "log"
    assert "logarithmic" in axis.title.text
    assert "logarithmic" in figure.layout.title.subtitle.text
    held, residual = figure.data
    for bars, values in ((residual, [r for r, _ in story]), (held, [h for _, h in story])):
        assert [bars.base + x for x in bars.x] == pytest.approx(values)
        assert list(bars.customdata) == values
        assert math.log10(min(bars.base, *values)) > axis.range[0]
        assert math.log10(max(values)) < axis.range[1]
    assert residual.text == ("1,043", "11.3", "0.94")
    assert "1,000" in axis.ticktext
    # Bars begin at the noise; where nobody knows it, at the least.
    assert residual.base == (1.0 if noise_um == 1.0 else 0.94)


def test_an_axis_is_linear_where_the_shortest_bar_can_be_seen() -> None:
    story = [(LARGEST_LINEAR_RATIO * 2.0, None), (2.0, None)]
    figure = error_fall([Stage("step", {"rmse_um": r, "held_out_rmse_um": h}) for r, h in story])
    assert figure.layout.xaxis.type is None
    assert figure.layout.xaxis.range[0] == 0.0
    assert "logarithmic" not in figure.layout.xaxis.title.text
    assert error_fall([Stage("nothing", {}), Stage("perfect", {"rmse_um": 0.0})]).layout.xaxis.type is None


def test_a_logarithmic_bar_says_how_many_times_the_noise_an_error_is() -> None:
    scale = ErrorScale.of([1000.0, 10.0, 0.9], 1.0)
    assert [scale.share(value) for value in (1000.0, 10.0, 1.0, 0.9)] == pytest.approx([1.0, 1.0 / 3.0, 0.0, 0.0])
    assert [ErrorScale.of([8.0, 2.0], 1.0).share(value) for value in (8.0, 2.0)] == [1.0, 0.25]
    # A noise above all errors is none to begin at.
    assert ErrorScale.of([1000.0, 10.0], 2000.0).begin_um == 10.0


def test_a_terminal_draws_the_fall_on_the_same_scale() -> None:
    first, last = figures(1000.0, 1000.0, 1.0), figures(10.0, math.nan, 1.0)
    heading, *rows = fall([HistoryEntry("backlash:x", "Backlash", first, last)])
    assert "logarithmic" in heading
    assert [row.count("█") for row in rows] == [36, 11]
    assert all(row.count("│") == 1 for row in rows)
    heading, *rows = fall([HistoryEntry("backlash:x", "Backlash", figures(40.0, 40.0), figures(10.0, math.nan))])
    assert "logarithmic" not in heading
    assert [row.count("█") for row in rows] == [40, 9]


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


def test_what_an_effect_leaves_out_is_told_apart_from_what_it_does() -> None:
    history = [
        HistoryEntry("backlash:x", "Backlash", figures(40.0, 45.0), figures(20.0, 25.0)),
        # A third of the rows has no temperature, and was the noisy one.
        HistoryEntry("growth:x@temp_bed", "Growth", figures(5.9, 7.2), figures(5.8, 7.3)),
        HistoryEntry("scale:y", "Scale", figures(5.8, math.nan), figures(5.0, 6.0)),
    ]
    stages = stages_of(history)
    assert [stage.name for stage in stages] == [
        *("at first", "+ backlash:x", "the same on other rows"),
        *("+ growth:x@temp_bed", "+ scale:y"),
    ]
    assert [stage.figure("held_out_rmse_um") for stage in stages] == [45.0, 25.0, 7.2, 7.3, 6.0]


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
