"""Files that a session is given, and the file that keeps it: nothing that a person has is lost over them."""

from __future__ import annotations

import json
import threading
from collections.abc import Callable
from pathlib import Path

import polars as pl
import pytest

pytest.importorskip("dash")

from workbench_scenes import N_LINES, N_POINTS, loaded, settle, texts, write_scene

from geoerr.diagnose import compare
from geoerr.errors import GeoerrError, InputFileError
from geoerr.summaries import counted
from geoerr.workbench import actions, wiring
from geoerr.workbench.job import Advance
from geoerr.workbench.server import begin_session
from geoerr.workbench.side_by_side import story


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


def test_two_tables_of_one_name_are_two_sessions_told_apart_by_their_folders(tmp_path: Path) -> None:
    machine, table = write_scene(tmp_path)
    tables = [tmp_path / name / "observations.csv" for name in ("cold", "hot")]
    for one in tables:
        one.parent.mkdir()
        # A table that names no session is one of its own.
        pl.read_csv(table).drop("session").write_csv(one)
    # Named twice it is still one file.
    session = begin_session([machine, *tables, tables[1]], None, threads=1)
    settle(session)
    assert [one.name for one in session.files] == ["machine.toml", "cold/observations.csv", "hot/observations.csv"]
    assert f"{2 * N_LINES * N_POINTS} rows in {2 * N_LINES} passes" in texts(wiring.panels(session)["given"])
    wiring.do(session, "put-away", "cold/observations.csv")
    settle(session)
    assert [one.path for one in session.files] == [machine, tables[1]]


def test_a_dropped_file_that_replaces_one_of_its_name_says_so(tmp_path: Path) -> None:
    session = loaded(tmp_path)
    said = "observations.csv took the place of the earlier file of its name"
    assert said not in texts(wiring.panels(session)["given"])
    actions.take_dropped(session, ["observations.csv"], [(tmp_path / "observations.csv").read_bytes()])
    settle(session)
    assert said in texts(wiring.panels(session)["given"])
    assert [one.kind for one in session.files] == ["model", "measurements"]


def test_rows_that_a_fit_leaves_out_are_told_with_that_model_only(tmp_path: Path) -> None:
    machine, table = write_scene(tmp_path)
    rows = pl.read_csv(table)
    # Fifteen times the noise, and little beside play that no term has yet.
    slip_mm = pl.when(pl.int_range(pl.len()) == 100).then(0.03).otherwise(0.0)
    rows.with_columns(my=pl.col("my") + slip_mm).write_csv(table)
    session = begin_session([machine, table], None, threads=1)
    settle(session)
    for action, what in (("fit", "21"), ("add", "backlash:x")):
        wiring.do(session, action, what)
        settle(session)
    outliers = (~session.seen.comparison.points.solved.used).sum()
    assert outliers > 0
    assert f"left out: {counted(int(outliers), 'row')} (gross outliers)" in texts(wiring.panels(session)["given"])
    wiring.do(session, "undo", "")
    settle(session)
    assert session.seen.comparison.points.solved.used.all()
    assert "gross" not in texts(wiring.panels(session)["given"])


def test_more_data_are_compared_with_every_model_that_the_page_tells_of(tmp_path: Path) -> None:
    session = loaded(tmp_path)
    # Two fits of one machine: the first is on no way to the second.
    for action, what in (("fit", "12"), ("show", "0"), ("fit", "21"), ("refer", "2")):
        wiring.do(session, action, what)
        settle(session)
    rows = pl.read_csv(tmp_path / "observations.csv")
    rows.with_columns(mx=pl.col("mx") + 0.01, session=pl.lit("later")).write_csv(tmp_path / "later.csv")
    actions.take_dropped(session, ["later.csv"], [(tmp_path / "later.csv").read_bytes()])
    settle(session)
    assert (session.current, session.reference) == (2, 2)
    for number in (0, 2):
        model, figures = session.steps[number].model, session.steps[number].figures
        expected = compare(model, *session.measured.tables, threads=1)
        assert figures["held_out_rmse_um"] == pytest.approx(expected.fitted.held_out.figures.headline_um)
    told = texts(wiring.panels(session)["given"])
    assert "2. 12 errors fitted –" in told
    assert "A model with a dash has no figure on these rows" in told
    # The picture numbers the models as the list does.
    assert [stage.name for stage in story(session.steps, 2, session.beside)] == [
        "1. machine without errors",
        "3. 21 errors fitted",
    ]
    wiring.do(session, "show", "1")
    settle(session)
    assert "with a dash" not in texts(wiring.panels(session)["given"])


