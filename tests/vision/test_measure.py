"""Sessions to observations: right, complete, honest about what is missing, the same for any number of threads."""

import os
import shutil
import threading
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import polars as pl
import pytest
import tomli_w
from rendering import as_picture, render
from stereo_scenes import (
    LEFT,
    RIGHT,
    SIZE,
    TARGETS,
    make_session,
    photograph,
    plates_at,
    rig,
    rig_covariance,
    right_of,
)

from geoerr.errors import InputFileError, ShapeError
from geoerr.observations import read_observations
from geoerr.vision import measure as measure_module
from geoerr.vision.frame import FrameResult
from geoerr.vision.images import read_grey, write_png
from geoerr.vision.measure import measure
from geoerr.vision.measured import write_measured
from geoerr.vision.rig import Rig, RightFromLeft
from geoerr.vision.session import read_session

NAMES = [f"{target['dictionary']}:{target['id']}" for target in TARGETS]


@pytest.fixture(scope="module")
def photographs(tmp_path_factory) -> tuple[Path, np.ndarray]:
    folder = tmp_path_factory.mktemp("photographs") / "session"
    return folder, make_session(folder)


@pytest.fixture
def session(photographs, tmp_path) -> Path:
    """A copy to spoil."""
    shutil.copytree(photographs[0], tmp_path / "session")
    return tmp_path / "session"


def run(folder, pair=None, **options):
    return measure(read_session(folder), pair or rig(rig_covariance()), **options)


def test_places_are_right_within_their_covariances(photographs):
    folder, truth = photographs
    measured = run(folder)
    found = measured.observations
    assert measured.missed == ()
    assert len(found) == truth.shape[0] * truth.shape[1]
    assert found.texts("target") == NAMES * truth.shape[0]
    error = found.measured_mm - truth.reshape(-1, 3)
    # Plates of 80 px at noise 1.5: about 0.006 px a corner, 0.003 px the centre: 2 µm across, 10 µm deep.
    assert np.abs(error[:, :2]).max() < 0.01
    assert np.abs(error[:, 2]).max() < 0.04
    normalised = np.einsum("ni,nij,nj->n", error, np.linalg.inv(found.covariance_mm2), error)
    assert 0.3 < normalised.mean() / 3 < 2.0
    assert measured.agreement.birge_ratio == pytest.approx(1.0, abs=0.3)
    for size, target in zip(measured.sizes, TARGETS, strict=True):
        assert size.measured_mm == pytest.approx(target["size_mm"], abs=0.01)
        assert size.n == truth.shape[0]
    assert measured.notes == ()
    assert measured.n_local_corners == 0


def test_pixels_lead_back_to_the_point(photographs):
    measured = run(photographs[0])
    shown = measured.observations.numbers("u_left", "v_left", "u_right", "v_right")
    points = measured.observations.measured_mm
    assert np.abs(LEFT.pixel(points) - shown[:, :2]).max() < 2e-6
    assert np.abs(RIGHT.pixel(right_of(points)) - shown[:, 2:]).max() < 2e-6


def test_what_frames_csv_and_session_toml_say_is_carried_through(photographs, tmp_path):
    measured = run(photographs[0])
    frame = measured.observations.frame
    assert frame["line"].unique().to_list() == ["X"]
    assert frame["carrier"].to_list()[:2] == ["tool", "work"]
    assert frame.select("tx", "ty", "tz").row(1) == (70.0, 0.0, 10.0)
    assert frame["load"].to_list()[:6] == [0.0, 0.0, None, None, 1.0, 1.0]
    assert frame["x"].to_list()[:4] == [0.0, 0.0, 12.0, 12.0]
    path = tmp_path / "observations.csv"
    write_measured(path, measured)
    again = read_observations(path)
    assert np.array_equal(again.measured_mm, measured.observations.measured_mm)
    assert np.array_equal(again.covariance_mm2, measured.observations.covariance_mm2)
    # Sessions are not named in frames.csv, so two such tables are two sessions.
    columns = pl.read_csv(path).columns
    assert "session" not in columns
    assert not {"left", "right", "file_row"} & set(columns)
    both = read_observations(path, path)
    assert sorted(set(both.texts("session"))) == ["0", "1"]


