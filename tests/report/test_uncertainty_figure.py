"""The map of uncertainty shows the numbers it was given, with units, and marks what is not determined."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from geoerr.budget import UncertaintyMap, text
from geoerr.budget.budget import Contribution
from geoerr.report import budget_page
from geoerr.report.figures import style, uncertainty_slices


def some_map() -> UncertaintyMap:
    x, y, z = np.linspace(0.0, 400.0, 5), np.linspace(0.0, 300.0, 4), np.linspace(0.0, 200.0, 3)
    size = x[:, None, None] + 2.0 * y[None, :, None] + 3.0 * z[None, None, :]
    return UncertaintyMap(x, y, z, np.ones(size.shape, dtype=bool), size, 0.1 * size, 0.2 * size, 0.4 * size)


def test_slices_hold_the_numbers_and_say_their_units() -> None:
    volume = some_map()
    figure = uncertainty_slices(volume)
    maps = [trace for trace in figure.data if trace.type == "heatmap"]
    assert len(maps) == 9
    for row, values in enumerate((volume.error_um, volume.prediction_um, volume.part_95_um)):
        for column in range(3):
            shown = maps[3 * row + column]
            assert np.array_equal(np.asarray(shown.z), values[:, :, column].T)
        # One scale a row, from 0 to its largest: slices compare.
        name = "coloraxis" if row == 0 else f"coloraxis{row + 1}"
        assert figure.layout[name].cmax == values.max()
        assert figure.layout[name].cmin == 0.0
        assert figure.layout[name].colorbar.title.text == "µm"
    titles = [note.text for note in figure.layout.annotations]
    assert {"z = 0 mm", "z = 100 mm", "z = 200 mm"} <= set(titles)
    assert figure.layout.xaxis7.title.text == "X, mm"
    assert figure.layout.yaxis.title.text == "Y, mm"
    assert "1,600 µm" in figure.layout.title.subtitle.text
    assert figure.layout.template.layout.colorway == style.SERIES


def test_what_is_not_determined_is_crossed_out() -> None:
    volume = some_map()
    known = volume.is_determined.copy()
    known[3:, :, 1] = False
    hidden = {
        name: np.where(known, getattr(volume, name), np.nan)
        for name in ("error_um", "prediction_um", "part_um", "part_95_um")
    }
    figure = uncertainty_slices(dataclasses.replace(volume, is_determined=known, **hidden))
    crosses = [trace for trace in figure.data if trace.type == "scatter"]
    assert len(crosses) == 3
    assert set(crosses[0].x) == {300.0, 400.0}
    assert len(crosses[0].x) == 2 * 4
    assert "not determined" in crosses[0].hovertemplate
    assert "not determined, 13 % of the volume" in figure.layout.title.subtitle.text


@pytest.mark.parametrize("n_slices", [1, 2, 9])
def test_any_number_of_slices(n_slices: int) -> None:
    figure = uncertainty_slices(some_map(), n_slices)
    assert sum(trace.type == "heatmap" for trace in figure.data) == 3 * min(n_slices, 3)
    assert figure.to_json() == uncertainty_slices(some_map(), n_slices).to_json()


def test_a_share_that_rounds_to_nothing_has_no_sign() -> None:
    one = Contribution("pitch-yaw", np.array([1e-7, 1.0]), np.array([-1e-9, -0.003]))
    assert [budget_page._share(one, place) for place in (0, 1)] == ["0.0", "−0.3"]
    assert [text._share_of(one, [place]) for place in (0, 1)] == ["0.0 %", "−0.3 %"]
