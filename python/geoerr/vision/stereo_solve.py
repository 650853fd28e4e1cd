"""Views of a board to a rig: each camera alone, then both at once, every view judged, all uncertainties stated."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from geoerr.errors import DetectionError, NotDeterminedError
from geoerr.vision.board_views import (
    DISAGREEMENT,
    LEAST_VIEWS,
    BoardView,
    corner_weights,
    far_view,
    sightings_of,
    total_rms,
    view_rms,
    without_wild_corners,
)
from geoerr.vision.bundle import Adjusted, Estimate, Poses, Sightings, adjust, covariance_of, parameters_of_estimate
from geoerr.vision.camera import parameters_of
from geoerr.vision.pair_start import exchanged_rms, side_name, start_pair, zhang
from geoerr.vision.rig import Rig

Array = npt.NDArray[np.float64]

_MOST_FOLDS = 12
_LEAST_HELD_OUT_VIEWS = LEAST_VIEWS + 1
_ROUNDS = 8
# Of the spread ratio's square, which is noisy with few views.
_SPREAD_SIGMAS = 4.0
# From the solution of all views it is not far to that of most.
_FOLD_ITERATIONS = 20
# A dropped view that is this near to the others when left and right are exchanged has them exchanged.
_EXCHANGED_FACTOR = 3.0


@dataclass(frozen=True)
class Dropped:
    """A pair that does not take part, and why."""

    name: str
    why: str


@dataclass(frozen=True)
class ViewResult:
    """One pair that takes part: corners used and set aside, and how far off they are (rms distance, px).

    `held_out_rms_px` is for a rig fitted without this view, only the board's pose free; None with too few views.
    `left_scatter` and `right_scatter` are 1 where the corners are off as much as their own uncertainty and what is
    common to all views explain.
    """

    name: str
    n_left: int
    n_right: int
    n_set_aside: int
    left_rms_px: float
    right_rms_px: float
    held_out_rms_px: float | None
    left_scatter: float
    right_scatter: float


@dataclass(frozen=True)
class Solved:
    """A rig and all that is known about it.

    Attributes
    ----------
    rig
        With covariance.
    views
        Pairs that took part.
    dropped
        Pairs that did not.
    left_rms_px, right_rms_px, stereo_rms_px
        Each camera solved alone, and the joint solve, over the same corners.
    lenses_held_rms_px
        Both cameras, with each lens as the camera alone has it.
    held_out_rms_px
        Over all held-out views; None with too few.
    sigma_px
        Deviation of one pixel coordinate from the joint residuals.
    degrees_of_freedom
        Pixel coordinates minus parameters.
    spread_ratio
        How much more the rig changes when views are left out than the corners' scatter explains (1 = as
        expected); None with too few views. Where it is significantly above 1, the covariance is widened by it.
    is_widened
        Whether it was.
    is_converged
        Whether the adjustment ended where its last step was nothing against the uncertainty.
    """

    rig: Rig
    views: tuple[ViewResult, ...]
    dropped: tuple[Dropped, ...]
    left_rms_px: float
    right_rms_px: float
    stereo_rms_px: float
    lenses_held_rms_px: float
    held_out_rms_px: float | None
    sigma_px: float
    degrees_of_freedom: int
    spread_ratio: float | None
    is_widened: bool
    is_converged: bool


@dataclass
class _Fit:
    """An adjustment of some views: their numbers, their corners with weights, the outcome."""

    views: list[int]
    sightings: tuple[Sightings, ...]
    outcome: Adjusted

    @property
    def estimate(self) -> Estimate:
        return self.outcome.estimate


def solve_stereo(views: Sequence[BoardView], image_size: tuple[int, int]) -> Solved:
    """Solve both cameras and their pair from views of a board.

    Parameters
    ----------
    views
        At least three, seen by both cameras.
    image_size
        (width, height), px.

    Raises
    ------
    DetectionError
        if fewer than three views are left when those that fit badly are dropped, or most contradict each other.
    NotDeterminedError
        if the views leave a parameter free, or tell next to nothing of a camera.

    Notes
    -----
    Starting values are Zhang's, each camera alone (Li §3.2); then everything is free at once. Verified against the
    simulator's truth, `cv2.stereoCalibrate` and by Monte-Carlo (tests/vision/test_calibrate.py, test_bundle.py).
    """
    dropped: dict[int, str] = {}
    starts = [zhang(views, camera, image_size) for camera in (0, 1)]
    alone = [_solve_alone(views, camera, starts[camera], dropped) for camera in (0, 1)]
    usable = [number for number in range(len(views)) if number not in dropped]
    _refuse_too_few(views, usable, dropped)
    renumbered, start = start_pair(
        [views[number] for number in usable], *(_of_views(fit, usable).estimate for fit in alone)
    )
    views = list(views)
    for number, view in zip(usable, renumbered, strict=True):
        views[number] = view
    joint = _solve_joint(views, usable, start, alone, dropped)
    _name_exchanged(views, joint, starts[1].poses, dropped)
    joint, sigma_px, freedom = _weighted_by_corner(views, joint)
    _refuse_too_few(views, joint.views, dropped)
    information = joint.outcome.information / sigma_px**2
    covariance = covariance_of(information)
    held_out, folds = _leave_out(joint)
    spread, spread_limit = _spread_ratio(folds, information, sigma_px)
    is_widened = spread is not None and spread > spread_limit
    if is_widened and spread is not None:
        covariance = covariance * spread**2
    rig = _rig(joint.estimate, image_size, covariance)
    _refuse_unknown(rig)
    again = [_alone_again(alone[camera], joint, camera) for camera in (0, 1)]
    held = adjust(
        joint.sightings,
        replace(joint.estimate, cameras=tuple(one.estimate.cameras[0] for one in again)),
        hold_cameras=True,
    )
    return Solved(
        rig=rig,
        views=_view_results(views, joint, held_out, sigma_px),
        dropped=tuple(Dropped(views[number].name, why) for number, why in sorted(dropped.items())),
        left_rms_px=total_rms(joint.sightings[:1], again[0].residual_px),
        right_rms_px=total_rms(joint.sightings[1:], again[1].residual_px),
        stereo_rms_px=total_rms(joint.sightings, joint.outcome.residual_px),
        lenses_held_rms_px=total_rms(joint.sightings, held.residual_px),
        held_out_rms_px=_held_out_rms(joint, held_out),
        sigma_px=sigma_px,
        degrees_of_freedom=freedom,
        spread_ratio=spread,
        is_widened=is_widened,
        is_converged=joint.outcome.is_converged,
    )


def _solve_alone(views: Sequence[BoardView], camera: int, start: Estimate, dropped: dict[int, str]) -> _Fit:
    fit = _fit(list(range(len(views))), (sightings_of(views, camera),), start)
    while len(fit.views) > LEAST_VIEWS:
        rms = view_rms(fit.sightings, fit.outcome.residual_px, len(fit.views))
        worst = far_view(rms)
        if worst is None:
            break
        dropped.setdefault(
            fit.views[worst],
            f"the {side_name(camera)} picture does not fit: {rms[worst]:.3g} px, the others {np.median(rms):.3g} px",
        )
        fit = _without(fit, worst)
    return fit


def _solve_joint(
    views: Sequence[BoardView], usable: list[int], start: Estimate, alone: list[_Fit], dropped: dict[int, str]
) -> _Fit:
    """Adjust everything; drop what fits each camera but not both: first from the robust start, then at the end."""
    sightings = tuple(sightings_of([views[number] for number in usable], camera) for camera in (0, 1))
    fit = _fit(list(usable), sightings, start, hold=True)
    is_final = False
    while True:
        rms = view_rms(fit.sightings, fit.outcome.residual_px, len(fit.views))
        worst = far_view(rms) if len(fit.views) > LEAST_VIEWS else None
        if worst is not None:
            dropped[fit.views[worst]] = _why_not_both(fit, worst, rms, alone)
            fit = _without(fit, worst, hold=not is_final)
        elif is_final:
            return fit
        else:
            fit = _fit(fit.views, fit.sightings, fit.estimate)
            is_final = True


def _why_not_both(fit: _Fit, worst: int, rms: Array, alone: list[_Fit]) -> str:
    number = fit.views[worst]
    each = [
        float(view_rms(one.sightings, one.outcome.residual_px, len(one.views))[one.views.index(number)])
        for one in alone
    ]
    if rms[worst] < DISAGREEMENT * float(np.sqrt(np.mean(np.square(each)))):
        return (
            f"its corners scatter more than the others', in each camera alone ({each[0]:.3g} and {each[1]:.3g} px) "
            f"as together ({rms[worst]:.3g} px, the other views {np.median(rms):.3g} px): blur, light, a moving "
            "board, or one far away"
        )
    return (
        f"each picture fits its camera ({each[0]:.3g} and {each[1]:.3g} px), together they do not "
        f"({rms[worst]:.3g} px, the other views {np.median(rms):.3g} px): board or camera moved between them, "
        "or they do not belong together"
    )


def _name_exchanged(views: Sequence[BoardView], fit: _Fit, right: Poses, dropped: dict[int, str]) -> None:
    """Say of dropped views that fit when exchanged that they are."""
    usual = float(np.median(view_rms(fit.sightings, fit.outcome.residual_px, len(fit.views))))
    for number in dropped:
        if exchanged_rms(views[number], fit.estimate, right.of_views([number])) < _EXCHANGED_FACTOR * usual:
            dropped[number] = "left and right pictures are exchanged"


def _fit(numbers: list[int], sightings: tuple[Sightings, ...], start: Estimate, *, hold: bool = False) -> _Fit:
    """Adjust, set single wild corners aside (judged anew each time), and so on until the same ones are."""
    base = [np.ones(len(seen.view)) for seen in sightings]
    current = sightings
    outcome = adjust(current, start, hold_cameras=hold, hold_pair=hold)
    for _ in range(_ROUNDS):
        judged = tuple(
            without_wild_corners(seen, residual, weight, len(numbers))
            for seen, residual, weight in zip(current, outcome.residual_px, base, strict=True)
        )
        if all(np.array_equal(new.weight, old.weight) for new, old in zip(judged, current, strict=True)):
            break
        current = judged
        outcome = adjust(current, outcome.estimate, hold_cameras=hold, hold_pair=hold)
    return _Fit(numbers, current, outcome)


def _of_views(fit: _Fit, numbers: Sequence[int]) -> _Fit:
    """Cut a fit down to some of its views, without adjusting again."""
    places = [fit.views.index(number) for number in numbers]
    sightings = tuple(seen.of_views(places) for seen in fit.sightings)
    residuals = tuple(
        residual[np.isin(seen.view, places)]
        for seen, residual in zip(fit.sightings, fit.outcome.residual_px, strict=True)
    )
    estimate = replace(fit.estimate, poses=fit.estimate.poses.of_views(places))
    return _Fit(list(numbers), sightings, replace(fit.outcome, estimate=estimate, residual_px=residuals))


def _without(fit: _Fit, worst: int, *, hold: bool = False) -> _Fit:
    """Leave one view out; adjust again with the corners judged anew, unless everything but the poses is held."""
    rest = _of_views(fit, [number for place, number in enumerate(fit.views) if place != worst])
    return rest if hold else _fit(rest.views, rest.sightings, rest.estimate)


def _weighted_by_corner(views: Sequence[BoardView], fit: _Fit) -> tuple[_Fit, float, int]:
    """Adjust once more with corners weighted by how well each is known; give the deviation of unit weight too."""
    sigma_px, _ = _scatter(fit)
    weights = corner_weights([views[number] for number in fit.views], fit.sightings, sigma_px)
    weighted = tuple(
        replace(seen, weight=np.where(seen.weight > 0.0, weight, 0.0))
        for seen, weight in zip(fit.sightings, weights, strict=True)
    )
    again = _Fit(fit.views, weighted, adjust(weighted, fit.estimate))
    return again, *_scatter(again)


def _scatter(fit: _Fit) -> tuple[float, int]:
    """Deviation of one pixel coordinate of unit weight, and the degrees of freedom."""
    n_numbers = sum(2 * int(np.count_nonzero(seen.weight)) for seen in fit.sightings)
    freedom = n_numbers - parameters_of_estimate(fit.estimate) - 6 * len(fit.views)
    if freedom < 1:
        raise NotDeterminedError(
            f"{n_numbers} pixel coordinates do not determine {n_numbers - freedom} parameters"
            "\nhint: take more views of a board with more corners"
        )
    cost = sum(
        float(np.sum(seen.weight[:, None] * residual**2))
        for seen, residual in zip(fit.sightings, fit.outcome.residual_px, strict=True)
    )
    return float(np.sqrt(cost / freedom)), freedom


@dataclass(frozen=True)
class _Fold:
    """A solve without some views: the change of θ, and its information for pixels of unit variance."""

    change: Array
    information: Array


def _leave_out(fit: _Fit) -> tuple[dict[int, tuple[float, int]], list[_Fold]]:
    """Fit without some views by turns; test on those with only the board's pose free.

    Returns
    -------
    held_out
        Place of a view to its sum of squared distances (px²) and number of corners.
    folds
        What the rig became without them.
    """
    n_views = len(fit.views)
    held_out: dict[int, tuple[float, int]] = {}
    folds: list[_Fold] = []
    if n_views < _LEAST_HELD_OUT_VIEWS:
        return held_out, folds
    n_folds = min(n_views, _MOST_FOLDS)
    for fold in range(n_folds):
        test = [place for place in range(n_views) if place % n_folds == fold]
        train = [place for place in range(n_views) if place % n_folds != fold]
        poses = fit.estimate.poses
        trained = adjust(
            tuple(seen.of_views(train) for seen in fit.sightings),
            replace(fit.estimate, poses=poses.of_views(train)),
            iterations=_FOLD_ITERATIONS,
        )
        folds.append(_Fold(_change(trained.estimate, fit.estimate), trained.information))
        tested = tuple(seen.of_views(test) for seen in fit.sightings)
        outcome = adjust(
            tested, replace(trained.estimate, poses=poses.of_views(test)), hold_cameras=True, hold_pair=True
        )
        rms = view_rms(tested, outcome.residual_px, len(test))
        for place, value in zip(test, rms, strict=True):
            count = sum(int(np.count_nonzero(seen.weight[seen.view == place])) for seen in fit.sightings)
            held_out[place] = (float(value) ** 2 * count, count)
    return held_out, folds


def _change(new: Estimate, old: Estimate) -> Array:
    """θ of one estimate minus that of another, in the order of `Rig.parameter_names`."""
    assert new.pair is not None
    assert old.pair is not None
    cameras = [parameters_of(a) - parameters_of(b) for a, b in zip(new.cameras, old.cameras, strict=True)]
    # A small turn: sine and angle are the same.
    turn = new.pair.R @ old.pair.R.T
    small = 0.5 * np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
    return np.concatenate([*cameras, small, new.pair.t_mm - old.pair.t_mm])


def _spread_ratio(folds: list[_Fold], information: Array, sigma_px: float) -> tuple[float | None, float]:
    """Compare how much the rig changes when views are left out with how much it should.

    With independent corners, `Cov(θ_without − θ) = C_without − C`. So Σ dᵀ C⁻¹ d over the folds has the expectation
    Σ tr(C⁻¹ C_without − 1), however much each view weighs.

    Returns
    -------
    ratio
        Root of what is seen over what is expected; None without folds.
    limit
        What independent corners exceed once in many thousand times.
    """
    seen, expected, expected_square = 0.0, 0.0, 0.0
    for fold in folds:
        try:
            more = information @ covariance_of(fold.information) * sigma_px**2 - np.eye(len(information))
        except NotDeterminedError:
            continue
        seen += float(fold.change @ information @ fold.change)
        expected += float(np.trace(more))
        expected_square += float(np.trace(more @ more))
    if not expected > 0.0:
        return None, np.inf
    n_effective = expected**2 / expected_square
    return float(np.sqrt(seen / expected)), float(np.sqrt(1.0 + _SPREAD_SIGMAS * np.sqrt(2.0 / n_effective)))


def _held_out_rms(fit: _Fit, held_out: dict[int, tuple[float, int]]) -> float | None:
    if len(held_out) < len(fit.views):
        return None
    square, count = np.sum(list(held_out.values()), axis=0)
    return float(np.sqrt(square / count))


def _alone_again(alone: _Fit, joint: _Fit, camera: int) -> Adjusted:
    """Adjust one camera alone on the corners that the joint solve used."""
    return adjust((joint.sightings[camera],), _of_views(alone, joint.views).estimate)


def _view_results(
    views: Sequence[BoardView], fit: _Fit, held_out: dict[int, tuple[float, int]], sigma_px: float
) -> tuple[ViewResult, ...]:
    n_views = len(fit.views)
    rms = [
        view_rms([seen], [residual], n_views)
        for seen, residual in zip(fit.sightings, fit.outcome.residual_px, strict=True)
    ]
    scatter = [
        view_rms([seen], [residual * np.sqrt(seen.weight)[:, None]], n_views) / (np.sqrt(2.0) * sigma_px)
        for seen, residual in zip(fit.sightings, fit.outcome.residual_px, strict=True)
    ]
    used = [np.bincount(seen.view, seen.weight > 0.0, n_views).astype(int) for seen in fit.sightings]
    seen_all = [np.bincount(seen.view, minlength=n_views) for seen in fit.sightings]
    results = []
    for place, number in enumerate(fit.views):
        square, count = held_out.get(place, (0.0, 0))
        results.append(
            ViewResult(
                views[number].name,
                int(used[0][place]),
                int(used[1][place]),
                int(sum(seen_all[camera][place] - used[camera][place] for camera in (0, 1))),
                float(rms[0][place]),
                float(rms[1][place]),
                float(np.sqrt(square / count)) if count else None,
                float(scatter[0][place]),
                float(scatter[1][place]),
            )
        )
    return tuple(results)


def _rig(estimate: Estimate, image_size: tuple[int, int], covariance: Array) -> Rig:
    assert estimate.pair is not None
    left, right = estimate.cameras
    return Rig(
        left.matrix_px, left.distortion, right.matrix_px, right.distortion, estimate.pair, image_size, covariance
    )


def _refuse_unknown(rig: Rig) -> None:
    """Refuse a rig of which nothing is known: a focal length of which 0 is within two standard uncertainties."""
    deviations = rig.standard_uncertainties() or {}
    for camera, lens in enumerate((rig.left, rig.right)):
        side = side_name(camera)
        focal_px, std_px = float(lens.focal_px[0]), deviations[f"{side}_fx_px"]
        if 2.0 * std_px > focal_px:
            raise NotDeterminedError(
                f"the views do not determine the {side} camera: its focal length would be "
                f"{focal_px:.0f} ± {std_px:.0f} px\nhint: take views of a tilted board, near and far, "
                "with both pictures of a pair from one moment"
            )


def _refuse_too_few(views: Sequence[BoardView], usable: list[int], dropped: dict[int, str]) -> None:
    if len(usable) >= LEAST_VIEWS:
        return
    reasons = "".join(f"\n  {views[number].name}: {why}" for number, why in sorted(dropped.items()))
    raise DetectionError(f"{len(usable)} of {len(views)} views are left, {LEAST_VIEWS} are needed{reasons}")
