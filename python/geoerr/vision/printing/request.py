"""What to print, as it is asked for: a spec, or a board or targets of a session.toml."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from geoerr.errors import InputFileError
from geoerr.files import read_toml
from geoerr.vision.patterns import looks_of_marker
from geoerr.vision.printing.artwork import Artwork, Parts, board_artwork, plate_artwork

_FORMS = {
    "charuco": "charuco:COLUMNSxROWS:SQUARE:MARKER:DICTIONARY, such as charuco:11x8:20:15:DICT_5X5_100",
    "chessboard": "chessboard:COLUMNSxROWS:SQUARE, such as chessboard:10x7:25",
    "aruco": "aruco:DICTIONARY:ID:SIZE, such as aruco:DICT_4X4_50:7:56",
}
_KEYS = {
    "charuco": ("squares", "square_mm", "marker_mm", "dictionary"),
    "chessboard": ("squares", "square_mm"),
    "aruco": ("dictionary", "id", "size_mm"),
}


@dataclass(frozen=True)
class Request:
    """What is to be printed.

    Attributes
    ----------
    text
        As it was asked for; names it in messages.
    artworks
        One for each page.
    session_file
        The session.toml that it came from; None for a spec.
    """

    text: str
    artworks: tuple[Artwork, ...]
    session_file: Path | None = None


def read_request(text: str) -> Request:
    """Understand PLATE_OR_BOARD.

    Parameters
    ----------
    text
        A spec (`charuco:11x8:20:15:DICT_5X5_100`, `chessboard:10x7:25`, `aruco:DICT_4X4_50:7:56`, lengths in mm), or
        a session.toml or its folder: alone or with `#board` for its board, with `#7` for its target 7, with
        `#targets` for all of them.

    Raises
    ------
    InputFileError
        names the file or spec, the part, and what would be right.
    """
    kind, colon, rest = text.partition(":")
    if colon and kind in _FORMS:
        return Request(text, (_from_spec(text, kind, rest.split(":")),))
    path, part = Path(text), "board"
    if not path.exists() and "#" in text:
        name, part = text.rsplit("#", 1)
        path = Path(name)
    if path.is_dir():
        path = path / "session.toml"
    if not path.exists():
        known = "; ".join(_FORMS.values())
        raise InputFileError(text, "is neither a session nor a spec", remedy=f"name a session.toml, or write {known}")
    return Request(text, _from_session(read_toml(path), path, part), path)


def _from_spec(text: str, kind: str, values: list[str]) -> Artwork:
    keys = _KEYS[kind]
    if len(values) != len(keys):
        raise InputFileError(
            text,
            f"has {len(values)} parts after {kind!r}, {len(keys)} are needed ({', '.join(keys)})",
            remedy=f"write {_FORMS[kind]}",
        )
    content: dict[str, Any] = {}
    for key, value in zip(keys, values, strict=True):
        try:
            content[key] = _spec_value(key, value)
        except ValueError as error:
            raise InputFileError(
                text, f"{value!r} cannot be read", column=key, remedy=f"write {_FORMS[kind]}"
            ) from error
    if kind == "aruco":
        return plate_artwork(Parts(content, text))
    return board_artwork(Parts({"type": kind, **content}, text))


def _spec_value(key: str, value: str) -> Any:
    if key == "dictionary":
        return value
    if key == "id":
        return int(value)
    if key == "squares":
        return [int(count) for count in value.lower().split("x")]
    return float(value)


def _from_session(document: dict[str, Any], path: Path, part: str) -> tuple[Artwork, ...]:
    if part == "board":
        return (_board(document, path),)
    targets = _targets(document, path)
    if part == "targets":
        return _plates(targets)
    if not part.isascii() or not part.isdigit():
        raise InputFileError(path, f"has no part #{part}", remedy="write #board, #targets, or # and a target's id")
    wanted = [target for target in targets if target.content.get("id") == int(part)]
    if not wanted:
        known = ", ".join(str(target.content.get("id", "?")) for target in targets)
        raise InputFileError(path, f"has no target {part}", column="targets", remedy=f"its ids are {known}")
    return _plates(wanted)


def _plates(targets: list[Parts]) -> tuple[Artwork, ...]:
    places: dict[bytes, str] = {}
    plates = []
    for target in targets:
        plate = plate_artwork(target)
        dictionary, identity = plate.document["dictionary"], plate.document["id"]
        earlier = places.setdefault(looks_of_marker(dictionary, identity), target.place)
        if earlier != target.place:
            raise target.refuse(
                "id",
                f"{dictionary} marker {identity} is {earlier} already",
                "give every target a marker of its own; two plates that look alike cannot be told apart",
            )
        plates.append(plate)
    return tuple(plates)


def _board(document: dict[str, Any], path: Path) -> Artwork:
    board = document.get("board")
    if board is None:
        remedy = "add a [board]"
        if document.get("targets"):
            remedy += f", or print its targets: {path}#targets"
        raise InputFileError(path, "has no board", column="board", remedy=remedy)
    if not isinstance(board, dict):
        raise InputFileError(path, f"{board!r} is not a table", column="board", remedy="write it as [board]")
    return board_artwork(Parts(board, path, "board"))


def _targets(document: dict[str, Any], path: Path) -> list[Parts]:
    targets = document.get("targets", [])
    if not isinstance(targets, list) or not all(isinstance(target, dict) for target in targets):
        raise InputFileError(path, "is not a list of tables", column="targets", remedy="write each as [[targets]]")
    if not targets:
        raise InputFileError(path, "has no targets", column="targets", remedy="add [[targets]] with id and size_mm")
    return [Parts(target, path, f"targets[{number}]") for number, target in enumerate(targets, start=1)]
