"""A farm measures a session's pictures where they are, and goes on with what it measured."""

from __future__ import annotations

import shutil
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

from stereo_scenes import make_session
from typer.testing import CliRunner

import geoerr
from geoerr.cli.main import app
from geoerr.farm import Recipe
from geoerr.farm.job import Job, work


def test_a_session_is_measured_as_the_verb_does(tmp_path: Path) -> None:
    session = tmp_path / "farm" / "printer"
    make_session(session, n_frames=2)
    shutil.copytree(session, tmp_path / "farm" / "blind")
    (tmp_path / "farm" / "blind" / "frames.csv").unlink()
    assert CliRunner().invoke(app, ["measure", str(session), "-o", str(tmp_path / "o.csv")]).exit_code == 0
    with ThreadPoolExecutor(1) as one:
        done = geoerr.run_farm(tmp_path / "farm", tmp_path / "out", Recipe(steps=("measure",)), executor=one)
    blind, seen = done.outcomes
    assert (seen.files, seen.says) == (("printer/observations.csv",), "4 observations from 2 frames, 0 missed")
    assert (tmp_path / "out/printer/observations.csv").read_bytes() == (tmp_path / "o.csv").read_bytes()
    assert str(blind.error).startswith(f"{tmp_path}/farm/blind")


def test_a_worker_that_does_not_see_the_pictures_says_so(tmp_path: Path) -> None:
    job = Job("printer", "farm/printer", ("measure", "fit"), Recipe(), {}, session=str(tmp_path / "elsewhere"))
    (result,) = work(job)
    assert str(result.error).startswith("farm/printer: the worker cannot see this folder\nhint: ")
    (version,) = work(replace(job, version="0.0.0"))
    assert "the call came from 0.0.0" in str(version.error)
