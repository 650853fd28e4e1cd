"""From board pictures to a rig: every view judged, every parameter with its uncertainty."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from geoerr.arguments import check_threads
from geoerr.drawing import drawn
from geoerr.errors import DetectionError, InputFileError, ShapeError
from geoerr.geometry import unmasked
from geoerr.vision.board_views import DISAGREEMENT, LEAST_VIEWS, BoardView, SeenCorners, repeated_views
from geoerr.vision.boards import LEAST_CORNERS, BoardSighting, find_board, hint_for_unseen_board, same_colours
from geoerr.vision.images import read_grey
from geoerr.vision.opencv_threads import one_opencv_thread
from geoerr.vision.pair_start import side_name
from geoerr.vision.rig import Rig
from geoerr.vision.scale_bar import ScaleBarResult, check_scale_bars
from geoerr.vision.session import BoardSpec, CalibrationPair, Session
from geoerr.vision.stereo_solve import Dropped, Solved, ViewResult, solve_stereo

if TYPE_CHECKING:
    import plotly.graph_objects as go

Array = npt.NDArray[np.float64]
Size = tuple[int, int]
# Called with pairs done and pairs in all.
Progress = Callable[[int, int], None]

# A view whose corners scatter this much more or less than all, and by so many of its own uncertainties.
_NOISIER_FACTOR = 1.5
_NOISIER_SIGMAS = 5.0
_FOCAL_NOTED = 0.01
_SCALE_BAR_NOTED_SIGMAS = 3.0
# A detector's corners give a marker's side to some hundredths.
_OTHER_MARKER = 0.1
_REASONS_SHOWN = 6
_SIZE_HINT = "image_size is (width, height), of a picture as an array `picture.shape[1::-1]`"


@dataclass(frozen=True)
class Calibration:
    """A calibrated rig and how well it is known.

    Attributes
    ----------
    rig
        With the covariance of all its parameters.
    solved
        Residuals, views used and dropped; see `Solved`.
    pairs_dropped
        Every pair, or single picture, that does not take part, with the reason.
    scale_bars
        Measured lengths against what the rig sees.
    notes
        What the user should know, in words.
    """

    rig: Rig
    solved: Solved
    pairs_dropped: tuple[Dropped, ...]
    scale_bars: tuple[ScaleBarResult, ...] = ()
    notes: tuple[str, ...] = ()

    @property
    def pairs_used(self) -> int:
        """How many pairs take part."""
        return len(self.solved.views)

    @property
    def per_view(self) -> tuple[ViewResult, ...]:
        """Each pair that takes part."""
        return self.solved.views

    @property
    def left_rms_px(self) -> float:
        """Reprojection error of the left camera solved alone: root mean square distance."""
        return self.solved.left_rms_px

    @property
    def right_rms_px(self) -> float:
        """Reprojection error of the right camera solved alone."""
        return self.solved.right_rms_px

    @property
    def stereo_rms_px(self) -> float:
        """Reprojection error of the joint solve over both cameras' corners."""
        return self.solved.stereo_rms_px

    @property
    def held_out_rms_px(self) -> float | None:
        """Reprojection error of views that took no part, only the board's pose free; None with fewer than four."""
        return self.solved.held_out_rms_px

    @property
    def baseline_std_mm(self) -> float:
        """Standard uncertainty of the cameras' distance."""
        assert self.rig.covariance is not None
        along = self.rig.right_from_left.t_mm / self.rig.baseline_mm
        return float(np.sqrt(along @ self.rig.covariance[-3:, -3:] @ along))

    def plot_views(self) -> go.Figure:
        """Draw the reprojection error of each view in both cameras."""
        return drawn("calibration_quality", self)

    def to_document(self) -> dict[str, Any]:
        """Give the content of `calibrate --json`."""
        solved = self.solved
        return {
            "pairs_used": self.pairs_used,
            "pairs_dropped": [{"name": item.name, "why": item.why} for item in self.pairs_dropped],
            "left_rms_px": solved.left_rms_px,
            "right_rms_px": solved.right_rms_px,
            "stereo_rms_px": solved.stereo_rms_px,
            "held_out_rms_px": solved.held_out_rms_px,
            "baseline_mm": self.rig.baseline_mm,
            "baseline_std_mm": self.baseline_std_mm,
            "per_view": [
                {
                    "name": view.name,
                    "left_corners": view.n_left,
                    "right_corners": view.n_right,
                    "set_aside": view.n_set_aside,
                    "left_rms_px": view.left_rms_px,
                    "right_rms_px": view.right_rms_px,
                    "held_out_rms_px": view.held_out_rms_px,
                    "left_scatter": view.left_scatter,
                    "right_scatter": view.right_scatter,
                }
                for view in solved.views
            ],
            "stereo_rms_lenses_held_px": solved.lenses_held_rms_px,
            "sigma_px": solved.sigma_px,
            "degrees_of_freedom": solved.degrees_of_freedom,
            "spread_ratio": solved.spread_ratio,
            "standard_uncertainties": self.rig.standard_uncertainties(),
            "scale_bars": [bar.to_document() for bar in self.scale_bars],
            "notes": list(self.notes),
        }