def test_what_is_no_number_of_threads_is_refused(photographs):
    with pytest.raises(ShapeError, match=r"^threads is -1\nhint: write a whole number"):
        run(photographs[0], threads=-1)


@pytest.mark.parametrize("threads", [2, 8])
def test_same_bytes_for_any_number_of_threads(photographs, tmp_path, threads):
    one, many = tmp_path / "one.csv", tmp_path / "many.csv"
    write_measured(one, run(photographs[0], threads=1))
    write_measured(many, run(photographs[0], threads=threads))
    assert one.read_bytes() == many.read_bytes()


def test_progress_counts_frames(photographs):
    seen = []
    run(photographs[0], progress=lambda done, total: seen.append((done, total)))
    assert seen == [(n, 5) for n in range(1, 6)]


def spoil_missing(path):
    path.unlink()


def spoil_truncated(path):
    path.write_bytes(path.read_bytes()[:-200])


def spoil_text(path):
    path.write_text("this is not a picture")


def spoil_empty(path):
    path.write_bytes(b"")


def spoil_size(path):
    write_png(path, read_grey(path)[:400, :600].copy())


def spoil_depth(path):
    path.write_bytes(cv2.imencode(".tif", read_grey(path).astype(np.float32))[1].tobytes())


@pytest.mark.parametrize(
    ("spoil", "why"),
    [
        (spoil_missing, "no such picture"),
        (spoil_truncated, "truncated"),
        (spoil_text, "not a picture"),
        (spoil_empty, "empty"),
        (spoil_depth, "floating-point numbers of 32 bits"),
        (spoil_size, "600 × 400 px, the rig's pictures are 640 × 480 px"),
    ],
)
@pytest.mark.parametrize("camera", ["left", "right"])
def test_a_bad_picture_is_listed_and_the_rest_goes_on(session, spoil, why, camera):
    spoil(session / camera / "2.png")
    measured = run(session)
    assert len(measured.observations) == 8
    (missed,) = measured.missed
    assert (missed.frame, missed.camera, missed.target) == ("left/2.png", camera, None)
    assert f"{camera}/2.png" in missed.why
    assert why in missed.why


def test_a_target_that_one_camera_does_not_see_is_listed(session):
    picture = read_grey(session / "right" / "1.png").copy()
    _, centres = plates_at(1)
    middle = RIGHT.pixel(right_of(centres)).mean(axis=0)
    picture[:, int(middle[0]) :] = 110
    write_png(session / "right" / "1.png", picture)
    measured = run(session)
    assert [(item.frame, item.camera) for item in measured.missed] == [("left/1.png", "right")]
    assert measured.missed[0].target == NAMES[1]
    assert measured.missed[0].why == "not found in the picture"
    assert len(measured.observations) == 9


def test_a_target_seen_twice_is_dropped_with_the_reason(session):
    twice = ({**TARGETS[0]}, {**TARGETS[1], "id": TARGETS[0]["id"], "size_mm": 45.0})
    plates, _ = plates_at(2, twice)
    for side, picture in zip(("left", "right"), photograph(plates, np.random.default_rng(0)), strict=True):
        write_png(session / side / "2.png", picture)
    missed = run(session).missed
    assert {item.frame for item in missed} == {"left/2.png"}
    reasons = {item.target: item.why for item in missed}
    assert "seen more than once" in reasons[NAMES[0]]
    assert reasons[NAMES[1]] == "not found in the picture"


def swap(session, text):
    path = session / "frames.csv"
    path.write_text(text(path.read_text()))


def test_swapped_cameras_are_recognised(session):
    swap(session, lambda text: text.replace("left,right", "right,left", 1))
    with pytest.raises(InputFileError, match="left and right look swapped") as caught:
        run(session)
    assert caught.value.path.endswith("frames.csv")
    assert "exchange" in caught.value.remedy


