"""What can be printed: marker plates and calibration boards, checked part by part.

The tables of session.toml and the specs of the command line come through the same checks; every refusal names the
part by its key in session.toml.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from geoerr.errors import InputFileError
from geoerr.vision.patterns import (
    Pattern,
    charuco_layout,
    chessboard_layout,
    dictionary_named,
    dictionary_names,
    dictionary_size,
    marker_bits,
    marker_pattern,
)

BOARD_TYPES = ("charuco", "chessboard")
# OpenCV's chessboard detectors refuse fewer than 3 inner corners either way; a ChArUco board of 3 × 3 squares has 4.
_LEAST_SQUARES = {"charuco": 3, "chessboard": 4}
# More squares than any picture resolves; it also bounds the work that a mistyped number can cause.
_MOST_SQUARES = 200
# Six dots of a printer with 600 dots an inch: what is finer comes out frayed.
_FINEST_MM = 0.25
# 200 inches: what programs that read PDF are bound to understand (ISO 32000-1, annex C).
_LARGEST_MM = 5080.0


@dataclass(frozen=True)
class Artwork:
    """One plate or board, ready to be laid out on a page.

    Attributes
    ----------
    pattern
        Its black and white cells.
    quiet_zone_mm
        White margin that belongs to it: one cell of a marker, half a square of a chessboard.
    description
        What it is: type, dictionary, id, sizes.
    size_keys
        Keys of session.toml that hold its sizes.
    document
        Its table in session.toml: `[board]`, or one of `[[targets]]`.
    notes
        What the user should know about it.
    """

    pattern: Pattern
    quiet_zone_mm: float
    description: str
    size_keys: tuple[str, ...]
    document: dict[str, Any]
    notes: tuple[str, ...] = ()

    @property
    def is_board(self) -> bool:
        """Whether it is a calibration board rather than a target."""
        return "type" in self.document


@dataclass(frozen=True)
class Parts:
    """The parts of one plate or board, and how to name them in a refusal.

    Attributes
    ----------
    content
        Keys and values, as in session.toml.
    source
        The file, or the spec itself.
    place
        Name of the table, such as `targets[2]`; empty for a spec.
    """

    content: dict[str, Any]
    source: str | Path
    place: str = ""

    def refuse(self, key: str, problem: str, remedy: str) -> InputFileError:
        """Make the refusal of one part."""
        column = f"{self.place}.{key}" if self.place else key
        return InputFileError(self.source, problem, column=column, remedy=remedy)

    def value(self, key: str, example: str) -> Any:
        """Give a part that must be there."""
        if key not in self.content:
            raise self.refuse(key, "is missing", f"give it, such as {key} = {example}")
        return self.content[key]

    def size_mm(self, key: str, example: str) -> float:
        """Give a length in mm: a number above 0 that a page may hold."""
        value = self.value(key, example)
        if isinstance(value, bool) or not isinstance(value, int | float) or not 0.0 < value <= _LARGEST_MM:
            raise self.refuse(key, f"{value!r} is not a size", f"give mm, above 0 and up to {_LARGEST_MM:g}")
        return float(value)

    def dictionary(self) -> str:
        """Give the name of a dictionary that OpenCV knows."""
        value = self.value("dictionary", '"DICT_4X4_50"')
        known = dictionary_named(value) if isinstance(value, str) else None
        if known is None:
            raise self.refuse(
                "dictionary",
                f"{value!r} is not a marker dictionary",
                f"known are {', '.join(dictionary_names())}",
            )
        return known


def plate_artwork(parts: Parts) -> Artwork:
    """Make a marker plate from `id`, `dictionary` and `size_mm`.

    Raises
    ------
    InputFileError
        names the part: unknown dictionary, an id that it does not hold, a size that is not above 0 or whose cells
        are finer than a printer prints.
    """
    dictionary = parts.dictionary()
    value = parts.value("id", "7")
    last = dictionary_size(dictionary) - 1
    if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value <= last:
        raise parts.refuse("id", f"{dictionary} has no marker {value!r}", f"its ids are 0 to {last}")
    size_mm = parts.size_mm("size_mm", "56.0")
    cell_mm = size_mm / marker_bits(dictionary, value).shape[0]
    _check_printable(parts, "size_mm", cell_mm)
    return Artwork(
        pattern=marker_pattern(dictionary, value, size_mm),
        quiet_zone_mm=cell_mm,
        description=f"Marker plate · {dictionary} · id {value} · {in_mm(size_mm)} over the black border",
        size_keys=("size_mm",),
        document={"id": value, "dictionary": dictionary, "size_mm": size_mm},
    )


def board_artwork(parts: Parts) -> Artwork:
    """Make a calibration board from `type`, `squares`, `square_mm` and, for ChArUco, `marker_mm` and `dictionary`.

    Raises
    ------
    InputFileError
        names the part: unknown type or dictionary, too few or too many squares, a size that is not above 0, a marker
        larger than its square, a dictionary that holds too few markers, cells finer than a printer prints.
    """
    kind = parts.value("type", '"charuco"')
    if kind not in BOARD_TYPES:
        raise parts.refuse("type", f"{kind!r} is not a board", f"known are {', '.join(BOARD_TYPES)}")
    squares = _squares(parts, kind)
    square_mm = parts.size_mm("square_mm", "20.0")
    document: dict[str, Any] = {"type": kind, "squares": list(squares), "square_mm": square_mm}
    size = f"{squares[0]} × {squares[1]} squares of {in_mm(square_mm)}"
    if kind == "chessboard":
        _check_printable(parts, "square_mm", square_mm)
        return Artwork(
            pattern=chessboard_layout(squares, square_mm).pattern,
            # Half a square: with less, findChessboardCornersSB misses a board cut out and laid on something dark.
            quiet_zone_mm=0.5 * square_mm,
            description=f"Chessboard · {size} · {squares[0] - 1} × {squares[1] - 1} inner corners",
            size_keys=("square_mm",),
            document=document,
            notes=_half_turn_notes(squares),
        )
    marker_mm = parts.size_mm("marker_mm", "15.0")
    if marker_mm >= square_mm:
        raise parts.refuse(
            "marker_mm",
            f"a marker of {in_mm(marker_mm)} does not fit into a square of {in_mm(square_mm)}",
            f"take about three quarters of the square: {0.75 * square_mm:g}",
        )
    dictionary = parts.dictionary()
    n_markers = squares[0] * squares[1] // 2
    if n_markers > dictionary_size(dictionary):
        raise parts.refuse(
            "dictionary",
            f"the board needs {n_markers} markers, {dictionary} holds {dictionary_size(dictionary)}",
            "take a larger dictionary or fewer squares",
        )
    cell_mm = marker_mm / marker_bits(dictionary, 0).shape[0]
    _check_printable(parts, "marker_mm", cell_mm)
    _check_printable(parts, "marker_mm", 0.5 * (square_mm - marker_mm), "the white around a marker")
    is_legacy = parts.content.get("legacy_pattern", False)
    if not isinstance(is_legacy, bool):
        raise parts.refuse("legacy_pattern", f"{is_legacy!r} is not true or false", "write true, or leave it out")
    document |= {"marker_mm": marker_mm, "dictionary": dictionary}
    if is_legacy:
        document["legacy_pattern"] = True
    return Artwork(
        pattern=charuco_layout(squares, square_mm, marker_mm, dictionary, is_legacy).pattern,
        quiet_zone_mm=cell_mm,
        description=(
            f"ChArUco board · {size} · markers of {in_mm(marker_mm)} · {dictionary} · ids 0 to {n_markers - 1}"
            + (" · layout before OpenCV 4.6" if is_legacy else "")
        ),
        size_keys=("square_mm", "marker_mm"),
        document=document,
    )


def in_mm(length_mm: float) -> str:
    """Write a length as people do: `20 mm`, `2.14 mm`."""
    return f"{round(length_mm, 2):g} mm"


def _squares(parts: Parts, kind: str) -> tuple[int, int]:
    value = parts.value("squares", "[11, 8]")
    whole = isinstance(value, list) and all(isinstance(n, int) and not isinstance(n, bool) for n in value)
    if not whole or len(value) != 2:
        raise parts.refuse("squares", f"{value!r} is not two whole numbers", "give columns and rows, such as 11, 8")
    columns, rows = value
    least = _LEAST_SQUARES[kind]
    if min(columns, rows) < least:
        raise parts.refuse(
            "squares",
            f"{columns} × {rows} squares are too few for a {kind} board",
            f"it needs {least} × {least} or more (squares, not inner corners)",
        )
    if max(columns, rows) > _MOST_SQUARES:
        raise parts.refuse(
            "squares",
            f"{columns} × {rows} squares are more than a picture resolves",
            f"take at most {_MOST_SQUARES} squares either way",
        )
    return columns, rows


def _check_printable(parts: Parts, key: str, cell_mm: float, what: str = "its smallest cell") -> None:
    if cell_mm < _FINEST_MM:
        raise parts.refuse(
            key,
            f"{what} would be {cell_mm:.2g} mm wide, which a printer frays",
            f"take sizes that leave at least {_FINEST_MM} mm",
        )


def _half_turn_notes(squares: tuple[int, int]) -> tuple[str, ...]:
    # Turning by half a turn moves colours by the sum of the counts: where that is even, the board looks the same.
    if (squares[0] + squares[1]) % 2:
        return ()
    return (
        f"a chessboard of {squares[0]} × {squares[1]} squares looks the same turned by half a turn, so that the"
        " cameras may count its corners from different ends; one even and one odd number of squares is safer",
    )
