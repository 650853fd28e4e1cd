"""What is said about a measured session: refused as a whole, single plates left out, notes to the user."""

from __future__ import annotations

import contextlib
import itertools
import math
from collections.abc import Collection, Iterator, Mapping, Sequence

import numpy as np
import numpy.typing as npt
import polars as pl

from geoerr.errors import InputFileError
from geoerr.summaries import counted
from geoerr.vision.consistency import Agreement, MeasuredSize, measured_size
from geoerr.vision.frame import NOT_FOUND, TWICE, Missed
from geoerr.vision.images import read_grey
from geoerr.vision.markers import dictionaries_seen, seen_in_a_mirror
from geoerr.vision.plate_rows import Collector, PlateRows
from geoerr.vision.rig import Rig
from geoerr.vision.sensitivity import points_from_pixels, project_to_both
from geoerr.vision.session import Session

Array = npt.NDArray[np.float64]

_OUTLIER_TIMES_MEDIAN = 10.0
_OUTLIER_LEAST_PX = 0.1
# Corners are known to hundredths of a pixel: where they miss each other by this much, in the median, something is
# wrong; by the second, they do not come from this rig at all.
_DOUBTFUL_RIG_PX = 0.5
_NOT_THIS_RIG_PX = 10.0
_SWAPPED_SHARE = 0.1
_SIZE_REFUSED = 0.05
# No print is off by as much: a margin that was measured with the marker makes a quarter of it at most.
_SIZE_NO_PRINT_HAS = 0.3
_SIZE_NOTED_SIGMAS = 5.0
_BIRGE_NOTED = 1.2
_RIG_SHIFT_NOTED_SIGMAS = 3.0
_MISFIT_NOTED = 1.5
_UNEVENNESS_NOTED = 2.0
# A target whose corners scatter so many times more than those of any other is the one to look at.
_STANDS_OUT = 2.0
_RIG_REMEDY = "use the rig.json of these cameras in this position, or calibrate again"


def nothing_seen(session: Session, collected: Collector, n_frames: int) -> InputFileError:
    """Say why no frame has both pictures of any target."""
    frames = session.require_frames()
    if collected.n_readable == 0:
        return nothing_left(session, collected.missed, n_frames)
    wanted = ", ".join(target.name for target in session.targets)
    unfitted = next((item for item in collected.missed if item.target and item.why not in (NOT_FOUND, TWICE)), None)
    if unfitted is not None:
        return InputFileError(
            session.directory / "frames.csv",
            f"targets are found, but none can be fitted with this rig in both pictures of any of the {n_frames} "
            f"frames; the first: {unfitted.target}: {unfitted.why}",
            column=unfitted.camera,
            remedy=f"{_RIG_REMEDY}; if the rig is right, check focus and light",
        )
    if collected.n_found:
        return InputFileError(
            session.description_path,
            f"no target ({wanted}) is in both pictures of any of the {n_frames} frames; the first: "
            f"{collected.missed[0].camera}: {collected.missed[0].why}",
            column="targets",
            remedy="both cameras must see a target whole",
        )
    first = list(_first_pictures(session, frames))
    markers = [target.marker for target in session.targets]
    if any(seen_in_a_mirror(picture, markers) for picture in first):
        return InputFileError(
            session.directory / "frames.csv",
            f"the pictures show the targets ({wanted}) as in a mirror",
            column="left",
            remedy="switch off what flips the pictures in the camera or its program",
        )
    seen = next((shown for picture in first if (shown := dictionaries_seen(picture))), {})
    if seen:
        text = "; ".join(f"{name} ids {', '.join(map(str, ids))}" for name, ids in list(seen.items())[:3])
        return InputFileError(
            session.description_path,
            f"none of the targets ({wanted}) is in any of the {n_frames} frames; the pictures show markers of {text}",
            column="targets",
            remedy="name the dictionary and id that were printed",
        )
    return InputFileError(
        session.description_path,
        f"none of the targets ({wanted}) is in any of the {n_frames} frames, nor any other known marker",
        column="targets",
        remedy="check focus and light, and that each plate has a white margin of one module",
    )


def nothing_left(session: Session, missed: Sequence[Missed], n_frames: int) -> InputFileError:
    """Say why no frame can be used; where all fail alike, with what helps against that."""
    first = min(missed, key=lambda item: item.row)
    remedies = {item.remedy for item in missed}
    own = remedies.pop() if len(remedies) == 1 else None
    return InputFileError(
        session.directory / "frames.csv",
        f"none of its {n_frames} frames can be used; the first: {first.why}",
        row=int(session.require_frames()["file_row"][first.row]),
        column=None if first.camera == "both" else first.camera,
        remedy=own or "check the pictures and that the rig belongs to these cameras",
    )


