"""The variables of expressions, row by row: positions, offsets, what follows from the order of rows, covariates."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from geoerr import _core
from geoerr.errors import GeoerrError
from geoerr.fit.bends import on_bends
from geoerr.fit.circle_motion import circle_motion
from geoerr.fit.reversals import unstated_turns
from geoerr.fit.sightings import Numbers, Sightings
from geoerr.machine import AXES
from geoerr.observations import CARRIERS
from geoerr.summaries import listed
from geoerr.terms import CLOCK_NAME, HISTORY_NAMES, PLACE_NAMES, SESSION_NAME, Part, Term

_HISTORY = {f"{name}_{axis}" for name in HISTORY_NAMES for axis in AXES}
# What nobody knows who does not know the direction of the last motion.
_OF_DIRECTION = ("d", "s", "t_rev")
_TRAVELS = {f"s_{axis}" for axis in AXES}

# Why a row is left out of one model and not of another begins so.
_LACKING = "nothing is known of"

# Of more rows that is gigabytes.
_MOST_KEPT = 1_000_000

Rows: TypeAlias = npt.NDArray[np.bool_]


def variable_columns(sightings: Sightings, names: Sequence[str]) -> Numbers:
    """Give the named variables as (k, n); NaN where a covariate is empty or a direction unknown.

    Raises
    ------
    GeoerrError
        for a covariate that is no column of the data.
    """
    columns = np.full((len(names), len(sightings)), np.nan)
    history = _known_history(sightings) if any(name in _HISTORY for name in names) else {}
    for row, name in enumerate(names):
        if name in AXES:
            columns[row] = sightings.commanded_mm[:, AXES.index(name)]
        elif name in ("tx", "ty", "tz"):
            columns[row] = sightings.offset_mm[:, AXES.index(name[1])]
        elif name in history:
            columns[row] = history[name]
        elif name in PLACE_NAMES:
            columns[row] = _place_on_work(sightings, PLACE_NAMES.index(name))
        elif name == SESSION_NAME:
            columns[row] = sightings.session_numbers[sightings.session]
        elif name in ("t", CLOCK_NAME):
            times = times_s(sightings) if name == "t" else clock_s(sightings)
            # Lengths come in no order: the number of one is no time.
            columns[row] = np.where(sightings.of_kind("lengths"), sightings.numbers("t"), times)
        elif name in sightings.table.columns:
            columns[row] = sightings.numbers(name)
        else:
            raise GeoerrError(
                f"the data have no column {name!r}, which the model needs\n"
                f"hint: columns that an effect may follow are {', '.join(sightings.free_columns) or 'none'}"
            )
    return columns


def with_rows(sightings: Sightings, mask: Rows, why: str) -> Sightings:
    """Give the rows where `mask` (n,) is true; what followed from the order of all rows stays what it was.

    The first row of what is left has one before it, which only takes no part.
    """
    history = _known_history(sightings)
    return replace(sightings, derived=history).select(mask, why)


def complete_rows_of(sightings: Sightings, names: Sequence[str], variables: Numbers, terms: Sequence[Term]) -> Rows:
    """Tell which rows have all that the terms need, (n,).

    Wind-up needs no travel where a session has not shown any yet: it begins settled, as in the core.

    Parameters
    ----------
    names, variables
        As in `variable_columns`, and (k, n) from it.
    """
    known = np.isfinite(variables)
    for row, name in enumerate(names):
        if (
            name in _TRAVELS
            and not known[row].all()
            and all(_is_only_wound(part, name) for t in terms for part in t.parts)
        ):
            (direction,) = variable_columns(sightings, [f"d_{name[-1]}"])
            known[row] |= _before_any_travel(sightings, variables[row], direction)
    return np.asarray(known.all(axis=0))


def why_lacking(names: Sequence[str], variables: Numbers, known: Rows) -> str:
    """Say of what nothing is known in the rows that lack something, by the names of columns.

    Parameters
    ----------
    names, variables
        As in `complete_rows_of`.
    known : (n,)
        What it gives.
    """
    lacking = [name for name, own in zip(names, variables, strict=True) if not np.isfinite(own[~known]).all()]
    return f"{_LACKING} {listed(lacking)}"


def lacks_some(sightings: Sightings) -> bool:
    """Tell whether rows were left out that lack what a model needs."""
    return any(why.startswith(_LACKING) for why in sightings.left_out)


def _is_only_wound(part: Part, travel: str) -> bool:
    """Tell whether a part's formula knows a travel through `windup` alone."""
    if travel not in part.names:
        return True
    own = [name for name, text in part.definitions if text == travel]
    texts = [part.expression or "", *(text for name, text in part.definitions if name not in own)]
    return not any(
        re.search(rf"(?<![A-Za-z0-9_.]){name}(?![A-Za-z0-9_])", text) for name in (travel, *own) for text in texts
    )


def _before_any_travel(sightings: Sightings, travel: Numbers, direction: Numbers) -> Rows:
    """Tell where a session has shown neither travel nor a change of direction yet."""
    found = np.zeros(len(travel), dtype=bool)
    for rows in sightings.rows_of_sessions:
        own = direction[rows]
        known = own[np.isfinite(own)]
        if known.size:
            before = np.logical_and.accumulate(np.isnan(travel[rows]))
            found[rows] = before & (own == known[0])
    return found


