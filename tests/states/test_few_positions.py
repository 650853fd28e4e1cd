"""Axes that stood at few places: what the gauge holds is no number that could be compared."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hot_machines import gantry
from validation.hot_and_cold import NO_HEAT, Hot, observe

from geoerr.errors import GeometryError, NotDeterminedError
from geoerr.observations import Observations
from geoerr.report.provenance import Provenance
from geoerr.report.states_page import write_states_page
from geoerr.states import States, identify_states

STATES_DEGC = (20.0, 120.0)
# The largest of some hundred values by chance alone: once in ten thousand.
FAR = 5.5


def at_few_places(observations: Observations, n_places: int) -> Observations:
    """Keep rows where the axis that moves stands at so many places, evenly from end to end."""
    commanded, lines = observations.commanded_mm, np.array(observations.texts("line"))
    kept = np.zeros(len(commanded), dtype=bool)
    for axis, letter in enumerate("XYZ"):
        on_line = np.char.startswith(lines.astype(str), letter)
        along = commanded[on_line, axis]
        chosen = np.linspace(along.min(), along.max(), 13)[:: 12 // (n_places - 1)]
        kept[on_line] = np.abs(along[:, None] - chosen).min(axis=1) < 1e-6
    return observations.select(kept)


def states_at(hot: Hot, seed: int, n_places: int) -> States:
    tables = {degc: at_few_places(observe(hot, degc, seed), n_places) for degc in STATES_DEGC}
    return identify_states(tables, hot.machine, threads=1)


@pytest.mark.parametrize(("n_places", "rank"), [(2, 15), (3, 33), (4, 51)])
def test_few_places_give_all_that_a_state_determines(n_places: int, rank: int) -> None:
    """Of k places 3 (k - 1) numbers of positioning, 6 (k - 2) of straightness, 9 (k - 1) of angles, 3 more."""
    hot = gantry(3)
    states = states_at(hot, 3, n_places)
    assert len(states.functions.names) == 21
    difference = states.difference(*STATES_DEGC)
    fit = states.temperature_fit
    assert difference.test.rank == fit.misfit.rank + len(fit.shapes) == rank
    for name, one in difference.by_name.items():
        true, known = hot.difference(name, one.position_mm, *STATES_DEGC), one.std > 0.0
        assert (np.abs(one.value - true)[known] < FAR * one.std[known]).all(), name
        assert one.value[~known] == pytest.approx(0.0, abs=1e-12)
    assert {"EXX", "EYY", "EZZ"} <= {shape.name for shape in fit.shapes}
    assert "expansion alpha" in states.report()


def test_few_places_that_do_not_differ_show_nothing() -> None:
    """Two independent states of one machine; a fixed seed, so that 1 % is bound enough."""
    hot = gantry(6)
    for n_places in (2, 3):
        states = states_at(Hot(hot.machine, hot.cold, NO_HEAT), 6, n_places)
        difference = states.difference(*STATES_DEGC)
        assert difference.p_value > 0.01
        assert difference.largest_p_value > 0.01
        assert difference.volume().p_value > 0.01
        assert difference.volume().p_values.min() > 0.01
        assert min(one.p_value for one in difference.by_name.values()) > 0.01
        assert states.temperature_fit.misfit.p_value > 0.01


def test_axes_that_never_moved_in_one_state_leave_the_rest_to_be_compared(tmp_path: Path) -> None:
    """Hot, one line along x was measured: x is compared, and the state and its file are named for the rest."""
    hot = gantry(3)
    warm = observe(hot, 60.0, 3)
    along_x = replace(warm.select([line == "X1" for line in warm.texts("line")]), sources=("warm.csv",))
    tables = {20.0: observe(hot, 20.0, 3), 60.0: along_x, 120.0: observe(hot, 120.0, 3)}
    states = identify_states(tables, hot.machine, threads=1)
    difference = states.difference(*STATES_DEGC)
    assert {"EXX", "EYX", "EZX"} <= set(difference.by_name) <= {f"E{one}X" for one in "XYZABC"}
    assert difference.by_name["EXX"].p_value < 1e-9
    with pytest.raises(NotDeterminedError, match=r"the states share one position only of y, z"):
        difference.volume()
    report = " ".join(states.report().split())
    for axis in "yz":
        assert f"the {axis} axis never moved at 60 °C (warm.csv)" in report
    document = states.to_document()
    assert document["difference"]["volume"] is None
    assert len(document["notes"]) == len(states.notes)
    write_states_page(tmp_path / "states.html", states, Provenance("0", "geoerr states"))
    page = (tmp_path / "states.html").read_text(encoding="utf-8")
    assert "No map" in page
    assert "warm.csv" in page


def test_states_that_share_nothing_are_refused_by_name() -> None:
    """Hot, one place was measured."""
    hot = gantry(3)
    cold, warm = (replace(observe(hot, degc, 3), sources=(f"at-{degc:g}.csv",)) for degc in STATES_DEGC)
    place = (warm.commanded_mm == warm.commanded_mm[0]).all(axis=1)
    with pytest.raises(GeometryError, match="no error is determined in all states") as caught:
        identify_states({20.0: cold, 120.0: warm.select(place)}, hot.machine, threads=1)
    assert "120 °C (at-120.csv): the x axis never moved" in str(caught.value)
