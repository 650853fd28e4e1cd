"""Session folders: read, checked, refused by name."""

from __future__ import annotations

from pathlib import Path

import pytest

from geoerr.errors import InputFileError
from geoerr.vision.printing.request import read_request
from geoerr.vision.session import read_session

MACHINE = """
[machine]
chain = "wZbXYt"
[axes.x]
range = [0.0, 400.0]
[axes.y]
range = [0.0, 400.0]
[axes.z]
range = [0.0, 400.0]
"""
BOARD = """
[board]
type = "charuco"
squares = [11, 8]
square_mm = 20.0
marker_mm = 15.0
dictionary = "DICT_5X5_100"
"""
TARGETS = """
[[targets]]
id = 7
dictionary = "DICT_4X4_50"
size_mm = 56.0
carrier = "tool"
offset_mm = [0.0, 0.0, 0.0]
[[targets]]
id = 8
dictionary = "DICT_4X4_50"
size_mm = 56
carrier = "work"
offset_mm = [200, 0, 0]
"""
SCALE_BAR = """
[[scale_bars]]
left = "bar/left.png"
right = "bar/right.png"
targets = [["DICT_4X4_50", 7], ["DICT_4X4_50", 8]]
length_mm = 200.0
std_mm = 0.005
"""
WHOLE = 'machine = "machine.toml"\n' + BOARD + TARGETS + SCALE_BAR
FRAMES = "left,right,line,x,y,z,temp_bed\nl/1.png,r/1.png,X,0,0,0,21.5\nl/2.png,r/2.png,X,10,0,0,\n"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "machine.toml").write_text(MACHINE)
    (tmp_path / "session.toml").write_text(WHOLE)
    (tmp_path / "frames.csv").write_text(FRAMES)
    for side in ("left", "right"):
        (tmp_path / "calibration" / side).mkdir(parents=True)
        for name in ("01.png", "02.png"):
            (tmp_path / "calibration" / side / name).touch()
    return tmp_path


def refusal(folder: Path) -> InputFileError:
    with pytest.raises(InputFileError) as caught:
        read_session(folder)
    return caught.value


def test_a_whole_session(folder: Path) -> None:
    session = read_session(folder)
    assert session.require_machine().chain == "wZbXYt"
    assert session.require_board().squares == (11, 8)
    assert len(session.require_board().layout().corners_mm) == 70
    assert [target.name for target in session.require_targets()] == ["DICT_4X4_50:7", "DICT_4X4_50:8"]
    assert session.targets[1].offset_mm == (200.0, 0.0, 0.0)
    frames = session.require_frames()
    assert frames["file_row"].to_list() == [2, 3]
    assert frames["temp_bed"].to_list() == [21.5, None]
    assert [pair.name for pair in session.require_pairs()] == ["01.png", "02.png"]
    assert session.calibration_pairs[0].right == folder / "calibration" / "right" / "01.png"
    assert session.scale_bars[0].left == "bar/left.png"
    assert session.scale_bars[0].targets[1].id == 8
    assert session.unpaired == session.set_aside == ()


def test_only_what_calibrate_needs(folder: Path) -> None:
    (folder / "session.toml").write_text('[board]\ntype = "chessboard"\nsquares = [10, 7]\nsquare_mm = 1\n')
    (folder / "frames.csv").unlink()
    session = read_session(folder)
    assert session.machine is None
    assert session.frames is None
    assert len(session.require_board().layout().corners_mm) == 54
    for ask, column in ((session.require_machine, "machine"), (session.require_targets, "targets")):
        with pytest.raises(InputFileError) as caught:
            ask()
        assert caught.value.column == column
    with pytest.raises(InputFileError, match=r"frames\.csv: no such file"):
        session.require_frames()


def test_a_missing_board_is_refused_only_when_asked_for(folder: Path) -> None:
    (folder / "session.toml").write_text("")
    with pytest.raises(InputFileError, match=r"session\.toml: board: is missing\nhint: write e\.g\. \[board\]"):
        read_session(folder).require_board()


