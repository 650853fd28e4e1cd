"""Simulated sessions: the folder, its pictures, the truth, and that nothing of it depends on chance."""

import csv
import hashlib
import json
import tomllib

import cv2
import numpy as np
import pytest
import typer
from small_plans import changed
from typer.testing import CliRunner

from geoerr.cli import simulate as verb
from geoerr.error_functions import ALL_NAMES, read_errors
from geoerr.errors import InputFileError
from geoerr.machine import read_machine
from geoerr.simulate.nine_lines import NineLines, nine_line_plan
from geoerr.simulate.pictures import Studio, board_views, frames, true_board_pixels, true_centres_mm, true_pixels
from geoerr.simulate.plan import plan_from_document, write_plan
from geoerr.simulate.scene import Scene
from geoerr.simulate.session import simulate_session
from geoerr.simulate.visibility import distance_px, look_around
from geoerr.vision.images import read_grey
from geoerr.vision.patterns import opencv_dictionary


def plan(**changes):
    return plan_from_document(changed(**changes), "plan.toml")


def digests(folder):
    return {
        str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


@pytest.fixture(scope="module")
def session(tmp_path_factory):
    folder = tmp_path_factory.mktemp("simulated") / "session"
    truth = simulate_session(plan(), folder, threads=2)
    return folder, truth


def test_the_folder_holds_what_the_contract_says(session):
    folder, truth = session
    description = tomllib.loads((folder / "session.toml").read_text())
    assert description["machine"] == "machine.toml"
    assert description["board"]["squares"] == [7, 5]
    assert description["targets"][1] == {
        "id": 8,
        "dictionary": "DICT_4X4_50",
        "size_mm": 60.0,
        "carrier": "work",
        "offset_mm": [0.0, 0.0, -60.0],
    }
    assert read_machine(folder / "machine.toml") == plan().machine
    with (folder / "frames.csv").open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert list(rows[0]) == ["left", "right", "line", "repeat", "x", "y", "z", "dir_x", "dir_y", "dir_z", "t"]
    assert len(rows) == truth.n_frames == 7
    for row in rows:
        assert read_grey(folder / row["left"]).shape == read_grey(folder / row["right"]).shape == (512, 612)
    left, right = (
        sorted(path.name for path in (folder / "calibration" / side).iterdir()) for side in ("left", "right")
    )
    assert left == right == ["01.png", "02.png", "03.png"]
    assert not [path for path in folder.parent.iterdir() if path.name.startswith(".")]


def test_the_truth_is_an_errors_file_at_the_commanded_positions(session):
    folder, truth = session
    errors = read_errors(folder / "truth.json")
    assert set(errors.functions) | set(errors.squareness) == set(ALL_NAMES)
    assert errors.method == "truth"
    assert errors.functions["EXX"].position_mm.tolist() == [0.0, 100.0]
    assert errors.functions["EAZ"].position_mm.tolist() == [10.0, 50.0, 90.0]
    assert len(errors.functions["EYY"].position_mm) == 21
    assert any("no pass moves axis y" in note for note in errors.notes)
    assert errors.squareness["EB0Z"].value_rad == pytest.approx(-1.24e-3, abs=1e-3)
    assert errors.extra["hidden"] == []
    assert errors.extra["rig"] == truth.rig
    assert errors.functions["EXX"].value == pytest.approx(truth.errors.functions["EXX"].value)


def test_the_truth_names_what_is_hidden(tmp_path):
    which = plan(hidden=[{"effect": "backlash", "axis": "x", "parameters": {"b": 0.02}}], board={"views": 1})
    simulate_session(which, tmp_path / "s", threads=1)
    assert json.loads((tmp_path / "s" / "truth.json").read_text())["hidden"] == [
        {"effect": "backlash", "axis": "x", "covariate": None, "parameters": {"b": 0.02}}
    ]


@pytest.mark.parametrize("threads", [1, 8])
def test_the_bytes_do_not_depend_on_the_number_of_threads(session, tmp_path, threads):
    simulate_session(plan(), tmp_path / "again", threads=threads)
    assert digests(tmp_path / "again") == digests(session[0])


def test_another_seed_gives_another_machine_and_other_noise(session, tmp_path):
    simulate_session(plan(seed=5), tmp_path / "other", threads=2)
    ours, theirs = digests(session[0]), digests(tmp_path / "other")
    assert ours.keys() == theirs.keys()
    assert {name for name in ours if ours[name] == theirs[name]} == {"session.toml", "machine.toml", "frames.csv"}


def test_frames_in_memory_are_those_on_disk(session):
    folder, _ = session
    for row, left, right in frames(plan()):
        assert np.array_equal(left, read_grey(folder / row.columns["left"]))
        assert np.array_equal(right, read_grey(folder / row.columns["right"]))
    for view, (left, _) in enumerate(board_views(plan())):
        assert np.array_equal(left, read_grey(folder / "calibration" / "left" / f"{view + 1:02d}.png"))


def test_an_independent_detector_finds_every_marker_at_its_true_pixels(session):
    folder, _ = session
    detector = cv2.aruco.ArucoDetector(opencv_dictionary("DICT_4X4_50"))
    for index in range(7):
        truth = true_pixels(plan(), index)
        for side in ("left", "right"):
            corners, ids, _ = detector.detectMarkers(read_grey(folder / "frames" / side / f"{index + 1:04d}.png"))
            found = dict(zip(np.ravel(ids).tolist(), corners, strict=True))
            assert set(found) == {3, 8, 9}
            for (_, identity), pixels in truth.items():
                # Unrefined corners: the right corner in the right order, to a pixel or two.
                assert np.abs(found[identity].reshape(4, 2) - pixels[side]).max() < 2.0


def test_true_board_corners_are_saddles_of_the_pictures(session):
    folder, _ = session
    for view in range(3):
        for side, pixels in true_board_pixels(plan(), view).items():
            picture = read_grey(folder / "calibration" / side / f"{view + 1:02d}.png")
            height, width = picture.shape
            inside = pixels[((pixels > 12) & (pixels < [width - 12, height - 12])).all(axis=1)]
            assert len(inside) >= 12
            start = np.ascontiguousarray(inside[:, None], dtype=np.float32)
            stop = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 50, 1e-3)
            refined = cv2.cornerSubPix(picture, start.copy(), (3, 3), (-1, -1), stop)
            assert np.median(np.abs(refined - start)) < 0.05


