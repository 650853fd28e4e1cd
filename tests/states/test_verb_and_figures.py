"""`geoerr states` and its figures: they say what the states say."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner
from validation.hot_and_cold import Hot

from geoerr.cli.main import app
from geoerr.machine import write_machine
from geoerr.model import load_model
from geoerr.observations import Observations, write_observations
from geoerr.report.provenance import Provenance
from geoerr.report.states_page import write_states_page
from geoerr.states import States
from geoerr.summaries import p_text


def test_every_state_has_its_curve(states: States) -> None:
    figure = states.plot_errors()
    lines = [trace for trace in figure.data if trace.mode == "lines" and trace.fill is None]
    assert len(lines) == 18 * len(states.states)
    assert {trace.name for trace in lines} == {"20 °C", "60 °C", "120 °C"}
    hottest = next(trace for trace in lines if trace.name == "120 °C")
    assert np.array(hottest.y) == pytest.approx(1e3 * states[120.0].errors.functions["EXX"].value)


def test_the_difference_is_drawn_with_its_bands(states: States) -> None:
    difference = states.difference(20.0, 120.0)
    figure = difference.plot_errors()
    beyond = sum(one.p_value < 0.05 for name, one in difference.by_name.items() if one.position_mm.size)
    drawn = [trace for trace in figure.data if trace.legendgroup == "beyond chance" and trace.fill is None]
    assert len(drawn) == beyond
    assert "120 °C minus 20 °C" in figure.layout.title.text


def test_the_map_marks_what_is_within_chance(states: States) -> None:
    volume = states.difference(20.0, 60.0).volume(4)
    figure = volume.plot_map()
    crosses = [trace for trace in figure.data if trace.type == "scatter" and trace.marker.symbol == "x-thin"]
    heights = np.unique(volume.position_mm[:, 2])[[0, 2, 3]]
    shown = np.isin(volume.position_mm[:, 2], heights) & ~volume.is_beyond
    assert sum(len(trace.x) for trace in crosses) == 2 * int(shown.sum())
    maps = [trace for trace in figure.data if trace.type == "heatmap"]
    assert len(maps) == 6
    along_z = 1e3 * volume.difference_mm.reshape(4, 4, 4, 3)[:, :, 0, 2]
    assert np.array(maps[1].z) == pytest.approx(along_z.T)


def test_growth_taken_off_is_the_metals(hot: Hot, states: States) -> None:
    volume = states.difference(20.0, 120.0).volume(4, without_growth=True)
    assert volume.growth is not None
    # Noise of 10 µm over 300 mm: 2e-6 is ten standard errors.
    assert volume.growth / 100.0 == pytest.approx(hot.heat.expansion, abs=0.3e-6)
    assert volume.rms_um < 0.2 * states.difference(20.0, 120.0).volume(4).rms_um


def test_the_verb_from_files_to_a_corrected_program(
    states: States, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What it hands on and writes; the numbers themselves are the guide's, from its files."""
    given: dict[float, list[Observations]] = {}

    def known(tables: dict[float, list[Observations]], *_: object, **__: object) -> States:
        given.update(tables)
        return states

    monkeypatch.setattr("geoerr.states.identify_states", known)
    write_machine(tmp_path / "machine.toml", states.machine)
    for state in states.states:
        table = state.observations
        write_observations(tmp_path / f"{state.temperature_degc:g}.csv", table)
    named = [f"{at:g}={tmp_path / f'{at:g}.csv'}" for at in states.temperatures_degc]
    common = ["--machine", str(tmp_path / "machine.toml"), "--threads", "1"]
    written = ["-o", str(tmp_path / "model.json"), "--report", str(tmp_path / "report.html")]
    run = CliRunner().invoke(app, ["states", *named, *common, *written, "--json"])
    assert run.exit_code == 0, run.output
    assert "What three scale factors would leave" in (tmp_path / "report.html").read_text(encoding="utf-8")
    for state in states.states:
        (table,) = given[state.temperature_degc]
        assert np.allclose(table.measured_mm, state.observations.measured_mm)
    document = json.loads(run.stdout)
    expected = json.loads(json.dumps(states.to_document()["difference"]["functions"]["EXX"]["value_um"]))
    assert document["difference"]["functions"]["EXX"]["value_um"] == expected
    assert load_model(tmp_path / "model.json").conditions == ("temp",)
    low = [states.machine.axes[axis].range_mm[0] for axis in "xyz"]
    lines = ["G90", *(f"G1 X{low[0] + k:.3f} Y{low[1] + k:.3f} Z{low[2] + k:.3f}" for k in (20, 100, 180))]
    (tmp_path / "in.gcode").write_text("\n".join(lines) + "\n")
    program = ["compensate", str(tmp_path / "model.json"), str(tmp_path / "in.gcode")]
    hot = CliRunner().invoke(app, [*program, "-o", str(tmp_path / "hot.gcode"), "--at", "temp=90"])
    cold = CliRunner().invoke(app, [*program, "-o", str(tmp_path / "cold.gcode"), "--at", "temp=20"])
    assert (hot.exit_code, cold.exit_code) == (0, 0), hot.output + cold.output
    assert (tmp_path / "hot.gcode").read_text() != (tmp_path / "cold.gcode").read_text()