def calibrate(session: Session, *, threads: int = 0, progress: Progress | None = None) -> Calibration:
    """Calibrate the pair of cameras of a session.

    Parameters
    ----------
    session
        With a board and pairs of its pictures.
    threads
        Pictures worked on at once, 0 for all cores; never changes a result.
    progress
        Called after each pair.

    Raises
    ------
    InputFileError
        without board or pairs, or with left and right pictures of different size.
    DetectionError
        where fewer than three pairs show the board to both cameras, or fit; the message says what was found.
    NotDeterminedError
        where the views leave a parameter free.
    ShapeError
        for what is no number of threads.

    Notes
    -----
    A picture that cannot be read or does not show the board drops its pair with the reason, never the rest. The
    scale is that of `square_mm`; a scale bar in the session is compared with it. Verified against the simulator's
    truth and real pictures (tests/vision/test_calibrate.py).
    """
    check_threads(threads)
    board, pairs = session.require_board(), session.require_pairs()
    looks = _look_at_all(pairs, board, threads, progress)
    size = _common_size(session, looks)
    views, dropped = _views_of(board, looks, size)
    if len(views) < LEAST_VIEWS:
        raise _too_few(session, board, looks, dropped)
    solved = solve_stereo(views, size)
    bars = check_scale_bars(session.directory, session.scale_bars, solved.rig)
    unpaired = tuple(Dropped(item.name, item.why) for item in session.unpaired)
    everything = sorted((*dropped, *solved.dropped), key=lambda item: item.name)
    notes = (*_notes(solved, bars), *_notes_on_markers(board, looks))
    return Calibration(solved.rig, solved, (*everything, *unpaired), bars, notes)


