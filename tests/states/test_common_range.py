"""States whose lines do not begin and end at the same places."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hot_machines import gantry
from validation.hidden_effects.chain import Displacements
from validation.hot_and_cold import Hot, observe

from geoerr.errors import GeometryError
from geoerr.machine import Axis
from geoerr.observations import Observations
from geoerr.states import States, identify_states

STATES_DEGC = (20.0, 120.0)
# The largest of some hundred values by chance alone: once in ten thousand.
FAR = 5.5


def run_over(hot: Hot, degc: float, begins_mm: float, ends_mm: float = 0.0) -> Observations:
    """Run the program over ranges that begin and end further in; the errors are those of the whole range."""
    axes = {
        axis: Axis((whole.range_mm[0] + begins_mm, whole.range_mm[1] - ends_mm))
        for axis, whole in hot.machine.axes.items()
    }
    inner = replace(hot.machine, axes=axes)

    class Inside(Hot):
        def moved(self, q_mm: np.ndarray, temperature_degc: float) -> Displacements:
            return hot.moved(q_mm, temperature_degc)

    return replace(observe(Inside(inner, hot.cold, hot.heat), degc, 3), sources=(f"at-{degc:g}.csv",))


def assert_true(states: States, hot: Hot) -> None:
    for name, one in states.difference(*STATES_DEGC).by_name.items():
        low = hot.machine.axes[name[2].lower()].range_mm[0] if one.position_mm.size else 0.0
        true = hot.difference(name, one.position_mm, *STATES_DEGC)
        if name in {"EXX", "EYY", "EZZ"}:
            # 0 at the first place of the table, not of the range.
            true = true - hot.difference(name, one.position_mm[:1], *STATES_DEGC)
            assert one.position_mm[0] >= low
            assert (np.abs(one.value - true)[one.std > 0.0] < FAR * one.std[one.std > 0.0]).all(), name


@pytest.mark.parametrize("begins_mm", [0.01, 5.0])
def test_a_little_further_in_loses_nothing(begins_mm: float) -> None:
    """Every line stands at the low end of the other axes: all of them were left out, and no error was told."""
    hot = gantry(3)
    tables = {20.0: run_over(hot, 20.0, 0.0), 120.0: run_over(hot, 120.0, begins_mm)}
    states = identify_states(tables, hot.machine, threads=1)
    assert len(states.functions.names) == 21
    assert not any("take no part" in note for note in states.notes)
    assert [len(state.observations) for state in states.states] == [len(table) for table in tables.values()]
    for axis, (low, high) in states.functions.range_mm.items():
        whole = hot.machine.axes[axis].range_mm
        assert (low, high) == pytest.approx((whole[0] + begins_mm, whole[1]))
    assert_true(states, hot)


def test_rows_far_beyond_the_other_state_are_named() -> None:
    hot = gantry(3)
    tables = {20.0: run_over(hot, 20.0, 0.0), 120.0: run_over(hot, 120.0, 0.0, ends_mm=100.0)}
    states = identify_states(tables, hot.machine, threads=1)
    low, high = hot.machine.axes["x"].range_mm
    of_x, of_y, of_z = (note for note in states.notes if "take no part" in note)
    n_rows = len(tables[20.0])
    assert f"of {n_rows} rows at 20 °C (at-20.csv) lie outside the range that all states share" in of_x
    assert f"share, x from {low:g} to {high - 100.0:g} mm, and take no part: there x is at" in of_x
    assert of_x.endswith(f"to {high:g} mm")
    assert "share, y from" in of_y
    assert "share, z from" in of_z
    assert len(states[20.0].observations) < n_rows
    assert len(states[120.0].observations) == len(tables[120.0])
    assert_true(states, hot)


def test_ranges_that_do_not_meet_are_refused_by_name() -> None:
    hot = gantry(3)
    span = min(np.ptp(axis.range_mm) for axis in hot.machine.axes.values())
    tables = {20.0: run_over(hot, 20.0, 0.0, 0.6 * span), 120.0: run_over(hot, 120.0, 0.6 * span)}
    with pytest.raises(
        GeometryError, match=r"share no range of [xyz]: at 120 °C \(at-120.csv\) it starts at .* mm, at 20 °C"
    ):
        identify_states(tables, hot.machine, threads=1)
