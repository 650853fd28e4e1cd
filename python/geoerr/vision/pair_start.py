"""Where to start: both cameras by Zhang's method, then how the right one stands as most views have it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np
import numpy.typing as npt

from geoerr.errors import DetectionError, NotDeterminedError
from geoerr.vision.board_views import BoardView, SeenCorners, sightings_of, view_rms
from geoerr.vision.bundle import Estimate, Poses, Sightings, adjust, residuals_of
from geoerr.vision.camera import Camera
from geoerr.vision.opencv_threads import one_opencv_thread
from geoerr.vision.rig import RightFromLeft
from geoerr.vision.rotation import angle_between_rad, nearest_rotation

Array = npt.NDArray[np.float64]

N_DISTORTION = 5
_CONSENSUS_RAD = np.deg2rad(5.0)
_ROUNDS = 4
# Two views agree on anything by chance too easily.
_LEAST_NEIGHBOURS = 3

# A numbering of the right picture's corners, and the right camera's board pose that goes with it.
Offer = tuple[Array, Array, Array]


def zhang(views: Sequence[BoardView], camera: int, image_size: tuple[int, int]) -> Estimate:
    """Start one camera and its board poses by Zhang's method (Li §3.2), with two distortion coefficients.

    Raises
    ------
    NotDeterminedError
        where the views do not determine a camera.
    """
    boards = [view.side(camera).board_mm.astype(np.float32) for view in views]
    pixels = [view.side(camera).pixel.astype(np.float32) for view in views]
    try:
        # k3 and the tangential terms only send a start astray; the adjustment frees them.
        flags = cv2.CALIB_FIX_K3 | cv2.CALIB_ZERO_TANGENT_DIST
        # Several threads would add up in the order in which they finish: other last digits each time.
        with one_opencv_thread():
            _, matrix, distortion, turns, shifts = cv2.calibrateCamera(
                boards, pixels, image_size, None, None, flags=flags
            )
    except cv2.error as error:
        raise NotDeterminedError(f"the {side_name(camera)} camera has no start: {error.err}") from error
    k = np.asarray(matrix, dtype=np.float64)
    if not (np.isfinite(k).all() and min(k[0, 0], k[1, 1]) > 0.0):
        raise NotDeterminedError(f"the views do not determine the {side_name(camera)} camera's focal length")
    lens = Camera(
        np.array([[k[0, 0], 0.0, k[0, 2]], [0.0, k[1, 1], k[1, 2]], [0.0, 0.0, 1.0]]),
        np.ravel(distortion)[:N_DISTORTION].astype(np.float64),
    )
    poses = Poses(
        np.stack([np.asarray(cv2.Rodrigues(turn)[0], dtype=np.float64) for turn in turns]),
        np.stack([np.ravel(shift).astype(np.float64) for shift in shifts]),
    )
    return Estimate((lens,), None, poses)


def side_name(camera: int) -> str:
    """Name camera 0 or 1."""
    return "right" if camera else "left"


def start_pair(views: Sequence[BoardView], left: Estimate, right: Estimate) -> tuple[tuple[BoardView, ...], Estimate]:
    """Find the pair's pose that most views agree on, and each view's board pose for it.

    Where a board looks the same in several orientations, the right picture is renumbered as agrees with the others.

    Parameters
    ----------
    views
        The views of both estimates.
    left, right
        Each camera alone.

    Raises
    ------
    DetectionError
        where most views contradict the orientation that most agree on, saying whether the right pictures of their
        neighbours would fit.

    Returns
    -------
    views, estimate
        Views as renumbered; an estimate for `bundle.adjust`, lenses as given, in which views that disagree have
        had little say.
    """
    offers = [_offers(view, right.poses, number) for number, view in enumerate(views)]
    relative = _relative(offers, left.poses.turn)
    middle = _medoid(relative)
    _refuse_contradiction(views, offers, left.poses.turn)
    chosen = [
        min(range(len(turns)), key=lambda index, turns=turns: angle_between_rad(middle, turns[index]))  # type: ignore[misc]
        for turns in relative
    ]
    picked = [offer[index] for offer, index in zip(offers, chosen, strict=True)]
    views = tuple(
        replace(view, right=replace(view.right, board_mm=board_mm))
        for view, (board_mm, _, _) in zip(views, picked, strict=True)
    )
    turns_right = np.stack([turn for _, turn, _ in picked])
    shifts_right = np.stack([shift for _, _, shift in picked])
    agrees = [
        number
        for number, index in enumerate(chosen)
        if angle_between_rad(middle, relative[number][index]) < _CONSENSUS_RAD
    ]
    shift = np.median([shifts_right[n] - relative[n][chosen[n]] @ left.poses.shift_mm[n] for n in agrees], axis=0)
    pair = RightFromLeft(nearest_rotation(middle), np.asarray(shift))
    cameras = (left.cameras[0], right.cameras[0])
    poses = _better_poses(views, cameras, pair, left.poses, Poses(turns_right, shifts_right))
    return views, _robust_pair(views, Estimate(cameras, pair, poses))


def _relative(offers: Sequence[Sequence[Offer]], left: Array) -> list[list[Array]]:
    """List for each view the orientations of the right camera from the left one that its offers mean."""
    return [[turn @ own.T for _, turn, _ in offer] for offer, own in zip(offers, left, strict=True)]


def _agreeing(relative: Sequence[Sequence[Array]]) -> list[int]:
    """List the views that agree with the orientation that most agree on."""

    def near(candidate: Array) -> list[int]:
        return [
            number
            for number, turns in enumerate(relative)
            if min(angle_between_rad(candidate, turn) for turn in turns) < _CONSENSUS_RAD
        ]

    return max((near(turn) for turns in relative for turn in turns), key=len)


def _refuse_contradiction(views: Sequence[BoardView], offers: Sequence[Sequence[Offer]], left: Array) -> None:
    """Refuse pairs of which no more than half agree on how the cameras stand: they are not of one moment each."""
    n_views, n_agree = len(views), len(_agreeing(_relative(offers, left)))
    if 2 * n_agree > n_views:
        return
    hint = "give both pictures of one moment the same name in left and right"
    # Left with the right picture that follows it, then with the one before it.
    for here, there, neighbours, own in ((0, 1, offers[1:], left[:-1]), (1, 0, offers[:-1], left[1:])):
        fitting = _agreeing(_relative(neighbours, own)) if n_views > _LEAST_NEIGHBOURS else []
        if 2 * len(fitting) > n_views - 1:
            one, other = (views[fitting[0] + shift].name for shift in (here, there))
            hint = f"the right pictures look numbered one off: left {one} fits right {other}; name them alike"
    raise DetectionError(
        f"only {n_agree} of {n_views} pairs agree, to {np.rad2deg(_CONSENSUS_RAD):.0f}°, on how the cameras stand to "
        f"each other: the pictures of a pair do not belong together\nhint: {hint}"
    )


def _offers(view: BoardView, poses: Poses, number: int) -> list[Offer]:
    """Each numbering of the right picture's corners with the right camera's board pose that goes with it."""
    turn, shift = poses.turn[number], poses.shift_mm[number]
    offers = [(view.right.board_mm, turn, shift)]
    for board_mm in view.right_renumbered:
        # old = spin @ new + off: the same points under both numberings.
        new_middle, old_middle = board_mm.mean(axis=0), view.right.board_mm.mean(axis=0)
        product = (view.right.board_mm - old_middle).T @ (board_mm - new_middle)
        spin = nearest_rotation(product)
        offers.append((board_mm, turn @ spin, shift + turn @ (old_middle - spin @ new_middle)))
    return offers


def _medoid(relative: Sequence[Sequence[Array]]) -> Array:
    """Give the relative orientation with the smallest median angle to all views' nearest offers."""
    candidates = [turn for turns in relative for turn in turns]
    medians = [
        float(np.median([min(angle_between_rad(candidate, turn) for turn in turns) for turns in relative]))
        for candidate in candidates
    ]
    return candidates[int(np.argmin(medians))]