def calibrate_from_corners(
    object_points: Sequence[npt.ArrayLike],
    left_points: Sequence[npt.ArrayLike],
    right_points: Sequence[npt.ArrayLike],
    image_size: Size,
    *,
    names: Sequence[str] | None = None,
) -> Calibration:
    """Calibrate from corners that were found elsewhere.

    Parameters
    ----------
    object_points
        For each view (n, 3) or (n, 2), mm on the flat board; z the same for all.
    left_points, right_points
        For each view (n, 2) pixels, pixel centres at whole numbers; NaN where a camera did not see the corner.
    image_size
        (width, height), px: no corner lies outside.
    names
        Of the views; numbers from 1 where absent.

    Raises
    ------
    ShapeError
        for arrays that do not fit together, a board that is not flat, or corners outside the picture.
    DetectionError, NotDeterminedError
        as `calibrate`.
    """
    n_views = len(object_points)
    if not len(left_points) == len(right_points) == n_views:
        raise ShapeError(f"{n_views} boards, {len(left_points)} left and {len(right_points)} right views")
    labels = [str(number + 1) for number in range(n_views)] if names is None else list(names)
    if len(labels) != n_views:
        raise ShapeError(f"{n_views} views, {len(labels)} names")
    size = _stated_size(image_size)
    views: list[BoardView] = []
    dropped: list[Dropped] = []
    for label, board, left, right in zip(labels, object_points, left_points, right_points, strict=True):
        board_mm = _board_points(board, label)
        sides = [_seen_corners(board_mm, points, label) for points in (left, right)]
        _refuse_outside(sides, size, label)
        too_few = [side_name(camera) for camera, side in enumerate(sides) if not _is_enough(side)]
        if too_few:
            dropped.append(
                Dropped(
                    label,
                    f"{' and '.join(too_few)}: fewer than {LEAST_CORNERS} corners, or all in one line",
                )
            )
        else:
            views.append(BoardView(label, sides[0], sides[1]))
    views, dropped = _each_once(views, dropped)
    if len(views) < LEAST_VIEWS:
        reasons = "".join(f"\n  {item.name}: {item.why}" for item in dropped)
        raise DetectionError(f"{len(views)} of {n_views} views can be used, {LEAST_VIEWS} are needed{reasons}")
    solved = solve_stereo(views, size)
    return Calibration(solved.rig, solved, (*dropped, *solved.dropped), (), tuple(_notes(solved, ())))


@dataclass(frozen=True)
class _Look:
    """What one picture shows: its size, the board or why not, and what helps where it cannot be read."""

    size: Size | None
    sighting: BoardSighting | None
    why: str = ""
    remedy: str | None = None


@dataclass(frozen=True)
class _PairLook:
    """What both pictures of a pair show."""

    pair: CalibrationPair
    left: _Look
    right: _Look

    @property
    def sides(self) -> tuple[_Look, _Look]:
        return self.left, self.right


def _look_at_all(
    pairs: Sequence[CalibrationPair], board: BoardSpec, threads: int, progress: Progress | None
) -> list[_PairLook]:
    def look(pair: CalibrationPair) -> _PairLook:
        return _PairLook(pair, _look(pair, 0, board), _look(pair, 1, board))

    looks = []
    with one_opencv_thread(), ThreadPoolExecutor(threads or os.cpu_count() or 1) as pool:
        jobs = [pool.submit(look, pair) for pair in pairs]
        try:
            for job in jobs:
                looks.append(job.result())
                if progress is not None:
                    progress(len(looks), len(pairs))
        except BaseException:
            pool.shutdown(cancel_futures=True)
            raise
    return looks


def _look(pair: CalibrationPair, camera: int, board: BoardSpec) -> _Look:
    try:
        picture = read_grey(pair.right if camera else pair.left)
    except InputFileError as error:
        return _Look(None, None, error.problem, error.remedy)
    size = (picture.shape[1], picture.shape[0])
    try:
        return _Look(size, find_board(picture, board))
    except DetectionError as error:
        return _Look(size, None, str(error))


def _common_size(session: Session, looks: Sequence[_PairLook]) -> Size:
    """Give the size that most pictures have; refuse cameras of different size."""
    folder = session.directory / "calibration"
    usual: list[Size] = []
    for camera in (0, 1):
        sizes = Counter(size for look in looks if (size := look.sides[camera].size) is not None)
        if not sizes:
            name = side_name(camera)
            first = looks[0].sides[camera]
            raise InputFileError(
                folder / name,
                f"none of its {len(looks)} pictures can be read; the first: {first.why}",
                remedy=_common_remedy(look.sides[camera] for look in looks),
            )
        usual.append(sizes.most_common(1)[0][0])
    if usual[0] != usual[1]:
        raise InputFileError(
            folder,
            f"left pictures are {_times(usual[0])} px, right pictures {_times(usual[1])} px",
            remedy="both cameras must give pictures of one size; crop or scale none of them",
        )
    return usual[0]


