"""Tables of observations: what is right is read, what is wrong is named, the rest goes on."""

from __future__ import annotations

import io
import sys
from collections.abc import Iterator
from datetime import timedelta
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from geoerr.errors import InputFileError, ShapeError
from geoerr.machine import Machine
from geoerr.measurements import read_measurements
from geoerr.observations import (
    kind_of,
    observations_from_columns,
    read_circular_test,
    read_lengths,
    read_observations,
    write_observations,
)

GOOD = "line,carrier,x,y,z,tx,ty,tz,mx,my,mz,sx,sy,sz\nL1,tool,0,1,2,0,0,200,10,20,30,0.1,0.2,0.3\n"


def write(folder: Path, text: str | bytes, name: str = "observations.csv") -> Path:
    path = folder / name
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    return path


def test_columns_and_defaults(tmp_path: Path) -> None:
    observations = read_observations(write(tmp_path, "x,y,z,mx,my,mz\n1,2,3,4,5,\n"))
    assert observations.texts("carrier") == ["tool"]
    assert observations.texts("session") == ["0"]
    assert observations.frame["repeat"].to_list() == [0]
    np.testing.assert_array_equal(observations.target_offset_mm, [[0, 0, 0]])
    np.testing.assert_array_equal(observations.commanded_mm, [[1, 2, 3]])
    np.testing.assert_array_equal(observations.measured_mm, [[4, 5, np.nan]])
    assert observations.covariance_mm2 is None


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
def test_lines_end_as_they_like(tmp_path: Path, end: str) -> None:
    path = tmp_path / "points.csv"
    path.write_bytes(end.join(["x,y,z,mx", "1,2,3,1.001", "2,2,3,2.002", ""]).encode())
    assert read_observations(path).numbers("x", "mx").tolist() == [[1.0, 1.001], [2.0, 2.002]]


def test_standard_uncertainties_and_covariances(tmp_path: Path) -> None:
    observations = read_observations(write(tmp_path, GOOD))
    assert observations.covariance_mm2 is not None
    np.testing.assert_allclose(observations.covariance_mm2[0], np.diag([0.01, 0.04, 0.09]), rtol=1e-15)
    text = GOOD.splitlines()
    full = f"{text[0]},cxx,cxy,cxz,cyy,cyz,czz\n{text[1]},1,2,3,4,5,6\n"
    observations = read_observations(write(tmp_path, full))
    assert observations.covariance_mm2 is not None
    np.testing.assert_array_equal(observations.covariance_mm2[0], [[1, 2, 3], [2, 4, 5], [3, 5, 6]])


def test_two_files_are_two_sessions_unless_they_name_them(tmp_path: Path) -> None:
    first = write(tmp_path, GOOD, "a.csv")
    second = write(tmp_path, GOOD, "b.csv")
    assert read_observations(first, second).texts("session") == ["0", "1"]
    named = write(tmp_path, "session,x,y,z,mx\n0,1,2,3,4\n2,1,2,3,4\n,1,2,3,4\n", "c.csv")
    # A name that one file states is not given to another that states none, in whatever order they come.
    assert read_observations(first, named).texts("session") == ["3", "0", "2", "1"]
    assert read_observations(named, first).texts("session") == ["0", "2", "3", "1"]
    assert read_observations(named, named).texts("session") == ["0", "2", "3", "0", "2", "1"]


def test_columns_that_say_nothing_are_left_out(tmp_path: Path) -> None:
    spreadsheet = read_observations(write(tmp_path, "x,y,z,mx,,\n1,2,3,4,,\n2,2,3,4,note,\n"))
    assert len(spreadsheet) == 2
    assert "" not in spreadsheet.frame.columns
    frame = spreadsheet.frame.select("x", "y", "z", "mx").with_columns(
        pl.Series("list", [[1], [2]]),
        pl.Series("bytes", [b"\xff", b"\xfe"]),
        pl.Series("wait", [timedelta(1), timedelta(2)]),
        pl.Series("moving", [True, False]),
    )
    frame.write_parquet(tmp_path / "odd.parquet")
    odd = read_observations(tmp_path / "odd.parquet")
    assert not {"list", "bytes", "wait"} & set(odd.frame.columns)
    assert odd.frame["moving"].to_list() == [1, 0]
    frame.with_columns(pl.Series("mx", [[1.0], [2.0]])).write_parquet(tmp_path / "lists.parquet")
    with pytest.raises(InputFileError, match=r"lists\.parquet: mx: List\(Float64\) is neither numbers nor text"):
        read_observations(tmp_path / "lists.parquet")


