"""The column of temperature: absent, empty in part, of texts; and a model that knows the data it is from."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from validation.hot_and_cold import Hot, observe

from geoerr.diagnose.comparison import compare
from geoerr.errors import GeoerrError
from geoerr.observations import Observations, read_observations
from geoerr.states import States, identify_states
from geoerr.states.temperature_model import temperature_model
from geoerr.states.temperatures import with_temperatures

STATES_DEGC = (20.0, 120.0)


def measured(hot: Hot, **columns: float) -> dict[float, Observations]:
    """Give the states with columns of temperature that lie so far from their names."""
    tables = {}
    for degc in STATES_DEGC:
        table = observe(hot, degc, 3)
        frame = table.frame.with_columns(**{name: pl.lit(degc + off) for name, off in columns.items()})
        tables[degc] = replace(table, frame=frame, sources=(f"at-{degc:g}.csv",))
    return tables


def with_column(table: Observations, values: np.ndarray) -> Observations:
    return replace(table, frame=table.frame.with_columns(temp=pl.Series(values)))


def test_empty_cells_are_filled_in_time_and_counted(hot: Hot) -> None:
    """Their rows were left out without a word, and with them the whole state."""
    tables = measured(hot, temp=0.0)
    warm = tables[120.0]
    seconds = warm.numbers("t")[:, 0]
    drifting = 118.0 + 4.0 * seconds / seconds.max()
    is_empty = (seconds > 0.2 * seconds.max()) & (seconds < 0.9 * seconds.max())
    (filled,), (note,) = (
        own if index else own[120.0]
        for index, own in enumerate(
            with_temperatures({120.0: [with_column(warm, np.where(is_empty, np.nan, drifting))]}, "temp")
        )
    )
    assert filled.numbers("temp")[:, 0] == pytest.approx(drifting)
    assert f"{int(is_empty.sum())} of {len(warm)} rows at 120 °C (at-120.csv) have no temp" in note
    all_but_one = np.full(len(warm), np.nan)
    all_but_one[0] = 120.0
    states = identify_states({**tables, 120.0: with_column(warm, all_but_one)}, hot.machine, threads=1)
    assert any(f"{len(warm) - 1} of {len(warm)} rows at 120 °C" in note for note in states.notes)
    (alpha,) = (
        one
        for term in states.model.temperature_terms
        if term.id == "EXX*T@temp"
        for one in term.coefficients
        if one.name == "alpha"
    )
    assert alpha.value == pytest.approx(hot.heat.expansion[0], abs=5.0 * alpha.std)


def test_a_term_that_nothing_determines_is_never_written_in_silence(states: States) -> None:
    """Without any temperature but one, growth has no size."""
    tables = [
        state.observations
        if state.temperature_degc == 20.0
        else with_column(state.observations, np.full(len(state.observations), np.nan))
        for state in states.states
    ]
    model = temperature_model(
        states.machine,
        "temp",
        states.functions,
        states.temperature_fit,
        tables,
        [state.sensitivity[:, :, :0] for state in states.states],
        states.weights,
        threads=1,
    )
    assert any("EXX*T@temp is not determined by all rows together" in note for note in model.notes)


def test_a_column_of_texts_is_refused_by_name(hot: Hot) -> None:
    with pytest.raises(
        GeoerrError, match=r"column carrier of the state at 20 °C \(at-20.csv\) holds texts, as 'tool'"
    ):
        identify_states(measured(hot), hot.machine, covariate="carrier", threads=1)


def test_a_name_taken_for_the_temperature_is_told_beside_columns_that_were_not_looked_at(hot: Hot) -> None:
    tables = measured(hot, temp_bed=1.0)
    states = identify_states(tables, hot.machine, covariate="temp_bead", threads=1)
    (note,) = states.notes
    assert note.startswith("the tables have no column temp_bead: the number that names the state was taken")
    assert "temp_bed of the tables was not looked at: name it with --covariate" in note
    assert "compare, diagnose and report need such a column" in note
    half = {20.0: tables[20.0], 120.0: replace(tables[120.0], frame=tables[120.0].frame.drop("temp_bed"))}
    (note,) = identify_states(half, hot.machine, covariate="temp_bed", threads=1).notes[:1]
    assert note.startswith("120 °C (at-120.csv) has no column temp_bed")


def test_the_model_knows_its_data(hot: Hot, tmp_path: Path) -> None:
    """Held against the files that it is from it said that its numbers came from others."""
    paths = []
    for degc, table in measured(hot, temp=0.5).items():
        paths.append(tmp_path / f"at-{degc:g}.csv")
        table.frame.drop("session").write_csv(paths[-1])
    read = {degc: read_observations(path) for degc, path in zip(STATES_DEGC, paths, strict=True)}
    states = identify_states(read, hot.machine, threads=1)
    assert compare(states.model.model, read_observations(*paths), threads=1).freedom == "own"
    assert compare(states.model.model, read_observations(paths[1]), threads=1).freedom == "held"