def test_each_carrier_moves_with_its_own_axes_only():
    scene = Scene(plan())
    place = np.array([np.stack(list(true_centres_mm(scene, row).values())) for row in range(len(scene))])
    tool, work, base = place[:, 0], place[:, 1], place[:, 2]
    step = np.linalg.norm(tool[1] - tool[0])
    assert step == pytest.approx(100.0, abs=0.5)
    assert np.allclose(work[:4], work[0], atol=1e-12)
    assert np.allclose(base, base[0], atol=1e-12)
    assert np.allclose(tool[4:], tool[4], atol=1e-12)
    down = (work[6] - work[4]) @ scene.rig.left.camera_from_base
    assert np.allclose(down, [0.0, 0.0, -80.0], atol=1.0)


def test_a_drifting_camera_moves_the_fixed_target_too():
    still = true_pixels(plan(), 6)
    drifting = plan(hidden=[{"effect": "camera-drift", "parameters": {"k_x": 0.01}}])
    moved = true_pixels(drifting, 6)
    for key in still:
        assert np.abs(still[key]["left"] - moved[key]["left"]).min(axis=0)[0] > 0.05


def test_a_folder_of_something_else_is_never_replaced(session, tmp_path):
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "letter.txt").write_text("dear")
    with pytest.raises(InputFileError, match="not a simulated session"):
        simulate_session(plan(), tmp_path / "mine")
    assert (tmp_path / "mine" / "letter.txt").read_text() == "dear"
    (tmp_path / "file").write_text("dear")
    with pytest.raises(InputFileError, match="is a file"):
        simulate_session(plan(), tmp_path / "file")
    with pytest.raises(InputFileError, match="does not exist"):
        simulate_session(plan(), tmp_path / "none" / "session")


def test_a_simulated_session_with_something_else_in_it_is_left(tmp_path):
    folder = tmp_path / "session"
    small = plan(passes=[{"axis": "x", "positions": [0.0]}], board={"views": 1})
    simulate_session(small, folder, threads=1)
    (folder / "rig.json").write_text("{}")
    with pytest.raises(InputFileError, match=r"holds rig\.json beside a simulated session"):
        simulate_session(small, folder, threads=1)
    assert (folder / "rig.json").read_text() == "{}"


def test_an_earlier_simulation_is_replaced_and_a_failed_one_leaves_it(session, tmp_path):
    folder = tmp_path / "session"
    small = plan(passes=[{"axis": "x", "positions": [0.0]}], board={"views": 1})
    simulate_session(small, folder, threads=1)
    before = digests(folder)

    def fail(done, total):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        simulate_session(plan(), folder, threads=2, progress=fail)
    assert digests(folder) == before
    assert [path.name for path in tmp_path.iterdir()] == ["session"]
    simulate_session(plan(board={"views": 1}), folder, threads=2)
    assert len(digests(folder)) > len(before)


