"""From a session's pictures to observations: one for each target that both cameras of a frame show."""

from __future__ import annotations

import itertools
import os
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt
import polars as pl

from geoerr.arguments import check_threads
from geoerr.observations import COVARIANCE, MEASURED, PIXELS, observations_from_columns
from geoerr.vision.consistency import agreement, stand_out
from geoerr.vision.copies import judge_copies
from geoerr.vision.expected import expected_places, rows_to_search
from geoerr.vision.frame import OWN_MARKER, FrameReader, FrameResult, Missed
from geoerr.vision.measured import Measured
from geoerr.vision.opencv_threads import one_opencv_thread
from geoerr.vision.plate import N_RESIDUALS
from geoerr.vision.plate_rows import Collector, PlateRows
from geoerr.vision.repeats import repeated_frames
from geoerr.vision.rig import Rig
from geoerr.vision.session import Session
from geoerr.vision.verdicts import notes, nothing_left, nothing_seen, outliers, refuse_wrong_rig, sizes

Array = npt.NDArray[np.float64]
Progress = Callable[[int, int], None]


def measure(session: Session, rig: Rig, threads: int = 0, progress: Progress | None = None) -> Measured:
    """Measure every target in every frame of a session.

    Parameters
    ----------
    session
        With targets and frames.
    rig
        The calibrated pair of cameras.
    threads
        Pictures worked on at once, 0 for all cores. The result is the same for any number.
    progress
        Called with frames done and frames in all.

    Raises
    ------
    InputFileError
        where left and right are swapped, a target's size contradicts the calibration, or no frame shows a target
        (saying which dictionary's markers the pictures do show).
    ShapeError
        for what is no number of threads.

    Notes
    -----
    For each target: corners by photometric fit in both pictures (`marker_fit`), a parallelogram in space through
    them (`plate`), its centre as the observation. A bad frame never stops the rest: it is listed in `missed`. Of a
    long session a few frames are searched whole; in the others targets are looked for where those and the commanded
    positions say that they are (`expected`), and searched for only where they are not. Where a marker is on two
    plates, sightings of which nobody can say that they are the target's are left out (`copies`).
    """
    check_threads(threads)
    frames = session.require_frames()
    reader = FrameReader(session.directory, rig, session.require_targets())
    collected = Collector(rig, threads, len(frames) * len(reader.targets))
    with one_opencv_thread():
        for row, result in enumerate(_some_searched_first(reader, frames, threads, progress)):
            collected.add(row, result)
    collected.locate()
    return _finished(session, rig, collected, len(frames))


def _some_searched_first(
    reader: FrameReader, frames: pl.DataFrame, threads: int, progress: Progress | None
) -> Iterator[FrameResult]:
    """Read all frames, in order; some are searched ahead, and tell where targets are in the others.

    Which ones is a matter of the frames alone: the result is the same for any number of threads.
    """
    n_read = itertools.count(1)

    def counted(rows: Sequence[int]) -> Iterator[FrameResult]:
        for result in _in_order(reader, frames, threads, rows):
            if progress is not None:
                progress(next(n_read), len(frames))
            yield result

    first = rows_to_search(frames)
    searched = dict(zip(first, counted(first), strict=True))
    if searched:
        reader = replace(reader, expected=expected_places(reader.rig, frames, searched))
    others = counted([row for row in range(len(frames)) if row not in searched])
    for row in range(len(frames)):
        yield searched.pop(row) if row in searched else next(others)


def _in_order(reader: FrameReader, frames: pl.DataFrame, threads: int, rows: Sequence[int]) -> Iterator[FrameResult]:
    """Read frames side by side, give results in order; never more in hand than twice the threads."""
    n_workers = threads or os.cpu_count() or 1
    waiting: deque[Future[FrameResult]] = deque()
    left, right = frames["left"], frames["right"]
    with ThreadPoolExecutor(n_workers) as pool:
        try:
            for row in rows:
                waiting.append(pool.submit(reader.read, row, left[row], right[row]))
                if len(waiting) >= 2 * n_workers:
                    yield waiting.popleft().result()
            while waiting:
                yield waiting.popleft().result()
        finally:
            pool.shutdown(cancel_futures=True)


