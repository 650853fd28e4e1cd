"""What is printed on plates and boards: marker bits and board layouts, as OpenCV defines them.

A pattern is a rectilinear grid of black and white cells: enough to print it, to draw it in a virtual picture and to
say where its corners are. Coordinates are millimetres from the pattern's upper left corner, u to the right, v
downwards, as one looks at it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import cv2
import numpy as np
import numpy.typing as npt

from geoerr.errors import DetectionError


@dataclass(frozen=True)
class Pattern:
    """Black and white cells between straight lines.

    Attributes
    ----------
    u_edges_mm, v_edges_mm
        Ascending positions of the vertical lines (columns + 1,) and of the horizontal lines (rows + 1,).
    white
        uint8 (rows, columns): 1 = white, 0 = black.
    """

    u_edges_mm: npt.NDArray[np.float64]
    v_edges_mm: npt.NDArray[np.float64]
    white: npt.NDArray[np.uint8]

    @property
    def width_mm(self) -> float:
        """Extent along u."""
        return float(self.u_edges_mm[-1] - self.u_edges_mm[0])

    @property
    def height_mm(self) -> float:
        """Extent along v."""
        return float(self.v_edges_mm[-1] - self.v_edges_mm[0])

    def with_margin(self, margin_mm: float) -> Pattern:
        """Give the same pattern with a white margin around it (the quiet zone); the origin stays where it was."""
        u, v = self.u_edges_mm, self.v_edges_mm
        return Pattern(
            np.concatenate(([u[0] - margin_mm], u, [u[-1] + margin_mm])),
            np.concatenate(([v[0] - margin_mm], v, [v[-1] + margin_mm])),
            np.pad(self.white, 1, constant_values=1),
        )


@dataclass(frozen=True)
class Board:
    """A calibration board.

    Attributes
    ----------
    pattern
        All its cells.
    corners_mm
        (n, 2) inner corners (u, v), row by row, in the order of OpenCV's corner ids.
    marker_ids
        (k,) ids of its markers; empty on a chessboard.
    marker_corners_mm
        (k, 4, 2): upper left, upper right, lower right, lower left corner of each marker.
    """

    pattern: Pattern
    corners_mm: npt.NDArray[np.float64]
    marker_ids: npt.NDArray[np.int64]
    marker_corners_mm: npt.NDArray[np.float64]


def dictionary_names() -> list[str]:
    """Names of the marker dictionaries that OpenCV brings, such as `DICT_4X4_50`, sorted."""
    return sorted(name for name in dir(cv2.aruco) if name.startswith("DICT_") and name == name.upper())


def dictionary_named(name: str) -> str | None:
    """Give the one name of a dictionary that OpenCV spells in two ways, as `DICT_APRILTAG_36h11`; None of no such."""
    return name.upper() if name.upper() in dictionary_names() else None


@cache
def opencv_dictionary(dictionary: str) -> cv2.aruco.Dictionary:
    """Give OpenCV's dictionary of that name.

    Raises
    ------
    DetectionError
        for a name that OpenCV does not know.
    """
    if dictionary not in dictionary_names():
        raise DetectionError(
            f"{dictionary!r} is not a marker dictionary\nhint: known are {', '.join(dictionary_names())}"
        )
    return cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, dictionary))


def dictionary_size(dictionary: str) -> int:
    """Count the markers that a dictionary holds; ids run from 0 to one less."""
    return int(opencv_dictionary(dictionary).bytesList.shape[0])


def marker_bits(dictionary: str, id: int) -> npt.NDArray[np.uint8]:
    """Give a marker's cells, its black border of one cell included.

    Parameters
    ----------
    dictionary
        Name such as `DICT_4X4_50`.
    id
        Number of the marker in it.

    Returns
    -------
    ndarray
        uint8 (m, m), m = bits of one side + 2; 1 = white; row 0 is the upper edge.

    Raises
    ------
    DetectionError
        for an unknown dictionary or an id that it does not hold.
    """
    known = opencv_dictionary(dictionary)
    n_markers = dictionary_size(dictionary)
    if not 0 <= id < n_markers:
        raise DetectionError(f"{dictionary} has no marker {id}\nhint: its ids are 0 to {n_markers - 1}")
    side = int(known.markerSize) + 2
    return (np.asarray(known.generateImageMarker(id, side)) > 127).astype(np.uint8)


def looks_of_marker(dictionary: str, id: int) -> bytes:
    """Give what is the same for markers that look the same, whichever way up: dictionaries share their markers.

    `DICT_4X4_50` is the beginning of `DICT_4X4_100`; a plate is one target, under whatever name.
    """
    bits = marker_bits(dictionary, id)
    return min(np.rot90(bits, turns).tobytes() for turns in range(4))


def marker_pattern(dictionary: str, id: int, size_mm: float) -> Pattern:
    """Give a marker of side `size_mm` (outer edge of its black border) as a pattern without margin."""
    bits = marker_bits(dictionary, id)
    edges_mm = np.linspace(0.0, size_mm, bits.shape[0] + 1)
    return Pattern(edges_mm, edges_mm, bits)


def chessboard_layout(squares: tuple[int, int], square_mm: float) -> Board:
    """Lay out a chessboard whose upper left square is black.

    Parameters
    ----------
    squares
        Squares along u and v; inner corners are one less each way.
    square_mm
        Side of a square.
    """
    _check_squares(squares)
    columns, rows = squares
    white = (np.add.outer(np.arange(rows), np.arange(columns)) % 2).astype(np.uint8)
    pattern = Pattern(
        np.arange(columns + 1, dtype=np.float64) * square_mm,
        np.arange(rows + 1, dtype=np.float64) * square_mm,
        white,
    )
    return Board(pattern, _inner_corners_mm(squares, square_mm), np.empty(0, dtype=np.int64), np.empty((0, 4, 2)))


def charuco_layout(
    squares: tuple[int, int], square_mm: float, marker_mm: float, dictionary: str, is_legacy: bool = False
) -> Board:
    """Lay out a ChArUco board as OpenCV does: upper left square black, markers in the white ones.

    Parameters
    ----------
    squares
        Squares along u and v; inner corners are one less each way.
    square_mm, marker_mm
        Side of a square and of the marker within it.
    dictionary
        Name of the markers' dictionary; ids 0, 1, 2 ... are given row by row.
    is_legacy
        The layout before OpenCV 4.6: with an even number of rows the upper left square is white.

    Raises
    ------
    DetectionError
        for a marker that is not smaller than its square, or more markers than the dictionary holds.
    """
    _check_squares(squares)
    if not 0.0 < marker_mm < square_mm:
        raise DetectionError(
            f"a marker of {marker_mm} mm does not fit into a square of {square_mm} mm"
            "\nhint: marker_mm must be above 0 and below square_mm"
        )
    board = cv2.aruco.CharucoBoard(squares, square_mm, marker_mm, opencv_dictionary(dictionary))
    board.setLegacyPattern(is_legacy)
    marker_ids = np.asarray(board.getIds(), dtype=np.int64).reshape(-1)
    n_markers = dictionary_size(dictionary)
    if marker_ids.size > n_markers:
        raise DetectionError(
            f"the board needs {marker_ids.size} markers, {dictionary} holds {n_markers}"
            "\nhint: take a larger dictionary or fewer squares"
        )
    # OpenCV keeps these coordinates in single precision: the layout is taken from it, the numbers are not.
    upper_left = np.asarray(board.getObjPoints(), dtype=np.float64)[:, 0, :2]
    places = np.rint((upper_left / square_mm) - 0.5 * (1.0 - marker_mm / square_mm)).astype(np.int64)

    cells = int(opencv_dictionary(dictionary).markerSize) + 2
    columns, rows = squares
    gap_mm = 0.5 * (square_mm - marker_mm)
    within_mm = np.concatenate(([0.0], np.linspace(gap_mm, gap_mm + marker_mm, cells + 1)))
    step = cells + 2
    first_white = int(is_legacy and rows % 2 == 0)
    checker = ((np.add.outer(np.arange(rows), np.arange(columns)) + first_white) % 2).astype(np.uint8)
    white = np.kron(checker, np.ones((step, step), dtype=np.uint8))
    for marker_id, (column, row) in zip(marker_ids, places, strict=True):
        top, left = row * step + 1, column * step + 1
        white[top : top + cells, left : left + cells] = marker_bits(dictionary, int(marker_id))
    pattern = Pattern(
        _square_edges_mm(columns, square_mm, within_mm), _square_edges_mm(rows, square_mm, within_mm), white
    )
    outline_mm = np.array([[0.0, 0.0], [marker_mm, 0.0], [marker_mm, marker_mm], [0.0, marker_mm]])
    marker_corners_mm = (places * square_mm + gap_mm)[:, None, :] + outline_mm
    return Board(pattern, _inner_corners_mm(squares, square_mm), marker_ids, marker_corners_mm)


def _square_edges_mm(n_squares: int, square_mm: float, within_mm: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    starts_mm = np.arange(n_squares) * square_mm
    return np.concatenate(((starts_mm[:, None] + within_mm).ravel(), [n_squares * square_mm]))


def _inner_corners_mm(squares: tuple[int, int], square_mm: float) -> npt.NDArray[np.float64]:
    columns, rows = squares
    u, v = np.meshgrid(np.arange(1, columns, dtype=np.float64), np.arange(1, rows, dtype=np.float64))
    return np.stack([u.ravel(), v.ravel()], axis=1) * square_mm


def _check_squares(squares: tuple[int, int]) -> None:
    if min(squares) < 2:
        raise DetectionError(
            f"a board of {squares[0]} × {squares[1]} squares has no inner corner\nhint: it needs 2 each way"
        )