def test_time_orders_the_rows_of_a_session(tmp_path: Path) -> None:
    observations = read_observations(write(tmp_path, "x,y,z,mx,t\n3,0,0,1,30\n1,0,0,1,10\n2,0,0,1,20\n"))
    np.testing.assert_array_equal(observations.commanded_mm[:, 0], [1, 2, 3])
    gap = read_observations(write(tmp_path, "x,y,z,mx,t\n3,0,0,1,30\n1,0,0,1,\n2,0,0,1,20\n"))
    np.testing.assert_array_equal(gap.commanded_mm[:, 0], [3, 1, 2])


def test_direction_of_approach_comes_from_the_order_of_rows(tmp_path: Path) -> None:
    observations = read_observations(write(tmp_path, "x,y,z,mx\n0,0,0,0\n5,0,0,0\n5,1,0,0\n3,1,0,0\n"))
    np.testing.assert_array_equal(observations.directions, [[0, 0, 0], [1, 0, 0], [1, 1, 0], [-1, 1, 0]])
    given_ones = read_observations(write(tmp_path, "x,y,z,mx,dir_x\n0,0,0,0,-1\n5,0,0,0,-1\n"))
    np.testing.assert_array_equal(given_ones.directions[:, 0], [-1, -1])


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_written_and_read_without_loss(tmp_path: Path, suffix: str) -> None:
    rng = np.random.default_rng(1)
    columns = {
        name: rng.normal(size=50) * 10.0 ** rng.integers(-9, 9, 50) for name in ("x", "y", "z", "mx", "my", "mz")
    }
    columns["temp_bed"] = rng.normal(size=50)
    original = observations_from_columns(columns)
    path = tmp_path / f"observations{suffix}"
    write_observations(path, original)
    again = read_observations(path)
    for name in columns:
        np.testing.assert_array_equal(again.numbers(name), original.numbers(name))
    assert again.texts("carrier") == original.texts("carrier")


def test_standard_input(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(GOOD.encode())))
    assert len(read_observations("-")) == 1


@pytest.mark.parametrize(
    ("cell", "value", "reason"),
    [
        ("x", "abc", "'abc' is not a number"),
        ("mx", "nan", "'nan' is not a finite number"),
        ("mz", "inf", "'inf' is not a finite number"),
        ("carrier", "spindle", "'spindle' is not one of tool, work, base, relative"),
        ("y", "", "the cell is empty"),
        ("repeat", "1.5", "'1.5' is not a whole number"),
        ("dir_x", "2", "'2' is no direction: −1, 0 or 1"),
        ("temp_bed", "9o", "'9o' is not a number"),
        ("temp_bed", "-inf", "'-inf' is not a finite number"),
    ],
)
def test_a_bad_row_is_named_and_the_rest_goes_on(tmp_path: Path, cell: str, value: str, reason: str) -> None:
    row = {
        "line": "L",
        "carrier": "tool",
        "repeat": "0",
        "x": "1",
        "y": "2",
        "z": "3",
        "mx": "4",
        "my": "5",
        "mz": "6",
        "dir_x": "1",
        "temp_bed": "20",
    }
    rows = [row, {**row, cell: value}, row]
    text = ",".join(row) + "\n" + "\n".join(",".join(entry.values()) for entry in rows) + "\n"
    path = write(tmp_path, text)
    observations = read_observations(path)
    assert len(observations) == 2
    assert [str(problem) for problem in observations.set_aside] == [f"{path}:3: {cell}: {reason}"]