def test_one_swapped_frame_is_listed(session):
    swap(session, lambda text: text.replace("left/3.png,right/3.png", "right/3.png,left/3.png"))
    measured = run(session)
    assert len(measured.observations) == 8
    assert {(item.frame, item.why) for item in measured.missed} == {
        ("right/3.png", "left and right look swapped in this frame")
    }


def test_pictures_of_two_moments_are_an_outlier(session):
    swap(session, lambda text: text.replace("left/3.png,right/3.png", "left/3.png,right/0.png"))
    measured = run(session)
    assert len(measured.observations) == 8
    assert all("miss each other by" in item.why and item.frame == "left/3.png" for item in measured.missed)


def test_a_frame_that_is_listed_again_is_no_second_measurement(session):
    """A row that names the same files, and copies of them under other names."""
    once = run(session)
    for side in ("left", "right"):
        shutil.copyfile(session / side / "3.png", session / side / "copy.png")
    rows = "left/2.png,right/2.png,X,24.0,0,0,1,30\nleft/copy.png,right/copy.png,X,36.0,0,0,1,34\n"
    swap(session, lambda text: text + rows)
    measured = run(session)
    assert measured.observations.measured_mm.tolist() == once.observations.measured_mm.tolist()
    assert [(item.row, item.camera, item.target, item.why) for item in measured.missed] == [
        (5, "both", None, "its pictures are those of left/2.png (row 4) again"),
        (6, "both", None, "its pictures are those of left/3.png (row 5) again"),
    ]
    assert any(text.startswith("2 frames hold pictures of another frame and are not c") for text in measured.notes)


def test_pictures_that_two_positions_claim_are_of_neither(session):
    for side in ("left", "right"):
        shutil.copyfile(session / side / "3.png", session / side / "2.png")
    measured = run(session)
    assert measured.observations.frame["x"].unique().to_list() == [0.0, 12.0, 48.0]
    assert [(item.row, item.frame) for item in measured.missed] == [(2, "left/2.png"), (3, "left/3.png")]
    assert "those of left/3.png (row 5), too, and the positions differ" in measured.missed[0].why
    assert "those of left/2.png (row 4), too, and the positions differ" in measured.missed[1].why


def test_one_pair_of_pictures_for_all_positions_is_refused(session):
    for number in range(1, 5):
        for side in ("left", "right"):
            shutil.copyfile(session / side / "0.png", session / side / f"{number}.png")
    with pytest.raises(
        InputFileError, match=r"none of its 5 frames can be used; the first: its pictures are those of"
    ):
        run(session)


def test_another_rig_is_refused(session):
    pair = rig()
    moved = RightFromLeft(pair.right_from_left.R, pair.right_from_left.t_mm + np.array([0.0, 60.0, 0.0]))
    other = Rig(pair.K_left, pair.dist_left, pair.K_right, pair.dist_right, moved, pair.image_size)
    with pytest.raises(InputFileError, match="do not belong to this rig: points miss each other by"):
        run(session, other)


def test_a_rig_of_which_nothing_is_known_is_blamed_and_not_the_targets(session):
    """A focal length of 15 px, as pictures give that do not belong together."""
    pair = rig()
    wide = [np.array([[15.0, 0.0, 320.0], [0.0, 15.0, 240.0], [0.0, 0.0, 1.0]]), pair.dist_left] * 2
    with pytest.raises(InputFileError, match="left: targets are found, but none can be fitted") as caught:
        run(session, Rig(*wide, pair.right_from_left, pair.image_size))
    assert caught.value.path.endswith("frames.csv")
    assert "calibrate again" in caught.value.remedy


def test_a_camera_moved_a_little_is_noted(session):
    pair = rig(rig_covariance())
    change = np.zeros(24)
    change[18] = 30 * 3e-5
    measured = run(session, pair.changed_by(change))
    assert measured.agreement.rig_shift_sigmas > 3.0
    assert any("moved since calibration" in text for text in measured.notes)