def times_s(sightings: Sightings) -> Numbers:
    """Give the time of every row; where a session has none in some row, the row's number in it (unit: rows)."""
    # A column may be the table's own memory.
    times = np.array(sightings.numbers("t"))
    for rows in sightings.rows_of_sessions:
        if not np.isfinite(times[rows]).all():
            times[rows] = np.arange(times[rows].size, dtype=np.float64)
    return times


def clock_s(sightings: Sightings) -> Numbers:
    """Give the time of every row on one clock: sessions laid end to end, each from where the one before ended.

    It is `times_s` in the first session. What lies between two sessions is not known, and takes no time.
    """
    clock = times_s(sightings)
    end = None
    for rows in sightings.rows_of_sessions:
        own = clock[rows]
        if own.size:
            clock[rows] = own if end is None else own + (end - own.min())
            end = float(clock[rows].max())
    return clock


def clock_span_s(sightings: Sightings) -> tuple[float, float] | None:
    """Give when the data begin and end on that clock; None where no time passes."""
    clock = clock_s(sightings)
    if not clock.size or not clock.min() < clock.max():
        return None
    return float(clock.min()), float(clock.max())


def _place_on_work(sightings: Sightings, index: int) -> Numbers:
    """Give where on the work a row's point is: the target's own place there, or the one that the tool stands over."""
    offset = sightings.offset_mm[:, index]
    on_work = sightings.carrier == CARRIERS.index("work")
    return np.asarray(np.where(on_work, offset, sightings.commanded_mm[:, index] + offset))


def _known_history(sightings: Sightings) -> Mapping[str, Numbers]:
    """Give what follows from the order of rows, as it was before some were left out."""
    if sightings.derived:
        return sightings.derived
    return sightings.once("history", _history) if len(sightings) <= _MOST_KEPT else _history(sightings)


def _history(sightings: Sightings) -> dict[str, Numbers]:
    """Derive what follows from the order of rows, in the core: the same code as for a program's moves."""
    feed, moving = sightings.numbers("feed"), np.nan_to_num(sightings.numbers("moving"))
    directions = np.where(sightings.directions == 0, np.nan, sightings.directions.astype(np.float64))
    is_circle = sightings.of_kind("circle")
    times = times_s(sightings)

    def derived(is_curve: Rows) -> dict[str, Numbers]:
        found = _core.history(
            np.ascontiguousarray(sightings.commanded_mm),
            times,
            np.where(is_circle, 1.0, moving),
            feed,
            np.ascontiguousarray(directions),
            sightings.sequences,
            # A smooth path: speed along its tangent, acceleration towards its centre.
            is_curve.astype(np.float64),
        )
        return {name: np.asarray(values) for name, values in found.items()}

    history = derived(is_circle)
    history |= _as_stated(sightings, history, times, is_circle)
    is_bent = on_bends(sightings, moving != 0.0, feed)
    if is_bent.any():
        on_tangents = derived(is_bent)
        names = [f"{own}_{axis}" for own in "va" for axis in AXES]
        history |= {name: np.where(is_bent, on_tangents[name], history[name]) for name in names}
    if is_circle.any():
        # What the first rows of a run cannot show of the circle that led to them, the circle itself says.
        known = circle_motion(sightings, times, feed)
        history |= {name: np.where(np.isnan(own), history[name], own) for name, own in known.items()}
    of_lengths = sightings.of_kind("lengths")
    if of_lengths.any():
        # How a part was made, no order of its lengths tells; the file may.
        stated = {name: sightings.numbers(name) for name in history}
        history = {name: np.where(of_lengths, stated[name], own) for name, own in history.items()}
    return history


def _as_stated(
    sightings: Sightings, history: dict[str, Numbers], times: Numbers, is_circle: Rows
) -> dict[str, Numbers]:
    """Give what depends on directions as the file states them: the core goes by the order of rows."""
    result: dict[str, Numbers] = {}
    turned = unstated_turns(sightings, times)
    is_same_place = np.append(False, (np.diff(sightings.commanded_mm, axis=0) == 0.0).all(axis=1))
    is_same_place[sightings.sequences] = False
    for number, axis in enumerate(AXES):
        # Stated as unknown: whoever wrote that knew better than the order of rows, which tells the rest.
        stated = sightings.numbers(f"dir_{axis}")
        has_turned = turned[:, number]
        is_unknown = (stated == 0.0) | has_turned
        names = [f"{own}_{axis}" for own in _OF_DIRECTION]
        result |= {name: np.where(is_unknown, np.nan, history[name]) for name in names}
        comes_back = is_same_place & ~is_circle & (np.nan_to_num(stated * history[f"v_{axis}"]) < 0.0)
        result |= _speeds(history, axis, comes_back, has_turned)
    return result


def _speeds(history: dict[str, Numbers], axis: str, comes_back: Rows, has_turned: Rows) -> dict[str, Numbers]:
    """Give speed and acceleration of an axis that comes back to a place from beyond it, or may do so.

    The core takes the feed along the last move that rows show; where the direction that is stated at a second look is
    not that move's, the axis has turned unseen and moves the other way.
    """
    v, a = history[f"v_{axis}"], history[f"a_{axis}"]
    is_unknown = has_turned & (v != 0.0)
    # What changed since the row before is not known, there and at the row behind.
    was_seen = ~(comes_back | is_unknown)
    was_seen[1:] &= was_seen[:-1]
    return {
        f"v_{axis}": np.where(is_unknown, np.nan, np.where(comes_back, -v, v)),
        f"a_{axis}": np.where(was_seen | (v == 0.0), a, np.nan),
    }