def test_a_comment_is_named_as_one(tmp_path: Path) -> None:
    """Not as a decimal comma, and not once for every cell that it has no number in."""
    rows = ["a,0,0,0,1,2,3,20", "#7,1,0,0,1,2,3,21", "b,2,0,0,1,2,3,22"]
    table = "\n".join(["line,x,y,z,mx,my,mz,load", *rows]) + "\n"
    with pytest.raises(InputFileError, match=r":1: begins with #, as a comment: .*\nhint: remove the line"):
        read_observations(write(tmp_path, "# measured by Bob, 3 May\n" + table))
    comments = ["# measured by Bob", "# turned round, 3 May", "# a, b, c, d, e, f, g, h, i"]
    path = write(tmp_path, "\n".join([table.rstrip(), *comments, rows[0], ""]))
    observations = read_observations(path)
    assert observations.texts("line") == ["a", "#7", "b", "a"]
    # What a comment spills over does not make a column of numbers one of texts.
    assert observations.numbers("load")[:, 0].tolist() == [20.0, 21.0, 22.0, 20.0]
    assert [(one.row, one.column) for one in observations.set_aside] == [(5, "line"), (6, "line"), (7, "line")]
    assert "as a comment" in str(observations.set_aside[0])
    # A column may be named so.
    named = write(tmp_path, "#,x,y,z,mx,my,mz\n1,0,0,0,1,2,3\n", "named.csv")
    assert len(read_observations(named)) == 1


def test_a_row_that_cannot_be_of_the_machine_is_set_aside(tmp_path: Path) -> None:
    """A mistyped place stretches every function of its axis; 450 of 400 mm is kept: ranges are stated carelessly."""
    ranges = Machine.from_chain("wbXYZt", (400.0, 400.0, 300.0)).ranges_mm
    header, rows = "x,y,z,mx,my,mz", ["10,0,0,1,2,3", "4500,0,0,1,2,3", "450,0,0,1,2,3", "10,0,-301,1,2,3"]
    path = write(tmp_path, "\n".join([header, *rows]) + "\n")
    assert len(read_observations(path)) == 4
    observations = read_observations(path, ranges_mm=ranges)
    assert observations.commanded_mm[:, 0].tolist() == [10.0, 450.0]
    first, second = map(str, observations.set_aside)
    assert first.startswith(f"{path}:3: x: 4500 mm is farther outside the range of x, 0 to 400 mm, than that is long")
    assert "correct the row" in first
    assert second.startswith(f"{path}:5: z: -301 mm")
    circle = write(tmp_path, "x,y,z,r\n0,0,0,50\n4500,0,0,50\n", "circle.csv")
    assert [one.row for one in read_circular_test(circle, ranges).set_aside] == [3]
    with pytest.raises(InputFileError, match=r":2: x: 4500 mm .*no usable row is left\n.*the machine's zero"):
        read_observations(write(tmp_path, f"{header}\n{rows[1]}\n", "other.csv"), ranges_mm=ranges)


def test_a_target_that_hangs_on_no_machine_is_set_aside(tmp_path: Path) -> None:
    """One mistyped lever outweighs every other row; a target on the base has none that is read."""
    ranges = Machine.from_chain("wbXYZt", (400.0, 400.0, 300.0)).ranges_mm
    header, rows = "carrier,x,y,z,tx,ty,tz,mx,my,mz", ["tool,10,0,0,0,1e7,0,1,2,3", "base,10,0,0,1e7,0,0,1,2,3"]
    path = write(tmp_path, "\n".join([header, *rows, "work,10,0,0,300,0,0,1,2,3"]) + "\n")
    observations = read_observations(path, ranges_mm=ranges)
    assert observations.texts("carrier") == ["base", "work"]
    (problem,) = map(str, observations.set_aside)
    assert problem.startswith(f"{path}:2: ty: a target 1e+07 mm from the tool is on no machine of this size: correct")
    with pytest.raises(InputFileError, match=r":2: ty: .*no usable row is left\n.*in mm\)$"):
        read_observations(write(tmp_path, f"{header}\n{rows[0]}\n", "other.csv"), ranges_mm=ranges)


@pytest.mark.parametrize(
    ("cells", "column", "words"),
    [
        ("1,2,3,4,2,", "moving", "'2' is neither 0 (no) nor 1 (yes)"),
        ("1,2,3,1e300,1,", "mx", "'1e300' is larger than anything that is measured"),
        ("1,2,3,4,1,-1e300", "sx", "'-1e300' is larger than anything that is measured"),
    ],
)
def test_a_cell_that_no_measurement_gives_sets_its_row_aside(
    tmp_path: Path, cells: str, column: str, words: str
) -> None:
    path = write(tmp_path, f"x,y,z,mx,moving,sx\n1,2,3,4,1,0.1\n{cells}\n1,2,3,4,0,0.1\n")
    observations = read_observations(path)
    assert observations.frame["moving"].to_list() == [1, 0]
    assert [(one.row, one.column, one.problem) for one in observations.set_aside] == [(3, column, words)]


