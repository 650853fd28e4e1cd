"""Calibration of whole sessions: simulated truth, real pictures, bad pictures, scale bars, the command."""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import polars as pl
import pytest
import tomli_w
import typer
from board_scenes import IMAGE_SIZE, board_mm, drawn_views, known_rig
from typer.testing import CliRunner

from geoerr.cli import calibrate as verb
from geoerr.errors import DetectionError, InputFileError, ShapeError
from geoerr.files import read_json, read_toml
from geoerr.simulate.nine_lines import NineLines, nine_line_plan
from geoerr.simulate.session import simulate_session
from geoerr.vision.calibrate import Calibration, calibrate, calibrate_from_corners
from geoerr.vision.camera import parameters_of
from geoerr.vision.rig import Rig, RightFromLeft, read_rig
from geoerr.vision.sensitivity import points_from_pixels, project_to_both
from geoerr.vision.session import read_session

N_VIEWS = 6


@pytest.fixture(scope="module")
def simulated(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("simulated") / "session"
    setting = NineLines(n_points=2, both_directions=False, image_size_px=IMAGE_SIZE, board_views=N_VIEWS)
    simulate_session(nine_line_plan(setting), folder)
    return folder


@pytest.fixture(scope="module")
def progress() -> list[tuple[int, int]]:
    """What the calibration of the fixture told while it ran."""
    return []


@pytest.fixture(scope="module")
def calibration(simulated: Path, progress: list[tuple[int, int]]) -> Calibration:
    return calibrate(read_session(simulated), threads=1, progress=lambda done, total: progress.append((done, total)))


@pytest.fixture
def session(simulated: Path, tmp_path: Path) -> Path:
    """A copy to spoil."""
    return Path(shutil.copytree(simulated, tmp_path / "session"))


def true_rig(folder: Path) -> Rig:
    rig = read_json(folder / "truth.json")["rig"]
    pose = rig["right_from_left"]
    return Rig(
        *(np.array(rig[key]) for key in ("K_left", "dist_left", "K_right", "dist_right")),
        RightFromLeft(np.array(pose["R"]), np.array(pose["t_mm"])),
        (rig["image_size"][0], rig["image_size"][1]),
    )


def change(rig: Rig, truth: Rig) -> np.ndarray:
    turn = rig.right_from_left.R @ truth.right_from_left.R.T
    small = 0.5 * np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
    return np.concatenate(
        [
            parameters_of(rig.left) - parameters_of(truth.left),
            parameters_of(rig.right) - parameters_of(truth.right),
            small,
            rig.right_from_left.t_mm - truth.right_from_left.t_mm,
        ]
    )


def edit(folder: Path, change: Callable[[dict], None]) -> None:
    document = read_toml(folder / "session.toml")
    change(document)
    (folder / "session.toml").write_text(tomli_w.dumps(document))


def test_what_is_no_number_of_threads_is_refused(simulated: Path) -> None:
    with pytest.raises(ShapeError, match=r"^threads is -1\nhint: write a whole number"):
        calibrate(read_session(simulated), threads=-1)


def test_the_simulated_rig_is_found(simulated: Path, calibration: Calibration) -> None:
    truth = true_rig(simulated)
    assert calibration.pairs_used == N_VIEWS
    assert calibration.pairs_dropped == ()
    assert calibration.notes == ()
    off = change(calibration.rig, truth)
    # χ² of 24 degrees of freedom: above 52 once in a thousand.
    assert off @ np.linalg.solve(calibration.rig.covariance, off) < 52.0
    # Corners are known to under a hundredth of a pixel (test_boards.py).
    assert calibration.stereo_rms_px < 0.015
    assert calibration.held_out_rms_px is not None
    assert calibration.held_out_rms_px < 0.02
    assert calibration.rig.image_size == IMAGE_SIZE


def test_its_views_are_drawn_in_one_call(calibration: Calibration) -> None:
    figure = calibration.plot_views()
    left = [view.left_rms_px for view in calibration.per_view]
    assert any(len(bars.y) >= len(left) and np.allclose(bars.y[: len(left)], left) for bars in figure.data)


def test_a_volume_keeps_its_shape(simulated: Path, calibration: Calibration) -> None:
    """Points seen through the true rig, measured with the found one, after a rigid fit."""
    truth = true_rig(simulated)
    base = read_json(simulated / "truth.json")["rig"]["base_from_left"]
    grid = np.stack(np.meshgrid(*[np.linspace(50.0, 350.0, 4)] * 3), axis=-1).reshape(-1, 3) - [0.0, 0.0, 200.0]
    points = (grid - base["t_mm"]) @ np.array(base["R"])
    found = points_from_pixels(calibration.rig, project_to_both(truth, points).pixel)
    true_part, found_part = points - points.mean(axis=0), found - found.mean(axis=0)
    u, _, vt = np.linalg.svd(found_part.T @ true_part)
    rest_um = 1e3 * (found_part - true_part @ (u @ vt).T)
    # Six views of 5-µm-a-hundredth-pixel corners: measured 1 to 3 µm over 300 mm; 24 large pictures give 0.6 µm.
    assert np.sqrt((rest_um**2).sum(axis=1).mean()) < 6.0


def test_the_number_of_threads_changes_nothing(simulated: Path, calibration: Calibration) -> None:
    """One in the fixture, all cores in the command's test."""
    again = calibrate(read_session(simulated), threads=8)
    assert again.to_document() == calibration.to_document()
    assert np.array_equal(again.rig.covariance, calibration.rig.covariance)


@pytest.mark.usefixtures("calibration")
def test_progress_counts_pairs(progress: list[tuple[int, int]]) -> None:
    assert progress == [(done, N_VIEWS) for done in range(1, N_VIEWS + 1)]


def test_bad_pictures_drop_their_pairs_with_the_reason(session: Path) -> None:
    left, right = session / "calibration" / "left", session / "calibration" / "right"
    content = (left / "01.png").read_bytes()
    (left / "01.png").write_bytes(content[: len(content) // 2])
    (right / "02.png").write_bytes(b"not a picture at all")
    cv2.imwrite(str(left / "03.png"), np.full((IMAGE_SIZE[1], IMAGE_SIZE[0]), 90, dtype=np.uint8))
    (left / "07.png").write_bytes(content)
    calibrated = calibrate(read_session(session))
    reasons = {item.name: item.why for item in calibrated.pairs_dropped}
    assert calibrated.pairs_used == N_VIEWS - 3
    assert set(reasons) == {"01.png", "02.png", "03.png", "left/07.png"}
    assert reasons["01.png"].startswith("left: the picture is truncated")
    assert reasons["02.png"].startswith("right: not a picture")
    assert reasons["03.png"] == "left: the board was not found: no marker of DICT_5X5_100 is seen"
    assert reasons["left/07.png"] == "the right folder has no picture of this name"


def test_a_picture_of_floats_drops_its_pair(session: Path) -> None:
    """It had ended the calibration with an error of Python."""
    right = session / "calibration" / "right"
    grey = cv2.imread(str(right / "04.png"), cv2.IMREAD_GRAYSCALE)
    (right / "04.png").write_bytes(cv2.imencode(".tif", grey.astype(np.float32))[1].tobytes())
    calibrated = calibrate(read_session(session))
    assert [item.name for item in calibrated.pairs_dropped] == ["04.png"]
    assert calibrated.pairs_dropped[0].why.startswith("right: its values are floating-point numbers of 32 bits")


def test_one_picture_of_another_size_drops_its_pair(session: Path) -> None:
    path = session / "calibration" / "right" / "04.png"
    cv2.imwrite(str(path), cv2.imread(str(path))[:-8])
    calibrated = calibrate(read_session(session))
    assert [(item.name, item.why) for item in calibrated.pairs_dropped] == [
        ("04.png", "right: 1224 × 1016 px, the others 1224 × 1024 px")
    ]


def test_cameras_of_different_size_are_refused(session: Path) -> None:
    for path in (session / "calibration" / "right").iterdir():
        cv2.imwrite(str(path), cv2.imread(str(path))[:-8])
    with pytest.raises(InputFileError, match=r"left pictures are 1224 × 1024 px, right pictures 1224 × 1016 px"):
        calibrate(read_session(session))


def test_exchanged_pictures_of_one_pair_are_named(session: Path) -> None:
    left, right = (session / "calibration" / side / "05.png" for side in ("left", "right"))
    left.rename(session / "other.png")
    right.rename(left)
    (session / "other.png").rename(right)
    calibrated = calibrate(read_session(session))
    assert [(item.name, item.why) for item in calibrated.pairs_dropped] == [
        ("05.png", "left and right pictures are exchanged")
    ]


def test_exchanged_folders_are_noted(session: Path) -> None:
    folder = session / "calibration"
    (folder / "left").rename(folder / "other")
    (folder / "right").rename(folder / "left")
    (folder / "other").rename(folder / "right")
    calibrated = calibrate(read_session(session))
    assert calibrated.pairs_used == N_VIEWS
    assert any("the right camera stands on the left camera's left" in text for text in calibrated.notes)


def test_the_wrong_dictionary_is_named(session: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # Which dictionaries are tried for the hint is tested with boards.
    monkeypatch.setattr("geoerr.vision.markers.dictionary_names", lambda: ("DICT_4X4_50", "DICT_5X5_100"))
    # Pictures in which nothing is found take the longest: three pairs are enough.
    for path in session.glob("calibration/*/0[456].png"):
        path.unlink()
    edit(session, lambda document: document["board"].update(dictionary="DICT_6X6_250"))
    with pytest.raises(DetectionError) as caught:
        calibrate(read_session(session))
    text = str(caught.value)
    assert "both cameras see the board in 0 of 3 pairs, 3 are needed" in text
    assert "01.png: left: the board was not found: no marker of DICT_6X6_250 is seen; right: the board" in text
    assert "hint: the pictures show" in text
    assert "markers of DICT_5X5_" in text


def test_exchanged_numbers_of_squares_are_told(session: Path) -> None:
    for path in session.glob("calibration/*/0[456].png"):
        path.unlink()
    edit(session, lambda document: document["board"].update(squares=[10, 14]))
    with pytest.raises(DetectionError, match=r"they lie as on one of 14 × 10 squares") as caught:
        calibrate(read_session(session))
    assert str(caught.value).endswith("hint: the board fits with its two numbers exchanged: write squares = [14, 10]")


@pytest.mark.parametrize("side", ["left", "right"])
def test_one_camera_whose_pictures_are_mirrored_is_named(
    session: Path, monkeypatch: pytest.MonkeyPatch, side: str
) -> None:
    monkeypatch.setattr("geoerr.vision.markers.dictionary_names", lambda: ("DICT_4X4_50", "DICT_5X5_100"))
    for path in session.glob("calibration/*/0[456].png"):
        path.unlink()
    for path in (session / "calibration" / side).iterdir():
        cv2.imwrite(str(path), cv2.imread(str(path))[:, ::-1])
    with pytest.raises(DetectionError, match=f"hint: the {side} camera: the pictures are mirror images"):
        calibrate(read_session(session))


def write_faint(path: Path) -> None:
    """As a camera of 12 bits writes into 16, not shifted up."""
    cv2.imwrite(str(path), cv2.imread(str(path), cv2.IMREAD_GRAYSCALE).astype(np.uint16) * 16)


@pytest.mark.parametrize("n_spoiled", [N_VIEWS, N_VIEWS - 1])
def test_pictures_that_all_fail_alike_are_told_what_helps(session: Path, n_spoiled: int) -> None:
    for number in range(n_spoiled):
        write_faint(session / "calibration" / "right" / f"{number + 1:02d}.png")
    with pytest.raises((InputFileError, DetectionError)) as caught:
        calibrate(read_session(session))
    assert str(caught.value).endswith(
        "hint: write values left-aligned: those of 12 bits times 16, those of 10 bits times 64"
    )


def test_too_few_views_say_which_camera_saw_what(session: Path) -> None:
    right = session / "calibration" / "right"
    for name in ("01", "02", "03", "04"):
        cv2.imwrite(str(right / f"{name}.png"), np.full((IMAGE_SIZE[1], IMAGE_SIZE[0]), 90, dtype=np.uint8))
    with pytest.raises(DetectionError) as caught:
        calibrate(read_session(session))
    text = str(caught.value)
    assert f"in 2 of {N_VIEWS} pairs, 3 are needed; the left camera sees it in 6, the right one in 2" in text
    assert "04.png: right: the board was not found" in text


def test_a_session_without_board_is_refused(session: Path) -> None:
    edit(session, lambda document: document.pop("board"))
    with pytest.raises(InputFileError, match=r"session\.toml: board: is missing"):
        calibrate(read_session(session))


def scale_bar(folder: Path, length_mm: float, *pictures: str) -> Path:
    """Name a bar of targets 0 and 1 in each of some pictures."""

    def add(document: dict) -> None:
        document["scale_bars"] = [
            {
                "left": f"frames/left/{name}",
                "right": f"frames/right/{name}",
                "targets": [["DICT_4X4_50", 0], ["DICT_4X4_50", 1]],
                "length_mm": length_mm,
                "std_mm": 0.002,
            }
            for name in pictures
        ]

    edit(folder, add)
    return folder


def test_a_scale_bar_agrees_and_one_that_is_not_seen_is_listed(session: Path) -> None:
    # Plates 0 and 1 stand 200 mm apart on the tool; a rigid body keeps that whatever the machine's errors.
    (session / "frames" / "right" / "0002.png").unlink()
    calibrated = calibrate(read_session(scale_bar(session, 200.0, "0001.png", "0002.png")))
    bar, unseen = calibrated.scale_bars
    assert bar.why == ""
    assert bar.sigmas is not None
    assert bar.difference_um is not None
    assert abs(bar.sigmas) < 4.0
    assert abs(bar.difference_um) < 20.0
    assert bar.seen_std_mm is not None
    assert 0.0005 < bar.seen_std_mm < 0.02
    assert unseen.seen_mm is None
    assert "no such picture" in unseen.why
    # The one that agrees is worth no note.
    assert len(calibrated.notes) == 1
    assert "no such picture" in calibrated.notes[0]
    assert json.dumps(calibrated.to_document(), allow_nan=False)


def test_a_scale_bar_of_two_moments_is_no_length(session: Path) -> None:
    """The machine moved between the pictures: what they show together stands nowhere."""
    folder = scale_bar(session, 200.0, "0001.png")
    edit(folder, lambda document: document["scale_bars"][0].update(right="frames/right/0002.png"))
    calibrated = calibrate(read_session(folder))
    (bar,) = calibrated.scale_bars
    assert bar.seen_mm is None
    assert "its two pictures miss each other by" in bar.why
    (text,) = calibrated.notes
    assert "was not seen: its two pictures miss each other by" in text
    assert "square_mm" not in text


def test_a_scale_bar_tells_a_wrong_square(session: Path) -> None:
    edit(session, lambda document: document["board"].update(square_mm=25.1, marker_mm=18.072))
    calibrated = calibrate(read_session(scale_bar(session, 200.0, "0001.png")))
    bar = calibrated.scale_bars[0]
    assert bar.difference_ppm is not None
    # 0.1 mm in 25 mm.
    assert bar.difference_ppm == pytest.approx(4000.0, abs=100.0)
    assert any("the board's square_mm or the bar's length_mm is wrong" in text for text in calibrated.notes)


def corners(n_views: int = 6) -> tuple[list[np.ndarray], list[np.ndarray], list[np.ndarray]]:
    views = drawn_views(known_rig(), n_views, 0.05, np.random.default_rng(1))
    return (
        [view.left.board_mm for view in views],
        [view.left.pixel for view in views],
        [view.right.pixel for view in views],
    )


@pytest.mark.parametrize(("stated_mm", "is_told"), [(12.0, True), (18.0, False)])
def test_markers_of_another_size_are_told(session: Path, stated_mm: float, is_told: bool) -> None:
    """12 mm for 18 doubled the residuals without a word."""
    edit(session, lambda document: document["board"].update(marker_mm=stated_mm))
    told = [note for note in calibrate(read_session(session), threads=1).notes if "marker_mm" in note]
    assert bool(told) == is_told
    if told:
        # In small pictures a detector's outlines lie some hundredths inside: 0.72 is true.
        found = re.match(r"the board's markers are (0\.\d+) of its squares in the pictures, and 0\.48 by", told[0])
        assert found is not None
        assert float(found[1]) == pytest.approx(0.72, abs=0.04)


def test_corners_from_elsewhere() -> None:
    boards, left, right = corners()
    right[2][3:6] = np.nan
    left[4][:50] = np.nan
    calibrated = calibrate_from_corners(boards, left, right, IMAGE_SIZE, names=list("abcdef"))
    assert [(item.name, item.why) for item in calibrated.pairs_dropped] == [
        ("e", "left: fewer than 6 corners, or all in one line")
    ]
    assert [view.n_right for view in calibrated.per_view] == [54, 54, 51, 54, 54]
    off = change(calibrated.rig, known_rig())
    assert off @ np.linalg.solve(calibrated.rig.covariance, off) < 52.0
    # OpenCV's shapes, and boards without z.
    again = calibrate_from_corners(
        [board[:, :2] for board in boards], [px[:, None] for px in left], right, IMAGE_SIZE, names=list("abcdef")
    )
    assert np.array_equal(again.rig.K_left, calibrated.rig.K_left)


def test_masked_corners_were_not_seen() -> None:
    """NumPy forgets a mask without a word, and the number beneath was a corner."""
    boards, left, right = corners()
    right[2][3:6] = np.nan
    expected = calibrate_from_corners(boards, left, right, IMAGE_SIZE)
    beneath = np.where(np.isnan(right[2]), 500.0, right[2])
    right[2] = np.ma.masked_array(beneath, mask=np.isnan(right[2]))
    found = calibrate_from_corners(boards, left, right, IMAGE_SIZE)
    assert found.to_document() == expected.to_document()
    right[2] = np.ma.masked_array(np.round(beneath).astype(int), mask=right[2].mask)
    with pytest.raises(ShapeError, match="view 3: the array of pixels is a masked array of int64"):
        calibrate_from_corners(boards, left, right, IMAGE_SIZE)


def upside_down(pixels: list[np.ndarray]) -> list[np.ndarray]:
    return [np.array(IMAGE_SIZE) - 1.0 - px for px in pixels]


@pytest.mark.parametrize("is_turned", [False, True])
@pytest.mark.parametrize("is_exchanged", [False, True])
def test_exchanged_cameras_are_noted_also_of_one_that_is_upside_down(is_exchanged: bool, is_turned: bool) -> None:
    """The right camera's own axes say nothing of which side of the left one it stands on."""
    boards, left, right = corners()
    if is_exchanged:
        left, right = right, left
    if is_turned:
        right = upside_down(right)
    notes = calibrate_from_corners(boards, left, right, IMAGE_SIZE).notes
    assert any("the right camera stands on the left camera's left" in text for text in notes) == is_exchanged


@pytest.mark.parametrize("size", [(1024, 1224, 3), (1224,), 1224, (1224, 0), (1224.5, 1024)])
def test_what_is_no_size_of_pictures_is_refused(size: Any) -> None:
    """An array's shape has the height first, and the number of colours."""
    with pytest.raises(
        ShapeError, match=r"^image_size is .*\nhint: image_size is \(width, height\), of .*shape\[1::-1\]"
    ):
        calibrate_from_corners(*corners(), size)


def test_corners_outside_the_stated_picture_are_refused() -> None:
    boards, left, right = corners()
    left[0][0] = [1220.0, 300.0]
    exchanged = (IMAGE_SIZE[1], IMAGE_SIZE[0])
    with pytest.raises(
        ShapeError, match=r"outside a picture of 1024 × 1224 px\nhint: image_size is \(width, height\)"
    ):
        calibrate_from_corners(boards, left, right, exchanged)
    right[1][7] = [-5.0, 300.0]
    with pytest.raises(ShapeError, match=r"^view 2, right: a corner at \(-5\.0, 300\.0\) px is outside"):
        calibrate_from_corners(boards, left, right, IMAGE_SIZE)


def test_views_that_come_again_are_no_more_views() -> None:
    """Copies of pictures made what is known from six views look as if it were known from more."""
    boards, left, right = corners()
    once = calibrate_from_corners(boards, left, right, IMAGE_SIZE)
    again = calibrate_from_corners(
        [*boards, *boards[:3]],
        [*left, left[0], left[1], right[2]],
        [*right, right[0], right[1] + 0.01, left[2]],
        IMAGE_SIZE,
        names=list("abcdefghi"),
    )
    assert np.array_equal(again.rig.covariance, once.rig.covariance)
    assert [(item.name, item.why) for item in again.pairs_dropped] == [
        ("g", "the left picture is the left one of a again; the right picture is the right one of a again"),
        ("h", "the left picture is the left one of b again"),
        ("i", "the left picture is the right one of c again; the right picture is the left one of c again"),
    ]
    with pytest.raises(
        DetectionError, match="0 of 6 views can be used, 3 are needed\n  1: left and right are one pic"
    ):
        calibrate_from_corners(boards, left, left, IMAGE_SIZE)


def test_a_copied_board_picture_drops_its_pair(session: Path) -> None:
    for side in ("left", "right"):
        folder = session / "calibration" / side
        for name in ("04", "05", "06"):
            (folder / f"{name}.png").unlink()
        # Of the same pixels in another file: what a viewer saved again.
        cv2.imwrite(str(folder / "copy.tif"), cv2.imread(str(folder / "02.png"), cv2.IMREAD_GRAYSCALE))
    calibrated = calibrate(read_session(session))
    assert calibrated.pairs_used == 3
    assert [item.name for item in calibrated.pairs_dropped] == ["copy.tif"]
    assert calibrated.pairs_dropped[0].why.startswith("the left picture is the left one of 02.png again; the right")


def test_corners_that_do_not_fit_together_are_refused() -> None:
    boards, left, right = corners(4)
    with pytest.raises(ShapeError, match="4 boards, 3 left and 4 right views"):
        calibrate_from_corners(boards, left[:3], right, IMAGE_SIZE)
    with pytest.raises(ShapeError, match="view 1: 54 board points, 53 pixels"):
        calibrate_from_corners(boards, [left[0][1:], *left[1:]], right, IMAGE_SIZE)
    with pytest.raises(ShapeError, match="4 views, 1 names"):
        calibrate_from_corners(boards, left, right, IMAGE_SIZE, names=["a"])
    bent = boards[1] + np.array([0.0, 0.0, 1.0]) * np.arange(54)[:, None]
    with pytest.raises(ShapeError, match="view 2: the board is not flat"):
        calibrate_from_corners([boards[0], bent, *boards[2:]], left, right, IMAGE_SIZE)
    with pytest.raises(ShapeError, match="view 1: board points are finite"):
        calibrate_from_corners([board_mm() * np.nan, *boards[1:]], left, right, IMAGE_SIZE)
    blind = [np.full((54, 2), np.nan)] * 2
    with pytest.raises(DetectionError, match="2 of 4 views can be used, 3 are needed\n  1: left: fewer"):
        calibrate_from_corners(boards, [*blind, *left[2:]], right, IMAGE_SIZE)


def test_cameras_that_disagree_are_noted() -> None:
    """A board that moves by half a pixel's worth between the two shutters, each time another way."""
    boards, left, right = corners(10)
    rng = np.random.default_rng(2)
    moved = [pixel + rng.normal(0.0, 1.0, 2) for pixel in right]
    calibrated = calibrate_from_corners(boards, left, moved, IMAGE_SIZE)
    assert calibrated.stereo_rms_px > 3.0 * max(calibrated.left_rms_px, calibrated.right_rms_px)
    assert any("the two cameras disagree although each alone fits" in text for text in calibrated.notes)


def test_a_bowed_board_is_told_with_what_its_widening_leaves_out() -> None:
    bowed = board_mm()
    bowed[:, 2] = 1.0 * np.sin(bowed[:, 0] / 60.0) * np.cos(bowed[:, 1] / 50.0)
    views = drawn_views(known_rig(), 10, 0.01, np.random.default_rng(8), bowed)
    pixels = ([view.left.pixel for view in views], [view.right.pixel for view in views])
    calibrated = calibrate_from_corners([board_mm()] * 10, *pixels, IMAGE_SIZE)
    (text,) = [text for text in calibrated.notes if "board that is not flat" in text]
    assert "widened by that factor, which is the least" in text


@pytest.fixture
def app() -> typer.Typer:
    app = typer.Typer()
    verb.register(app)
    app.command("other")(lambda: None)
    return app


def test_the_command(
    session: Path, app: typer.Typer, calibration: Calibration, monkeypatch: pytest.MonkeyPatch
) -> None:
    output = session / "rig.json"
    asked = CliRunner().invoke(app, ["calibrate", str(session), "-o", str(output), "--json", "--quiet"])
    assert asked.exit_code == 0, asked.output
    assert np.array_equal(read_rig(output).covariance, calibration.rig.covariance)
    document = json.loads(asked.stdout)
    assert list(document.pop("provenance")["inputs"]) == [str(session / "session.toml")]
    assert document == calibration.to_document()
    assert list(document)[:8] == [
        "pairs_used",
        "pairs_dropped",
        "left_rms_px",
        "right_rms_px",
        "stereo_rms_px",
        "held_out_rms_px",
        "baseline_mm",
        "baseline_std_mm",
    ]
    assert document["pairs_used"] == N_VIEWS
    assert document["baseline_mm"] == pytest.approx(300.0, abs=0.05)
    # What it says of the same calibration, without the work done again.
    monkeypatch.setattr("geoerr.vision.calibrate.calibrate", lambda *_, **__: calibration)
    result = CliRunner().invoke(app, ["calibrate", str(session), "-o", str(output)])
    assert result.exit_code == 0, result.output
    assert "6 of 6 pairs used" in result.stdout
    assert max(len(line) for line in result.stdout.splitlines()) <= 80


def test_the_command_never_writes_over_its_input(session: Path, app: typer.Typer) -> None:
    before = (session / "session.toml").read_bytes()
    result = CliRunner().invoke(app, ["calibrate", str(session), "-o", str(session / "session.toml")])
    assert isinstance(result.exception, InputFileError)
    assert (session / "session.toml").read_bytes() == before


@pytest.mark.real_data
def test_thirteen_real_pairs(real_data: Path) -> None:
    calibrated = calibrate(read_session(real_data / "stereo"))
    assert calibrated.pairs_used == 13
    assert calibrated.pairs_dropped == ()
    assert calibrated.stereo_rms_px <= 0.22
    # Published for these pictures with OpenCV's own corners: 0.195 and 0.207 px alone, 3.33 squares, f 533 px.
    assert calibrated.left_rms_px <= 0.195
    assert calibrated.right_rms_px <= 0.207
    assert calibrated.rig.baseline_mm == pytest.approx(3.33, abs=0.01)
    assert calibrated.rig.K_left[0, 0] == pytest.approx(533.0, abs=3.0)


@pytest.mark.real_data
def test_two_real_cameras_that_are_out_of_step(real_data: Path) -> None:
    table = pl.read_csv(real_data / "stereo" / "charuco_corners_two_cameras.csv")
    moments = table.partition_by("sync_index", maintain_order=True)
    calibrated = calibrate_from_corners(
        [1e3 * moment.select("obj_x_m", "obj_y_m").to_numpy() for moment in moments],
        [moment.select("u0_px", "v0_px").to_numpy() for moment in moments],
        [moment.select("u1_px", "v1_px").to_numpy() for moment in moments],
        (1280, 720),
    )
    assert calibrated.left_rms_px <= 0.17
    assert calibrated.right_rms_px <= 0.17
    assert calibrated.stereo_rms_px > 0.8
    assert calibrated.solved.lenses_held_rms_px == pytest.approx(1.1, abs=0.1)
    assert any("the cameras are not synchronised, or the board moved" in text for text in calibrated.notes)
