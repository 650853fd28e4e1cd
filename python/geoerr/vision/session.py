"""Session folders: what was photographed, with what board and targets, at which axis positions.

A session is a directory (`docs/reference/formats/session.md`): `session.toml`, `calibration/left/*` and
`calibration/right/*`, `frames.csv` with its pictures. What only one verb needs may be absent; that verb asks with a
`require_...` method, which refuses by name what is missing.
"""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import polars as pl

from geoerr.errors import InputFileError
from geoerr.files import read_toml
from geoerr.machine import Machine, read_machine
from geoerr.observations import CARRIERS, COVARIANCE, DIRECTIONS, MEASURED, PIXELS, STANDARD_UNCERTAINTY
from geoerr.tables import RowProblem, Schema, check, read_raw
from geoerr.vision.patterns import (
    Board,
    charuco_layout,
    chessboard_layout,
    dictionary_named,
    dictionary_names,
    dictionary_size,
    looks_of_marker,
)

BOARD_TYPES = ("charuco", "chessboard")
TARGET_CARRIERS = tuple(name for name in CARRIERS if name != "relative")
"""What a target in a picture can be fixed to: cameras stand on the floor, so nothing they see is `relative`."""

PICTURE_SUFFIXES = (".png", ".jpg", ".jpeg", ".tif", ".tiff")
FORBIDDEN_COLUMNS = (
    *MEASURED,
    *STANDARD_UNCERTAINTY,
    *COVARIANCE,
    *("tx", "ty", "tz", "carrier", "target"),
    *PIXELS,
)
"""Columns of observations that `measure` writes itself."""

FRAME_COLUMNS = Schema(
    required=("left", "right", "x", "y", "z"),
    filled=("left", "right", "x", "y", "z"),
    numbers=("x", "y", "z", "t", "feed", "temp"),
    whole_numbers=("repeat", *DIRECTIONS, "moving"),
    signs=DIRECTIONS,
    flags=("moving",),
    texts=("left", "right", "line", "session", "group"),
)
_DESCRIPTION = "session.toml"
_FRAMES_NAME = "frames.csv"
_BOARD_HINT = 'write e.g. [board] type = "charuco", squares = [11, 8], square_mm = 20.0, marker_mm, dictionary'


@dataclass(frozen=True)
class BoardSpec:
    """The calibration board as `[board]` describes it.

    Attributes
    ----------
    type
        `charuco` or `chessboard`.
    squares
        Squares along u and v; inner corners are one less each way.
    square_mm
        Side of a square.
    marker_mm, dictionary
        Of a ChArUco board's markers; None on a chessboard.
    is_legacy_pattern
        The layout that OpenCV had before 4.6: with an even number of rows it begins with a white square.
    """

    type: str
    squares: tuple[int, int]
    square_mm: float
    marker_mm: float | None = None
    dictionary: str | None = None
    is_legacy_pattern: bool = False

    def layout(self) -> Board:
        """Lay the board out in mm.

        Raises
        ------
        DetectionError
            for a board that cannot exist: a marker larger than its square, more markers than the dictionary has.
        """
        if self.marker_mm is None or self.dictionary is None:
            return chessboard_layout(self.squares, self.square_mm)
        return charuco_layout(self.squares, self.square_mm, self.marker_mm, self.dictionary, self.is_legacy_pattern)


@dataclass(frozen=True)
class Target:
    """One marker plate.

    Attributes
    ----------
    id, dictionary
        Which marker.
    size_mm
        Side of the marker, its black border included.
    carrier
        `tool`, `work` or `base`: what it is fixed to.
    offset_mm
        From the tool point (on `work`: from the base origin) to the marker's centre; becomes `tx ty tz`.
    """

    id: int
    dictionary: str
    size_mm: float
    carrier: str
    offset_mm: tuple[float, float, float]

    @property
    def name(self) -> str:
        """Name in the `target` column, such as `DICT_4X4_50:7`."""
        return f"{self.dictionary}:{self.id}"

    @property
    def marker(self) -> tuple[str, int]:
        """Dictionary and id: which marker pictures show."""
        return self.dictionary, self.id


@dataclass(frozen=True)
class CalibrationPair:
    """The board seen by both cameras at one moment: `name` is the left picture's file name."""

    name: str
    left: Path
    right: Path


@dataclass(frozen=True)
class Unpaired:
    """A calibration picture without a partner: `name` as `left/03.png`."""

    name: str
    why: str