@pytest.mark.parametrize(
    ("text", "row", "column", "words"),
    [
        ("", None, None, "empty"),
        ("x,y,z,mx,my,mz\n", None, None, "no rows"),
        ("x,y,mx\n1,2,3\n", 1, "z", "missing"),
        ("x,y,z\n1,2,3\n", 1, "mx my mz", "missing"),
        ("x,x,y,z,mx\n1,1,2,3,4\n", 1, "x", "two columns"),
        ("x,y,z,mx\n1,2,3,4,5\n", 2, None, "5 cells under 4"),
        ("x,y,z,mx\nabc,2,3,4\n", 2, "x", "no usable row"),
        ("x,y,z,r\n1,2,3,4\n", None, None, "circular test"),
        (b"x,y,z,mx\n1,2,3,\xff\n", 2, None, "not UTF-8"),
        (b"PK\0\0", None, None, "NUL"),
        ("x;y;z;mx\n1;2;3;4\n", 1, None, "separated by semicolons"),
        ("x\ty\tz\tmx\n1\t2\t3\t4\n", 1, None, "separated by tabs"),
    ],
)
def test_a_file_without_a_usable_row_is_refused(
    tmp_path: Path, text: str | bytes, row: int | None, column: str | None, words: str
) -> None:
    path = write(tmp_path, text)
    with pytest.raises(InputFileError) as caught:
        read_observations(path)
    assert (caught.value.path, caught.value.row, caught.value.column) == (str(path), row, column)
    assert words in str(caught.value)


@pytest.mark.parametrize(
    ("column", "cell", "remedy"),
    [
        ("t", "2026-11-30T09:00:00", "times are seconds since the session began"),
        ("t", "30.11.2026 09:00", "times are seconds since the session began"),
        ("t", "09:00:20", "times are seconds since the session began"),
        ("x", "10:30", None),
        ("mx", '"240,36"', "numbers are written with a point, and not with a decimal comma"),
        ("mx", "240.36 mm", "numbers are written without units"),
        ("temp_bed", "20.00°C", "numbers are written without units"),
        ("temp_bed", "9o", None),
        ("mx", "abc", None),
    ],
)
def test_how_a_cell_is_written_that_is_no_number_is_said(
    tmp_path: Path, column: str, cell: str, remedy: str | None
) -> None:
    """Where all rows are wrong as the hint, and beside each row that is set aside."""
    names = ["x", "y", "z", "mx", "t", "temp_bed"]
    good = ["1"] * len(names)
    bad = [cell if name == column else "1" for name in names]
    with pytest.raises(InputFileError) as caught:
        read_observations(write(tmp_path, "\n".join(",".join(row) for row in (names, bad, bad))))
    assert caught.value.remedy is not None
    assert (remedy or "all of them are wrong") in caught.value.remedy
    assert caught.value.problem.endswith("is not a number; no usable row is left")
    (found,) = read_observations(write(tmp_path, "\n".join(",".join(row) for row in (names, good, bad)))).set_aside
    assert str(found).endswith(f"is not a number: {remedy}" if remedy else "is not a number")


@pytest.mark.parametrize("cell", ["n/a", "N/A", "NA", "#N/A", "null", "None", "-", " n/a ", "NaN"])
def test_a_temperature_that_is_said_to_be_unknown_is_an_empty_cell(tmp_path: Path, cell: str) -> None:
    """Set aside, its row was a place that the machine never went to: the next one seemed to come from elsewhere."""
    rows = ["x,y,z,mx,temp_bed,load", "0,0,0,0,20,1", f"9,0,0,9,{cell},{cell}", "4,0,0,4,21,2"]
    observations = read_observations(write(tmp_path, "\n".join(rows)))
    empty = read_observations(write(tmp_path, "\n".join(rows).replace(cell, "")))
    assert not observations.set_aside
    assert observations.frame.equals(empty.frame)
    assert observations.directions[:, 0].tolist() == [0, 1, -1]


def test_texts_of_ones_own_stay_texts_whatever_some_of_them_say(tmp_path: Path) -> None:
    table = read_observations(write(tmp_path, "x,y,z,mx,who,why\n1,2,3,4,-,-\n2,2,3,4,Ann,-\n"))
    assert table.frame["who"].to_list() == ["-", "Ann"]
    assert table.frame["why"].to_list() == ["-", "-"]


