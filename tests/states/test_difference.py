"""Differences of states: against what heat was told to do, in any measuring frame, and what is refused."""

from __future__ import annotations

import pickle

import numpy as np
import pytest
from hot_machines import gantry, seen_from_elsewhere
from validation.hot_and_cold import NO_HEAT, Hot, observe, without_rigid

from geoerr.bases import spline_over
from geoerr.error_functions import LINEAR_AND_ANGULAR, errors_from_document
from geoerr.errors import GeoerrError, GeometryError
from geoerr.geometry import rigid_columns
from geoerr.observations import Observations
from geoerr.states import States, identify_states
from geoerr.states.common import estimate_of
from geoerr.terms import BasisSpec

# The largest of some hundred values by chance alone: once in ten thousand.
FAR = 5.5


def bases_of(hot: Hot, n_functions: int = 7) -> dict[str, BasisSpec]:
    ranges = {axis: np.linspace(*one.range_mm, 13) for axis, one in hot.machine.axes.items()}
    return {name: spline_over(name[2].lower(), ranges[name[2].lower()], n_functions) for name in LINEAR_AND_ANGULAR}


def test_states_go_to_other_processes(states: States) -> None:
    there = pickle.loads(pickle.dumps(states))
    here, other = (one.difference(20.0, 120.0) for one in (states, there))
    assert other.p_value == here.p_value
    for name, one in here.by_name.items():
        assert other.by_name[name].value.tobytes() == one.value.tobytes(), name
    html = there._repr_html_()
    assert html == states._repr_html_()
    assert "at 3 temperatures" in html
    assert ">120</td>" in html


def test_every_function_differs_by_what_heat_did(hot: Hot, states: States) -> None:
    difference = states.difference(20.0, 120.0)
    assert difference.p_value < 1e-9
    assert set(difference.by_name) == {*LINEAR_AND_ANGULAR, "EC0Y", "EB0Z", "EA0Z"}
    for name, one in difference.by_name.items():
        true = hot.difference(name, one.position_mm, 20.0, 120.0)
        known = one.std > 0.0
        assert (np.abs(one.value - true)[known] < FAR * one.std[known]).all(), name
        assert one.value[~known] == pytest.approx(0.0, abs=1e-12)
    # Expansion of a metal over hundreds of millimetres is a hundred times the noise: each axis is named.
    assert all(difference.by_name[name].p_value < 1e-9 for name in ("EXX", "EYY", "EZZ"))
    assert difference.by_name["EXX"].is_beyond[-1]


def test_tables_of_the_difference_are_those_of_the_states(states: States) -> None:
    difference = states.difference(20.0, 120.0)
    for name, table in difference.errors.functions.items():
        cold, warm = (states[at].errors.functions[name] for at in (20.0, 120.0))
        assert table.value == pytest.approx(warm.value - cold.value, abs=1e-12)
        assert table.std == pytest.approx(np.hypot(warm.std, cold.std), rel=1e-6, abs=1e-12)
    assert errors_from_document(difference.errors.to_document(), "-").functions.keys() == set(LINEAR_AND_ANGULAR)


def test_the_volume_differs_by_what_heat_did(hot: Hot, states: States) -> None:
    volume = states.difference(20.0, 120.0).volume(4)
    places = volume.position_mm
    true = without_rigid(places, hot.volume_mm(places, 120.0) - hot.volume_mm(places, 20.0))
    assert (np.abs(volume.difference_mm - true) < FAR * volume.std_mm).all()
    assert volume.p_value < 1e-9
    assert volume.is_beyond.any()
    assert ((volume.p_values < 0.05) == volume.is_beyond).mean() > 0.97
    assert volume.shape == (4, 4, 4)


def test_a_rigid_motion_is_no_difference(states: States) -> None:
    """What is left has no shift and no turn, neither in the values nor in what noise may do to them."""
    volume = states.difference(20.0, 120.0).volume(3)
    arm = volume.position_mm + np.asarray(states.machine.tool_offset_mm)
    columns = rigid_columns(arm - arm.mean(axis=0))
    size = np.linalg.norm(columns, axis=0)
    assert (columns.T @ volume.difference_mm.ravel()) / size == pytest.approx(0.0, abs=1e-9)
    assert (columns / size).T @ volume.root_mm.reshape(len(columns), -1) == pytest.approx(0.0, abs=1e-9)


