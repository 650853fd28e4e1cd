"""States that warm while they are measured: their tables are of one temperature all the same."""

from __future__ import annotations

import numpy as np
import polars as pl
import pytest
from hot_machines import TEMPERATURES_DEGC, Warming, gantry
from validation.hot_and_cold import observe

from geoerr.bases import spline_over
from geoerr.error_functions import LI_SQUARENESS, LINEAR_AND_ANGULAR
from geoerr.observations import Observations
from geoerr.states import States, identify_states


def states_of(hot: Warming) -> States:
    ranges = {axis: np.linspace(*one.range_mm, 13) for axis, one in hot.machine.axes.items()}
    bases = {name: spline_over(name[2].lower(), ranges[name[2].lower()], 7) for name in LINEAR_AND_ANGULAR}
    tables = {}
    for temperature in TEMPERATURES_DEGC:
        table = observe(hot, temperature, 3)
        column = pl.Series(hot.row_degc(temperature, len(table)))
        tables[temperature] = Observations(table.frame.with_columns(temp=column))
    return identify_states(tables, hot.machine, bases=bases, threads=1)


def warming(colder_k: float) -> Warming:
    hot = gantry(3)
    return Warming(hot.machine, hot.cold, hot.heat, colder_k)


@pytest.fixture(scope="module")
def warm() -> States:
    return states_of(warming(15.0))


def test_the_tables_are_of_the_mean_temperature() -> None:
    """Left as measured, lengths of sessions that begin 40 K colder are off by seven standard uncertainties."""
    hot = warming(40.0)
    warm = states_of(hot)
    first, last = warm.states[0], warm.states[-1]
    worst, inside = 0.0, []
    for name, one in warm.difference(20.0, 120.0).by_name.items():
        expected = hot.difference(name, one.position_mm, first.mean_degc, last.mean_degc)
        known = one.std > 0.0
        off = np.abs(one.value - expected)[known] / one.std[known]
        inside.append(off < 1.96)
        worst = max(worst, float(off.max()))
    # As independent numbers 252 would have their largest at 2.9.
    assert worst < 4.5
    assert np.concatenate(inside).mean() > 0.85


def test_it_is_said_by_how_much(warm: States) -> None:
    (note,) = (note for note in warm.notes if "at 120 °C" in note)
    assert "from 105.0 to 119.2 °C while it was measured" in note
    assert "referred to the mean of 115.2 °C" in note
    assert any("at 60 °C" in note for note in warm.notes)
    assert not any("at 20 °C" in note for note in warm.notes)


def test_the_slopes_that_rows_are_referred_by_are_known_so_well_only(warm: States) -> None:
    """Fifteen kelvins of growth that is known to a percent: uncertainties are hardly larger than when steady."""
    steady = states_of(warming(0.0))
    one, other = (states.states[-1].errors.functions["EXX"] for states in (warm, steady))
    known = other.std > 0.0
    ratio = one.std[known] / other.std[known]
    assert (ratio > 0.97).all()
    assert (ratio < 1.25).all()
    assert not steady.notes
    assert set(LI_SQUARENESS) <= set(steady.functions.names)
