"""Boards found in simulated pictures, against the simulator's own corners; which way up; what is not a board."""

from __future__ import annotations

from copy import deepcopy
from dataclasses import replace

import cv2
import numpy as np
import pytest

from geoerr.errors import DetectionError
from geoerr.simulate.nine_lines import NineLines, nine_line_plan
from geoerr.simulate.pictures import board_views, true_board_pixels
from geoerr.simulate.plan import Plan, plan_from_document
from geoerr.vision.boards import find_board, hint_for_unseen_board, same_colours
from geoerr.vision.patterns import chessboard_layout
from geoerr.vision.session import BoardSpec

CHARUCO = BoardSpec("charuco", (14, 10), 25.0, 18.0, "DICT_5X5_100")
CHESSBOARD = BoardSpec("chessboard", (12, 9), 25.0)
SETTING = NineLines(n_points=2, both_directions=False, image_size_px=(1224, 1024), board_views=3)


def charuco_plan() -> Plan:
    return nine_line_plan(SETTING)


def chessboard_plan() -> Plan:
    plan = charuco_plan()
    assert plan.board is not None
    layout = chessboard_layout(CHESSBOARD.squares, CHESSBOARD.square_mm)
    document = {"type": "chessboard", "squares": [12, 9], "square_mm": 25.0}
    return replace(plan, board=replace(plan.board, board=layout, document=document, least_seen=1.0))


@pytest.mark.parametrize(("plan", "board"), [(charuco_plan(), CHARUCO), (chessboard_plan(), CHESSBOARD)])
def test_corners_are_where_the_simulator_drew_them(plan: Plan, board: BoardSpec) -> None:
    off, standardised, n_visible = [], [], 0
    for view, pictures in enumerate(board_views(plan)):
        truth = true_board_pixels(plan, view)
        for picture, true_px in zip(pictures, truth.values(), strict=True):
            sighting = find_board(picture, board)
            assert (np.diff(sighting.ids) > 0).all()
            off.append(sighting.corners_px - true_px[sighting.ids])
            standardised.append(off[-1] / sighting.std_px[:, None])
            inside = (true_px > 40) & (true_px < np.array([1224, 1024]) - 40)
            n_visible += int(inside.all(axis=1).sum())
    errors, z = np.concatenate(off), np.concatenate(standardised)
    # No corner's shift is shared by all; what is left of the mean is chance.
    assert np.abs(errors.mean(axis=0)).max() < 4.0 * errors.std() / np.sqrt(len(errors)) + 0.001
    # Noise of 1.5 grey levels on 150 of contrast allows a few thousandths of a pixel; cornerSubPix has 0.02.
    assert errors.std() < 0.01
    assert 0.85 < z.std() < 1.2
    assert np.abs(z).max() < 5.5
    # Nothing that is well inside of the picture is missed, but a few whose neighbour markers are cut.
    assert len(errors) > 0.95 * n_visible


@pytest.mark.parametrize("turns", [1, 2, 3])
def test_a_turned_picture_gives_the_same_numbers(turns: int) -> None:
    picture, _ = next(board_views(chessboard_plan()))
    upright = find_board(picture, CHESSBOARD)
    turned_picture = np.ascontiguousarray(np.rot90(picture, turns))
    turned = find_board(turned_picture, CHESSBOARD)
    back = turned.corners_px
    height, width = picture.shape
    for k in range(turns):
        # A quarter turn against the clock takes (u, v) to (v, width − 1 − u).
        side = (width, height)[(turns - 1 - k) % 2]
        back = np.column_stack([side - 1 - back[:, 1], back[:, 0]])
    assert np.array_equal(turned.ids, upright.ids)
    assert np.abs(back - upright.corners_px).max() < 1e-3


