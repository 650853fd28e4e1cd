"""Circular runs as the ball-bar plot draws them: what was measured beside the model at the same commands."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geoerr.diagnose import Comparison
from geoerr.diagnose.circles import CircleDiagnosis
from geoerr.diagnose.components import is_circle
from geoerr.errors import GeometryError
from geoerr.fit.sightings import Numbers, Sightings
from geoerr.verify.ballbar import Trace
from geoerr.verify.circle import PLANES, CircleOfCommands, fit_circle, plane_of

# Centre and radius of the set-up alone take three.
_FEWEST_ROWS = 4
_SENSE_WORDS = {1: "counter-clockwise", -1: "clockwise"}


@dataclass(frozen=True, eq=False)
class CircleRun:
    """One run of a circular test.

    Attributes
    ----------
    name
        Line, sense and feed.
    rows : (n,)
        Its places among the rows of the comparison.
    measured, predicted
        The measured radius, and the model's with the set-up's centre and radius, at each commanded angle.
    """

    name: str
    rows: np.ndarray
    measured: Trace
    predicted: Trace


def circle_runs(comparison: Comparison) -> tuple[CircleRun, ...]:
    """Give the runs that take part, in the order of measurement; one that is no circle in a plane is left out."""
    fitted = comparison.points
    sightings = fitted.sightings
    taken = is_circle(fitted) & fitted.solved.used
    runs: list[CircleRun] = []
    for number in np.unique(sightings.pass_number[taken]):
        rows = np.flatnonzero(taken & (sightings.pass_number == number))
        if len(rows) < _FEWEST_ROWS:
            continue
        try:
            run = _run(comparison, rows)
        except GeometryError:
            continue
        twins = sum(one.name.partition(" #")[0] == run.name for one in runs)
        name = f"{run.name} #{twins + 1}" if twins else run.name
        runs.append(CircleRun(name, run.rows, run.measured, run.predicted))
    return tuple(runs)


def cause_um(diagnosis: CircleDiagnosis, reference: str, sightings: Sightings) -> Numbers | None:
    """Give what a found cause does to the radius at rows of another table (n, 3), in the first component.

    A diagnosis sets rows aside and orders them in its own way: a row is known again by its place in its file, its
    commanded position and its radius. None of a cause that was looked at and left; NaN of a row that took no part.
    """
    names = [str(one.reference) for one in diagnosis.found]
    if reference not in names:
        return None
    runs = diagnosis.searched.whole
    trace = diagnosis.searched.whole_traces[:, names.index(reference)]
    known = dict(zip(_keys(runs.fitted.sightings, runs.rows), trace.tolist(), strict=True))
    moved = np.full((len(sightings), 3), np.nan)
    moved[:, 0] = [known.get(key, np.nan) for key in _keys(sightings, np.arange(len(sightings)))]
    return moved


def _run(comparison: Comparison, rows: np.ndarray) -> CircleRun:
    sightings = comparison.points.sightings
    q_mm = sightings.commanded_mm[rows]
    plane = plane_of(q_mm)
    first, second, _ = PLANES[plane]
    commanded = fit_circle(q_mm[:, [first, second]])
    centre = np.median(q_mm, axis=0)
    centre[[first, second]] = commanded.center_mm
    circle = CircleOfCommands(plane, tuple(np.round(centre, 6).tolist()), round(commanded.radius_mm, 6))
    arm = circle.in_plane(q_mm)
    angle = np.arctan2(arm[:, 1], arm[:, 0])
    measured_mm = sightings.measured_mm[rows, 0]
    return CircleRun(
        _name(sightings, rows, angle),
        rows,
        _trace(circle, angle, measured_mm),
        _trace(circle, angle, measured_mm - comparison.residual_mm[rows, 0]),
    )


def _trace(circle: CircleOfCommands, angle_rad: Numbers, radius_mm: Numbers) -> Trace:
    points = radius_mm[:, None] * np.column_stack([np.cos(angle_rad), np.sin(angle_rad)])
    return Trace(circle, angle_rad, points, fit_circle(points))


def _name(sightings: Sightings, rows: np.ndarray, angle_rad: Numbers) -> str:
    line = sightings.texts("line")[rows[0]] if "line" in sightings.table.columns else ""
    turned = float(np.unwrap(angle_rad)[-1] - angle_rad[0])
    stated = sightings.numbers("dir")[rows[0]]
    sense = int(np.sign(stated if np.isfinite(stated) and stated else turned))
    feed = sightings.numbers("feed")[rows]
    known = float(np.nanmedian(feed)) if np.isfinite(feed).any() else np.nan
    words = [line, _SENSE_WORDS.get(sense, ""), f"{known:.6g} mm/min" if np.isfinite(known) else ""]
    return ", ".join(word for word in words if word) or "run"


def _keys(sightings: Sightings, rows: np.ndarray) -> list[bytes]:
    told = np.column_stack(
        [sightings.numbers("file_row")[rows], sightings.commanded_mm[rows], sightings.measured_mm[rows, 0]]
    )
    return [row.tobytes() for row in np.nan_to_num(np.round(told, 9)) + 0.0]
