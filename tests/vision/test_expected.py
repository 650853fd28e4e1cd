"""Targets are fitted where other frames and the commanded positions say that they are, and searched for elsewhere."""

import shutil
from dataclasses import replace

import numpy as np
import polars as pl
import pytest

from geoerr.simulate.pictures import true_pixels
from geoerr.simulate.plan import plan_from_document
from geoerr.simulate.scene import Scene
from geoerr.simulate.session import simulate_session
from geoerr.vision import frame as frame_module
from geoerr.vision import measure as measure_module
from geoerr.vision.expected import expected_places, rows_to_search
from geoerr.vision.frame import FrameReader
from geoerr.vision.images import read_grey, write_png
from geoerr.vision.measure import measure
from geoerr.vision.measured import write_measured
from geoerr.vision.rig import Rig, RightFromLeft
from geoerr.vision.session import read_session

PLAN = {
    "seed": 11,
    "machine": {"name": "small", "chain": "wZbXYt"},
    "axes": {axis: {"range": [0.0, 100.0]} for axis in "xyz"},
    "rig": {
        "middle_mm": [50.0, -600.0, 300.0],
        "look_at_mm": [80.0, 0.0, 0.0],
        "baseline_mm": 200.0,
        "image_size_px": [720, 600],
        "pixel_um": 11.7,
    },
    "noise": {"grey": 2.0},
    "errors": {"linear_um": 400.0, "angular_urad": 300.0},
    "targets": [
        {"id": 3, "size_mm": 50.0, "carrier": "tool", "offset_mm": [0.0, 0.0, 60.0], "roll_deg": 7.0},
    ],
    "passes": [{"axis": "x", "count": 18}, {"axis": "y", "count": 18}, {"axis": "z", "count": 18}],
}


@pytest.fixture(scope="module")
def simulated(tmp_path_factory):
    folder = tmp_path_factory.mktemp("tracked") / "session"
    plan = plan_from_document(PLAN, "plan.toml")
    simulate_session(plan, folder, threads=2)
    pair = Scene(plan).rig
    lenses = [(lens.matrix, np.asarray(lens.distortion)) for lens in (pair.left, pair.right)]
    return folder, Rig(*lenses[0], *lenses[1], RightFromLeft(*pair.right_from_left), (720, 600))


@pytest.fixture
def folder(simulated, tmp_path):
    """A copy to spoil."""
    shutil.copytree(simulated[0], tmp_path / "session")
    return tmp_path / "session"


@pytest.fixture
def searched(monkeypatch):
    """The number of pictures searched so far, in a list of one."""
    count = [0]
    find = frame_module.find_markers

    def counting(picture, wanted):
        count[0] += 1
        return find(picture, wanted)

    monkeypatch.setattr(frame_module, "find_markers", counting)
    return count


def photograph_again(here, there):
    """Another picture of the same: noise is never the same twice."""
    picture = read_grey(here).copy()
    picture[:4, :4] ^= 1
    write_png(there, picture)


def run(folder, rig, threads=2):
    return measure(read_session(folder), rig, threads=threads)


def test_few_frames_are_searched_and_all_are_measured_alike(simulated, searched, monkeypatch):
    folder, rig = simulated
    session = read_session(folder)
    rows = rows_to_search(session.require_frames())
    assert len(rows) == 24
    assert {rows[0], rows[-1]} == {0, 53}
    tracked = run(folder, rig)
    assert searched == [2 * len(rows)]
    assert tracked.missed == ()
    monkeypatch.setattr(measure_module, "rows_to_search", lambda _: [])
    whole = run(folder, rig)
    assert searched == [2 * len(rows) + 2 * 54]
    apart = np.abs(tracked.observations.measured_mm - whole.observations.measured_mm)
    std = np.sqrt(whole.observations.covariance_mm2.diagonal(axis1=1, axis2=2))
    # Where the fit begins decides its last step, of a ten-thousandth of a pixel; corners are known to thousandths.
    assert (apart < 0.1 * std).all()
    assert np.allclose(tracked.observations.covariance_mm2, whole.observations.covariance_mm2, rtol=0.02, atol=1e-9)


def test_same_bytes_for_any_number_of_threads(simulated, tmp_path):
    folder, rig = simulated
    paths = [tmp_path / f"{threads}.csv" for threads in (1, 3)]
    for path, threads in zip(paths, (1, 3), strict=True):
        write_measured(path, run(folder, rig, threads))
    assert paths[0].read_bytes() == paths[1].read_bytes()


def test_a_target_that_is_elsewhere_is_searched_for(folder, simulated, searched):
    """The machine lost its way in one frame: its pictures are those of another place."""
    frames = pl.read_csv(folder / "frames.csv")
    rows = set(rows_to_search(frames))
    lost, other = next(row for row in range(20, 30) if row not in rows), 2
    for side in ("left", "right"):
        photograph_again(folder / frames[side][other], folder / frames[side][lost])
    measured = run(folder, simulated[1])
    assert searched == [2 * len(rows) + 2]
    points = measured.observations.measured_mm
    assert len(points) == 54
    assert np.abs(points[lost] - points[other]).max() < 1e-3