def test_the_simulator_photographs_the_layout_that_is_asked_for() -> None:
    document = deepcopy(charuco_plan().document)
    document["board"] |= {"legacy_pattern": True, "views": 1}
    plan = plan_from_document(document, "plan.toml")
    assert plan.board is not None
    assert plan.board.document["legacy_pattern"] is True
    picture, _ = next(board_views(plan))
    assert len(find_board(picture, replace(CHARUCO, is_legacy_pattern=True)).ids) > 50
    with pytest.raises(DetectionError, match="set legacy_pattern = true"):
        find_board(picture, CHARUCO)


def drawn(board: BoardSpec) -> np.ndarray:
    """A picture of the board as OpenCV draws it, a little blurred."""
    assert board.marker_mm is not None
    assert board.dictionary is not None
    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, board.dictionary))
    layout = cv2.aruco.CharucoBoard(board.squares, board.square_mm, board.marker_mm, dictionary)
    layout.setLegacyPattern(board.is_legacy_pattern)
    columns, rows = board.squares
    flat = layout.generateImage((60 * columns, 60 * rows), marginSize=0)
    return cv2.GaussianBlur(cv2.copyMakeBorder(flat, 40, 40, 40, 40, cv2.BORDER_CONSTANT, value=255), (0, 0), 1.0)


@pytest.mark.parametrize("is_legacy", [False, True])
@pytest.mark.parametrize("squares", [(6, 8), (7, 5), (5, 6)])
def test_half_pixels(squares: tuple[int, int], is_legacy: bool) -> None:
    board = BoardSpec("charuco", squares, 20.0, 15.0, "DICT_5X5_100", is_legacy)
    sighting = find_board(drawn(board), board)
    assert len(sighting.ids) == (squares[0] - 1) * (squares[1] - 1)
    # Squares of 60 px after a margin of 40: edges lie between pixels 99 and 100, at 99.5.
    u, v = np.meshgrid(np.arange(1, squares[0]) * 60 + 39.5, np.arange(1, squares[1]) * 60 + 39.5)
    assert np.abs(sighting.corners_px - np.column_stack([u.ravel(), v.ravel()])).max() < 0.01


def test_a_legacy_board_is_not_taken_for_a_present_one() -> None:
    legacy = BoardSpec("charuco", (6, 8), 20.0, 15.0, "DICT_5X5_100", True)
    present = replace(legacy, is_legacy_pattern=False)
    with pytest.raises(DetectionError, match=r"do not lie as on this board.*: set legacy_pattern = true"):
        find_board(drawn(legacy), present)
    with pytest.raises(DetectionError, match=r"do not lie as on this board.*: leave legacy_pattern out"):
        find_board(drawn(present), legacy)
    with pytest.raises(DetectionError, match=r"do not lie as on this board: check squares and dictionary$"):
        find_board(drawn(present)[::-1].copy()[:, ::-1].copy(), replace(present, squares=(8, 9)))


@pytest.mark.parametrize("is_legacy", [False, True])
@pytest.mark.parametrize("squares", [(6, 8), (7, 5), (14, 10)])
def test_numbers_of_squares_that_are_exchanged_are_told(squares: tuple[int, int], is_legacy: bool) -> None:
    board = BoardSpec("charuco", squares, 20.0, 15.0, "DICT_5X5_100", is_legacy)
    stated = replace(board, squares=(squares[1], squares[0]))
    with pytest.raises(
        DetectionError, match=rf"do not lie as on .*: they lie as on one of {squares[0]} × {squares[1]} "
    ):
        find_board(drawn(board), stated)
    assert hint_for_unseen_board(drawn(board), stated) == (
        f"the board fits with its two numbers exchanged: write squares = [{squares[0]}, {squares[1]}]"
    )
    assert hint_for_unseen_board(drawn(board), replace(board, squares=(squares[0] - 1, squares[1]))) is None


def test_corners_that_could_not_be_fitted_leave_the_markers_their_size() -> None:
    """A dark spot on a corner has no pixels to give: the markers' side came out as 0.00 of the squares'."""
    board = BoardSpec("charuco", (6, 8), 20.0, 15.0, "DICT_5X5_100")
    picture = drawn(board)
    whole = find_board(picture, board)
    assert whole.marker_of_square == pytest.approx(0.75, abs=0.03)
    # Squares of 60 px after a margin of 40: the third corner of the third row.
    cv2.circle(picture, (220, 220), 14, 120, -1)
    spotted = find_board(picture, board)
    assert len(spotted.ids) < len(whole.ids)
    assert spotted.marker_of_square == pytest.approx(0.75, abs=0.03)


