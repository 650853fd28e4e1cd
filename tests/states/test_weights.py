"""Noise that is larger in depth, where no uncertainty is stated."""

from __future__ import annotations

import numpy as np
import polars as pl
import pytest
from hot_machines import gantry
from validation.hot_and_cold import NO_HEAT, Hot, observe

from geoerr.bases import spline_over
from geoerr.error_functions import LINEAR_AND_ANGULAR
from geoerr.observations import Observations
from geoerr.states import States, identify_states
from geoerr.states.weights import weights_of

TEMPERATURES = (20.0, 120.0)
WHITE_MM = np.array([10e-3, 10e-3, 30e-3])


def machine() -> Hot:
    hot = gantry(5)
    return Hot(hot.machine, hot.cold, NO_HEAT)


def tables(depth_mm: float, *, is_stated: bool) -> dict[float, Observations]:
    """Give both states with noise of 10 µm, along z of the measuring frame of another size."""
    made = {}
    for temperature in TEMPERATURES:
        table = observe(machine(), temperature, 5)
        more = np.sqrt(depth_mm**2 - 10e-3**2) * np.random.default_rng(int(temperature)).normal(size=len(table))
        frame = table.frame.with_columns(
            mz=table.measured_mm[:, 2] + more, sz=pl.lit(depth_mm), session=pl.lit(f"at {temperature:g}")
        )
        made[temperature] = Observations(frame if is_stated else frame.drop("sx", "sy", "sz"))
    return made


def states_of(depth_mm: float, *, is_stated: bool) -> States:
    ranges = {axis: np.linspace(*one.range_mm, 13) for axis, one in machine().machine.axes.items()}
    bases = {name: spline_over(name[2].lower(), ranges[name[2].lower()], 7) for name in LINEAR_AND_ANGULAR}
    return identify_states(tables(depth_mm, is_stated=is_stated), machine().machine, bases=bases, threads=1)


def test_each_component_has_its_own_scatter() -> None:
    found = weights_of(machine().machine, tables(WHITE_MM[2], is_stated=False), {}, 1)
    assert len(found.std_mm) == 2
    for std_mm in found.std_mm.values():
        # Some 600 degrees of freedom tell each to 3 %.
        assert std_mm == pytest.approx(WHITE_MM, rel=0.12)
    assert found.mean_mm == pytest.approx(np.sqrt((WHITE_MM**2).mean()), rel=0.1)
    assert "µm along the measuring frame's x, y, z" in found.notes[0]


@pytest.mark.parametrize(("depth_mm", "is_stated"), [(10e-3, False), (30e-3, True)])
def test_what_is_alike_or_stated_needs_no_weights(depth_mm: float, is_stated: bool) -> None:
    given = tables(depth_mm, is_stated=is_stated)
    found = weights_of(machine().machine, given, {}, 1)
    assert not found.notes
    assert found.sightings(list(given.values())) is None


def test_what_is_not_stated_is_known_as_well_as_what_is() -> None:
    """One scale for all components would be twice too large for two of them, and half as large for the third."""
    told, stated = states_of(WHITE_MM[2], is_stated=False), states_of(WHITE_MM[2], is_stated=True)
    assert any("no uncertainty is stated" in note for note in told.notes)
    assert not any("no uncertainty is stated" in note for note in stated.notes)
    one, other = (states.difference(*TEMPERATURES).by_name for states in (told, stated))
    for name in other:
        known = other[name].std > 0.0
        assert one[name].std[known] == pytest.approx(other[name].std[known], rel=0.15)
    # The one model sees all states with the same weights.
    sizes = [np.sqrt(np.diag(states.model.model.record.covariance)) for states in (told, stated)]
    known = sizes[1] > 0.0
    assert np.median(sizes[0][known] / sizes[1][known]) == pytest.approx(1.0, abs=0.1)
