"""Sessions of one temperature against each other: cold before the heat, and cold after it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hot_machines import gantry
from validation.hot_and_cold import Hot, observe

from geoerr.observations import Observations
from geoerr.states import identify_states

STATES_DEGC = (20.0, 120.0)


def named(table: Observations, file: str) -> Observations:
    return replace(table, sources=(file,))


def after(hot: Hot, lean_rad: float) -> Observations:
    """Measure at 20 °C again, with noise of its own, on a machine whose axes x and y have moved for good."""
    # Heat of a hundredth of a kelvin is none but for what leans.
    lean = hot.heat.lean_rad + np.array([lean_rad / 0.01, 0.0, 0.0])
    return named(observe(replace(hot, heat=replace(hot.heat, lean_rad=lean)), 20.01, 3), "after.csv")


@pytest.mark.parametrize(("lean_rad", "contradicts"), [(300e-6, True), (0.0, False)])
def test_a_machine_that_did_not_come_back_is_told(lean_rad: float, contradicts: bool) -> None:
    """The mean of both was taken without a word, with the uncertainty of one machine measured twice."""
    hot = gantry(3)
    before, warm = (named(observe(hot, degc, 3), f"at-{degc:g}.csv") for degc in STATES_DEGC)
    states = identify_states({20.0: [before, after(hot, lean_rad)], 120.0: warm}, hot.machine, threads=1)
    (repeat,) = states.repeats
    document = states.to_document()
    assert document["repeats"][0]["p_value"] == repeat.p_value
    assert (document["repeats"][0]["first"], document["repeats"][0]["second"]) == ("at-20.csv", "after.csv")
    (sentence,) = (note for note in document["notes"] if note.startswith("at-20.csv and after.csv, both 20 °C, "))
    assert " ".join(sentence.split()) in " ".join(states.report().split())
    assert repeat.contradicts == contradicts
    if contradicts:
        assert repeat.p_value < 1e-6
        assert (
            f"contradict each other, most of all in EC0Y: chance does as much with p = {repeat.p_value:.2g}"
            in sentence
        )
    else:
        assert repeat.p_value > 0.01
        assert f"agree: chance does as much with p = {repeat.p_value:.2g}" in sentence


def test_sessions_that_show_one_axis_each_are_one_measurement() -> None:
    """Nothing of the one is in the other: there is nothing to compare, and nothing is said."""
    hot = gantry(3)
    cold, warm = (observe(hot, degc, 3) for degc in STATES_DEGC)
    of_x = np.array([line.startswith("X") for line in cold.texts("line")])
    states = identify_states({20.0: [cold.select(of_x), cold.select(~of_x)], 120.0: warm}, hot.machine, threads=1)
    assert states.repeats == ()
    assert "EXX" in states.functions.names


def test_tables_without_files_are_told_apart_by_their_number() -> None:
    hot = gantry(3)
    cold, warm = (observe(hot, degc, 3) for degc in STATES_DEGC)
    states = identify_states({20.0: [cold, observe(hot, 20.01, 3)], 120.0: warm}, hot.machine, threads=1)
    (repeat,) = states.repeats
    assert repeat.difference.first != repeat.difference.second
    assert repeat.difference.second.endswith("(table 2)")