def _finished(session: Session, rig: Rig, collected: Collector, n_frames: int) -> Measured:
    if not collected.blocks:
        raise nothing_seen(session, collected, n_frames)
    rows = collected.rows()
    refuse_wrong_rig(session, rig, rows)
    why = outliers(rig, rows)
    names = [target.name for target in session.targets]
    frames = session.require_frames()
    repeated = repeated_frames(frames, collected.digests)
    is_repeated = np.isin(rows.row, list(repeated))
    copies = judge_copies(session, rows, (why == "") & ~is_repeated, collected.twice)
    is_copy = copies.why != ""
    why = np.where(is_copy, copies.why, why)
    is_off = (why != "") & ~is_repeated
    kept = ~is_repeated & ~is_off
    missed = [
        *collected.missed,
        *(Missed(row, str(frames["left"][row]), "both", None, reason) for row, reason in repeated.items()),
        *(
            Missed(
                int(rows.row[index]),
                str(frames["left"][int(rows.row[index])]),
                "both",
                names[rows.target[index]],
                str(why[index]),
                OWN_MARKER if is_copy[index] else None,
            )
            for index in np.flatnonzero(is_off)
        ),
    ]
    if not kept.any():
        raise nothing_left(session, missed, n_frames)
    is_odd = kept & rows.is_photometric
    is_odd[is_odd] = stand_out(rows.chi[is_odd], N_RESIDUALS)
    agrees = kept & rows.is_photometric & ~is_odd
    pooled = [item for item in collected.pooled if agrees[item[0]]]
    verdict = agreement(
        np.array([item[1] for item in pooled]).reshape(-1, N_RESIDUALS),
        np.array([item[2] for item in pooled]).reshape(-1, N_RESIDUALS, len(rig.parameter_names)),
        rig,
    )
    is_local = kept & ~rows.is_photometric
    of_local = float((rows.chi[is_local] ** 2).mean()) if is_local.any() else 1.0
    scale = np.maximum(1.0, np.where(rows.is_photometric, verdict.birge_ratio**2, of_local))
    scale = np.where(is_odd, rows.chi**2, scale)
    rows = replace(
        rows,
        covariance_mm2=rows.covariance_mm2 * scale[:, None, None],
        side_std_mm=rows.side_std_mm * np.sqrt(scale),
    )
    table = _table(session, rows, kept)
    measured_sizes = sizes(session, rig, rows, kept)
    n_local = int(is_local.sum())
    shown_twice = {target for _, target in collected.twice}
    return Measured(
        observations=observations_from_columns(table, str(session.directory)),
        missed=tuple(sorted(missed, key=lambda item: item.row)),
        n_frames=n_frames,
        agreement=verdict,
        sizes=measured_sizes,
        n_local_corners=n_local,
        names_session="session" in frames.columns,
        notes=(
            *copies.notes,
            *notes(session, rows, kept, verdict, measured_sizes, n_local, repeated, is_odd, shown_twice),
        ),
    )


def _table(session: Session, rows: PlateRows, kept: npt.NDArray[np.bool_]) -> dict[str, Any]:
    """Columns of the observations: what was commanded, what was measured, everything else of frames.csv."""
    frames = session.require_frames()[rows.row[kept].tolist()].drop("left", "right", "file_row")
    targets = [session.targets[index] for index in rows.target[kept]]
    offsets = np.array([target.offset_mm for target in targets])
    covariance = rows.covariance_mm2[kept]
    columns: dict[str, Any] = {name: frames[name] for name in ("line", "session", "repeat") if name in frames.columns}
    columns["carrier"] = [target.carrier for target in targets]
    columns["target"] = [target.name for target in targets]
    columns |= {name: frames[name] for name in ("x", "y", "z", "dir_x", "dir_y", "dir_z") if name in frames.columns}
    columns |= {name: offsets[:, axis] for axis, name in enumerate(("tx", "ty", "tz"))}
    # A tenth of a nanometre, a millionth of a pixel: far below anything real, and files stay readable.
    columns |= {name: np.round(rows.centre_mm[kept, axis], 7) for axis, name in enumerate(MEASURED)}
    pairs = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))
    columns |= {name: _seven_digits(covariance[:, i, j]) for name, (i, j) in zip(COVARIANCE, pairs, strict=True)}
    columns |= {name: np.round(rows.pixel[kept, k], 6) for k, name in enumerate(PIXELS)}
    return columns | {name: frames[name] for name in frames.columns if name not in columns}


def _seven_digits(values: Array) -> Array:
    return np.array([float(f"{value:.6e}") for value in values])