def test_another_measuring_frame_is_no_difference() -> None:
    """The same rows seen from elsewhere: offsets are found along other axes, and rows weigh a little otherwise."""
    hot = gantry(4)
    cold = observe(hot, 20.0, 4)
    found = identify_states(
        {20.0: cold, 60.0: seen_from_elsewhere(cold, 1)}, hot.machine, bases=bases_of(hot), threads=1
    ).difference(20.0, 60.0)
    assert all((np.abs(one.value) <= 0.1 * one.std + 1e-12).all() for one in found.by_name.values())
    assert found.p_value > 0.999
    volume = found.volume(3)
    assert volume.rms_um < 0.1 * volume.rms_by_chance_um


def test_where_nothing_differs_nothing_is_found() -> None:
    """Two independent states of one machine; a fixed seed, so that 1 % is bound enough."""
    hot = gantry(6)
    unchanged = Hot(hot.machine, hot.cold, NO_HEAT)
    tables = {temperature: observe(unchanged, temperature, 6) for temperature in (20.0, 120.0)}
    difference = identify_states(tables, hot.machine, threads=1).difference(20.0, 120.0)
    assert difference.p_value > 0.01
    assert difference.largest_p_value > 0.01
    assert difference.volume().p_value > 0.01
    assert min(one.p_value for one in difference.by_name.values()) > 0.01


def test_refusals(hot: Hot, states: States) -> None:
    table = states[20.0].observations
    with pytest.raises(GeoerrError, match="two temperatures"):
        identify_states({20.0: table}, hot.machine)
    with pytest.raises(GeoerrError, match="all 2 tables carry the same temperature, 20 °C"):
        identify_states({20.0: [table, table]}, hot.machine)
    with pytest.raises(GeoerrError, match="no state at 75"):
        states.difference(20.0, 75.0)
    with pytest.raises(GeoerrError, match="does not differ from itself"):
        states.difference(20.0, 20.0)
    with pytest.raises(GeoerrError, match="cannot be a column's name"):
        identify_states({20.0: table, 60.0: table}, hot.machine, covariate="temp bed")
    with pytest.raises(GeoerrError, match="nearer to 20"):
        identify_states({20.0: table, 60.0: table}, hot.machine)
    empty = Observations(table.frame.with_columns(temp_bed=None))
    with pytest.raises(GeoerrError, match="is empty"):
        identify_states({20.0: empty, 60.0: table}, hot.machine, covariate="temp_bed")
    flat = np.column_stack([np.arange(9.0) % 3, np.arange(9.0) // 3, np.zeros(9)])
    with pytest.raises(GeometryError, match="in one plane"):
        states.difference(20.0, 120.0).volume(q_mm=100.0 * flat)


def test_what_one_state_does_not_determine_is_not_compared() -> None:
    """Hot, one target was in view, the tool point: what turns about it is unknown, and so is where a lever leads."""
    hot = gantry(7)
    cold, warm = (observe(hot, temperature, 7) for temperature in (20.0, 120.0))
    one_target = warm.select([name == "tool0" for name in warm.texts("target")])
    states = identify_states({20.0: cold, 120.0: one_target}, hot.machine, bases=bases_of(hot), threads=1)
    lost = {item.name for item in states.functions.not_determined}
    assert {"EAZ", "EBZ", "ECZ"} <= lost
    difference = states.difference(20.0, 120.0)
    assert not lost & set(difference.by_name)
    assert difference.by_name["EXX"].p_value < 1e-9


def test_rows_outside_the_common_range_are_counted() -> None:
    hot = gantry(8)
    cold, warm = (observe(hot, temperature, 8) for temperature in (20.0, 120.0))
    low, high = hot.machine.axes["x"].range_mm
    narrow = warm.select(warm.commanded_mm[:, 0] <= low + 0.8 * (high - low))
    states = identify_states({20.0: cold, 120.0: narrow}, hot.machine, bases=None, threads=1)
    assert len(states[20.0].observations) < len(cold)
    assert any("outside the range" in note for note in states.notes)
    assert states.functions.range_mm["x"][1] <= low + 0.8 * (high - low)


def test_scatter_beyond_what_is_stated_counts_before_a_fit_can_tell_it(states: States) -> None:
    """Of three fits as they are stated, some leave more than that: their covariance is as much larger (Birge)."""
    ratios = []
    for state in states.states:
        fitted = state.fitted
        assert fitted.scale == 1.0
        ratio = fitted.solved.chi_squared / fitted.dof
        assert estimate_of(fitted).covariance == pytest.approx(fitted.covariance * max(ratio, 1.0))
        ratios.append(ratio)
    assert min(ratios) < 1.0 < max(ratios)