@dataclass(frozen=True)
class ScaleBar:
    """A measured length between the centres of two targets that one pair of pictures shows.

    Attributes
    ----------
    left, right
        The pictures, relative to the session's folder.
    targets
        The two targets.
    length_mm, std_mm
        What was measured by other means, and its standard uncertainty.
    """

    left: str
    right: str
    targets: tuple[Target, Target]
    length_mm: float
    std_mm: float


@dataclass(frozen=True, eq=False)
class Session:
    """A session folder that has been read and checked.

    Attributes
    ----------
    directory
        The folder.
    machine, board
        None where session.toml does not name one.
    targets
        Every marker plate.
    frames
        Usable rows of frames.csv in the file's order, with `file_row`; None without the file. `left` and `right`
        are as in the file, relative to `directory`.
    set_aside
        Rows of frames.csv that cannot be used, with the reason.
    calibration_pairs
        In order of their names.
    unpaired
        Calibration pictures without a partner.
    scale_bars
        Measured lengths.
    """

    directory: Path
    machine: Machine | None
    board: BoardSpec | None
    targets: tuple[Target, ...]
    frames: pl.DataFrame | None
    set_aside: tuple[RowProblem, ...]
    calibration_pairs: tuple[CalibrationPair, ...]
    unpaired: tuple[Unpaired, ...]
    scale_bars: tuple[ScaleBar, ...]

    @property
    def description_path(self) -> Path:
        """Path of session.toml."""
        return self.directory / _DESCRIPTION

    def require_machine(self) -> Machine:
        """Give the machine, or refuse the session for lacking one."""
        if self.machine is None:
            raise InputFileError(
                self.description_path, "is missing", column="machine", remedy='write machine = "machine.toml"'
            )
        return self.machine

    def require_board(self) -> BoardSpec:
        """Give the calibration board, or refuse the session for lacking one."""
        if self.board is None:
            raise InputFileError(self.description_path, "is missing", column="board", remedy=_BOARD_HINT)
        return self.board

    def require_targets(self) -> tuple[Target, ...]:
        """Give the targets, or refuse the session for having none."""
        if not self.targets:
            raise InputFileError(
                self.description_path,
                "there are none",
                column="targets",
                remedy="describe each in [[targets]] with id, dictionary, size_mm, carrier and offset_mm",
            )
        return self.targets

    def require_frames(self) -> pl.DataFrame:
        """Give the rows of frames.csv, or refuse the session for lacking the file."""
        if self.frames is None:
            raise InputFileError(
                self.directory / _FRAMES_NAME,
                "no such file",
                remedy="list the pictures of the machine with columns left, right, x, y, z",
            )
        return self.frames

    def require_pairs(self) -> tuple[CalibrationPair, ...]:
        """Give the pairs of board pictures, or refuse the session for having none."""
        if self.calibration_pairs:
            return self.calibration_pairs
        folder = self.directory / "calibration"
        for side in ("left", "right"):
            if not (folder / side).is_dir():
                raise InputFileError(
                    folder / side,
                    "no such folder",
                    remedy="put pictures of the board into calibration/left and calibration/right",
                )
        if not self.unpaired:
            raise InputFileError(
                folder, "no pictures in left and right", remedy=f"understood are {', '.join(PICTURE_SUFFIXES)}"
            )
        first = self.unpaired[0]
        raise InputFileError(
            folder,
            f"no left picture has a right one of the same name ({first.name}: {first.why})",
            remedy="give both pictures of a pair one name, such as left/01.png and right/01.png",
        )


def read_session(directory: str | Path) -> Session:
    """Read and check a session folder.

    Parameters
    ----------
    directory
        Folder with session.toml.

    Raises
    ------
    InputFileError
        for a missing folder or session.toml, a key that is missing or wrong, a target described twice, or a
        frames.csv without a usable row. A row that is wrong is set aside, a picture without partner listed.
    """
    folder = Path(directory)
    if not folder.is_dir():
        problem = "is a file, a session is a folder" if folder.exists() else "no such folder"
        raise InputFileError(folder, problem, remedy="name the folder that holds session.toml")
    path = folder / _DESCRIPTION
    top = _Table(read_toml(path), path)
    targets = _targets(top)
    frames, set_aside = _frames(folder / _FRAMES_NAME)
    pairs, unpaired = _calibration_pairs(folder / "calibration")
    return Session(
        directory=folder,
        machine=read_machine(folder / top.text("machine")) if "machine" in top.content else None,
        board=_board(top.table("board")) if "board" in top.content else None,
        targets=targets,
        frames=frames,
        set_aside=set_aside,
        calibration_pairs=pairs,
        unpaired=unpaired,
        scale_bars=tuple(_scale_bar(table, targets) for table in top.tables("scale_bars")),
    )


