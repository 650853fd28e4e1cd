"""The roll of a device about the one line on which its session's points lie.

Commanded points on a line say nothing about a turn about it: at a machine without errors none of them moves. What
tells it is what the machine is off across the line, which other sessions see too: turned by 0.3 rad, a
straightness of 30 µm is off by 9. So each such roll is an unknown whose lever is what the machine was found to be off
across the line; frames are turned by what is found, and the lever is taken anew, until nothing turns.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from geoerr import _core
from geoerr.fit.noise import is_static
from geoerr.fit.sightings import Numbers, Sightings
from geoerr.fit.solve import Solved
from geoerr.fit.start import N_UNKNOWNS, Frames, first_frame_column, turn_about

# A machine that is off across a line by less than a tenth of a nanometre says nothing about a roll.
_LEAST_LEVER_MM = 1e-7
# Two points are a straight line, whatever the machine is off.
_FEWEST_ROWS = 3
# A turn by less than this share of its standard error changes nothing that anybody reads.
_SETTLED = 0.03
# A roll that is known no better than this changes nothing that shows beside the noise.
_UNKNOWN_RAD = 1.0


class Rolls:
    """Which devices' rolls are looked for, from fit to fit: one that these terms do not tell is left as it is."""

    def __init__(self, along: Numbers, known: np.ndarray) -> None:
        self.sessions = np.flatnonzero(along.any(axis=1))
        self._n_frames = len(along)
        self._is_first = not np.array_equal(self.sessions, known)

    def angles_rad(self, sessions: np.ndarray, rolls_rad: Numbers, spread_rad: Numbers) -> Numbers | None:
        """Give by how much each frame is to be turned next, (s,).

        Parameters
        ----------
        sessions : (k,)
            Those whose rolls were unknowns of the last fit.
        rolls_rad, spread_rad : (k,)
            What it found of them, and with what standard errors; infinite for one that it does not determine.

        Returns
        -------
        None where no further fit is needed.
        """
        angles = np.zeros(self._n_frames)
        is_told = spread_rad <= _UNKNOWN_RAD
        angles[sessions[is_told]] = np.arctan(rolls_rad[is_told])
        if self._is_first:
            # Of those that have no lever yet, or were not told by other terms, nothing is known.
            self._is_first = False
            return angles
        self.sessions = sessions[is_told]
        is_settled = is_told.all() and (np.abs(rolls_rad) <= _SETTLED * spread_rad).all()
        return None if is_settled else angles


def held_rolls(frames: Frames, sightings: Sightings, problem: _core.FitProblem) -> Numbers:
    """Give rows C (k, n_columns), C x = 0: the poses of devices that saw one line do not roll about it.

    Where commands lie exactly on a line nothing notices to first order; where they are rounded, that does.
    """
    rows = []
    first = first_frame_column(problem, sightings)
    for kind, along, is_rounded in zip(sightings.frames, frames.along, frames.is_rounded, strict=True):
        if is_rounded:
            row = np.zeros(problem.n_columns)
            row[first + 3 : first + 6] = along
            rows.append(row)
        first += N_UNKNOWNS[kind]
    return np.array(rows).reshape(len(rows), problem.n_columns)


def turned(frames: Frames, angles_rad: Numbers) -> Frames:
    """Turn every frame about its session's line, at the middle of its points, by an angle (s,)."""
    rotations, translations = frames.rotations.copy(), frames.translations_mm.copy()
    for number in np.flatnonzero(angles_rad):
        before, pivot = frames.rotations[number], frames.pivots_mm[number]
        rotations[number] = before @ turn_about(angles_rad[number] * frames.along[number])
        translations[number] += (before - rotations[number]) @ pivot
    return replace(frames, rotations=rotations, translations_mm=translations)


def levers(
    frames: Frames,
    sightings: Sightings,
    solved: Solved,
    beside_mm: Numbers,
    angles_rad: Numbers,
    sessions: np.ndarray,
) -> tuple[Numbers, np.ndarray]:
    """Give what a roll moves, with the machine as it was found.

    Parameters
    ----------
    frames
        Those that the fit started from.
    beside_mm : (n, 3)
        What the fit adds to the model's points in the measuring frames: targets, calibration, rolls so far.
    angles_rad : (s,)
        By how much the frames are to be turned.
    sessions
        Whose rolls are asked for.

    Returns
    -------
    derivative : (n, 3, k)
        Of the measured points by the rolls of those sessions that have a lever, mm/rad, in the turned frames.
    sessions : (k,)
        Their numbers.
    """
    found, numbers = [], []
    # A marker that stands still has a place of its own, and follows no line.
    is_told = sightings.is_measured.all(axis=1) & ~is_static(sightings)
    for number in sessions:
        rows = np.flatnonzero((sightings.session == number) & is_told)
        if len(rows) < _FEWEST_ROWS:
            continue
        line = frames.rotations[number] @ frames.along[number]
        seen = sightings.measured_mm[rows] - solved.residual_mm[rows] - beside_mm[rows]
        lever = np.cross(line, _off_their_line(seen, seen @ line))
        if np.abs(lever).max(initial=0.0) < _LEAST_LEVER_MM:
            continue
        moved = np.zeros((len(sightings), 3))
        moved[rows] = lever @ turn_about(angles_rad[number] * line).T
        found.append(moved)
        numbers.append(number)
    return np.array(found).reshape(-1, len(sightings), 3).transpose(1, 2, 0), np.array(numbers, dtype=np.int64)


def _off_their_line(points: Numbers, along_mm: Numbers) -> Numbers:
    """Give how far points (n, 3) are off the straight line that follows their positions along it."""
    design = np.column_stack([np.ones(len(points)), along_mm - along_mm.mean()])
    return np.asarray(points - design @ np.linalg.lstsq(design, points, rcond=None)[0])