def test_a_plate_that_shakes_is_named_where_it_widens_all(session):
    """The second plate stands 60 µm elsewhere when the right camera looks, each time another way."""
    for step in range(5):
        plates, _ = plates_at(step)
        rng = np.random.default_rng(step)
        left, _ = photograph(plates, rng)
        shaken = replace(plates[1], origin=plates[1].origin + np.array([0.0, 0.06 * (-1) ** step, 0.0]))
        _, right = photograph([plates[0], shaken], rng)
        write_png(session / "left" / f"{step}.png", left)
        write_png(session / "right" / f"{step}.png", right)
    measured = run(session)
    assert measured.missed == ()
    (text,) = [text for text in measured.notes if text.startswith("corners scatter")]
    assert f", those of {NAMES[1]} " in text
    assert "the covariances of all are enlarged" in text


def test_a_shadow_across_one_plate_is_its_own(session, photographs):
    """Half of one plate is a third darker in one picture: corners move by more than they state, of that row alone."""
    plain = run(photographs[0])
    path = session / "left" / "2.png"
    picture = read_grey(path).copy()
    column = round(float(plain.observations.numbers("u_left")[4, 0]))
    assert plain.observations.texts("target")[4] == NAMES[0]
    picture[:, column:] = np.round(0.67 * picture[:, column:]).astype(np.uint8)
    write_png(path, picture)
    measured = run(session)
    (text,) = measured.notes
    assert text.startswith("1 observation in uneven light: a shadow's edge or a reflection on the plate")
    assert f"most of all that of {NAMES[0]}, row 4 of frames.csv" in text
    # Its corners scatter less than its enlarged covariance says: it widens no other's.
    assert measured.agreement.birge_ratio < plain.agreement.birge_ratio + 0.01
    before, after = plain.observations.covariance_mm2, measured.observations.covariance_mm2
    assert np.trace(after[4]) > 4.0 * np.trace(before[4])
    # The other plate of that frame is darker as a whole.
    others = ~np.isin(np.arange(len(before)), (4, 5))
    assert after[others] == pytest.approx(before[others], rel=0.1)
    moved = measured.observations.measured_mm[4] - plain.observations.measured_mm[4]
    # An edge through the very middle, along a print's line: one of the worst.
    assert moved @ np.linalg.solve(after[4], moved) < 20.0
    assert moved @ np.linalg.solve(before[4], moved) > 500.0


def test_a_plate_that_contradicts_itself_is_named(session, photographs):
    """Half of one plate is a tenth of a pixel lower in one picture: light says nothing of it, its corners do."""
    plain = run(photographs[0])
    path = session / "left" / "2.png"
    picture = read_grey(path).astype(float)
    column = round(float(plain.observations.numbers("u_left")[4, 0]))
    lower = slice(column, column + 70)
    picture[1:, lower] = 0.9 * picture[1:, lower] + 0.1 * picture[:-1, lower]
    write_png(path, np.round(picture).astype(np.uint8))
    measured = run(session)
    (text,) = [text for text in measured.notes if "contradict each other far more" in text]
    assert (
        f"1 observation whose corners contradict each other far more than those of the others; the first: {NAMES[0]}"
        in text
    )
    assert "row 4 of frames.csv" in text
    assert np.trace(measured.observations.covariance_mm2[4]) > 4.0 * np.trace(plain.observations.covariance_mm2[4])


def test_the_wrong_dictionary_is_named(session):
    path = session / "session.toml"
    path.write_text(path.read_text().replace("DICT_4X4_50", "DICT_5X5_100"))
    with pytest.raises(InputFileError, match="the pictures show markers of DICT_4X4_50 ids 7, 9") as caught:
        run(session)
    assert caught.value.column == "targets"
    assert caught.value.path.endswith("session.toml")