def test_plates_that_hide_each_other_are_refused_by_name(tmp_path):
    targets = [
        {"id": 1, "size_mm": 60.0, "carrier": "tool", "offset_mm": [0.0, 0.0, 0.0]},
        {"id": 2, "size_mm": 60.0, "carrier": "base", "offset_mm": [100.0, 0.0, 0.0]},
    ]
    with pytest.raises(InputFileError, match=r"target 1 .* and target 2 .* overlap in the left picture of frame 2"):
        simulate_session(plan(targets=targets), tmp_path / "s")
    assert not (tmp_path / "s").exists()


def test_plates_out_of_view_are_listed_not_refused(tmp_path):
    targets = [{"id": 1, "size_mm": 60.0, "carrier": "base", "offset_mm": [5000.0, 0.0, 0.0]}]
    missing = look_around(Scene(plan(targets=targets)))
    assert len(missing) == 14
    assert missing[0].why == "not whole in the picture"


def test_a_plan_with_nothing_to_photograph_is_refused(tmp_path):
    for name in ("targets", "passes"):
        with pytest.raises(InputFileError, match=name):
            simulate_session(plan(**{name: []}), tmp_path / "s")
        with pytest.raises(InputFileError, match=name):
            next(frames(plan(**{name: []})))


def test_a_board_that_cannot_be_shown_is_refused():
    with pytest.raises(InputFileError, match="does not fit"):
        Studio(plan(board={"depth_mm": [100.0, 150.0]}))


def test_distance_of_polygons():
    square = np.array([[0.0, 0], [1, 0], [1, 1], [0, 1]])
    assert distance_px(square, square + np.array([3.0, 0.5])) == pytest.approx(2.0)
    assert distance_px(square, square + 0.5) == pytest.approx(-0.5)


@pytest.mark.parametrize("chain", ["wZbXYt", "wbXYZt", "wXYbZt", "wYXZbt"])
def test_nine_lines_are_planned_for_any_chain(chain):
    made = nine_line_plan(NineLines(chain=chain, n_points=5, image_size_px=(1224, 1024)))
    assert not look_around(Scene(made), 0.01 * 1224)
    drawn = set()
    for item in made.passes:
        side = made.machine.side(item.axis)
        for target in made.targets:
            if target.carrier == side:
                arm = "xyz"[int(np.argmax(target.offset_mm))] if any(target.offset_mm) else "0"
                drawn.add((item.axis, arm))
    lines = {
        ("x", "0"),
        ("y", "0"),
        ("z", "0"),
        ("x", "z"),
        ("x", "y"),
        ("y", "z"),
        ("y", "x"),
        ("z", "y"),
        ("z", "x"),
    }
    assert lines <= drawn


def test_a_nine_line_plan_that_does_not_fit_is_refused(monkeypatch):
    # All ways to look are tried before it is refused: those of one slant are enough here.
    monkeypatch.setattr("geoerr.simulate.nine_lines._SLANTS", ((1.0, 1.0, 1.0),))
    with pytest.raises(InputFileError, match="no arrangement shows every plate"):
        nine_line_plan(NineLines(offsets_mm=(50.0, 50.0, 50.0), n_points=2))


def test_a_nine_line_plan_carries_hidden_effects():
    made = nine_line_plan(
        NineLines(n_points=2),
        hidden=[{"effect": "thermal-drift", "axis": "z", "covariate": "temp_a", "parameters": {"k": 0.001}}],
        covariates={"temp_a": {"start": 20.0, "end": 40.0, "tau_s": 60.0}},
    )
    assert made.hidden[0].effect == "thermal-drift"
    assert "temp_a" in Studio(made).row(0).columns


def test_the_verb_makes_a_session(tmp_path):
    app = typer.Typer()
    verb.register(app)
    write_plan(tmp_path / "plan.toml", plan(board={"views": 1}, passes=[{"axis": "x", "positions": [0.0]}]))
    arguments = [str(tmp_path / "plan.toml"), "-o", str(tmp_path / "s")]
    result = CliRunner().invoke(app, [*arguments, "--json", "--seed", "7"])
    assert result.exit_code == 0, result.output
    report = json.loads(result.stdout)
    assert (report["frames"], report["board_views"], report["seed"]) == (1, 1, 7)
    assert (tmp_path / "s" / "truth.json").is_file()
    plain = CliRunner().invoke(app, [*arguments, "--threads", "1", "--quiet"])
    assert "1 stereo frames of 3 targets" in plain.stdout