def _first_pictures(session: Session, frames: pl.DataFrame) -> Iterator[npt.NDArray[np.uint8]]:
    """Read the pictures of the first few frames, as far as they can be."""
    for name in itertools.chain(*zip(frames["left"][:3], frames["right"][:3], strict=True)):
        with contextlib.suppress(InputFileError):
            yield read_grey(session.directory / name)


def refuse_wrong_rig(session: Session, rig: Rig, rows: PlateRows) -> None:
    """Refuse a session whose corners as a whole do not fit the rig, and say so if they do the other way round."""
    typical = float(np.median(np.where(rows.why == "", rows.reprojection_px, np.inf)))
    if typical < _DOUBTFUL_RIG_PX:
        return
    how = "lie behind the cameras" if math.isinf(typical) else f"miss each other by {typical:.1f} px"
    swapped = float(np.median(_reprojection_when_swapped(rig, rows.centre_seen_px)))
    if swapped < _SWAPPED_SHARE * min(typical, _NOT_THIS_RIG_PX):
        raise InputFileError(
            session.directory / "frames.csv",
            f"left and right look swapped: points {how}, and fit when the pictures are exchanged",
            column="left",
            remedy="exchange the columns left and right, or calibrate with the same naming",
        )
    if typical > _NOT_THIS_RIG_PX:
        raise InputFileError(
            session.directory / "frames.csv",
            f"the pictures do not belong to this rig: points {how}",
            column="left",
            remedy=_RIG_REMEDY,
        )


def _reprojection_when_swapped(rig: Rig, pixels: Array) -> Array:
    """(n,) px by which the plates' middles miss each other when left and right are exchanged; inf = behind."""
    exchanged = pixels[:, [2, 3, 0, 1]]
    points = points_from_pixels(rig, exchanged)
    known = np.isfinite(points).all(axis=1)
    result = np.full(len(pixels), np.inf)
    difference = project_to_both(rig, points[known]).pixel - exchanged[known]
    result[known] = np.sqrt((difference**2).sum(axis=1) / 2.0)
    return result


def outliers(rig: Rig, rows: PlateRows) -> npt.NDArray[np.object_]:
    """Reason for every plate that does not fit like the others, '' for those that do."""
    why = rows.why.copy()
    placed = why == ""
    if not placed.any():
        return why
    limit_px = max(_OUTLIER_TIMES_MEDIAN * float(np.median(rows.reprojection_px[placed])), _OUTLIER_LEAST_PX)
    limit_chi = _OUTLIER_TIMES_MEDIAN * float(np.median(rows.chi[placed]))
    far = placed & (rows.reprojection_px > limit_px) & (rows.chi > limit_chi)
    for index in np.flatnonzero(far):
        why[index] = f"the two pictures miss each other by {rows.reprojection_px[index]:.2f} px (outlier)"
    doubtful = np.flatnonzero(why != "")
    swapped = _reprojection_when_swapped(rig, rows.centre_seen_px[doubtful]) < limit_px
    why[doubtful[swapped]] = "left and right look swapped in this frame"
    return why


