"""Marker bits and board layouts against OpenCV's own drawings and its detector."""

import cv2
import numpy as np
import pytest

from geoerr.errors import DetectionError
from geoerr.vision.patterns import (
    charuco_layout,
    chessboard_layout,
    dictionary_names,
    dictionary_size,
    marker_bits,
    marker_pattern,
    opencv_dictionary,
)


@pytest.mark.parametrize("dictionary", ["DICT_4X4_50", "DICT_5X5_100", "DICT_6X6_250", "DICT_APRILTAG_36H11"])
def test_every_marker_is_found_under_its_id(dictionary):
    detector = cv2.aruco.ArucoDetector(opencv_dictionary(dictionary))
    for marker in range(0, dictionary_size(dictionary), 17):
        bits = marker_bits(dictionary, marker)
        assert not bits[[0, -1]].any()
        assert not bits[:, [0, -1]].any()
        picture = np.pad(np.kron(bits * np.uint8(255), np.ones((9, 9), np.uint8)), 30, constant_values=255)
        _, ids, _ = detector.detectMarkers(picture)
        assert ids is not None
        assert np.ravel(ids).tolist() == [marker]


@pytest.mark.parametrize("is_legacy", [False, True])
@pytest.mark.parametrize(("columns", "rows"), [(11, 8), (14, 10), (5, 4), (2, 2), (3, 2), (5, 7)])
def test_a_charuco_layout_is_the_board_that_opencv_draws(columns, rows, is_legacy):
    square_mm, marker_mm, px_per_mm = 20.0, 15.0, 14
    board = charuco_layout((columns, rows), square_mm, marker_mm, "DICT_5X5_100", is_legacy)
    theirs = cv2.aruco.CharucoBoard((columns, rows), square_mm, marker_mm, opencv_dictionary("DICT_5X5_100"))
    theirs.setLegacyPattern(is_legacy)
    drawn = theirs.generateImage((columns * 20 * px_per_mm, rows * 20 * px_per_mm), marginSize=0)
    u, v = board.pattern.u_edges_mm, board.pattern.v_edges_mm
    u_px, v_px = (((edges[1:] + edges[:-1]) * 0.5 * px_per_mm).astype(int) for edges in (u, v))
    assert np.array_equal(drawn[np.ix_(v_px, u_px)] > 127, board.pattern.white == 1)
    assert np.allclose(theirs.getChessboardCorners()[:, :2], board.corners_mm, atol=1e-5)
    assert np.allclose(np.array(theirs.getObjPoints())[..., :2], board.marker_corners_mm, atol=1e-5)
    assert np.array_equal(np.ravel(theirs.getIds()), board.marker_ids)
    assert np.all(np.diff(u) > 0)
    assert (board.pattern.width_mm, board.pattern.height_mm) == (columns * square_mm, rows * square_mm)


def test_a_chessboard_has_black_in_its_upper_left_corner_and_inner_corners_between_four_squares():
    board = chessboard_layout((4, 3), 10.0)
    assert board.pattern.white.tolist() == [[0, 1, 0, 1], [1, 0, 1, 0], [0, 1, 0, 1]]
    assert board.corners_mm.tolist() == [[10, 10], [20, 10], [30, 10], [10, 20], [20, 20], [30, 20]]


def test_a_margin_is_white_and_leaves_the_origin_where_it_was():
    bare = marker_pattern("DICT_4X4_50", 7, 54.0)
    plate = bare.with_margin(6.0)
    assert plate.u_edges_mm[0] == -6.0
    assert plate.u_edges_mm[1] == 0.0
    assert plate.width_mm == 66.0
    assert plate.white[[0, -1]].all()
    assert plate.white[:, [0, -1]].all()
    assert np.array_equal(plate.white[1:-1, 1:-1], bare.white)


def test_what_opencv_does_not_hold_is_refused_with_what_it_holds():
    assert "DICT_4X4_50" in dictionary_names()
    with pytest.raises(DetectionError, match="DICT_4X4_50"):
        marker_bits("DICT_9X9", 0)
    with pytest.raises(DetectionError, match="ids are 0 to 49"):
        marker_bits("DICT_4X4_50", 50)
    with pytest.raises(DetectionError, match="needs 70 markers"):
        charuco_layout((14, 10), 25.0, 18.0, "DICT_5X5_50")
    with pytest.raises(DetectionError, match="does not fit"):
        charuco_layout((5, 4), 15.0, 15.0, "DICT_5X5_50")
    with pytest.raises(DetectionError, match="no inner corner"):
        chessboard_layout((1, 5), 10.0)
