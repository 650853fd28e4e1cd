"""A plan as a file that can be carried out."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import polars as pl
import pytest
from advice_machine import lines_at_one_feed, machine, measure

from geoerr.diagnose.advice import adviser_of, plan_table, write_plan
from geoerr.effects import catalogue
from geoerr.errors import InputFileError, ShapeError
from geoerr.fit import FitOptions, fit_model, fit_terms


def test_a_plan_is_written_as_the_frames_of_a_session(tmp_path: Path) -> None:
    log = lines_at_one_feed(np.random.default_rng(1), n_lines=2, n_points=6)
    log.columns["temp_bed"] = np.linspace(20.0, 50.0, len(log))
    fitted = fit_terms(
        machine(),
        [measure(log, lambda log: -8.0 * log.d * np.eye(3)[0], 1)],
        options=FitOptions(components="none", threads=1, is_robust=False),
    )
    adviser = adviser_of(fitted, [catalogue()[name].term("x", None, machine()) for name in ("backlash", "lag")])
    plan, other = adviser.plans[:2]
    path = tmp_path / "plan.csv"
    write_plan(path, [(plan, 2), (other, 1)])
    table = pl.read_csv(path)
    assert table.columns[:7] == ["session", "line", "repeat", "x", "y", "z", "dir_x"]
    assert {"feed", "moving", "t", "plan"} <= set(table.columns)
    assert not {"mx", "tx", "carrier", "target"} & set(table.columns)
    assert table.height == 2 * len(plan.pictures) + len(other.pictures)
    assert table["session"].n_unique() == 2 * plan.n_sessions + other.n_sessions
    np.testing.assert_allclose(table["x"].to_numpy()[: len(plan.pictures)], plan.pictures.q_mm[:, 0], atol=1e-4)
    assert plan_table([(plan, 1)])["plan"].unique().to_list() == [f"{plan.name} 1"]


def test_what_a_fit_gives_is_taken_as_its_fit_is() -> None:
    log = lines_at_one_feed(np.random.default_rng(1), n_lines=2, n_points=6)
    table = measure(log, lambda log: -8.0 * log.d * np.eye(3)[0], 1)
    result = fit_model(machine(), table, components="none", effects=("scale:x",))
    terms = [catalogue()[name].term("x", None, machine()) for name in ("backlash", "lag")]
    of_result, of_fit = adviser_of(result, terms), adviser_of(result.fitted, terms)
    assert [plan.name for plan in of_result.plans] == [plan.name for plan in of_fit.plans]
    np.testing.assert_array_equal(of_result.gains, of_fit.gains)
    with pytest.raises(ShapeError, match=r"^fitted: a value of type Model was given\nhint: give what fit_model"):
        adviser_of(result.model, terms)  # type: ignore[arg-type]  # a model is no fit


def test_nothing_is_not_written(tmp_path: Path) -> None:
    with pytest.raises(InputFileError, match="no measurement to write"):
        write_plan(tmp_path / "plan.csv", [])
    assert not (tmp_path / "plan.csv").exists()