def test_wrong_boards_are_refused_with_what_is_seen() -> None:
    board = BoardSpec("charuco", (3, 4), 20.0, 15.0, "DICT_5X5_100")
    other = replace(board, dictionary="DICT_6X6_250")
    with pytest.raises(DetectionError, match="no marker of DICT_6X6_250 is seen"):
        find_board(drawn(board), other)
    hint = hint_for_unseen_board(drawn(board), other)
    assert hint is not None
    assert "6 markers of DICT_5X5_" in hint
    assert hint_for_unseen_board(np.full((300, 300), 200, dtype=np.uint8), other) is None


def test_a_mirror_image_is_told_as_such() -> None:
    board = BoardSpec("charuco", (6, 8), 20.0, 15.0, "DICT_5X5_100")
    flipped = drawn(board)[:, ::-1].copy()
    with pytest.raises(DetectionError, match="the board was not found"):
        find_board(flipped, board)
    hint = hint_for_unseen_board(flipped, board)
    assert hint is not None
    assert "mirror images" in hint


def test_corners_counted_for_squares_are_recognised() -> None:
    picture, _ = next(board_views(chessboard_plan()))
    wrong = replace(CHESSBOARD, squares=(11, 8))
    with pytest.raises(DetectionError, match="no 10 × 7 inner corners"):
        find_board(picture[::2, ::2].copy(), wrong)
    assert hint_for_unseen_board(picture, wrong) == (
        "a chessboard of 12 × 9 squares is seen: squares counts squares, not corners"
    )


@pytest.mark.parametrize("seen_px", [140, 150, 160, 170, 180, 190, 200, 220])
def test_a_corner_of_a_board_that_is_cut_off_is_counted_or_refused(seen_px: int) -> None:
    """One, two, three corners tell no homography, which OpenCV says in its own way."""
    board = BoardSpec("charuco", (6, 8), 20.0, 15.0, "DICT_5X5_100")
    cut = np.ascontiguousarray(drawn(board)[:seen_px, :seen_px])
    with pytest.raises(DetectionError, match=r"only \d of the board's 35 corners were found|the board was not found"):
        find_board(cut, board)


def test_an_empty_picture() -> None:
    grey = np.full((480, 640), 128, dtype=np.uint8)
    for board in (CHARUCO, CHESSBOARD):
        with pytest.raises(DetectionError, match="the board was not found"):
            find_board(grey, board)


@pytest.mark.parametrize(("squares", "n_turns"), [((10, 7), 1), ((9, 7), 2), ((10, 8), 2), ((7, 7), 4), ((8, 8), 2)])
def test_numberings_under_which_a_chessboard_looks_the_same(squares: tuple[int, int], n_turns: int) -> None:
    board = BoardSpec("chessboard", squares, 10.0)
    layout = board.layout()
    renumberings = same_colours(board)
    assert len(renumberings) == n_turns
    white = layout.pattern.white
    for numbers in renumberings:
        old, new = layout.corners_mm - layout.corners_mm.mean(axis=0), layout.corners_mm[numbers]
        new = new - new.mean(axis=0)
        spin = np.linalg.lstsq(old, new, rcond=None)[0]
        # A rigid turn, not a mirror, that maps black squares on black ones.
        assert np.allclose(spin @ spin.T, np.eye(2))
        assert np.allclose(old @ spin, new)
        assert np.linalg.det(spin) == pytest.approx(1.0)
        quarter = round(np.arctan2(spin[0, 1], spin[0, 0]) / (0.5 * np.pi)) % 4
        assert np.array_equal(np.rot90(white, quarter), white)
    assert len(same_colours(CHARUCO)) == 1
