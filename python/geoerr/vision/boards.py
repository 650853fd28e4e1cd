"""The calibration board in a picture: its inner corners to hundredths of a pixel.

OpenCV finds the board; every corner is then fitted to the full picture (`corners.py`). A chessboard found upside
down is turned the right way where its colours tell which that is.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np
import numpy.typing as npt

from geoerr.errors import DetectionError
from geoerr.vision.corners import CornerFits, fit_corners
from geoerr.vision.markers import dictionaries_seen, seen_in_a_mirror
from geoerr.vision.patterns import opencv_dictionary
from geoerr.vision.session import BoardSpec

Array = npt.NDArray[np.float64]
GreyImage = npt.NDArray[np.uint8]

LEAST_CORNERS = 6
"""Fewer corners of a view than this say nothing about a lens."""

# Chessboards are first looked for in a picture of about this width: quicker, and large squares are found better.
_SEARCH_WIDTH_PX = 1280
_HINT_WIDTH_PX = 800
# Of the corners of one board: more with the wrong colours than this, and it is not this board.
_MOST_WRONG_COLOURS = 0.2
_NOT_FOUND = "the board was not found"


@dataclass(frozen=True)
class BoardSighting:
    """The board's corners in one picture.

    Attributes
    ----------
    ids
        (n,) numbers of the inner corners, row by row, ascending.
    corners_px
        (n, 2) distorted pixels.
    std_px
        (n,) standard uncertainty of one coordinate, from what the picture leaves unexplained.
    marker_of_square
        Side of its markers over that of its squares, as the picture shows them; None of a chessboard.
    """

    ids: npt.NDArray[np.int64]
    corners_px: Array
    std_px: Array
    marker_of_square: float | None = None


def find_board(picture: GreyImage, board: BoardSpec) -> BoardSighting:
    """Find the board in a picture.

    Parameters
    ----------
    picture
        (h, w) uint8.
    board
        A ChArUco board may be seen in part, a chessboard must be seen whole.

    Raises
    ------
    DetectionError
        saying what was seen and what was not.

    Notes
    -----
    Verified against the simulator's true corners (tests/vision/test_boards.py).
    """
    sighting = _find_charuco(picture, board) if board.type == "charuco" else _find_chessboard(picture, board)
    _refuse_too_few(sighting.ids, board)
    return sighting


def _refuse_too_few(ids: npt.NDArray[np.int64], board: BoardSpec) -> None:
    columns, rows = board.squares[0] - 1, board.squares[1] - 1
    across, down = ids % columns, ids // columns
    if len(ids) < LEAST_CORNERS or len(np.unique(across)) < 2 or len(np.unique(down)) < 2:
        raise DetectionError(
            f"only {len(ids)} of the board's {columns * rows} corners were found, "
            f"{LEAST_CORNERS} in more than one row are needed"
        )


def hint_for_unseen_board(picture: GreyImage, board: BoardSpec) -> str | None:
    """Say what a picture without the board does show: markers of another dictionary, a board of another size."""
    if board.type == "charuco":
        exchanged = _exchanged(picture, board)
        if exchanged is not None:
            return f"the board fits with its two numbers exchanged: write squares = [{exchanged[0]}, {exchanged[1]}]"
        # Every known dictionary is tried: a smaller picture is enough to tell which.
        scale = min(1.0, _HINT_WIDTH_PX / max(picture.shape))
        small = cv2.resize(picture, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
        return _hint_for_markers(np.asarray(small, dtype=np.uint8), board)
    columns, rows = board.squares
    for other in ((columns + 1, rows + 1), (columns - 1, rows - 1)):
        if min(other) > 2 and _chessboard_corners(picture, (other[0] - 1, other[1] - 1)) is not None:
            return f"a chessboard of {other[0]} × {other[1]} squares is seen: squares counts squares, not corners"
    return None


def _hint_for_markers(picture: GreyImage, board: BoardSpec) -> str | None:
    assert board.dictionary is not None
    seen = dictionaries_seen(picture)
    if board.dictionary in seen:
        return None
    own = [(board.dictionary, int(identity)) for identity in board.layout().marker_ids]
    name, ids = next(iter(seen.items()), ("", []))
    # In a mirror markers are those of no dictionary, but for a few that by chance are another's.
    if seen_in_a_mirror(picture, own) > len(ids):
        return "the pictures are mirror images: switch off what flips them in the camera or its program"
    return f"the pictures show {len(ids)} markers of {name}: name the dictionary that was printed" if ids else None


def same_colours(board: BoardSpec) -> tuple[npt.NDArray[np.int64], ...]:
    """List the renumberings of corners under which the board looks the same, the identity first.

    A ChArUco board has one: its markers say which way up it is. A chessboard turned by half a turn has its own
    colours again if both sides have odd or both have even numbers of squares; a square one also by a quarter turn
    where that number is odd.

    Returns
    -------
    tuple of (n,) arrays
        entry i of the turned board's corners is corner `renumbering[i]` of the board.
    """
    columns, rows = board.squares[0] - 1, board.squares[1] - 1
    numbers = np.arange(columns * rows, dtype=np.int64).reshape(rows, columns)
    if board.type == "charuco":
        return (numbers.ravel(),)
    return tuple(turned.ravel() for turned, keeps_colours in _turns(numbers, board) if keeps_colours)


def _turns(numbers: npt.NDArray[np.int64], board: BoardSpec) -> list[tuple[npt.NDArray[np.int64], bool]]:
    """All turns that a chessboard's outline allows, each with whether it keeps the colours."""
    columns, rows = board.squares
    turns = [(numbers, True), (np.rot90(numbers, 2), (columns + rows) % 2 == 0)]
    if columns == rows:
        keeps = columns % 2 == 1
        turns += [(np.rot90(numbers, 1), keeps), (np.rot90(numbers, 3), keeps)]
    return turns