def test_pictures_that_something_flips_are_told_as_such(session):
    # The other target's mirror image is itself, turned.
    (session / "session.toml").write_text(tomli_w.dumps({"targets": [TARGETS[0]]}))
    for side in ("left", "right"):
        for path in (session / side).iterdir():
            write_png(path, read_grey(path)[:, ::-1].copy())
    with pytest.raises(InputFileError, match=r"show the targets .* as in a mirror"):
        run(session)


def test_no_marker_at_all(session):
    for side in ("left", "right"):
        for path in (session / side).iterdir():
            write_png(path, as_picture(np.full((480, 640), 110.0), np.random.default_rng(0), 2.0))
    with pytest.raises(InputFileError, match="nor any other known marker"):
        run(session)


def test_one_camera_that_sees_nothing(session):
    for path in (session / "right").iterdir():
        write_png(path, as_picture(np.full((480, 640), 110.0), np.random.default_rng(0), 2.0))
    with pytest.raises(InputFileError, match=r"in both pictures of any of the 5 frames; the first: right: not found"):
        run(session)


def test_no_picture_can_be_read(session):
    shutil.rmtree(session / "right")
    with pytest.raises(InputFileError, match=r"none of its 5 frames can be used; the first: right/0\.png") as caught:
        run(session)
    assert caught.value.row == 2


def write_faint(path):
    """As a camera of 12 bits writes into 16, not shifted up."""
    picture = read_grey(path).astype(np.uint16) * 16
    cv2.imwrite(str(path), picture)


def test_pictures_that_all_fail_alike_are_told_what_helps(session):
    for side in ("left", "right"):
        for path in (session / side).iterdir():
            write_faint(path)
    with pytest.raises(InputFileError, match=r"none of its 5 frames can be used.* 16-bit") as caught:
        run(session)
    assert caught.value.remedy == "write values left-aligned: those of 12 bits times 16, those of 10 bits times 64"


def test_pictures_that_fail_for_several_reasons_have_the_general_hint(session):
    for path in (session / "right").iterdir():
        write_faint(path)
    shutil.rmtree(session / "left")
    with pytest.raises(InputFileError) as caught:
        run(session)
    assert caught.value.remedy == "check the pictures and that the rig belongs to these cameras"


@pytest.mark.skipif(os.name == "nt", reason="there a backslash is read")
def test_folders_as_windows_writes_them_are_told_as_such(session):
    swap(session, lambda text: text.replace("left/", "left\\").replace("right/", "right\\"))
    with pytest.raises(InputFileError, match="no such picture") as caught:
        run(session)
    assert caught.value.remedy.startswith("write / between folders")


def test_a_size_that_contradicts_the_calibration_is_refused(session):
    path = session / "session.toml"
    path.write_text(path.read_text().replace("size_mm = 45.0", "size_mm = 50.0"))
    with pytest.raises(InputFileError, match=r"size of target DICT_4X4_50:9 .* 50 mm given, 45\.0\d\d mm|44\.9"):
        run(session)


def test_a_size_that_no_print_has_names_what_turns_or_scales_all(session):
    pair = rig()
    pose = pair.right_from_left
    in_metres = replace(pair, right_from_left=RightFromLeft(pose.R, pose.t_mm / 1000.0))
    with pytest.raises(InputFileError, match="contradicts the calibration") as caught:
        run(session, in_metres)
    assert "turned, mirrored" in caught.value.remedy
    assert "right_from_left.t_mm is in mm" in caught.value.remedy
    path = session / "session.toml"
    path.write_text(path.read_text().replace("size_mm = 45.0", "size_mm = 50.0"))
    with pytest.raises(InputFileError, match="contradicts the calibration") as caught:
        run(session)
    assert "turned" not in caught.value.remedy


def test_a_size_slightly_off_is_noted(session):
    path = session / "session.toml"
    path.write_text(path.read_text().replace("size_mm = 45.0", "size_mm = 45.4"))
    notes = run(session).notes
    assert len(notes) == 1
    assert "DICT_4X4_50:9" in notes[0]
    assert "45.4 mm given" in notes[0]
    # A print is not all that makes plates look too small.
    assert "gamma, sharpening, blur" in notes[0]


