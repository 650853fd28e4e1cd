"""What the data do not determine has no standard uncertainty: a tiny one would say that it is known perfectly."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import geoerr
from geoerr.cli.main import app
from geoerr.fit import FitOptions, FitResult, fit_model
from geoerr.machine import Machine
from geoerr.observations import Observations, observations_from_columns

MACHINE = Machine.from_chain("wbXYZt", (400.0, 300.0, 250.0))
# Turns of an axis about where the only target sits: no lever shows them.
UNSEEN = {"EAZ", "EBZ", "ECZ", "ECY"}


def one_target(n: int = 400) -> Observations:
    """Make points of a machine without errors, seen at one target in the tool's point."""
    rng = np.random.default_rng(3)
    q = rng.uniform(0.0, [400.0, 300.0, 250.0], (n, 3))
    seen = q + rng.normal(0.0, 1e-3, q.shape)
    columns: dict[str, object] = {"carrier": ["tool"] * n, "target": ["T0"] * n}
    columns |= {f"t{name}": np.zeros(n) for name in "xyz"}
    columns |= {name: q[:, number] for number, name in enumerate("xyz")}
    columns |= {f"m{name}": seen[:, number] for number, name in enumerate("xyz")}
    columns |= {f"s{name}": np.full(n, 1e-3) for name in "xyz"}
    return observations_from_columns(columns)


@pytest.fixture(scope="module")
def result() -> FitResult:
    return fit_model(MACHINE, one_target(), options=FitOptions(threads=1))


def test_what_is_not_determined_has_no_uncertainty(result: FitResult, tmp_path: Path) -> None:
    assert {item.name for item in result.fitted.not_determined} == UNSEEN
    unknown = {
        name.partition(".")[0] for name, one in result.to_document()["parameters"].items() if one["std"] != one["std"]
    }
    assert unknown == UNSEEN
    path = tmp_path / "model.json"
    geoerr.write_model(path, result.model)
    terms = {term["id"]: term for term in json.loads(path.read_text())["terms"]}
    assert {name for name, term in terms.items() if None in [one["std"] for one in term["coefficients"]]} == UNSEEN
    again = geoerr.load_model(path)
    assert np.isnan([one.std for term in again.terms if term.id in UNSEEN for one in term.coefficients]).all()
    assert np.isfinite([one.std for term in again.terms if term.id not in UNSEEN for one in term.coefficients]).all()


def test_parameters_are_counted_that_the_data_determine(result: FitResult, tmp_path: Path) -> None:
    """As many as the covariance has directions: without what is held by a gauge, and without what is open."""
    covariance, known = (
        result.fitted.covariance,
        ~np.repeat(
            [term.id in UNSEEN for term in result.fitted.terms],
            [len(term.coefficients) for term in result.fitted.terms],
        ),
    )
    std = np.sqrt(np.diag(covariance))
    known &= std > 0.0
    scaled = covariance[np.ix_(known, known)] / np.outer(std[known], std[known])
    assert result.fitted.n_determined == np.linalg.matrix_rank(scaled, tol=1e-9)
    assert result.fitted.n_determined < known.sum() < result.fitted.n_parameters
    table, machine = tmp_path / "obs.csv", tmp_path / "machine.toml"
    geoerr.write_observations(table, one_target())
    machine.write_text(
        '[machine]\nname = "m"\nchain = "wbXYZt"\n[axes.x]\nrange = [0.0, 400.0]\n'
        "[axes.y]\nrange = [0.0, 300.0]\n[axes.z]\nrange = [0.0, 250.0]\n"
    )
    said = CliRunner().invoke(app, ["fit", str(table), "--machine", str(machine), "--quiet"])
    assert said.exit_code == 0, said.output
    assert f"{result.fitted.n_determined} parameters" in " ".join(said.stdout.split())