def _common_remedy(sides: Iterable[_Look]) -> str | None:
    """Give what helps against all that is wrong with pictures, where that is one thing."""
    remedies = {side.remedy for side in sides}
    return remedies.pop() if len(remedies) == 1 else None


def _common_remedy_of_pairs(looks: Sequence[_PairLook], n_dropped: int) -> str | None:
    """Give what helps against all that is wrong with the pairs that were dropped, where that is one thing."""
    unseen = [[side for side in look.sides if side.sighting is None] for look in looks]
    if sum(map(bool, unseen)) < n_dropped:
        # Some show the board, and are dropped for their size, or because they repeat another one.
        return None
    return _common_remedy(side for sides in unseen for side in sides)


def _views_of(board: BoardSpec, looks: Sequence[_PairLook], size: Size) -> tuple[list[BoardView], list[Dropped]]:
    flat = board.layout().corners_mm
    corners_mm = np.column_stack([flat, np.zeros(len(flat))])
    turns = same_colours(board)[1:]
    views, dropped = [], []
    for look in looks:
        reasons = list(_reasons(look, size))
        left, right = look.left.sighting, look.right.sighting
        if reasons or left is None or right is None:
            dropped.append(Dropped(look.pair.name, "; ".join(reasons)))
            continue
        views.append(
            BoardView(
                look.pair.name,
                SeenCorners(corners_mm[left.ids], left.corners_px, left.std_px),
                SeenCorners(corners_mm[right.ids], right.corners_px, right.std_px),
                tuple(corners_mm[turn[right.ids]] for turn in turns),
            )
        )
    return _each_once(views, dropped)


def _each_once(views: list[BoardView], dropped: list[Dropped]) -> tuple[list[BoardView], list[Dropped]]:
    """Take out views that hold the picture of another one."""
    repeated = repeated_views(views)
    told = [Dropped(views[number].name, why) for number, why in repeated.items()]
    return [view for number, view in enumerate(views) if number not in repeated], [*dropped, *told]


def _reasons(look: _PairLook, size: Size) -> Iterator[str]:
    for camera, side in enumerate(look.sides):
        if side.size is not None and side.size != size:
            yield f"{side_name(camera)}: {_times(side.size)} px, the others {_times(size)} px"
        elif side.sighting is None:
            yield f"{side_name(camera)}: {side.why}"


def _too_few(
    session: Session, board: BoardSpec, looks: Sequence[_PairLook], dropped: Sequence[Dropped]
) -> DetectionError:
    """Say in which pictures the board was found and why not in the others."""
    counts = [sum(look.sides[camera].sighting is not None for look in looks) for camera in (0, 1)]
    n_pairs = len(looks)
    text = (
        f"{session.directory / 'calibration'}: both cameras see the board in {n_pairs - len(dropped)} of {n_pairs} "
        f"pairs, {LEAST_VIEWS} are needed; the left camera sees it in {counts[0]}, the right one in {counts[1]}"
    )
    text += "".join(f"\n  {item.name}: {item.why}" for item in dropped[:_REASONS_SHOWN])
    if len(dropped) > _REASONS_SHOWN:
        text += f"\n  ... and {len(dropped) - _REASONS_SHOWN} more"
    hint = _common_remedy_of_pairs(looks, len(dropped)) or (
        "take ten or more pairs in which both cameras see the board, sharp and well lit"
    )
    hint = _hint_for_blind_cameras(board, looks) or hint
    return DetectionError(f"{text}\nhint: {hint}")