def test_text_of_a_spreadsheet_is_told_by_its_encoding(tmp_path: Path) -> None:
    for encoding in ("utf-16", "utf-16-be"):
        mark = b"" if encoding == "utf-16" else b"\xfe\xff"
        path = write(tmp_path, mark + GOOD.encode(encoding))
        with pytest.raises(
            InputFileError, match=r'UTF-16.*\nhint: save it as UTF-8, in a spreadsheet as "CSV UTF-8"'
        ):
            read_observations(path)


@pytest.mark.parametrize(
    ("header", "missing", "remedy"),
    [
        ("feature,x1,y1,z1,x2,y2,z2,mesured", "measured", "did you mean measured, where the file has mesured?"),
        ("Feature,X1,Y1,Z1,X2,Y2,Z2,Measured", "feature", "write the names of columns in lower case"),
        ("feature,x1,y1,z1,x2,y2,z2", "measured", "a table of this kind needs feature, x1"),
        ("x,y,z,R", "r", "write the names of columns in lower case"),
        ("x,y,z,MX,MY,MZ", "mx my mz", "write the names of columns in lower case"),
        ("x,y,z,m_x", "mx my mz", "did you mean mx, where the file has m_x?"),
        ("x,y,z", "mx my mz", "leave cells empty"),
    ],
)
def test_a_column_that_is_called_nearly_so_is_named(tmp_path: Path, header: str, missing: str, remedy: str) -> None:
    """Lengths with a slip in `measured` were taken for points that lack mx, my and mz."""
    path = write(tmp_path, f"{header}\n{','.join('1' for _ in header.split(','))}\n")
    with pytest.raises(InputFileError) as caught:
        read_measurements([path])
    assert caught.value.column == missing
    assert remedy in str(caught.value.remedy)


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    for name in ("absent.csv", "absent.parquet"):
        with pytest.raises(InputFileError, match=f"{name}: no such file"):
            read_observations(tmp_path / name)
    with pytest.raises(InputFileError, match="is a folder"):
        read_observations(tmp_path)


def test_a_session_folder_is_told_what_is_made_of_it(tmp_path: Path) -> None:
    with pytest.raises(InputFileError) as caught:
        read_observations(tmp_path)
    assert caught.value.remedy == "name a file in it"
    (tmp_path / "session.toml").write_text("")
    with pytest.raises(InputFileError) as caught:
        read_observations(tmp_path)
    assert "the observations that `geoerr measure` makes of it" in str(caught.value)


@pytest.mark.parametrize("name", ["rig.json", "machine.TOML"])
def test_a_rig_or_a_machine_is_no_table(tmp_path: Path, name: str) -> None:
    path = write(tmp_path, '{"K_left": []}', name)
    with pytest.raises(InputFileError, match=f"{name}: is no table of measurements") as refused:
        read_observations(path)
    assert refused.value.remedy is not None
    assert "--rig" in refused.value.remedy


def quoted_rows(*lines: str) -> str:
    return "\n".join(('"line",x,y,z,mx,my,mz', *lines, ""))


@pytest.mark.parametrize(
    ("text", "row", "reason"),
    [
        (quoted_rows("a,0,0,0,0,0,0", '"b,1,0,0,1,0,0', "c,2,0,0,2,0,0"), 3, "not closed"),
        (quoted_rows("a,0,0,0,0,0,0", '"b,1,0,0,1,0,0', '"c",2,0,0,2,0,0'), 3, "not closed"),
        (quoted_rows('"5" bar",0,0,0,0,0,0'), 2, "not closed"),
        (quoted_rows('"a",0,0,0,0,0,0', '"b",1,5,0,0,1,0,0'), 3, "8 cells under 7 column names"),
    ],
)
def test_a_quotation_mark_too_few_is_told_with_its_row(tmp_path: Path, text: str, row: int, reason: str) -> None:
    with pytest.raises(InputFileError, match=reason) as error:
        read_observations(write(tmp_path, text))
    assert error.value.row == row
    assert len(str(error.value).splitlines()) == 2
    assert "mark" in str(error.value.remedy)