def _find_charuco(picture: GreyImage, board: BoardSpec) -> BoardSighting:
    assert board.marker_mm is not None
    corners, ids, markers, marker_ids = _charuco_detector(board).detectBoard(picture)
    if marker_ids is None or len(marker_ids) == 0:
        raise DetectionError(f"{_NOT_FOUND}: no marker of {board.dictionary} is seen")
    if ids is None or len(ids) == 0:
        raise DetectionError(
            f"{_NOT_FOUND}: {len(marker_ids)} markers of {board.dictionary} are seen but they do not lie as on this "
            f"board: {_what_to_check(picture, board)}"
        )
    order = np.argsort(np.ravel(ids))
    numbers = np.ravel(ids)[order].astype(np.int64)
    # Fewer tell no homography, and OpenCV raises its own.
    _refuse_too_few(numbers, board)
    starts = np.asarray(corners, dtype=np.float64).reshape(-1, 2)[order]
    gap_of_side = 0.5 * (1.0 - board.marker_mm / board.square_mm)
    fits = _fit(picture, board, numbers, starts, gap_of_side)
    has_colours = fits.half_contrast_grey * _colours(board, numbers) > 0.0
    outlines_px = np.asarray(markers, dtype=np.float64).reshape(-1, 4, 2)
    return BoardSighting(
        numbers[has_colours],
        fits.corners_px[has_colours],
        fits.std_px[has_colours],
        _marker_of_square(board, numbers, fits.corners_px, outlines_px),
    )