@dataclass(frozen=True)
class _Table:
    """One table of session.toml; each refusal names the file, the key and what would be right."""

    content: dict[str, Any]
    path: Path
    place: str = ""

    def key(self, name: str) -> str:
        return f"{self.place}.{name}" if self.place else name

    def refuse(self, name: str, problem: str, remedy: str | None = None) -> InputFileError:
        return InputFileError(self.path, problem, column=self.key(name), remedy=remedy)

    def value(self, name: str, remedy: str | None = None) -> Any:
        if name not in self.content:
            raise self.refuse(name, "is missing", remedy)
        return self.content[name]

    def table(self, name: str) -> _Table:
        content = self.value(name)
        if not isinstance(content, dict):
            raise self.refuse(name, f"{content!r} is not a table", f"write it as [{self.key(name)}]")
        return _Table(content, self.path, self.key(name))

    def tables(self, name: str) -> list[_Table]:
        content = self.content.get(name, [])
        if not isinstance(content, list) or not all(isinstance(item, dict) for item in content):
            raise self.refuse(name, "is not a list of tables", f"write each as [[{self.key(name)}]]")
        return [_Table(item, self.path, f"{self.key(name)}[{n}]") for n, item in enumerate(content, start=1)]

    def text(self, name: str, choices: tuple[str, ...] = ()) -> str:
        value = self.value(name, f"one of {', '.join(choices)}" if choices else None)
        if not isinstance(value, str) or (choices and value not in choices):
            one_of = f"not one of {', '.join(choices)}" if choices else "not a text"
            raise self.refuse(name, f"{value!r} is {one_of}")
        return value

    def whole(self, name: str) -> int:
        value = self.value(name)
        if isinstance(value, bool) or not isinstance(value, int):
            raise self.refuse(name, f"{value!r} is not a whole number")
        return value

    def positive(self, name: str) -> float:
        value = self.value(name, "a length in mm")
        if not _is_finite(value) or not value > 0:
            raise self.refuse(name, f"{value!r} is not a length above 0", "write millimetres, such as 56.0")
        return float(value)

    def dictionary(self, name: str) -> str:
        value = self.text(name)
        known = dictionary_named(value)
        if known is None:
            raise self.refuse(
                name, f"{value!r} is not a marker dictionary", f"known are {', '.join(dictionary_names())}"
            )
        return known


