"""Files that a session is given, and the file that keeps it: nothing that a person has is lost over them."""

from __future__ import annotations

import threading
from collections.abc import Callable
from pathlib import Path

import pytest

pytest.importorskip("dash")

from workbench_scenes import loaded, settle, write_scene

from geoerr.errors import GeoerrError, InputFileError
from geoerr.workbench import actions, wiring
from geoerr.workbench.job import Advance
from geoerr.workbench.server import begin_session


def test_the_same_command_line_again_goes_on_with_the_session(tmp_path: Path) -> None:
    saved = tmp_path / "work.json"
    session = loaded(tmp_path, saved)
    wiring.do(session, "fit", "12")
    settle(session)
    files = [tmp_path / "machine.toml", tmp_path / "observations.csv"]
    again = begin_session(files, saved, threads=1)
    settle(again)
    assert [step.name for step in again.steps] == ["machine without errors", "12 errors fitted"]
    assert again.current == 1


def test_a_session_with_work_is_not_begun_anew_over_other_files(tmp_path: Path) -> None:
    saved = tmp_path / "work.json"
    loaded(tmp_path, saved)
    kept = saved.read_bytes()
    other = tmp_path / "other.csv"
    other.write_bytes((tmp_path / "observations.csv").read_bytes())
    with pytest.raises(InputFileError, match=r"other\.csv\nhint: .*another --session"):
        begin_session([tmp_path / "machine.toml", other], saved, threads=1)
    assert saved.read_bytes() == kept


@pytest.mark.parametrize("name", ["machine.toml", "observations.csv"])
def test_a_session_never_takes_the_place_of_a_file_that_is_none(tmp_path: Path, name: str) -> None:
    files = write_scene(tmp_path)
    kept = (tmp_path / name).read_bytes()
    with pytest.raises(InputFileError, match="is an input"):
        begin_session(files, tmp_path / name, threads=1)
    for given in ([], [path for path in files if path.name != name]):
        with pytest.raises(InputFileError, match="is no session of the workbench"):
            begin_session(given, tmp_path / name, threads=1)
    assert (tmp_path / name).read_bytes() == kept


def test_a_refused_file_leaves_the_earlier_one_of_its_name_as_it_was(tmp_path: Path) -> None:
    saved = tmp_path / "work.json"
    machine, table = write_scene(tmp_path)
    session = begin_session([machine], saved, threads=1)
    settle(session)
    actions.take_dropped(session, ["points.csv"], [table.read_bytes()])
    settle(session)
    actions.take_dropped(session, ["points.csv"], [b"x,y,z,mx,my,mz\na,b,c,d,e,f\n"])
    session.job.wait(60.0)
    assert session.problems.pop(actions.DATA).startswith("points.csv")
    # What is read again is what was there before, now and when the work is gone on with.
    actions.take_dropped(session, ["more.csv"], [table.read_bytes()])
    settle(session)
    again = begin_session([], saved, threads=1)
    settle(again)
    assert [one.name for one in again.files] == ["machine.toml", "points.csv", "more.csv"]
    assert again.files[1].path.read_bytes() == table.read_bytes()


def test_a_file_that_is_dropped_while_work_is_under_way_replaces_nothing(tmp_path: Path) -> None:
    session = loaded(tmp_path)
    table = (tmp_path / "observations.csv").read_bytes()
    actions.take_dropped(session, ["observations.csv"], [table])
    settle(session)
    goes_on = threading.Event()

    def work(_: Advance) -> Callable[[], None]:
        goes_on.wait(30.0)
        return lambda: None

    session.begin("long work", actions.DATA, work)
    with pytest.raises(GeoerrError, match="still under way"):
        actions.take_dropped(session, ["observations.csv"], [b"nothing"])
    goes_on.set()
    settle(session)
    assert session.files[-1].path.read_bytes() == table