def test_one_frame_states_its_sizes_with_their_noise(session):
    """One plate scatters from nothing: that is no proof of its size."""
    swap(session, lambda text: "\n".join(text.splitlines()[:2]) + "\n")
    measured = run(session, rig())
    assert measured.notes == ()
    for size in measured.sizes:
        assert size.n == 1
        # Corners of a plate of 80 px to 0.006 px, its sides to a few micrometres, more where it is tilted.
        assert 0.0005 < size.std_mm < 0.02
        assert abs(size.sigmas) < 4.0


def test_a_target_that_is_nowhere_is_noted(session):
    path = session / "session.toml"
    third = (
        '[[targets]]\nid = 11\ndictionary = "DICT_4X4_50"\nsize_mm = 45.0\ncarrier = "base"\noffset_mm = [0, 0, 0]\n'
    )
    path.write_text(path.read_text() + third)
    measured = run(session)
    assert "target DICT_4X4_50:11 was seen in no frame" in measured.notes
    assert len(measured.missed) == 5
    assert {item.camera for item in measured.missed} == {"both"}


def test_rows_with_text_for_a_number_are_set_aside(session):
    swap(session, lambda text: text.replace("X,24.0,", "X,far,"))
    measured = run(session)
    assert len(measured.observations) == 8
    assert any("frames.csv:4: x" in text for text in measured.notes)


def test_corners_that_cannot_be_fitted_are_marked_as_uncertain(session, monkeypatch):
    """Pictures too small for the fit's module: a plate 15 px wide."""
    from geoerr.vision import markers
    from geoerr.vision.marker_fit import MarkerFitError, fit_marker

    def picky(picture, camera, pattern, corners):
        if len(pattern) == 6 and np.linalg.norm(corners[0] - corners[1]) < 70:
            raise MarkerFitError("the fit did not converge")
        return fit_marker(picture, camera, pattern, corners)

    monkeypatch.setattr(markers, "fit_marker", picky)
    measured = run(session)
    assert measured.n_local_corners == 5
    assert any("5 observations rest on a local corner detector" in text for text in measured.notes)
    spread = np.sqrt(np.trace(measured.observations.covariance_mm2, axis1=1, axis2=2)).reshape(5, 2)
    assert (spread[:, 1] > 10 * spread[:, 0]).all()


def test_local_corners_that_scatter_more_than_stated_widen_their_covariances(session, monkeypatch):
    from geoerr.vision import markers
    from geoerr.vision.marker_fit import MarkerFitError

    def fails(*_):
        raise MarkerFitError("the fit did not converge")

    monkeypatch.setattr(markers, "fit_marker", fails)
    usual = run(session).observations.covariance_mm2
    monkeypatch.setattr(markers, "_LOCAL_CORNER_SIGMA_PX", 0.003)
    bold = run(session).observations.covariance_mm2
    # Corners a few hundredths of a pixel off their parallelogram say so themselves, whatever is stated of them.
    assert (np.trace(bold, axis1=1, axis2=2) > 25.0 * (0.003 / 0.3) ** 2 * np.trace(usual, axis1=1, axis2=2)).all()


def test_few_frames_are_in_hand_at_once():
    """Memory does not grow with the number of frames: no more than two a thread are read ahead."""
    lock, alive, most = threading.Lock(), 0, 0

    class Reader:
        def read(self, row, left, right):
            nonlocal alive, most
            with lock:
                alive += 1
                most = max(most, alive)
            return FrameResult((), (), True, row)

    frames = pl.DataFrame({"left": ["a"] * 500, "right": ["b"] * 500})
    order = []
    for result in measure_module._in_order(Reader(), frames, 3, range(500)):
        order.append(result.n_found)
        with lock:
            alive -= 1
    assert order == list(range(500))
    assert most <= 2 * 3 + 1


def test_the_tests_pictures_are_of_the_right_size():
    plates, _ = plates_at(0)
    assert render(plates, LEFT, SIZE, samples=1).shape == (480, 640)