def _is_finite(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def _board(table: _Table) -> BoardSpec:
    kind = table.text("type", BOARD_TYPES)
    squares = table.value("squares", "count squares along both sides, such as [11, 8]")
    if not isinstance(squares, list) or len(squares) != 2 or not all(type(n) is int and n >= 2 for n in squares):
        raise table.refuse("squares", f"{squares!r} is not two whole numbers above 1", "count squares, not corners")
    square_mm = table.positive("square_mm")
    if kind == "chessboard":
        return BoardSpec(kind, (squares[0], squares[1]), square_mm)
    marker_mm, dictionary = table.positive("marker_mm"), table.dictionary("dictionary")
    if not marker_mm < square_mm:
        raise table.refuse(
            "marker_mm", f"a marker of {marker_mm:g} mm does not fit into a square of {square_mm:g} mm"
        )
    is_legacy = table.content.get("legacy_pattern", False)
    if not isinstance(is_legacy, bool):
        raise table.refuse("legacy_pattern", f"{is_legacy!r} is not true or false")
    board = BoardSpec(kind, (squares[0], squares[1]), square_mm, marker_mm, dictionary, is_legacy)
    n_markers = squares[0] * squares[1] // 2
    if n_markers > dictionary_size(dictionary):
        raise table.refuse(
            "dictionary",
            f"the board needs {n_markers} markers, {dictionary} holds {dictionary_size(dictionary)}",
            "name the dictionary that the board was printed with",
        )
    return board


def _targets(top: _Table) -> tuple[Target, ...]:
    targets: dict[bytes, str] = {}
    result = []
    for table in top.tables("targets"):
        target = _target(table)
        earlier = targets.setdefault(looks_of_marker(target.dictionary, target.id), table.place)
        if earlier != table.place:
            raise table.refuse(
                "id",
                f"{target.dictionary} marker {target.id} is {earlier} already",
                "give every target a marker of its own; two plates that look alike cannot be told apart",
            )
        result.append(target)
    return tuple(result)


def _target(table: _Table) -> Target:
    dictionary, identity = table.dictionary("dictionary"), table.whole("id")
    if not 0 <= identity < dictionary_size(dictionary):
        raise table.refuse(
            "id", f"{dictionary} has no marker {identity}", f"its ids are 0 to {dictionary_size(dictionary) - 1}"
        )
    offset = table.value("offset_mm", "from the tool point to the marker's centre, such as [0.0, 0.0, 0.0]")
    if not isinstance(offset, list) or len(offset) != 3 or not all(_is_finite(value) for value in offset):
        raise table.refuse("offset_mm", f"{offset!r} is not three numbers", "write millimetres as [0.0, 0.0, 0.0]")
    return Target(
        id=identity,
        dictionary=dictionary,
        size_mm=table.positive("size_mm"),
        carrier=table.text("carrier", TARGET_CARRIERS),
        offset_mm=(float(offset[0]), float(offset[1]), float(offset[2])),
    )


def _scale_bar(table: _Table, targets: tuple[Target, ...]) -> ScaleBar:
    ends = table.value("targets", 'the two targets as [["DICT_4X4_50", 7], ["DICT_4X4_50", 8]]')
    if not isinstance(ends, list) or len(ends) != 2:
        raise table.refuse("targets", f"{ends!r} is not two targets", "write [[dictionary, id], [dictionary, id]]")
    known = {target.marker: target for target in targets}
    found = []
    for end in ends:
        is_name = isinstance(end, list) and [type(part) for part in end] == [str, int]
        target = known.get((dictionary_named(end[0]) or "", end[1])) if is_name else None
        if target is None:
            raise table.refuse("targets", f"{end!r} is not one of this session's targets", "see its [[targets]]")
        found.append(target)
    if found[0] == found[1]:
        raise table.refuse("targets", f"both ends are {found[0].name}", "name the two targets that it lies between")
    return ScaleBar(
        left=table.text("left"),
        right=table.text("right"),
        targets=(found[0], found[1]),
        length_mm=table.positive("length_mm"),
        std_mm=table.positive("std_mm"),
    )


def _frames(path: Path) -> tuple[pl.DataFrame | None, tuple[RowProblem, ...]]:
    if not path.exists():
        return None, ()
    raw = read_raw(path)
    for name in FORBIDDEN_COLUMNS:
        if name in raw.columns:
            raise InputFileError(
                path,
                "this column is what measuring gives; a list of pictures cannot have it",
                row=1,
                column=name,
                remedy="remove the column; targets, carriers and offsets are described in session.toml",
            )
    frame, problems = check(raw, FRAME_COLUMNS, path)
    is_one_picture = frame["left"] == frame["right"]
    doubled = tuple(
        RowProblem(str(path), row, "right", "left and right are the same picture")
        for row in frame.filter(is_one_picture)["file_row"]
    )
    frame = frame.filter(~is_one_picture)
    if frame.is_empty():
        raise InputFileError(path, doubled[0].problem + "; no usable row is left", row=doubled[0].row, column="right")
    return frame, tuple(sorted((*problems, *doubled), key=lambda problem: problem.row))


def _calibration_pairs(folder: Path) -> tuple[tuple[CalibrationPair, ...], tuple[Unpaired, ...]]:
    """Match pictures by name without suffix; what has no partner is listed with the reason."""
    sides: dict[str, dict[str, Path]] = {}
    unpaired = []
    for side in ("left", "right"):
        files = sorted((folder / side).iterdir()) if (folder / side).is_dir() else []
        files = [file for file in files if file.is_file() and not file.name.startswith(".")]
        pictures = [file for file in files if file.suffix.lower() in PICTURE_SUFFIXES]
        unpaired += [
            Unpaired(f"{side}/{file.name}", f"not a picture ({', '.join(PICTURE_SUFFIXES)})")
            for file in files
            if file not in pictures
        ]
        counts = Counter(file.stem for file in pictures)
        unpaired += [
            Unpaired(f"{side}/{file.name}", f"two pictures are named {file.stem}")
            for file in pictures
            if counts[file.stem] > 1
        ]
        sides[side] = {file.stem: file for file in pictures if counts[file.stem] == 1}
    left, right = sides["left"], sides["right"]
    for side, here, there in (("left", left, right), ("right", right, left)):
        other = "right" if side == "left" else "left"
        unpaired += [
            Unpaired(f"{side}/{file.name}", f"the {other} folder has no picture of this name")
            for stem, file in here.items()
            if stem not in there
        ]
    pairs = tuple(CalibrationPair(left[stem].name, left[stem], right[stem]) for stem in left if stem in right)
    return pairs, tuple(sorted(unpaired, key=lambda item: item.name))