@pytest.mark.parametrize("before", [[], ["--"]])
def test_a_temperature_below_zero_is_typed_as_it_is(
    states: States, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, before: list[str]
) -> None:
    """`o` and `q` in the files' names are no options either."""
    given: list[float] = []

    def known(tables: dict[float, list[Observations]], *_: object, **__: object) -> States:
        given.extend(tables)
        return states

    monkeypatch.setattr("geoerr.states.identify_states", known)
    monkeypatch.chdir(tmp_path)
    write_machine("machine.toml", states.machine)
    for name in ("cold.csv", "q.csv", "lab.csv"):
        write_observations(name, states.states[0].observations)
    named = ["-20=cold.csv", "-.5=q.csv", "20=lab.csv"]
    run = CliRunner().invoke(app, ["states", "--machine", "machine.toml", "--json", *before, *named])
    assert run.exit_code == 0, run.output
    assert sorted(given) == [-20.0, -0.5, 20.0]


def test_the_page_has_what_the_text_says_of_chance(states: States, tmp_path: Path) -> None:
    """How probable each left-out state is, and what uncertainties were multiplied by."""
    scaled = replace(states)
    scaled.__dict__["temperature_fit"] = replace(states.temperature_fit, scale=2.5)
    scaled.__dict__["model"], scaled.__dict__["left_out"] = states.model, states.left_out
    write_states_page(tmp_path / "states.html", scaled, Provenance("0", "geoerr states"))
    page = (tmp_path / "states.html").read_text(encoding="utf-8")
    assert "uncertainties are multiplied by 2.50" in page
    for one in states.left_out:
        assert f">{p_text(one.difference.p_value)}<" in page


def test_two_results_of_one_name_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The page was written over the model."""
    monkeypatch.chdir(tmp_path)
    for name in ("machine.toml", "cold.csv", "hot.csv"):
        Path(name).touch()
    arguments = ["states", "20=cold.csv", "60=hot.csv", "--machine", "machine.toml"]
    run = CliRunner().invoke(app, [*arguments, "-o", "out", "--report", str(tmp_path / "out")])
    assert run.exit_code == 1
    assert "is named for two results" in str(run.exception)
    assert not Path("out").exists()


def test_an_option_that_there_is_not_is_named() -> None:
    run = CliRunner().invoke(
        app, ["states", "-20=cold.csv", "20=lab.csv", "--machine", "machine.toml", "--treads", "1"]
    )
    assert run.exit_code == 2
    assert "No such option: --treads" in run.output


@pytest.mark.parametrize("wrong", ["cold.csv", "=cold.csv", "20=", "warm=cold.csv", "nan=cold.csv"])
def test_what_is_no_state_is_wrong_usage(wrong: str) -> None:
    run = CliRunner().invoke(app, ["states", wrong, "--machine", "machine.toml"])
    assert run.exit_code == 2