def sizes(session: Session, rig: Rig, rows: PlateRows, kept: npt.NDArray[np.bool_]) -> tuple[MeasuredSize, ...]:
    """Measured side of each target; refuse a size that contradicts the calibration."""
    sizes = []
    for index, target in enumerate(session.targets):
        mine = np.flatnonzero(kept & (rows.target == index))
        if not len(mine):
            continue
        some = mine[:: 1 + len(mine) // 50]
        size = measured_size(
            target.name,
            target.size_mm,
            rows.sides_mm[mine],
            rows.side_std_mm[mine],
            rows.side_px[mine],
            rows.centre_mm[some],
            rows.along[some],
            rig,
        )
        if abs(size.relative_error) > _SIZE_REFUSED:
            raise InputFileError(
                session.description_path,
                f"the size of target {target.name} contradicts the calibration: {target.size_mm:g} mm given,"
                f" {size.measured_mm:.3f} mm measured in {size.n} frames",
                column=f"targets[{index + 1}].size_mm",
                remedy=_remedy_for_size(size),
            )
        sizes.append(size)
    return tuple(sizes)


def _remedy_for_size(size: MeasuredSize) -> str:
    """Say what makes a size wrong; where it is far off, what turns or scales all that is seen, too."""
    remedy = "measure the marker's black square; if it is right, square_mm of the board is not"
    if abs(size.relative_error) <= _SIZE_NO_PRINT_HAS:
        return remedy
    return (
        f"{remedy}, or the pictures are turned, mirrored, cropped or scaled since the calibration, or the rig is in"
        " other units: its right_from_left.t_mm is in mm"
    )


def _most_of_all(session: Session, rows: PlateRows, kept: npt.NDArray[np.bool_]) -> str:
    """Name the target whose corners scatter far more than those of the others, if there is one."""
    of_target = {
        target.name: float(np.sqrt((rows.chi[mine] ** 2).mean()))
        for index, target in enumerate(session.targets)
        if (mine := kept & rows.is_photometric & (rows.target == index)).any()
    }
    worst = max(of_target, key=lambda name: of_target[name])
    others = [scatter for name, scatter in of_target.items() if name != worst]
    if not others or of_target[worst] < _STANDS_OUT * max(others):
        return ""
    return f", those of {worst} {of_target[worst]:.1f} times (of the others at most {max(others):.1f})"


def _contradicting(session: Session, rows: PlateRows, odd: npt.NDArray[np.intp]) -> str:
    """Say which plates contradict themselves, and why that may be."""
    first = int(odd[0])
    line = session.require_frames()["file_row"][int(rows.row[first])]
    return (
        f"{counted(len(odd), 'observation')} whose corners contradict each other far more than those of the others; "
        f"the first: {session.targets[rows.target[first]].name}, row {line} of frames.csv, {rows.chi[first]:.1f} "
        "times what noise explains: a shadow's edge, a reflection or a finger on the plate; the covariance of each "
        "is enlarged for itself, and the plate may be off by more: leave it out, or light it evenly"
    )


def _unevenly_lit(session: Session, rows: PlateRows, uneven: npt.NDArray[np.intp]) -> str:
    """Say which plates are lit unevenly, and what it costs."""
    worst = int(uneven[np.argmax(rows.unevenness[uneven])])
    line = session.require_frames()["file_row"][int(rows.row[worst])]
    return (
        f"{counted(len(uneven), 'observation')} in uneven light: a shadow's edge or a reflection on the plate (or a "
        "camera that sharpens its pictures); the uncertainty of each is enlarged for itself, most of all that of "
        f"{session.targets[rows.target[worst]].name}, row {line} of frames.csv, {rows.unevenness[worst]:.1f} times; "
        "even light makes them better"
    )


def _not_measured(session: Session, sizes: tuple[MeasuredSize, ...], seen: Collection[int]) -> Iterator[str]:
    """Name the targets without an observation, and whether any picture shows them."""
    measured = {size.target for size in sizes}
    for index, item in enumerate(session.targets):
        if item.name not in measured:
            yield f"target {item.name} {'gives no observation' if index in seen else 'was seen in no frame'}"


def notes(
    session: Session,
    rows: PlateRows,
    kept: npt.NDArray[np.bool_],
    verdict: Agreement,
    sizes: tuple[MeasuredSize, ...],
    n_local: int,
    repeated: Mapping[int, str],
    is_odd: npt.NDArray[np.bool_],
    shown_twice: Collection[int],
) -> Iterator[str]:
    """Say what the user should know about a session that was measured."""
    yield from (f"row set aside: {problem}" for problem in session.set_aside)
    if repeated:
        first, reason = next(iter(repeated.items()))
        yield (
            f"{len(repeated)} frames hold pictures of another frame and are not counted; the first, "
            f"row {session.require_frames()['file_row'][first]}: {reason}"
        )
    yield from _not_measured(session, sizes, {*rows.target.tolist(), *shown_twice})
    for size in sizes:
        if abs(size.sigmas) > _SIZE_NOTED_SIGMAS:
            yield (
                f"target {size.target}: {size.measured_mm:.4f} mm measured, {size.given_mm:g} mm given"
                f" ({1e6 * size.relative_error:+.0f} ppm, {size.sigmas:+.1f} standard uncertainties):"
                " the print or the calibration board differs from its stated size, or the cameras move edges (gamma,"
                " sharpening, blur, a white margin that is missing): then all plates are off by about the same pixels"
            )
    if is_odd.any():
        yield _contradicting(session, rows, np.flatnonzero(is_odd))
    if verdict.birge_ratio > _BIRGE_NOTED:
        yield (
            f"corners scatter {verdict.birge_ratio:.2f} times more than their pictures' noise explains"
            f"{_most_of_all(session, rows, kept)}; the covariances of all are enlarged accordingly"
        )
    if verdict.rig_shift_sigmas is not None and verdict.rig_shift_sigmas > _RIG_SHIFT_NOTED_SIGMAS:
        yield (
            f"the pictures ask for a rig changed by {verdict.rig_shift_sigmas:.1f} of its standard uncertainties:"
            " a camera may have moved since calibration"
        )
    is_uneven = kept & rows.is_photometric & (rows.unevenness > _UNEVENNESS_NOTED)
    if is_uneven.any():
        yield _unevenly_lit(session, rows, np.flatnonzero(is_uneven))
    if n_local:
        yield (
            f"{n_local} observations rest on a local corner detector (0.3 px),"
            " because their picture could not be fitted as a whole"
        )
    misfit = float(np.median(rows.misfit[kept & rows.is_photometric])) if (kept & rows.is_photometric).any() else 1.0
    if misfit > _MISFIT_NOTED:
        yield (
            f"near edges the pictures differ {misfit:.1f} times more from the fitted markers than noise explains:"
            " a lens that smears to one side, prints with ragged edges, gamma or sharpening, or compressed pictures"
        )