def _marker_of_square(
    board: BoardSpec, numbers: npt.NDArray[np.int64], corners_px: Array, outlines_px: Array
) -> float | None:
    """Measure the markers' side, in squares, through the homography of the corners that could be fitted."""
    columns = board.squares[0] - 1
    place = np.stack([numbers % columns, numbers // columns], axis=1).astype(np.float64)
    # Of others there are no pixels (NaN), and OpenCV gives a homography all the same: one of zeros.
    is_fitted = np.isfinite(corners_px).all(axis=1)
    if is_fitted.sum() < LEAST_CORNERS:
        return None
    homography, _ = cv2.findHomography(corners_px[is_fitted], place[is_fitted])
    if homography is None:
        return None
    outlines = cv2.perspectiveTransform(outlines_px.reshape(-1, 1, 2), homography).reshape(-1, 4, 2)
    sides = np.linalg.norm(outlines - np.roll(outlines, -1, axis=1), axis=2)
    share = float(np.median(sides))
    # A marker lies inside its square: anything else was not measured on this board.
    return share if 0.0 < share < 1.0 else None


def _charuco_detector(board: BoardSpec) -> cv2.aruco.CharucoDetector:
    assert board.marker_mm is not None
    assert board.dictionary is not None
    layout = cv2.aruco.CharucoBoard(
        board.squares, board.square_mm, board.marker_mm, opencv_dictionary(board.dictionary)
    )
    layout.setLegacyPattern(board.is_legacy_pattern)
    return cv2.aruco.CharucoDetector(layout)


def _what_to_check(picture: GreyImage, board: BoardSpec) -> str:
    """Say whether the markers lie as in OpenCV's other layout, or as with the numbers of squares exchanged."""
    exchanged = _exchanged(picture, board)
    if exchanged is not None:
        return f"they lie as on one of {exchanged[0]} × {exchanged[1]} squares"
    if not _has_corners(picture, replace(board, is_legacy_pattern=not board.is_legacy_pattern)):
        return "check squares and dictionary"
    if board.is_legacy_pattern:
        return "they lie as OpenCV draws boards since 4.6: leave legacy_pattern out"
    return "they lie as on a board made before OpenCV 4.6: set legacy_pattern = true"


def _exchanged(picture: GreyImage, board: BoardSpec) -> tuple[int, int] | None:
    """Give the numbers of squares the other way round, where the markers lie so."""
    other = replace(board, squares=(board.squares[1], board.squares[0]))
    return other.squares if other != board and _has_corners(picture, other) else None


def _has_corners(picture: GreyImage, board: BoardSpec) -> bool:
    """Tell whether a board's corners are found where its markers say that they are."""
    _, ids, _, _ = _charuco_detector(board).detectBoard(picture)
    return ids is not None and len(ids) > 0


def _find_chessboard(picture: GreyImage, board: BoardSpec) -> BoardSighting:
    columns, rows = board.squares[0] - 1, board.squares[1] - 1
    starts = _chessboard_corners(picture, (columns, rows))
    if starts is None:
        raise DetectionError(f"{_NOT_FOUND}: no {columns} × {rows} inner corners of a chessboard are seen")
    grid = starts.reshape(rows, columns, 2)
    along_u, along_v = grid[0, -1] - grid[0, 0], grid[-1, 0] - grid[0, 0]
    if along_u[0] * along_v[1] - along_u[1] * along_v[0] < 0.0:
        # Numbered as in a mirror.
        grid = grid[:, ::-1]
    numbers = np.arange(columns * rows, dtype=np.int64)
    fits = _fit(picture, board, numbers, grid.reshape(-1, 2))
    colours = fits.half_contrast_grey * _colours(board, numbers)
    is_inverse = float(np.sum(np.sign(colours))) < 0.0
    is_good = (colours < 0.0) if is_inverse else (colours > 0.0)
    if np.mean(~is_good) > _MOST_WRONG_COLOURS:
        raise DetectionError(f"{_NOT_FOUND}: black and white do not alternate as on a chessboard")
    found, std_px = fits.corners_px, fits.std_px
    if is_inverse:
        turned = next((turn for turn, keeps in _turns(numbers.reshape(rows, columns), board) if not keeps), None)
        if turned is not None:
            found, std_px, is_good = found[turned.ravel()], std_px[turned.ravel()], is_good[turned.ravel()]
    return BoardSighting(numbers[is_good], found[is_good], std_px[is_good])


def _chessboard_corners(picture: GreyImage, inner: tuple[int, int]) -> Array | None:
    """Look in a reduced picture first, then in the full one; the quick detector first, then the thorough one."""
    scale = min(1.0, _SEARCH_WIDTH_PX / max(picture.shape))
    sizes = [(picture, 1.0)]
    if scale < 1.0:
        reduced = cv2.resize(picture, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
        sizes.insert(0, (np.asarray(reduced, dtype=np.uint8), scale))
    for image, shrunk in sizes:
        is_found, corners = cv2.findChessboardCorners(image, inner)
        if not is_found:
            is_found, corners = cv2.findChessboardCornersSB(image, inner)
        if is_found:
            found = np.asarray(corners, dtype=np.float64).reshape(-1, 2)
            # Pixel centres are at whole numbers in both pictures.
            return np.asarray((found + 0.5) / shrunk - 0.5)
    return None


def _fit(
    picture: GreyImage, board: BoardSpec, numbers: npt.NDArray[np.int64], starts: Array, gap_of_side: float = np.inf
) -> CornerFits:
    """Fit corners, with the squares' sides at each taken from the board's homography."""
    columns = board.squares[0] - 1
    place = np.stack([numbers % columns, numbers // columns], axis=1).astype(np.float64)
    homography, _ = cv2.findHomography(place, starts)
    if homography is None:
        raise DetectionError(f"{_NOT_FOUND}: its corners lie in one line")

    def seen(at: Array) -> Array:
        mapped = np.column_stack([at, np.ones(len(at))]) @ np.asarray(homography, dtype=np.float64).T
        return np.asarray(mapped[:, :2] / mapped[:, 2:])

    half_u, half_v = np.array([0.5, 0.0]), np.array([0.0, 0.5])
    side_u = seen(place + half_u) - seen(place - half_u)
    side_v = seen(place + half_v) - seen(place - half_v)
    return fit_corners(picture, starts, side_u, side_v, gap_of_side)


def _colours(board: BoardSpec, numbers: npt.NDArray[np.int64]) -> Array:
    """+1 for corners whose square towards −u −v is black, −1 for the others."""
    columns = board.squares[0] - 1
    parity = (numbers % columns + numbers // columns) % 2
    sign = -1.0 if board.is_legacy_pattern and board.squares[1] % 2 == 0 else 1.0
    return np.asarray(sign * (1.0 - 2.0 * parity))