def _hint_for_blind_cameras(board: BoardSpec, looks: Sequence[_PairLook]) -> str | None:
    """Say what a camera's first picture shows that sees the board in none; which camera, where the other does."""
    is_blind = [all(look.sides[camera].sighting is None for look in looks) for camera in (0, 1)]
    for camera in (0, 1):
        unseen = next((look.pair for look in looks if look.sides[camera].size is not None), None)
        if unseen is None or not is_blind[camera]:
            continue
        hint = hint_for_unseen_board(read_grey(unseen.right if camera else unseen.left), board)
        if hint is not None:
            return hint if all(is_blind) else f"the {side_name(camera)} camera: {hint}"
    return None


def _board_points(board: npt.ArrayLike, label: str) -> Array:
    points = np.asarray(unmasked(board, f"view {label}: the board"), dtype=np.float64)
    points = points.reshape(-1, points.shape[-1]) if points.ndim else points.reshape(0, 0)
    if points.shape[1] == 2:
        points = np.column_stack([points, np.zeros(len(points))])
    if points.shape[1] != 3 or not np.isfinite(points).all():
        raise ShapeError(f"view {label}: board points are finite (n, 3) or (n, 2), not {np.shape(board)}")
    if len(points) and np.ptp(points[:, 2]) > 0.0:
        raise ShapeError(f"view {label}: the board is not flat; its z must be the same for all corners")
    return points


def _seen_corners(board_mm: Array, points: npt.ArrayLike, label: str) -> SeenCorners:
    pixels = np.asarray(unmasked(points, f"view {label}: the array of pixels"), dtype=np.float64).reshape(-1, 2)
    if len(pixels) != len(board_mm):
        raise ShapeError(f"view {label}: {len(board_mm)} board points, {len(pixels)} pixels")
    is_seen = np.isfinite(pixels).all(axis=1)
    return SeenCorners(board_mm[is_seen], pixels[is_seen], np.ones(int(is_seen.sum())))


def _stated_size(image_size: Sequence[int]) -> Size:
    """Give width and height; refuse what is not two whole numbers, as the shape of a picture is in NumPy."""
    numbers = np.asarray(image_size)
    if numbers.shape != (2,) or not np.issubdtype(numbers.dtype, np.integer) or numbers.min() < 1:
        raise ShapeError(
            f"image_size is {image_size!r}, which is no (width, height) in whole pixels\nhint: {_SIZE_HINT}"
        )
    return int(numbers[0]), int(numbers[1])


def _refuse_outside(sides: Sequence[SeenCorners], size: Size, label: str) -> None:
    for camera, side in enumerate(sides):
        # Who counts from the corner of the first pixel is half a pixel off, and no farther.
        is_outside = ((side.pixel < -1.0) | (side.pixel > size)).any(axis=1)
        if is_outside.any():
            u, v = side.pixel[is_outside][0]
            raise ShapeError(
                f"view {label}, {side_name(camera)}: a corner at ({u:.1f}, {v:.1f}) px is outside a picture of "
                f"{_times(size)} px\nhint: {_SIZE_HINT}, or the corner is wrong: NaN where it was not seen"
            )


def _is_enough(side: SeenCorners) -> bool:
    if len(side.pixel) < LEAST_CORNERS:
        return False
    spread = np.linalg.svd(side.board_mm - side.board_mm.mean(axis=0), compute_uv=False)
    return bool(spread[1] > 1e-6 * spread[0])


def _times(size: Size) -> str:
    return f"{size[0]} × {size[1]}"


def _notes(solved: Solved, bars: Sequence[ScaleBarResult]) -> Iterator[str]:
    yield from _notes_on_agreement(solved)
    yield from _notes_on_parameters(solved)
    for bar in bars:
        name = f"scale bar {bar.targets[0]} to {bar.targets[1]}"
        if bar.sigmas is None or bar.difference_um is None or bar.difference_ppm is None:
            yield f"{name} was not seen: {bar.why}"
        elif abs(bar.sigmas) > _SCALE_BAR_NOTED_SIGMAS:
            yield (
                f"{name} is seen {bar.difference_um:+.1f} µm ({bar.difference_ppm:+.0f} ppm, {bar.sigmas:+.1f} "
                "standard uncertainties) from its length: the board's square_mm or the bar's length_mm is wrong"
            )