def _better_poses(
    views: Sequence[BoardView], cameras: tuple[Camera, ...], pair: RightFromLeft, left: Poses, right: Poses
) -> Poses:
    """Take each view's pose from the camera whose pose explains both pictures better."""
    carried = Poses(pair.R.T @ right.turn, np.einsum("ij,vj->vi", pair.R.T, right.shift_mm - pair.t_mm))
    both = tuple(sightings_of(views, camera) for camera in (0, 1))
    rms = [
        view_rms(both, residuals_of(both, Estimate(cameras, pair, poses)), len(views)) for poses in (left, carried)
    ]
    takes_left = np.nan_to_num(rms[0], nan=np.inf) <= np.nan_to_num(rms[1], nan=np.inf)
    return Poses(
        np.where(takes_left[:, None, None], left.turn, carried.turn),
        np.where(takes_left[:, None], left.shift_mm, carried.shift_mm),
    )


def _robust_pair(views: Sequence[BoardView], start: Estimate) -> Estimate:
    """Adjust pair and poses with the lenses held; views count the less the further off they are (Cauchy's weight)."""
    both = tuple(sightings_of(views, camera) for camera in (0, 1))
    estimate = start
    weights = [np.ones(len(seen.view)) for seen in both]
    for _ in range(_ROUNDS):
        weighted = tuple(replace(seen, weight=weight) for seen, weight in zip(both, weights, strict=True))
        fitted = adjust(weighted, estimate, hold_cameras=True)
        estimate = fitted.estimate
        rms = view_rms(both, fitted.residual_px, len(views))
        by_view = 1.0 / (1.0 + (rms / max(float(np.median(rms)), 1e-12)) ** 2)
        weights = [by_view[seen.view] for seen in both]
    return estimate


def exchanged_rms(view: BoardView, estimate: Estimate, right_pose: Poses) -> float:
    """Give the view's rms if its left and right pictures were exchanged, with the rig as it is."""
    sides: tuple[SeenCorners, SeenCorners] = (view.right, view.left)
    swapped = BoardView(view.name, *sides)
    both: tuple[Sightings, ...] = tuple(sightings_of([swapped], camera) for camera in (0, 1))
    fitted = adjust(both, replace(estimate, poses=right_pose), hold_cameras=True, hold_pair=True)
    return float(view_rms(both, fitted.residual_px, 1)[0])
