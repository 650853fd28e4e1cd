"""An error that one state leaves open is not compared, and the others are as if it had been told."""

from __future__ import annotations

import numpy as np
import pytest
from validation.hidden_effects.machines import draw_machine
from validation.hot_and_cold import Hot, draw_heat, observe, turned

from geoerr import identify_joint
from geoerr.observations import Observations, observations_from_columns
from geoerr.states import States, identify_states

STATES_DEGC = (20.0, 120.0)
# The largest of some hundred values by chance alone: once in ten thousand.
FAR = 5.5


def bed_machine(seed: int) -> Hot:
    """Give a machine whose bed moves along y, with angles that one target on it cannot show."""
    rng = np.random.default_rng(seed)
    machine, cold = draw_machine(rng, "wYbXZt")
    return Hot(machine, cold, draw_heat(rng))


def with_one_bed_target(observations: Observations) -> Observations:
    kept = {"tool0", "tool1", "tool2", "work0"}
    return observations.select([name in kept for name in observations.texts("target")])


def seen_from_the_work(hot: Hot, degc: float, seed: int, n_points: int = 100) -> Observations:
    """Measure the tool's point alone, from the work, at scattered positions, all of them twice; 3 µm of noise."""
    rng = np.random.default_rng([seed, round(degc)])
    low, high = np.array([hot.machine.axes[axis].range_mm for axis in "xyz"]).T
    ends = np.array(np.meshgrid(*zip(low, high, strict=True))).reshape(3, -1).T
    inside = low + np.random.default_rng(seed).random((n_points - len(ends), 3)) * (high - low)
    q_mm = np.tile(np.concatenate([ends, inside]), (2, 1))
    seen = hot.volume_mm(q_mm, degc) @ turned(rng.normal(0.0, 0.005, 3)).T + rng.normal(0.0, 0.003, q_mm.shape)
    columns = {
        name: values
        for names, block in (("xyz", q_mm), (("mx", "my", "mz"), seen))
        for name, values in zip(names, block.T, strict=True)
    }
    columns |= {name: np.zeros(len(q_mm)) for name in ("tx", "ty", "tz")}
    columns |= {name: np.full(len(q_mm), 0.003) for name in ("sx", "sy", "sz")}
    columns |= {
        "carrier": ["relative"] * len(q_mm),
        "line": ["scattered"] * len(q_mm),
        "t": 10.0 * np.arange(len(q_mm)),
        "repeat": np.repeat([0.0, 1.0], n_points),
    }
    return observations_from_columns(columns)


def assert_true(states: States, hot: Hot) -> None:
    for name, one in states.difference(*STATES_DEGC).by_name.items():
        true, known = hot.difference(name, one.position_mm, *STATES_DEGC), one.std > 0.0
        assert (np.abs(one.value - true)[known] < FAR * one.std[known]).all(), name


@pytest.mark.parametrize("seed", [4, 7])
def test_one_target_on_the_bed_when_hot_leaves_its_angles_open_and_nothing_else_wrong(seed: int) -> None:
    """Chosen from a mean without them, the cold bed's angles were straight lines, and the rest took the bends up."""
    hot = bed_machine(seed)
    cold, warm = (observe(hot, degc, seed) for degc in STATES_DEGC)
    states = identify_states({20.0: cold, 120.0: with_one_bed_target(warm)}, hot.machine, threads=1)
    both = identify_states({20.0: cold, 120.0: warm}, hot.machine, threads=1)
    assert {item.name for item in states.functions.not_determined} == {"EAY", "EBY", "ECY"}
    assert len(both.functions.names) == 21
    assert_true(states, hot)
    # The same rows on other bases: they differ by less than their noise.
    for name in states.functions.names:
        if name in both[20.0].errors.functions:
            own, known = (one[20.0].errors.functions[name] for one in (states, both))
            moves = own.std > 1e-9
            assert (np.abs(own.value - known.value)[moves] < 1.5 * known.std[moves]).all(), name
    for item in states.functions.not_determined:
        assert item.why.startswith("at 120 °C (memory): no measured point responds to it"), item


def test_scattered_points_of_one_tool_point_tell_as_much_as_of_each_state_alone() -> None:
    """Angles are open in every state: the rest was refused, or told with errors of many uncertainties."""
    hot = bed_machine(5)
    tables = {degc: seen_from_the_work(hot, degc, 5) for degc in STATES_DEGC}
    alone = identify_joint(tables[20.0], hot.machine, threads=1).errors
    states = identify_states(tables, hot.machine, threads=1)
    assert set(states.functions.names) == {*alone.functions, *alone.squareness}
    assert {"EXY", "EYY", "EZY"} <= set(states.functions.names)
    assert_true(states, hot)
    assert states.temperature_fit.misfit.p_value > 1e-3
