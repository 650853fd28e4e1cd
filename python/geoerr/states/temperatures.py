"""The column of temperature: filled where a state has none of it, so that every row takes part in the one model."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import polars as pl

from geoerr.errors import GeoerrError
from geoerr.fit.sightings import Numbers
from geoerr.observations import Observations
from geoerr.states.common_range import called
from geoerr.summaries import counted, listed


def with_temperatures(
    parts: Mapping[float, Sequence[Observations]], covariate: str
) -> tuple[dict[float, list[Observations]], tuple[str, ...]]:
    """Fill the column where it is absent, by the state's name, and where cells are empty, from what is beside them.

    Parameters
    ----------
    parts
        Temperature to what was measured at it.

    Returns
    -------
    parts, notes
        The same with the column, and what was filled, in words. A table whose column is empty throughout stays so.

    Raises
    ------
    GeoerrError
        for a column of texts, with file and column.
    """
    filled: dict[float, list[Observations]] = {}
    notes: list[str] = []
    without = [called(degc, part) for degc, tables in parts.items() for part in tables if not _has(part, covariate)]
    if without:
        everywhere = len(without) == sum(len(tables) for tables in parts.values())
        notes.append(_absent(covariate, [] if everywhere else without, _others(parts, covariate)))
    for degc, tables in parts.items():
        filled[degc] = []
        for part in tables:
            if not _has(part, covariate):
                filled[degc].append(replace(part, frame=part.frame.with_columns(pl.lit(degc).alias(covariate))))
                continue
            own = _numbers(part, covariate, called(degc, part))
            known = np.isfinite(own)
            if known.all() or not known.any():
                filled[degc].append(part)
                continue
            column = pl.Series(covariate, _between(part, own))
            filled[degc].append(replace(part, frame=part.frame.with_columns(column)))
            notes.append(
                f"{int((~known).sum())} of {counted(len(own), 'row')} at {called(degc, part)} have no {covariate}: "
                "filled from the rows before and behind in the session, or with the mean where a session has none"
            )
    return filled, tuple(notes)


def _has(part: Observations, covariate: str) -> bool:
    return covariate in part.frame.columns


def _others(parts: Mapping[float, Sequence[Observations]], covariate: str) -> list[str]:
    """Name the columns that every table has, and that are named like temperatures."""
    columns = [set(part.frame.columns) for tables in parts.values() for part in tables]
    alike = set.intersection(*columns) if columns else set()
    return sorted(one for one in alike if one != covariate and (one == "temp" or one.startswith("temp_")))


def _absent(covariate: str, without: Sequence[str], others: Sequence[str]) -> str:
    where = listed(without) if without else "the tables"
    taken = "have" if len(without) != 1 else "has"
    note = (
        f"{where} {taken} no column {covariate}: the number that names the state was taken for every row; compare, "
        f"diagnose and report need such a column for this model, so write it into the files"
    )
    if not others:
        return note
    return f"{note}; {listed(others)} of the tables was not looked at: name it with --covariate if that is meant"


def _numbers(part: Observations, covariate: str, state: str) -> Numbers:
    column = part.frame[covariate]
    if column.dtype.is_numeric() or not column.null_count() < len(column):
        return part.numbers(covariate)[:, 0]
    text = next(one for one in column.cast(pl.String).to_list() if one is not None)
    raise GeoerrError(
        f"the column {covariate} of the state at {state} holds texts, as {text!r}, and no temperature\n"
        "hint: name the column of the temperature in °C"
    )


def _between(part: Observations, own: Numbers) -> Numbers:
    """Give temperatures (n,) with those that are missing between their neighbours in time, by session."""
    known, found = np.isfinite(own), own.copy()
    times, sessions = part.numbers("t")[:, 0], np.array(part.texts("session"))
    if not np.isfinite(times).all():
        times = np.arange(len(own), dtype=np.float64)
    for session in dict.fromkeys(sessions.tolist()):
        rows = np.flatnonzero(sessions == session)
        rows = rows[np.argsort(times[rows], kind="stable")]
        told = rows[known[rows]]
        missing = rows[~known[rows]]
        found[missing] = np.interp(times[missing], times[told], own[told]) if told.size else own[known].mean()
    return found