@pytest.mark.parametrize(
    ("was", "becomes", "column", "problem"),
    [
        ('type = "charuco"', 'type = "circles"', "board.type", "not one of charuco, chessboard"),
        ("squares = [11, 8]", "squares = [11]", "board.squares", "not two whole numbers"),
        ("squares = [11, 8]", "squares = [11, 1]", "board.squares", "not two whole numbers"),
        ("squares = [11, 8]", "", "board.squares", "is missing"),
        ("squares = [11, 8]", "squares = [21, 18]", "board.dictionary", "needs 189 markers, DICT_5X5_100 holds 100"),
        ("square_mm = 20.0", "square_mm = 0", "board.square_mm", "not a length above 0"),
        ("square_mm = 20.0", "square_mm = nan", "board.square_mm", "not a length above 0"),
        ("marker_mm = 15.0", "marker_mm = 25.0", "board.marker_mm", "does not fit"),
        ("DICT_5X5_100", "DICT_5X5_101", "board.dictionary", "not a marker dictionary"),
        ("id = 7", "id = 77", "targets[1].id", "DICT_4X4_50 has no marker 77"),
        ("id = 7", 'id = "7"', "targets[1].id", "not a whole number"),
        ("id = 8", "id = 7", "targets[2].id", "DICT_4X4_50 marker 7 is targets[1] already"),
        ("size_mm = 56.0", "size_mm = -56.0", "targets[1].size_mm", "not a length above 0"),
        ("size_mm = 56.0", "", "targets[1].size_mm", "is missing"),
        ('carrier = "tool"', 'carrier = "spindle"', "targets[1].carrier", "not one of tool, work, base"),
        ('carrier = "tool"', 'carrier = "relative"', "targets[1].carrier", "not one of tool, work, base"),
        ("[200, 0, 0]", "[200, 0]", "targets[2].offset_mm", "not three numbers"),
        ("[200, 0, 0]", "[200, 0, inf]", "targets[2].offset_mm", "not three numbers"),
        ('[["DICT_4X4_50", 7], ["DICT', '[["DICT_4X4_50", 9], ["DICT', "scale_bars[1].targets", "not one of this"),
        ('[["DICT_4X4_50", 7], ["DICT', '[[["a"], 7], ["DICT', "scale_bars[1].targets", "not one of this"),
        ('7], ["DICT_4X4_50", 8]]', '7], ["dict_4x4_50", 7]]', "scale_bars[1].targets", "both ends are DICT_4X4"),
        ("length_mm = 200.0", "length_mm = 0", "scale_bars[1].length_mm", "not a length above 0"),
        ("std_mm = 0.005", "", "scale_bars[1].std_mm", "is missing"),
        ('machine = "machine.toml"', "machine = 3", "machine", "not a text"),
        ("[board]", "[[board]]", "board", "is not a table"),
    ],
)
def test_what_is_wrong_in_session_toml_is_named(
    folder: Path, was: str, becomes: str, column: str, problem: str
) -> None:
    assert was in WHOLE
    (folder / "session.toml").write_text(WHOLE.replace(was, becomes, 1))
    error = refusal(folder)
    assert error.path == str(folder / "session.toml")
    assert error.column == column
    assert problem in error.problem


@pytest.mark.parametrize(
    ("first", "second"),
    [
        (("DICT_4X4_50", 7), ("DICT_4X4_100", 7)),
        # The same bits, turned by a quarter.
        (("DICT_APRILTAG_16H5", 16), ("DICT_4X4_1000", 227)),
    ],
)
def test_one_plate_is_one_target_whichever_dictionary_names_it(
    folder: Path, first: tuple[str, int], second: tuple[str, int]
) -> None:
    text = TARGETS
    for identity, (dictionary, other) in ((7, first), (8, second)):
        was = f'id = {identity}\ndictionary = "DICT_4X4_50"'
        text = text.replace(was, f'id = {other}\ndictionary = "{dictionary}"')
    (folder / "session.toml").write_text(text)
    error = refusal(folder)
    assert error.column == "targets[2].id"
    assert error.problem == f"{second[0]} marker {second[1]} is targets[1] already"


def test_a_dictionary_may_be_spelled_as_opencv_spells_it(folder: Path) -> None:
    """Its documentation has DICT_APRILTAG_36h11, its newer headers DICT_APRILTAG_36H11: one dictionary, one name."""
    text = WHOLE.replace("DICT_4X4_50", "DICT_APRILTAG_36h11")
    (folder / "session.toml").write_text(text)
    session = read_session(folder)
    assert [target.name for target in session.targets] == ["DICT_APRILTAG_36H11:7", "DICT_APRILTAG_36H11:8"]
    assert session.scale_bars[0].targets == session.targets
    board = WHOLE.replace("DICT_5X5_100", "DICT_APRILTAG_36h11")
    (folder / "session.toml").write_text(board)
    assert read_session(folder).require_board().dictionary == "DICT_APRILTAG_36H11"
    printed = read_request("aruco:DICT_APRILTAG_36h11:3:80").artworks[0]
    assert printed.document["dictionary"] == "DICT_APRILTAG_36H11"


def test_a_machine_file_that_is_not_there_is_named(folder: Path) -> None:
    (folder / "machine.toml").unlink()
    assert refusal(folder).path == str(folder / "machine.toml")


def test_not_a_session(tmp_path: Path) -> None:
    assert refusal(tmp_path / "nowhere").problem == "no such folder"
    (tmp_path / "file").touch()
    assert "a session is a folder" in refusal(tmp_path / "file").problem
    assert refusal(tmp_path).path == str(tmp_path / "session.toml")