@pytest.mark.parametrize("name", ["table.xlsx", "notes.txt", "part.gcode", "photo.png", "README"])
def test_what_the_page_cannot_take_is_refused_with_what_it_takes(tmp_path: Path, name: str) -> None:
    session = loaded(tmp_path)
    with pytest.raises(InputFileError, match=r"measurements are \.csv or \.parquet") as refused:
        actions.take_dropped(session, [name], [b"PK \x00\xff"])
    assert "TOML" not in str(refused.value)
    assert [one.name for one in session.files] == ["machine.toml", "observations.csv"]


def other_machine(folder: Path) -> bytes:
    return (folder / "machine.toml").read_bytes().replace(b'"mill"', b'"lathe"')


def test_the_machine_that_is_there_already_changes_nothing(tmp_path: Path) -> None:
    saved = tmp_path / "work.json"
    session = loaded(tmp_path, saved)
    wiring.do(session, "fit", "12")
    settle(session)
    session = begin_session([], saved, threads=1)
    settle(session)
    before, seen, files = session.steps, session.seen, session.files
    # Another file, of an equal machine.
    machine = b"# as it was\n" + (tmp_path / "machine.toml").read_bytes()
    actions.take_dropped(session, ["again.toml"], [machine])
    assert session.job is None
    assert (session.steps, session.current, session.earlier) == (before, 1, ())
    assert session.seen is seen
    assert session.files == files
    assert "again.toml is what these models began with" in texts(wiring.panels(session)["given"])
    # Beside it others are taken.
    rows = pl.read_csv(tmp_path / "observations.csv").with_columns(session=pl.lit("later"))
    actions.take_dropped(session, ["machine.toml", "later.csv"], [machine, rows.write_csv().encode()])
    settle(session)
    assert [step.name for step in session.steps] == ["machine without errors", "12 errors fitted"]
    assert [one.name for one in session.files] == ["machine.toml", "observations.csv", "later.csv"]


def test_another_machine_begins_anew_and_the_work_before_it_comes_back(tmp_path: Path) -> None:
    saved = tmp_path / "work.json"
    session = loaded(tmp_path, saved)
    wiring.do(session, "fit", "12")
    settle(session)
    held = session.step.figures["held_out_rmse_um"]
    assert "Earlier work" not in texts(wiring.panels(session)["given"])
    actions.take_dropped(session, ["lathe.toml"], [other_machine(tmp_path)])
    settle(session)
    assert [step.name for step in session.steps] == ["machine without errors"]
    told = texts(wiring.panels(session)["given"])
    assert "Earlier work Another machine or model begins anew. What was here before it is kept." in told
    assert "mill · 2. 12 errors fitted  2 models of machine.toml, observations.csv Go back" in told
    # The saved session keeps it too, and the command line that began it goes on with it.
    again = begin_session([tmp_path / "machine.toml"], saved, threads=1)
    settle(again)
    for one in (session, again):
        wiring.do(one, "go-back", "0")
        settle(one)
        assert [step.name for step in one.steps] == ["machine without errors", "12 errors fitted"]
        assert [file.name for file in one.files] == ["machine.toml", "observations.csv"]
        assert one.model.machine.name == "mill"
        assert one.step.figures["held_out_rmse_um"] == pytest.approx(held)
        # What was there when it came back is kept in its place.
        (kept,) = one.earlier
        assert kept.title == "lathe · 1. machine without errors"
    wiring.do(session, "go-back", "0")
    settle(session)
    assert session.model.machine.name == "lathe"
    wiring.do(session, "go-back", "7")
    assert "not kept" in session.problems[actions.DATA]


def test_a_session_that_was_saved_before_earlier_work_was_kept_goes_on(tmp_path: Path) -> None:
    saved = tmp_path / "work.json"
    loaded(tmp_path, saved)
    document = json.loads(saved.read_text())
    del document["earlier"]
    saved.write_text(json.dumps(document))
    again = begin_session([], saved, threads=1)
    settle(again)
    assert again.earlier == ()
    assert len(again.steps) == 1
