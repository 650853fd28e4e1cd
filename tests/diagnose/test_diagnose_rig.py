"""The calibration in a diagnosis: what its unknowns can do is no effect's."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from compare_scenes import measured
from hidden_machine import Plan, machine, motion
from typer.testing import CliRunner

import geoerr
from geoerr.cli.main import app
from geoerr.diagnose import diagnose
from geoerr.effects import catalogue
from geoerr.effects.collection import Catalogue
from geoerr.errors import GeometryError, InputFileError
from geoerr.fit import FitOptions
from geoerr.machine import write_machine
from geoerr.model import Model
from geoerr.observations import PIXELS, Observations
from geoerr.vision.rig import Rig, RightFromLeft, write_rig

KNOWN = Catalogue({name: catalogue()[name] for name in ("scale", "rig-scale", "backlash")})
PLAN = Plan(n_sessions=1, n_lines=20, n_points=12)
OPTIONS = FitOptions(threads=1)


def test_what_the_calibration_can_do_is_no_effects(monkeypatch: pytest.MonkeyPatch) -> None:
    """All lengths 1 in 10⁴ too long, and play: with a baseline that is known to 1 in 10⁴ only the play is missing."""
    monkeypatch.setattr("geoerr.diagnose.asked.catalogue", lambda: KNOWN)
    rng = np.random.default_rng(4)
    moved = motion(rng, PLAN)
    seen = 1.0001 * moved.q - 8e-3 * moved.d[:, :1] * np.eye(3)[0]
    observations = measured(moved.q, seen, rng, noise_mm=5e-3, **moved.seen_from_the_tool)
    model = geoerr.fit_model(machine(), observations, components="none", options=FitOptions(threads=1)).model
    without = diagnose(model, observations, threads=1)
    assert {one.reference.effect for one in without.found} == {"rig-scale", "backlash"}
    longer = observations.measured_mm[:, :, None]
    known = diagnose(model, observations, rig_sensitivity=longer, rig_covariance=np.array([[1e-8]]), threads=1)
    assert [str(one.reference) for one in known.found] == ["backlash:x"]


def test_cameras_that_are_blamed_without_their_calibration_are_said_to_be(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of cameras only: where there are no pixels there is no rig.json; held, the calibration needs --refit, too."""
    monkeypatch.setattr("geoerr.diagnose.asked.catalogue", lambda: KNOWN)
    rng = np.random.default_rng(4)
    moved = motion(rng, PLAN)
    pixels = dict.fromkeys(PIXELS, np.zeros(len(moved.q)))
    said = "an effect of the cameras may be no more than what their calibration does not know"

    def notes(points: Observations, **calibration: np.ndarray) -> list[str]:
        model = geoerr.fit_model(machine(), points, components="none", effects=("backlash:x",), options=OPTIONS).model
        return [note for note in diagnose(model, points, threads=1, **calibration).notes if said in note]

    points, bare = (
        measured(
            moved.q, 1.0001 * moved.q, np.random.default_rng(5), noise_mm=5e-3, **moved.seen_from_the_tool, **more
        )
        for more in (pixels, {})
    )
    (note,) = notes(points)
    assert note.endswith("which took no part: --rig rig.json lets it")
    assert not notes(bare)
    longer = points.measured_mm[:, :, None]
    assert not notes(points, rig_sensitivity=longer, rig_covariance=np.array([[1e-14]]))
    held = diagnose(Model(machine()), points, threads=1).notes
    assert any(note.endswith("--rig rig.json --refit lets it") for note in held)


@pytest.mark.parametrize("known_to", [1e-5, 1e-3])
def test_what_the_calibration_hardly_moves_takes_no_residual_away(
    monkeypatch: pytest.MonkeyPatch, known_to: float
) -> None:
    """The scale moves points along where they were measured, residual and all; the rest of that is the machine's own.

    Twenty-one functions beside it: all that is left of a column of the scale, known to 1 in 10⁵, is the residual.
    """
    monkeypatch.setattr("geoerr.diagnose.asked.catalogue", lambda: KNOWN)
    rng = np.random.default_rng(4)
    moved = motion(rng, PLAN)
    seen = moved.q - 16e-3 * moved.d[:, :1] * np.eye(3)[0]
    observations = measured(moved.q, seen, rng, noise_mm=5e-3, **moved.seen_from_the_tool)
    calibration = {
        "rig_sensitivity": observations.measured_mm[:, :, None],
        "rig_covariance": np.array([[known_to**2]]),
    }
    model = geoerr.fit_model(machine(), observations, options=FitOptions(threads=1), **calibration).model
    found = diagnose(model, observations, threads=1, **calibration)
    assert [str(one.reference) for one in found.found] == ["backlash:x"]


@pytest.mark.parametrize("verb", ["compare", "diagnose"])
def test_a_rig_that_does_not_serve_is_refused_alike(tmp_path: Path, verb: str) -> None:
    write_machine(tmp_path / "machine.toml", machine())
    place = {name: [0.0, 100.0, 200.0, 300.0] for name in ("x", "y", "z", "mx", "my", "mz")}
    pl.DataFrame(place).write_csv(tmp_path / "points.csv")
    matrix = np.array([[2300.0, 0.0, 1224.0], [0.0, 2300.0, 1024.0], [0.0, 0.0, 1.0]])
    pose = RightFromLeft(np.eye(3), np.array([-300.0, 0.0, 0.0]))
    rig = Rig(matrix, np.zeros(5), matrix, np.zeros(5), pose, (2448, 2048), None)
    arguments = [verb, *(str(tmp_path / name) for name in ("machine.toml", "points.csv"))]
    arguments += ["--rig", str(tmp_path / "rig.json")]
    write_rig(tmp_path / "rig.json", rig)
    refused = CliRunner().invoke(app, arguments).exception
    assert isinstance(refused, InputFileError)
    assert "states no covariance" in str(refused)
    write_rig(tmp_path / "rig.json", replace(rig, covariance=np.eye(len(rig.parameter_names))))
    refused = CliRunner().invoke(app, arguments).exception
    assert isinstance(refused, GeometryError)
    assert "the observations have no pixels" in str(refused)