def test_quotation_marks_belong_to_a_name_inside_it_and_around_a_cell_do_not(tmp_path: Path) -> None:
    text = quoted_rows('5" bar,0,0,0,0,0,0', '"6"" bar, new",1,0,0,1,0,0', '"7, new",2,0,0,2,0,0', "8,3,0,0,3,0")
    for content in (text, text.replace("\n", "\r\n"), "\ufeff" + text):
        observations = read_observations(write(tmp_path, content))
        assert observations.texts("line") == ['5" bar', '6" bar, new', "7, new", "8"]
        np.testing.assert_array_equal(observations.measured_mm[:, 0], [0.0, 1.0, 2.0, 3.0])
        assert np.isnan(observations.measured_mm[3, 2])


def test_a_comma_in_the_quoted_name_of_a_column_separates_nothing(tmp_path: Path) -> None:
    observations = read_observations(write(tmp_path, 'x,y,z,mx,my,mz,"load, N"\n0,0,0,0,0,0,3\n'))
    assert observations.frame["load, N"].to_list() == [3.0]


def test_no_words_for_programmers_reach_the_user(tmp_path: Path) -> None:
    with pytest.raises(InputFileError, match="not a readable table") as error:
        read_observations(write(tmp_path, b"PAR1 is all", "observations.parquet"))
    assert len(str(error.value).splitlines()) == 2


def test_columns_of_different_lengths_are_refused_by_name() -> None:
    columns = {name: np.zeros(3) for name in ("x", "y", "z", "mx", "my")} | {"mz": np.zeros(2)}
    with pytest.raises(InputFileError, match=r"differ in length: x 3, .*mz 2\nhint: "):
        observations_from_columns(columns)


PLACES = {name: np.arange(3.0) for name in ("x", "y", "z", "mx", "my", "mz")}


@pytest.mark.parametrize("as_frame", [False, True])
def test_not_a_number_in_memory_is_an_empty_cell(as_frame: bool) -> None:
    """Rows without a component were set aside, which only `set_aside` told, and a whole frame was refused."""
    columns = {
        **dict.fromkeys(("x", "y", "z"), np.arange(3.0)),
        "mx": np.array([0.1, np.nan, 2.1]),
        "my": np.full(3, np.nan),
        "temp_bed": np.array([20.0, np.nan, 21.0]),
    }
    observations = observations_from_columns(pl.DataFrame(columns) if as_frame else columns)
    assert not observations.set_aside
    np.testing.assert_array_equal(observations.measured_mm[:, 0], [0.1, np.nan, 2.1])
    np.testing.assert_array_equal(observations.numbers("temp_bed")[:, 0], [20.0, np.nan, 21.0])
    with pytest.raises(InputFileError, match="the cell is empty"):
        observations_from_columns({"x": np.full(3, np.nan), "y": 0.0, "z": 0.0, "mx": 0.0})


def test_columns_without_a_measured_position_are_refused_as_in_a_file() -> None:
    with pytest.raises(InputFileError, match="mx my mz"):
        observations_from_columns({"x": np.arange(3.0), "y": np.zeros(3), "z": np.zeros(3)})


def test_columns_in_memory_are_frames_lists_or_single_values() -> None:
    frame = observations_from_columns(pl.DataFrame(PLACES))
    assert frame.frame.equals(observations_from_columns(PLACES).frame)
    given = {
        **PLACES,
        "temp": 20.5,
        "feed": np.array(600.0),
        "carrier": "work",
        "load": [1, 2.5, None],
        "t": (0, 1, 2.5),
    }
    observations = observations_from_columns(given)
    assert observations.texts("carrier") == ["work"] * 3
    np.testing.assert_array_equal(observations.numbers("temp", "feed"), [[20.5, 600.0]] * 3)
    np.testing.assert_array_equal(observations.numbers("load")[:, 0], [1.0, 2.5, np.nan])


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ([1.0, "warm", 2.0], "holds numbers and texts"),
        (np.array([1.0, "warm", 2.0], dtype=object), "holds numbers and texts"),
        (np.array(["2026-01-01T10:00"] * 3, dtype="datetime64[s]"), "holds dates or times of day"),
        (np.array(["2026-01-01T10:00"] * 3, dtype="datetime64[ms]"), "holds dates or times of day"),
        (np.zeros((3, 2)), "ndarray is no column of numbers or texts"),
        ([[1], [1, 2], [3]], "list is no column of numbers or texts"),
        ({1, 2, 3}, "set is no column of numbers or texts"),
        (np.zeros(3, dtype=complex), "ndarray is no column of numbers or texts"),
    ],
)
@pytest.mark.parametrize("name", ["t", "temp_bed", "my"])
def test_a_column_that_is_none_is_refused_by_its_name(name: str, values: object, said: str) -> None:
    with pytest.raises(InputFileError, match=f"^memory: {name}: {said}.*\nhint: ") as error:
        observations_from_columns({**PLACES, name: values})
    assert error.value.column == name


