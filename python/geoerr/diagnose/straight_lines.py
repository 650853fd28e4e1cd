"""Straight lines of the data as a positioning test reads them: place along the line, deviation, direction.

Held against the machine without errors, so that nothing of a model is in the deviations: of the measuring frame only
where it stands is fitted, and a scale stays what was measured.

Every reading of a line is in it, as ISO 230-2 takes every one: what a fit sets aside as a mistake is marked, so that
who sums up can say so. Only what was measured metres from any place that the machine reaches is no reading.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from geoerr.diagnose.comparison import compare
from geoerr.diagnose.motions import rows_by_motion
from geoerr.fit import Fitted
from geoerr.fit.sightings import Numbers
from geoerr.machine import AXES, Machine
from geoerr.model import Model
from geoerr.observations import CARRIERS, Observations

# Rows that leave a line's chord by more than this share of its length are on no common line.
_STRAIGHT = 1e-3
# Two places from both sides: fewer readings are no line that was run.
_LEAST_READINGS = 4
_UM_PER_MM = 1e3


@dataclass(frozen=True, eq=False)
class StraightLine:
    """Readings along one straight line of one session, of one target.

    Attributes
    ----------
    session, line, target
        As the data name them.
    moving
        The axes that move along it: `x`, or `xyz` of a space diagonal.
    start_mm, end_mm : (3,)
        Axis positions at its ends; it counts from start to end, upwards in the first of its axes.
    offset_mm : (3,)
        Of the target from the tool point, or from the base origin on the work.
    position_mm, deviation_um : (n,)
        Place along the line, and deviation along it: actual minus commanded, the tool as seen from the work.
    direction : (n,)
        +1 forwards, −1 backwards, 0 unknown.
    is_alone : (n,) bool
        Readings far from all around them that no other run found again: a fit sets them aside as mistakes.
    """

    session: str
    line: str
    target: str
    moving: str
    start_mm: Numbers
    end_mm: Numbers
    offset_mm: Numbers
    position_mm: Numbers
    deviation_um: Numbers
    direction: Numbers
    is_alone: npt.NDArray[np.bool_]


def straight_lines(machine: Machine, *tables: Observations, threads: int = 0) -> tuple[StraightLine, ...]:
    """Find the straight lines of measured points, in the order in which they were measured.

    Parameters
    ----------
    machine
        Which axes there are; its errors take no part.
    tables
        Measured points; rows whose component along their line was not measured take no part.
    """
    if not tables:
        return ()
    fitted = compare(Model(machine), *tables, threads=threads).points
    named = _Named(_texts(fitted, "line"), _texts(fitted, "target"))
    return tuple(line for rows in _groups(fitted, named) for line in _lines_of(fitted, named, rows))


@dataclass(frozen=True)
class _Named:
    """What the data call line and target of each row."""

    line: list[str]
    target: list[str]


def _groups(fitted: Fitted, named: _Named) -> Iterator[npt.NDArray[np.int64]]:
    """Give the rows of each line name of each session, of one target in one place."""
    sightings = fitted.sightings
    places = np.round(sightings.offset_mm, 3) + 0.0
    keys = [
        (session, carrier, line, target, *place)
        for session, carrier, line, target, place in zip(
            sightings.session.tolist(),
            sightings.carrier.tolist(),
            named.line,
            named.target,
            places.tolist(),
            strict=True,
        )
    ]
    by_key: dict[tuple[object, ...], list[int]] = {}
    for row, key in enumerate(keys):
        by_key.setdefault(key, []).append(row)
    yield from (np.array(rows, dtype=np.int64) for rows in by_key.values())


def _lines_of(fitted: Fitted, named: _Named, rows: npt.NDArray[np.int64]) -> Iterator[StraightLine]:
    """Give the line that the rows are on, or those along which the machine moved to them."""
    whole = _line(fitted, named, rows)
    if whole is not None:
        yield whole
        return
    sightings = fitted.sightings
    marks = np.column_stack([np.nan_to_num(sightings.numbers("repeat")[rows]), sightings.directions[rows]])
    for part in rows_by_motion(sightings.commanded_mm[rows], marks):
        found = _line(fitted, named, rows[part]) if len(part) >= _LEAST_READINGS else None
        if found is not None:
            yield found


def _line(fitted: Fitted, named: _Named, rows: npt.NDArray[np.int64]) -> StraightLine | None:
    """Read rows as one line; None where they are on none, nothing moved, or its deviation was not measured."""
    sightings = fitted.sightings
    q_mm = sightings.commanded_mm[rows]
    span = np.ptp(q_mm, axis=0)
    if not span.any():
        return None
    first = int(np.argmax(span > _STRAIGHT * span.max()))
    start, end = q_mm[np.argmin(q_mm[:, first])], q_mm[np.argmax(q_mm[:, first])]
    length = float(np.linalg.norm(end - start))
    unit = (end - start) / length
    position = (q_mm - start) @ unit
    beside = np.linalg.norm(q_mm - start - position[:, None] * unit, axis=1)
    if beside.max() > _STRAIGHT * length:
        return None
    moves = np.abs(unit) > _STRAIGHT
    unit = np.where(moves, unit, 0.0) / np.linalg.norm(unit[moves])
    is_seen = np.asarray(sightings.is_measured[rows][:, moves].all(axis=1))
    if not is_seen.any():
        return None
    moving = "".join(axis for axis, is_moving in zip(AXES, moves, strict=True) if is_moving)
    carrier = CARRIERS[int(sightings.carrier[rows[0]])]
    # A target that the axes do not carry stands still, whatever they do.
    if carrier != "relative" and any(fitted.machine.side(axis) != carrier for axis in moving):
        return None
    # A target on the work goes the other way than the tool as seen from it.
    sign = -1.0 if carrier == "work" else 1.0
    senses = sightings.directions[rows][:, moves] * np.sign(unit[moves])
    agree = (senses == senses[:, :1]).all(axis=1)
    line = StraightLine(
        session=sightings.sessions[int(sightings.session[rows[0]])],
        line=named.line[rows[0]],
        target=named.target[rows[0]],
        moving=moving,
        start_mm=start,
        end_mm=end,
        offset_mm=sightings.offset_mm[rows[0]],
        position_mm=position,
        deviation_um=sign * fitted.residual_mm[rows] @ unit * _UM_PER_MM,
        direction=np.where(agree, senses[:, 0], 0).astype(np.float64),
        is_alone=~fitted.solved.used[rows],
    )
    return _of_readings(line, is_seen)


def _of_readings(line: StraightLine, kept: npt.NDArray[np.bool_]) -> StraightLine:
    names = ("position_mm", "deviation_um", "direction", "is_alone")
    return replace(line, **{name: getattr(line, name)[kept] for name in names})


def _texts(fitted: Fitted, column: str) -> list[str]:
    sightings = fitted.sightings
    return sightings.texts(column) if column in sightings.table.columns else [""] * len(sightings)