def test_a_target_that_is_gone_is_missed(folder, simulated):
    frames = pl.read_csv(folder / "frames.csv")
    gone = next(row for row in range(20, 30) if row not in set(rows_to_search(frames)))
    picture = read_grey(folder / frames["left"][gone])
    write_png(folder / frames["left"][gone], np.full_like(picture, 128))
    measured = run(folder, simulated[1])
    assert len(measured.observations) == 53
    assert [(missed.row, missed.camera) for missed in measured.missed] == [(gone, "left")]


@pytest.mark.parametrize("spoil", ["no positions", "positions of another machine"])
def test_positions_that_say_nothing_cost_a_search_and_nothing_else(folder, simulated, searched, spoil):
    frames = pl.read_csv(folder / "frames.csv")
    if spoil == "no positions":
        frames = frames.with_columns(x=pl.lit(1.0), y=pl.lit(1.0), z=pl.lit(1.0))
    else:
        frames = frames.with_columns(x=pl.col("z") * 0.5, z=pl.col("y"), y=(pl.col("x") * 7.0).sin())
    frames.write_csv(folder / "frames.csv")
    measured = run(folder, simulated[1])
    assert len(measured.observations) == 54
    assert searched[0] == 2 * 54


class Anywhere:
    """Says that every target is where one of them is."""

    def __init__(self, corners_px):
        self._corners_px = corners_px

    def corners_px(self, row, target):
        return self._corners_px


@pytest.mark.parametrize(("there", "asked_for"), [(21, 28), (28, 21)])
def test_a_marker_with_a_neighbouring_id_is_not_taken_for_the_target(tmp_path, there, asked_for):
    """In DICT_4X4_50 these two differ in three modules of 49: a fit of the whole picture calls them dirt."""
    target = {**PLAN["targets"][0], "id": there}
    plan = plan_from_document(PLAN | {"targets": [target], "passes": [{"axis": "x", "count": 2}]}, "plan.toml")
    simulate_session(plan, tmp_path / "session", threads=2)
    session = read_session(tmp_path / "session")
    scene = Scene(plan)
    lenses = [(lens.matrix, np.asarray(lens.distortion)) for lens in (scene.rig.left, scene.rig.right)]
    rig = Rig(*lenses[0], *lenses[1], RightFromLeft(*scene.rig.right_from_left), (720, 600))
    places = true_pixels(scene, 0)["DICT_4X4_50", there]
    wanted = (replace(session.targets[0], id=asked_for), session.targets[0])
    expected = Anywhere((places["left"], places["right"]))
    frames = session.require_frames()
    result = FrameReader(session.directory, rig, wanted, expected).read(0, frames["left"][0], frames["right"][0])
    assert [item.target for item in result.seen] == [1]
    assert [missed.why for missed in result.missed] == ["not found in the picture"]


def test_a_target_that_some_picture_shows_twice_is_expected_nowhere(folder, simulated):
    rig, session = simulated[1], read_session(folder)
    frames = session.require_frames()
    reader = FrameReader(session.directory, rig, session.targets)
    rows = rows_to_search(frames)
    searched = {row: reader.read(row, frames["left"][row], frames["right"][row]) for row in rows}
    assert expected_places(rig, frames, searched).corners_px(1, 0) is not None
    twice = rows[5]
    for side in ("left", "right"):
        path = folder / frames[side][twice]
        write_png(path, with_a_copy(read_grey(path), getattr(searched[twice].seen[0], side).corners_px))
    searched[twice] = reader.read(twice, frames["left"][twice], frames["right"][twice])
    assert searched[twice].repeated == {0}
    assert expected_places(rig, frames, searched).corners_px(1, 0) is None


def with_a_copy(picture, corners_px):
    """A picture that shows a marker again, above or below."""
    left, top = np.floor(corners_px.min(axis=0)).astype(int) - 14
    right, bottom = np.ceil(corners_px.max(axis=0)).astype(int) + 14
    own = picture[top:bottom, left:right]
    result = picture.copy()
    # Not at the picture's end, where no marker is looked for.
    first = 40 if top > len(own) + 40 else len(picture) - len(own) - 40
    assert first + len(own) <= top or first >= bottom
    result[first : first + len(own), left:right] = own
    return result


def test_a_session_of_its_own_is_learnt_by_itself(folder, simulated, searched):
    """The cameras were moved between two sessions of the same frames."""
    frames = pl.read_csv(folder / "frames.csv")
    after = frames.with_columns(pl.col("left", "right").str.replace("frames/", "after/"), session=pl.lit("after"))
    for side in ("left", "right"):
        (folder / "after" / side).mkdir(parents=True)
        for here, there in zip(frames[side], after[side], strict=True):
            photograph_again(folder / here, folder / there)
    both = pl.concat([frames.with_columns(session=pl.lit("before")), after])
    both.write_csv(folder / "frames.csv")
    assert len(rows_to_search(both)) == 48
    measured = run(folder, simulated[1])
    assert len(measured.observations) == 108
    assert searched == [2 * 48]
