"""Views to a rig: truth, uncertainty, views and corners that are wrong, boards that look the same when turned."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from board_scenes import IMAGE_SIZE, board_mm, drawn_views, known_rig, seen_by
from scipy.spatial.transform import Rotation

from geoerr.errors import DetectionError, NotDeterminedError
from geoerr.vision.board_views import BoardView, SeenCorners, corner_weights, far_view, sightings_of
from geoerr.vision.boards import same_colours
from geoerr.vision.bundle import adjust
from geoerr.vision.camera import parameters_of
from geoerr.vision.pair_start import zhang
from geoerr.vision.rig import Rig
from geoerr.vision.session import BoardSpec
from geoerr.vision.stereo_solve import Solved, solve_stereo

RIG = known_rig()
SIGMA_PX = 0.05


def views(n_views: int = 8, seed: int = 1, sigma_px: float = SIGMA_PX) -> list[BoardView]:
    return drawn_views(RIG, n_views, sigma_px, np.random.default_rng(seed))


def change(rig: Rig) -> np.ndarray:
    turn = rig.right_from_left.R @ RIG.right_from_left.R.T
    small = 0.5 * np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
    return np.concatenate(
        [
            parameters_of(rig.left) - parameters_of(RIG.left),
            parameters_of(rig.right) - parameters_of(RIG.right),
            small,
            rig.right_from_left.t_mm - RIG.right_from_left.t_mm,
        ]
    )


def chi2(solved: Solved) -> float:
    assert solved.rig.covariance is not None
    return float(change(solved.rig) @ np.linalg.solve(solved.rig.covariance, change(solved.rig)))


def with_pixels(view: BoardView, side: str, pixel: np.ndarray) -> BoardView:
    return replace(view, **{side: replace(getattr(view, side), pixel=pixel)})


def test_the_rig_is_found_within_its_uncertainty() -> None:
    solved = solve_stereo(views(), IMAGE_SIZE)
    assert solved.is_converged
    assert solved.dropped == ()
    # χ² of 24 degrees of freedom: above 52 once in a thousand, below 8 likewise.
    assert 8.0 < chi2(solved) < 52.0
    # The scatter that was put in, known to 1/√(2 · freedom) of itself.
    assert solved.degrees_of_freedom == 8 * 2 * 2 * 54 - 24 - 8 * 6
    assert solved.sigma_px == pytest.approx(SIGMA_PX, rel=4.0 / np.sqrt(2.0 * solved.degrees_of_freedom))
    assert solved.stereo_rms_px == pytest.approx(SIGMA_PX * np.sqrt(2.0), rel=0.06)
    # More freedom leaves less, held-out views leave more.
    assert max(solved.left_rms_px, solved.right_rms_px) < 1.05 * solved.stereo_rms_px
    assert solved.stereo_rms_px < solved.lenses_held_rms_px
    assert solved.held_out_rms_px is not None
    assert solved.stereo_rms_px < solved.held_out_rms_px < 2.0 * solved.stereo_rms_px
    assert len(solved.rig.parameter_names) == 24


def test_the_joint_solve_is_better_than_lenses_fixed_first() -> None:
    """The pair fitted with each lens as it is alone is further from the truth (what the joint solve is for)."""
    joint, alone = [], []
    for seed in range(6):
        solved = solve_stereo(views(6, 40 + seed), IMAGE_SIZE)
        joint.append(change(solved.rig)[[0, 9]])
        mono = [one_lens(views(6, 40 + seed), camera) for camera in (0, 1)]
        alone.append([mono[0] - RIG.K_left[0, 0], mono[1] - RIG.K_right[0, 0]])
    assert np.std(joint) < np.std(alone)


def one_lens(some: list[BoardView], camera: int) -> float:
    fitted = adjust((sightings_of(some, camera),), zhang(some, camera, IMAGE_SIZE))
    return float(fitted.estimate.cameras[0].matrix_px[0, 0])


def test_single_wild_corners_are_set_aside() -> None:
    some = views()
    pixel = some[2].left.pixel.copy()
    pixel[10] += [3.0, -2.0]
    pixel[40] += [0.0, 0.6]
    some[2] = with_pixels(some[2], "left", pixel)
    solved = solve_stereo(some, IMAGE_SIZE)
    assert [view.n_set_aside for view in solved.views] == [0, 0, 2, 0, 0, 0, 0, 0]
    assert solved.views[2].n_left == 52
    assert chi2(solved) < 52.0


def test_a_board_that_moved_between_the_pictures_is_dropped() -> None:
    some = views(9)
    other = views(9, 2)
    some[4] = with_pixels(some[4], "right", some[4].right.pixel + np.array([2.0, 1.0]))
    some[6] = with_pixels(some[6], "right", other[6].right.pixel)
    solved = solve_stereo(some, IMAGE_SIZE)
    reasons = {item.name: item.why for item in solved.dropped}
    assert set(reasons) == {"view 4", "view 6"}
    assert all("board or camera moved between them" in why for why in reasons.values())
    assert chi2(solved) < 52.0


def test_a_view_that_is_only_noisier_is_dropped_as_such() -> None:
    """Each camera alone has views of unlike noise, so that this one stands out only where both are seen."""
    some = views(10, sigma_px=0.0)
    rng = np.random.default_rng(5)
    for number, view in enumerate(some):
        left, right = (0.1, 0.1) if number == 4 else (0.03, 0.05) if number % 2 else (0.05, 0.03)
        for side, sigma_px in (("left", left), ("right", right)):
            pixel = getattr(view, side).pixel
            some[number] = with_pixels(some[number], side, pixel + rng.normal(0.0, sigma_px, pixel.shape))
    solved = solve_stereo(some, IMAGE_SIZE)
    (dropped,) = solved.dropped
    assert dropped.name == "view 4"
    assert dropped.why.startswith("its corners scatter more than the others', in each camera alone (0.1")
    assert "moved between them" not in dropped.why


def test_exchanged_pictures_are_recognised() -> None:
    some = views(9)
    some[3] = replace(some[3], left=some[3].right, right=some[3].left)
    solved = solve_stereo(some, IMAGE_SIZE)
    assert [(item.name, item.why) for item in solved.dropped] == [("view 3", "left and right pictures are exchanged")]
    assert chi2(solved) < 52.0


def test_a_picture_of_something_else_is_dropped_by_its_camera() -> None:
    some = views(9)
    rng = np.random.default_rng(3)
    some[5] = with_pixels(some[5], "left", some[5].left.pixel + rng.normal(0.0, 4.0, (54, 2)))
    solved = solve_stereo(some, IMAGE_SIZE)
    assert [item.name for item in solved.dropped] == ["view 5"]
    assert solved.dropped[0].why.startswith("the left picture does not fit")


def test_a_board_that_looks_the_same_upside_down_is_renumbered() -> None:
    board = BoardSpec("chessboard", (8, 8), 30.0)
    corners_mm = board_mm(7, 7)
    turns = same_colours(board)
    assert len(turns) == 2
    some = drawn_views(RIG, 8, SIGMA_PX, np.random.default_rng(4), corners_mm)
    confused = []
    for number, view in enumerate(some):
        right = view.right
        if number % 3 == 0:
            # Found the other way up: corner i of the list is corner turns[1][i] of the board.
            right = SeenCorners(corners_mm, right.pixel[turns[1]], right.std_px)
        confused.append(BoardView(view.name, view.left, right, (corners_mm[turns[1]],)))
    solved = solve_stereo(confused, IMAGE_SIZE)
    assert solved.dropped == ()
    assert chi2(solved) < 52.0


def test_views_of_different_noise_are_weighted_by_what_their_corners_say() -> None:
    some = [
        drawn_views(RIG, 10, 0.02 if number % 2 else 0.1, np.random.default_rng(6))[number] for number in range(10)
    ]
    solved = solve_stereo(some, IMAGE_SIZE)
    scatter = [view.left_scatter for view in solved.views]
    assert max(scatter) < 1.3
    assert min(scatter) > 0.75
    assert 8.0 < chi2(solved) < 52.0


def test_a_bent_board_widens_the_uncertainties() -> None:
    bent = board_mm()
    bent[:, 2] = 1.0 * np.sin(bent[:, 0] / 60.0) * np.cos(bent[:, 1] / 50.0)
    flat = board_mm()
    bent_views = drawn_views(RIG, 10, 0.01, np.random.default_rng(8), bent)
    some = [
        replace(view, left=replace(view.left, board_mm=flat), right=replace(view.right, board_mm=flat))
        for view in bent_views
    ]
    solved = solve_stereo(some, IMAGE_SIZE)
    assert solved.is_widened
    assert solved.spread_ratio is not None
    assert solved.spread_ratio > 1.5
    straight = solve_stereo(views(10, 8, 0.01), IMAGE_SIZE)
    assert not straight.is_widened


def test_corners_seen_by_one_camera_only_take_part() -> None:
    some = views()
    partial = [
        replace(
            view,
            left=SeenCorners(view.left.board_mm[:40], view.left.pixel[:40], view.left.std_px[:40]),
            right=SeenCorners(view.right.board_mm[20:], view.right.pixel[20:], view.right.std_px[20:]),
        )
        for view in some
    ]
    solved = solve_stereo(partial, IMAGE_SIZE)
    assert [(view.n_left, view.n_right) for view in solved.views] == [(40, 34)] * 8
    assert chi2(solved) < 52.0


def test_too_few_views() -> None:
    some = views(4)
    assert solve_stereo(some[:3], IMAGE_SIZE).held_out_rms_px is None
    some[1] = with_pixels(some[1], "right", views(4, 9)[1].right.pixel)
    some[2] = with_pixels(some[2], "right", views(4, 9)[2].right.pixel)
    # Half of the views contradict the other half: nobody can say which are right, but it is said that they do.
    with pytest.raises(DetectionError, match="only 2 of 4 pairs agree"):
        solve_stereo(some, IMAGE_SIZE)


@pytest.mark.parametrize(
    ("off", "fits"), [(1, "left view 0 fits right view 1"), (-1, "left view 1 fits right view 0")]
)
def test_right_pictures_numbered_one_off_are_recognised(off: int, fits: str) -> None:
    some = views(9)
    shifted = [replace(view, right=some[(number - off) % 9].right) for number, view in enumerate(some)]
    with pytest.raises(DetectionError, match=rf"only \d of 9 pairs agree, to 5°.*\n.*numbered one off: {fits}"):
        solve_stereo(shifted, IMAGE_SIZE)


def test_pictures_in_no_order_are_refused() -> None:
    some = views(9)
    order = np.random.default_rng(3).permutation(9)
    with pytest.raises(DetectionError, match="do not belong together\nhint: give both pictures of one moment"):
        solve_stereo([replace(view, right=some[order[n]].right) for n, view in enumerate(some)], IMAGE_SIZE)


def test_no_rig_is_given_of_which_nothing_is_known() -> None:
    """A board that hardly tilts and corners to a pixel: its size in the picture is as much depth as focal length."""
    n_refused = 0
    for seed in range(6):
        rng = np.random.default_rng(seed)
        some = []
        for number in range(4):
            place = np.array([rng.uniform(-150.0, 100.0), rng.uniform(-100.0, 100.0), rng.uniform(800.0, 1000.0)])
            turn = Rotation.from_rotvec([*(0.002 * rng.normal(size=2)), 0.0]).as_matrix()
            pixels = (pixel + rng.normal(0.0, 1.0, pixel.shape) for pixel in seen_by(RIG, board_mm(), (turn, place)))
            some.append(BoardView(str(number), *(SeenCorners(board_mm(), pixel, np.ones(54)) for pixel in pixels)))
        try:
            rig = solve_stereo(some, IMAGE_SIZE).rig
        except (NotDeterminedError, DetectionError):
            n_refused += 1
            continue
        deviations = rig.standard_uncertainties()
        assert deviations is not None
        assert 2.0 * deviations["left_fx_px"] < rig.K_left[0, 0]
        assert 2.0 * deviations["right_fx_px"] < rig.K_right[0, 0]
    assert n_refused


def test_views_without_tilt_are_refused() -> None:
    some = []
    for number in range(5):
        flat = board_mm()
        square = flat[:, :2] * (1.0 + 0.05 * number)
        pixel = 400.0 + square
        some.append(BoardView(str(number), *(SeenCorners(flat, pixel + off, np.ones(54)) for off in (0.0, 20.0))))
    with pytest.raises((NotDeterminedError, DetectionError)):
        solve_stereo(some, IMAGE_SIZE)


def test_far_views() -> None:
    assert far_view(np.array([0.2, 0.21, 0.19, 0.2, 0.35])) is None
    assert far_view(np.array([0.2, 0.21, 0.19, 0.2, 0.5])) == 4
    assert far_view(np.array([0.1, 0.5, 0.9, 1.3, 1.8])) is None


def test_a_view_as_good_as_a_corner_detector_is_never_far() -> None:
    """On clean pictures a board farther away was dropped for 0.024 px, beside 0.012."""
    assert far_view(np.array([0.012, 0.0121, 0.0119, 0.012, 0.024])) is None
    assert far_view(np.array([0.012, 0.0121, 0.0119, 0.012, 0.05])) == 4


def test_weights_follow_what_corners_know_of_themselves() -> None:
    some = views(3)
    some[0] = replace(some[0], left=replace(some[0].left, std_px=np.full(54, 4.0 * SIGMA_PX)))
    sightings = [sightings_of(some, camera) for camera in (0, 1)]
    photon = corner_weights(some, sightings, SIGMA_PX)[0]
    assert photon[60] / photon[0] > 10.0
    common = corner_weights(some, sightings, 100.0 * SIGMA_PX)[0]
    assert common[60] / common[0] < 1.01
