"""Whether the pictures that a session names are there, whole and of one size, before anything takes long."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from geoerr.errors import InputFileError
from geoerr.summaries import counted
from geoerr.vision.board_views import LEAST_VIEWS
from geoerr.vision.frame import CAMERAS, remedy_for
from geoerr.vision.images import picture_size
from geoerr.vision.session import Session

Size = tuple[int, int]


@dataclass(frozen=True)
class Finding:
    """Something about a session's pictures that is not as it should be.

    Attributes
    ----------
    is_wrong
        Whether a verb would lack what it needs; else others go on without it.
    text
        What, how many, and the first by its name.
    remedy
        What helps, where that is known.
    """

    is_wrong: bool
    text: str
    remedy: str | None = None


@dataclass(frozen=True)
class _Picture:
    """One picture: where it is named, its name in the session's folder, its size or why it has none."""

    place: str
    name: str
    size: Size | None
    why: str = ""
    remedy: str | None = None


def findings(session: Session) -> tuple[Finding, ...]:
    """Look at every picture that a session names, as far as its header and its length tell; none is decoded.

    Frames whose pictures cannot be used are measurements that are lost, and that can still be taken again. Of board
    pictures some may be bad, as long as enough pairs are left.
    """
    seen: dict[Path, tuple[Size | None, str, str | None]] = {}
    boards = [
        tuple(_picture(session, f"calibration/{side}", _inside(session, path), seen) for side, path in pair)
        for pair in (zip(CAMERAS, (item.left, item.right), strict=True) for item in session.calibration_pairs)
    ]
    others = [_picture(session, place, name, seen) for place, name in _named(session)]
    sizes = Counter(one.size for one in (*(one for pair in boards for one in pair), *others) if one.size is not None)
    usual = sizes.most_common(1)[0][0] if sizes else None
    of_boards = [[bad for one in pair if (bad := _judged(one, usual)) is not None] for pair in boards]
    return (
        *_of_frames([bad for one in others if (bad := _judged(one, usual)) is not None], len(others)),
        *_of_calibration(session, of_boards),
    )


def _named(session: Session) -> Iterator[tuple[str, str]]:
    """Give the pictures that frames.csv and scale bars name, each with its place there."""
    if session.frames is not None:
        for row, *names in session.frames.select("file_row", *CAMERAS).iter_rows():
            yield from ((f"row {row} of frames.csv", str(name)) for name in names)
    for number, bar in enumerate(session.scale_bars, start=1):
        yield from ((f"scale_bars[{number}]", name) for name in (bar.left, bar.right))


def _inside(session: Session, path: Path) -> str:
    return path.relative_to(session.directory).as_posix()


def _picture(
    session: Session, place: str, name: str, seen: dict[Path, tuple[Size | None, str, str | None]]
) -> _Picture:
    path = session.directory / name
    if path not in seen:
        try:
            seen[path] = picture_size(path), "", None
        except InputFileError as error:
            seen[path] = None, error.problem, remedy_for(session.directory, name, error)
    return _Picture(place, name, *seen[path])


def _judged(picture: _Picture, usual: Size | None) -> _Picture | None:
    """Give a picture that cannot be used, with the reason; None for one that can."""
    if picture.size is None:
        return picture
    if usual is None or picture.size == usual:
        return None
    why = f"{_times(picture.size)} px, the others {_times(usual)} px"
    remedy = "both cameras must give pictures of one size; crop or scale none of them"
    return _Picture(picture.place, picture.name, picture.size, why, remedy)


def _of_frames(bad: list[_Picture], n_all: int) -> Iterator[Finding]:
    if bad:
        first = bad[0]
        yield Finding(
            True,
            f"{len(bad)} of {counted(n_all, 'picture')} of the machine cannot be used; the first, {first.place}: "
            f"{first.name}: {first.why}",
            first.remedy,
        )


def _of_calibration(session: Session, bad_of_pairs: list[list[_Picture]]) -> Iterator[Finding]:
    """Say what is wrong with board pictures, and whether enough are left; a rig that is there needs none of them.

    Where there are none at all, the rig is to come from elsewhere (`--rig`).
    """
    has_rig = (session.directory / "rig.json").is_file()
    bad = [one for pair in bad_of_pairs for one in pair]
    reasons = [f"{one.name}: {one.why}" for one in bad]
    reasons += [f"calibration/{one.name}: {one.why}" for one in session.unpaired]
    n_good = sum(not pair for pair in bad_of_pairs)
    lost = f"; {counted(len(reasons), 'board picture')} cannot be used, the first: {reasons[0]}" if reasons else ""
    if not (bad_of_pairs or session.unpaired):
        return
    if n_good < LEAST_VIEWS:
        yield Finding(
            not has_rig,
            f"{counted(n_good, 'pair')} of board pictures can be used, {LEAST_VIEWS} are needed to calibrate{lost}",
            "take ten or more pairs, both pictures of each under one name in calibration/left and calibration/right",
        )
    elif reasons:
        yield Finding(False, lost.removeprefix("; "), bad[0].remedy if bad else None)
    if n_good and session.board is None:
        yield Finding(
            not has_rig, "there are board pictures and no [board] in session.toml", "describe it in [board]"
        )


def _times(size: Size) -> str:
    return f"{size[0]} × {size[1]}"