@pytest.mark.parametrize("columns", [[1.0], "points.csv", None, {}, {"x": 1.0, "y": 2.0, "z": 3.0}])
def test_what_has_no_columns_is_refused_with_what_to_give(columns: object) -> None:
    with pytest.raises(InputFileError, match=r"no (set of columns|column tells how many rows).*\nhint: give"):
        observations_from_columns(columns)  # type: ignore[arg-type]  # the point of the test


def test_rows_are_selected_by_one_answer_for_each() -> None:
    observations = observations_from_columns({name: np.arange(3.0) for name in ("x", "y", "z", "mx", "my", "mz")})
    assert observations.select([True, False, True]).commanded_mm[:, 0].tolist() == [0.0, 2.0]
    for mask in ([True], True, [True] * 4):
        with pytest.raises(ShapeError, match=r"mask must be \(3,\)"):
            observations.select(mask)


def test_the_other_kinds(tmp_path: Path) -> None:
    circle = read_circular_test(write(tmp_path, "line,x,y,z,r,dir\nA,1,2,3,100.01,-1\nA,1,2,3,,1\n"))
    assert circle.frame["r"].to_list() == [100.01]
    assert circle.set_aside[0].column == "r"


def test_columns_of_a_frame_of_another_library() -> None:
    """Of what has `items` and columns with `to_numpy`, as pandas; columns of texts are arrays of objects there."""

    class Column:
        def __init__(self, values: list[object]) -> None:
            self.values = values

        def to_numpy(self) -> np.ndarray:
            return np.array(self.values, dtype=object if isinstance(self.values[0], str) else None)

    class Frame:
        def items(self) -> Iterator[tuple[str, Column]]:
            yield from ((name, Column([*values])) for name, values in {**PLACES, "line": ["a", "b", "b"]}.items())

    observations = observations_from_columns(Frame())  # type: ignore[arg-type]  # frames of others have no such type
    assert observations.texts("line") == ["a", "b", "b"]
    assert np.array_equal(observations.measured_mm, observations_from_columns(PLACES).measured_mm)


@pytest.mark.parametrize(("column", "bad"), [("sr", "0,001mm"), ("sr", "nan"), ("dir_x", "up")])
def test_a_circle_whose_uncertainty_or_direction_is_no_number_loses_that_row(
    tmp_path: Path, column: str, bad: str
) -> None:
    text = f'x,y,z,r,{column}\n1,2,3,100.01,1\n1,3,3,100.02,"{bad}"\n'
    circle = read_circular_test(write(tmp_path, text))
    assert circle.frame[column].to_list() == [1.0]
    assert [(problem.row, problem.column) for problem in circle.set_aside] == [(3, column)]
    lengths = read_lengths(write(tmp_path, "feature,x1,y1,z1,x2,y2,z2,measured\nd,0,0,0,3,4,0,5.01\n"))
    assert lengths.frame["measured"].to_list() == [5.01]
    assert kind_of(["x", "y", "z", "mx"]) == "points"


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=200)
@given(content=st.binary(max_size=200) | st.text(alphabet="xyzm,\n\"'.-+e0123 \t", max_size=200).map(str.encode))
def test_no_bytes_get_past_the_reader_unnamed(tmp_path: Path, content: bytes) -> None:
    path = write(tmp_path, b"x,y,z,mx\n" + content)
    try:
        observations = read_observations(path)
    except InputFileError:
        return
    assert np.isfinite(observations.commanded_mm).all()


@pytest.mark.real_data
def test_real_tables(real_data: Path) -> None:
    for name, rows in (("thermal", 1203), ("plates", 650), ("positioning", 50)):
        observations = read_observations(real_data / name / "observations.csv")
        assert len(observations) == rows
        assert not observations.set_aside
