"""`geoerr measure`: what it prints, what it writes, how it ends."""

import json
import shutil
from pathlib import Path

import pytest
import tomli_w
from stereo_scenes import make_session
from typer.testing import CliRunner

from geoerr.cli.main import app
from geoerr.errors import InputFileError
from geoerr.observations import read_observations


@pytest.fixture(scope="module")
def photographs(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("verb") / "session"
    make_session(folder, n_frames=2)
    return folder


@pytest.fixture
def session(photographs, tmp_path) -> Path:
    shutil.copytree(photographs, tmp_path / "session")
    return tmp_path / "session"


def run(*arguments):
    return CliRunner().invoke(app, ["measure", *map(str, arguments)])


def test_json_is_one_document_of_the_agreed_form(session, tmp_path):
    (session / "right" / "1.png").unlink()
    result = run(session, "-o", tmp_path / "o.csv", "--json")
    assert result.exit_code == 0
    document = json.loads(result.stdout)
    assert document["frames"] == 2
    assert document["observations"] == 2
    (missed,) = document["missed"]
    assert set(missed) == {"frame", "camera", "target", "why"}
    assert (missed["frame"], missed["camera"], missed["target"]) == ("left/1.png", "right", None)
    assert {"version", "command", "inputs"} <= set(document["provenance"])
    assert len(read_observations(tmp_path / "o.csv")) == 2


def test_words_without_json(session, tmp_path):
    result = run(session, "-o", tmp_path / "o.csv")
    assert result.exit_code == 0
    assert "4 observations from 2 frames" in result.stdout
    assert "DICT_4X4_50:7: 2 observations, side 5" in result.stdout
    assert result.stderr == ""


def test_table_on_standard_output(session):
    result = run(session, "-o", "-")
    assert result.exit_code == 0
    lines = result.stdout.splitlines()
    assert lines[0].startswith("line,carrier,target,x,y,z,tx,ty,tz,mx,my,mz,cxx")
    assert len(lines) == 5
    refused = run(session, "-o", "-", "--json")
    assert refused.exit_code == 2


def test_parquet(session, tmp_path):
    assert run(session, "-o", tmp_path / "o.parquet").exit_code == 0
    assert len(read_observations(tmp_path / "o.parquet")) == 4


def test_the_named_rig_wins(session, tmp_path):
    other = json.loads((session / "rig.json").read_text())
    other["image_size"] = [1000, 800]
    (tmp_path / "rig.json").write_text(json.dumps(other))
    result = run(session, "--rig", tmp_path / "rig.json", "-o", tmp_path / "o.csv")
    assert isinstance(result.exception, InputFileError)
    assert "the rig's pictures are 1000 × 800 px" in str(result.exception)
    assert not (tmp_path / "o.csv").exists()


def test_without_a_rig_it_calibrates_and_says_what_is_missing(session, tmp_path):
    (session / "rig.json").unlink()
    result = run(session, "-o", tmp_path / "o.csv")
    assert isinstance(result.exception, InputFileError)
    assert result.exception.column == "board"
    content = {"board": {"type": "chessboard", "squares": [10, 7], "square_mm": 20.0}}
    (session / "session.toml").write_text((session / "session.toml").read_text() + tomli_w.dumps(content))
    result = run(session, "-o", tmp_path / "o.csv")
    assert isinstance(result.exception, InputFileError)
    assert result.exception.path.endswith("calibration/left")
    assert "calibrating from the session's board pictures" in result.stderr


@pytest.mark.parametrize("name", ["frames.csv", "session.toml", "rig.json", "left/0.png"])
def test_an_input_is_never_the_output(session, name):
    before = (session / name).read_bytes()
    result = run(session, "-o", session / name)
    assert isinstance(result.exception, InputFileError)
    assert "is an input" in str(result.exception)
    assert (session / name).read_bytes() == before


def test_what_is_missing_is_told_before_boards_are_searched_for(session, tmp_path):
    (session / "rig.json").unlink()
    (session / "frames.csv").unlink()
    result = run(session, "-o", tmp_path / "o.csv")
    assert isinstance(result.exception, InputFileError)
    assert result.exception.path.endswith("frames.csv")
    assert "calibrating" not in result.stderr


def test_a_table_is_not_written_under_the_name_of_something_else(session, tmp_path):
    result = run(session, "-o", tmp_path / "o.xyz")
    assert result.exit_code == 2
    assert "name it .csv, or .parquet" in " ".join(result.stderr.replace("│", " ").split())
    assert not (tmp_path / "o.xyz").exists()


def test_no_such_session(tmp_path):
    result = run(tmp_path / "nowhere", "-o", tmp_path / "o.csv")
    assert isinstance(result.exception, InputFileError)
    assert "no such folder" in str(result.exception)