def _notes_on_markers(board: BoardSpec, looks: Sequence[_PairLook]) -> Iterator[str]:
    seen = [side.sighting.marker_of_square for look in looks for side in look.sides if side.sighting is not None]
    shares = [share for share in seen if share is not None]
    if board.marker_mm is None or not shares:
        return
    stated, share = board.marker_mm / board.square_mm, float(np.median(shares))
    if abs(share / stated - 1.0) > _OTHER_MARKER:
        yield (
            f"the board's markers are {share:.2f} of its squares in the pictures, and {stated:.2f} by marker_mm "
            f"{board.marker_mm:g} and square_mm {board.square_mm:g}: measure both; square_mm gives the scale"
        )


def _notes_on_agreement(solved: Solved) -> Iterator[str]:
    alone = float(np.hypot(solved.left_rms_px, solved.right_rms_px) / np.sqrt(2.0))
    if solved.stereo_rms_px > DISAGREEMENT * alone:
        yield (
            f"the two cameras disagree although each alone fits: {solved.left_rms_px:.2f} and "
            f"{solved.right_rms_px:.2f} px alone, {solved.stereo_rms_px:.2f} px together "
            f"({solved.lenses_held_rms_px:.2f} px with each lens as it is alone): the cameras are not synchronised, "
            "or the board moved; this rig is not fit to measure with"
        )
    scatter = {
        f"{view.name} {side}": (ratio, rms, count)
        for view in solved.views
        for side, ratio, rms, count in (
            ("left", view.left_scatter, view.left_rms_px, view.n_left),
            ("right", view.right_scatter, view.right_rms_px, view.n_right),
        )
    }
    # The uncertainty of a scatter from n corners is about 1/√(4n) of it.
    unusual = [
        name
        for name, (ratio, _, count) in scatter.items()
        if ratio > max(_NOISIER_FACTOR, 1.0 + _NOISIER_SIGMAS / np.sqrt(4.0 * count))
    ]
    if unusual:
        worst = max(unusual, key=lambda name: scatter[name][0])
        yield (
            f"in {len(unusual)} of {len(scatter)} pictures corners scatter more than in the others: "
            f"{scatter[worst][1]:.3g} px in {worst}, {scatter[worst][0]:.1f} times as much as expected "
            "(blur, light or a moving board)"
        )
    if solved.is_widened and solved.spread_ratio is not None:
        yield (
            f"views left out by turns change the rig {solved.spread_ratio:.1f} times more than the corners' "
            "scatter explains: a board that is not flat, or a lens that five coefficients do not describe; the "
            "uncertainties are widened by that factor, which is the least: what all views share, such as the bend of "
            "the board, does not show when some are left out"
        )


def _notes_on_parameters(solved: Solved) -> Iterator[str]:
    rig = solved.rig
    if not solved.is_converged:
        yield "the adjustment did not settle: the views hardly determine the lenses; tilt the board more"
    deviations = rig.standard_uncertainties() or {}
    for side, camera in (("left", rig.left), ("right", rig.right)):
        relative = deviations[f"{side}_fx_px"] / camera.focal_px[0]
        if relative > _FOCAL_NOTED:
            yield (
                f"the {side} camera's focal length is known to {100.0 * relative:.1f} % only: take views with the "
                "board tilted by 30° or more, near and far, and in the corners of the picture"
            )
    # The right camera's centre: the shift itself is along its own axes, and it may be mounted upside down.
    centre_mm = -rig.right_from_left.R.T @ rig.right_from_left.t_mm
    if -centre_mm[0] > abs(centre_mm[1]):
        yield (
            "the right camera stands on the left camera's left: the folders may be exchanged, or the left camera is "
            "upside down, which does no harm as long as frames.csv names the cameras the same way"
        )
