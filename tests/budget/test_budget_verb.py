"""`geoerr budget`: the budget of a model file in text, JSON and on a page."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest
from fitted_models import fitted as drawn_model
from typer.testing import CliRunner

from geoerr.budget import uncertainty_budget
from geoerr.budget.sources import Stage
from geoerr.budget.text import budget_text
from geoerr.cli.main import app
from geoerr.errors import GeoerrError, NotDeterminedError
from geoerr.machine import write_machine
from geoerr.model import write_model

HOT = ["--at", "temp_bed=50"]


@pytest.fixture
def model(tmp_path: Path) -> Path:
    write_model(tmp_path / "model.json", drawn_model())
    return tmp_path / "model.json"


def test_it_says_what_the_library_says(model: Path) -> None:
    places = ["--place", "400,400,400", "--place", "100,0,50"]
    done = CliRunner().invoke(app, ["budget", str(model), *HOT, "--at-std", "temp_bed=2", *places, "--json"])
    assert done.exit_code == 0, done.output
    document = json.loads(done.stdout)
    expected = uncertainty_budget(
        drawn_model(),
        [[400.0, 400.0, 400.0], [100.0, 0.0, 50.0]],
        offset_mm=(0.0, 0.0, 0.0),
        at={"temp_bed": 50.0, "d_y": 1.0},
        at_std={"temp_bed": 2.0},
    ).to_document()
    assert [place["name"] for place in document["places"]] == ["(400,400,400)", "(100,0,50)"]
    for found, wanted in zip(document["places"], expected["places"], strict=True):
        assert found["part"]["std_um"] == pytest.approx(wanted["part"]["std_um"], rel=1e-9)
        assert found["prediction"]["expanded_length_um"] == wanted["prediction"]["expanded_length_um"]
    assert {source["name"] for source in document["sources"]} >= {"data", "condition temp_bed", "chord"}
    assert set(document["provenance"]["inputs"]) == {str(model)}


def test_in_words_and_on_a_page(model: Path, tmp_path: Path) -> None:
    page = tmp_path / "budget.html"
    done = CliRunner().invoke(
        app, ["budget", str(model), "--at", "temp_bed=70", "--at", "spool=1", "--report", str(page)]
    )
    assert done.exit_code == 0, done.output
    assert "[[Combined]]" in done.stdout
    assert "worst" in done.stdout
    # What was assumed and what lies beyond the data is said.
    assert "taken as d_y = 1" in done.stderr
    assert "note: the model does not depend on spool: --at spool changes nothing" in done.stderr
    assert "temp_bed = 70 is extrapolated: 8.75 °C above" in done.stdout
    text = page.read_text(encoding="utf-8")
    for word in ("How uncertain", "Uncertainty over the volume", "thermal-expansion:x@temp_bed", "Not counted"):
        assert word in text
    assert "<script" in text


def test_refusals(model: Path, tmp_path: Path) -> None:
    runner = CliRunner()
    assert runner.invoke(app, ["budget", str(model), *HOT, "--at-std", "temp_bed=reference"]).exit_code == 2
    assert runner.invoke(app, ["budget", str(model), *HOT, "--place", "1,2"]).exit_code == 2
    with pytest.raises(GeoerrError, match="temp_bed"):
        raise runner.invoke(app, ["budget", str(model)]).exception or AssertionError
    write_machine(tmp_path / "machine.toml", drawn_model().machine)
    with pytest.raises(NotDeterminedError, match="geoerr fit"):
        raise runner.invoke(app, ["budget", str(tmp_path / "machine.toml")]).exception or AssertionError


def test_what_is_not_determined_is_null(tmp_path: Path) -> None:
    write_model(tmp_path / "model.json", drawn_model(n_null=1))
    arguments = ["budget", str(tmp_path / "model.json"), *HOT, "--place", "300,200,100"]
    document = json.loads(CliRunner().invoke(app, [*arguments, "--json"]).stdout)
    assert document["places"][0]["part"]["std_um"] == [None] * 3
    page = tmp_path / "page.html"
    assert CliRunner().invoke(app, [*arguments, "--report", str(page)]).exit_code == 0
    assert "not determined" in page.read_text(encoding="utf-8")


def test_a_slope_per_millimetre_and_kelvin_is_no_zero() -> None:
    """Less than a billionth of its unit is no rounding there."""
    budget = uncertainty_budget(drawn_model(), [[100.0, 0.0, 50.0]], at={"temp_bed": 50.0, "d_y": 1.0})
    slope = Stage("parameters", "EBX*T@temp: slope c1", 8.7e-10, "rad/(mm*K)")
    text = budget_text(replace(budget, stages=(*budget.stages, slope)))
    assert any(line.split()[-2:] == ["8.7e-10", "rad/(mm*K)"] for line in text.splitlines())