@pytest.mark.parametrize("name", ["mx", "sz", "cxy", "tx", "carrier", "target", "u_left"])
def test_columns_that_measure_writes_are_refused(folder: Path, name: str) -> None:
    (folder / "frames.csv").write_text(f"left,right,x,y,z,{name}\na,b,0,0,0,1\n")
    error = refusal(folder)
    assert (error.path, error.row, error.column) == (str(folder / "frames.csv"), 1, name)


def test_a_temperature_that_is_no_number_sets_its_row_aside(folder: Path) -> None:
    (folder / "frames.csv").write_text("left,right,x,y,z,temp_bed\na,b,0,0,0,20\nc,d,1,0,0,warm\n")
    session = read_session(folder)
    assert [(one.row, one.column, one.problem) for one in session.set_aside] == [
        (3, "temp_bed", "'warm' is not a number")
    ]
    assert session.frames is not None
    assert session.frames["temp_bed"].to_list() == [20.0]


def test_directions_and_flags_are_judged_as_in_observations(folder: Path) -> None:
    """Else `measure` writes rows that every reader sets aside."""
    rows = ["a,b,0,0,0,1,0", "c,d,1,0,0,2,0", "e,f,1,0,0,-1,7"]
    (folder / "frames.csv").write_text("\n".join(["left,right,x,y,z,dir_x,moving", *rows, ""]))
    assert [(one.row, one.column) for one in read_session(folder).set_aside] == [(3, "dir_x"), (4, "moving")]


def test_bad_rows_are_set_aside(folder: Path) -> None:
    rows = ["a,b,0,0,0", "a,b,zero,0,0", "a,,0,0,0", "c,c,0,0,0", "a,b,nan,0,0", "d,e,1,0,0"]
    (folder / "frames.csv").write_text("left,right,x,y,z\n" + "\n".join(rows) + "\n")
    session = read_session(folder)
    assert session.require_frames()["file_row"].to_list() == [2, 7]
    assert [(problem.row, problem.column) for problem in session.set_aside] == [
        (3, "x"),
        (4, "right"),
        (5, "right"),
        (6, "x"),
    ]


def test_frames_without_a_usable_row_are_refused(folder: Path) -> None:
    (folder / "frames.csv").write_text("left,right,x,y,z\nc,c,0,0,0\n")
    assert "same picture; no usable row" in refusal(folder).problem
    (folder / "frames.csv").write_text("left,x,y,z\nc,0,0,0\n")
    assert refusal(folder).column == "right"
    (folder / "frames.csv").write_text("")
    assert "empty" in refusal(folder).problem


def test_semicolons_are_named(folder: Path) -> None:
    """What spreadsheets write where numbers have decimal commas."""
    (folder / "frames.csv").write_text(FRAMES.replace(".5", ",5").replace(",", ";"))
    error = refusal(folder)
    assert (error.problem, error.row) == ("its cells are separated by semicolons", 1)
    assert "commas between cells" in (error.remedy or "")


def test_pictures_without_partner_are_listed(folder: Path) -> None:
    for name in ("left/03.png", "right/04.PNG", "left/notes.txt", "left/05.png", "left/05.jpg", "right/05.png"):
        (folder / "calibration" / name).touch()
    (folder / "calibration" / "left" / ".DS_Store").touch()
    (folder / "calibration" / "right" / "02.png").rename(folder / "calibration" / "right" / "02.tif")
    session = read_session(folder)
    assert [pair.name for pair in session.calibration_pairs] == ["01.png", "02.png"]
    reasons = {item.name: item.why for item in session.unpaired}
    assert list(reasons) == [
        "left/03.png",
        "left/05.jpg",
        "left/05.png",
        "left/notes.txt",
        "right/04.PNG",
        "right/05.png",
    ]
    assert reasons["left/03.png"] == "the right folder has no picture of this name"
    assert reasons["left/05.jpg"] == "two pictures are named 05"
    assert reasons["left/notes.txt"].startswith("not a picture")


def test_no_pairs_are_refused_with_the_reason(folder: Path) -> None:
    right = folder / "calibration" / "right"
    for name in ("01", "02"):
        (right / f"{name}.png").rename(right / f"right{name}.png")
    with pytest.raises(InputFileError, match=r"no left picture has a right one of the same name \(left/01\.png"):
        read_session(folder).require_pairs()
    for picture in (folder / "calibration").rglob("*.png"):
        picture.unlink()
    with pytest.raises(InputFileError, match="no pictures in left and right"):
        read_session(folder).require_pairs()
    right.rmdir()
    with pytest.raises(InputFileError, match="no such folder"):
        read_session(folder).require_pairs()
