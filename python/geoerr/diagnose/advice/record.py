"""A plan as a file: what to command, when a picture is taken, and under which conditions."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import polars as pl

from geoerr.diagnose.advice.measurement import Measurement
from geoerr.errors import InputFileError
from geoerr.machine import AXES
from geoerr.tables import write_table

_DIGITS = 4


def plan_table(measurements: Sequence[tuple[Measurement, int]]) -> pl.DataFrame:
    """Give a row for each picture, in order: the columns of a session's frames.csv, without the pictures' names.

    `session` counts the set-ups; `t` is when the picture is due by the moves' own time. Covariates are those that the
    plan prescribes: what was really measured takes their place.
    """
    parts, first = [], 0
    for plan, times in measurements:
        pictures = plan.pictures
        for number in range(times):
            columns: dict[str, object] = {
                "session": [f"{first + session}" for session in pictures.session.tolist()],
                "line": list(pictures.line),
                "repeat": pictures.repeat,
            }
            columns |= {axis: np.round(pictures.q_mm[:, place], _DIGITS) for place, axis in enumerate(AXES)}
            columns |= {f"dir_{axis}": pictures.direction[:, place] for place, axis in enumerate(AXES)}
            columns |= {
                "feed": pictures.feed_mm_min,
                "moving": pictures.is_moving.astype(np.int64),
                "t": np.round(pictures.t_s, 1),
                "plan": [f"{plan.name} {number + 1}"] * len(pictures),
            }
            columns |= {name: np.round(values, 2) for name, values in plan.conditions.items()}
            parts.append(pl.DataFrame(columns))
            first += plan.n_sessions
    return pl.concat(parts, how="diagonal_relaxed")


def write_plan(path: str | Path, measurements: Sequence[tuple[Measurement, int]]) -> None:
    """Write a plan (`.csv`, `.parquet`), whole or not at all; see `plan_table`.

    Raises
    ------
    InputFileError
        where there is nothing to carry out, or the file cannot be written.
    """
    if not measurements:
        raise InputFileError(path, "there is no measurement to write", remedy="ask for tied candidates first")
    write_table(path, plan_table(measurements))
