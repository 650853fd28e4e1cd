"""Tables of measurements as one set of sightings: rows in order, sessions one after the other, weights of each.

Points state up to three components with their covariances, circular tests one radius with its `sr`, and lengths one
number with its `s_measured`.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt
import polars as pl

from geoerr.commanded_circle import on_their_circle
from geoerr.errors import GeometryError
from geoerr.fit.carried import refuse_other_carriers
from geoerr.fit.columns import lacking_rows, mean_covariance, stated_rows, unread_columns, unused_uncertainties
from geoerr.fit.counted_twice import counted_twice
from geoerr.fit.false_readings import without_false_readings
from geoerr.fit.lengths import sightings_of_lengths
from geoerr.fit.mirrored import refuse_mirrored
from geoerr.fit.misplaced import misplaced_targets
from geoerr.fit.moved_targets import targets_that_moved
from geoerr.fit.noise import in_the_way_of_repeats
from geoerr.fit.odd_devices import odd_devices
from geoerr.fit.odd_directions import odd_directions
from geoerr.fit.odd_lines import odd_lines
from geoerr.fit.odd_temperatures import odd_temperatures
from geoerr.fit.odd_times import odd_times
from geoerr.fit.other_units import other_units, places_in_metres
from geoerr.fit.passes import passes_of
from geoerr.fit.scatter import scatter_of
from geoerr.fit.sightings import Numbers, Sightings, columns_of_numbers
from geoerr.fit.unbelievable import (
    LEAST_STD_MM,
    NOT_POSITIVE,
    place_of_unbelievable,
    stated_std_mm,
    unbelievable_rows,
)
from geoerr.fit.weights import weighed
from geoerr.fit.wide_gaps import wide_gaps
from geoerr.machine import AXES, Machine
from geoerr.model.called import check_tables
from geoerr.observations import CARRIERS, CircularTest, Lengths, MeasuredTable, Observations
from geoerr.terms import is_column

# Limit switches are found again to so much.
_AT_AN_END_MM = 1.0
# A point that is measured so many times, and so much, farther from the others than the machine moves is a mistake.
_BEYOND_REACH, _BEYOND_REACH_MM = 10.0, 1000.0
_FEWEST_NEAR = 0.5


def sightings_of(*tables: MeasuredTable) -> Sightings:
    """Join measurements of points, circular tests and lengths.

    Where no uncertainty is stated rows are weighed by their own scatter, where that tells devices or components apart
    (`weights`), and a note says so. A circular test states the uncertainty of its radii in a column `sr` (mm), if at
    all, and lengths in `s_measured`. Beside tables that state theirs, one that does not has that of its scatter;
    radii and lengths, or else, of the points.

    Raises
    ------
    GeometryError
        where nothing is measured, or some tables state uncertainties and others neither do nor tell them by scatter.
    ShapeError
        for a table that is none.
    """
    check_tables(tables, "fit_model(machine, observations)", Observations, CircularTest, Lengths)
    # Lengths last: the order of the others is that of time.
    in_order = sorted(tables, key=lambda table: isinstance(table, Lengths))
    parts = [part for table in in_order for part in _of_one(table) if len(part)]
    if not parts:
        raise GeometryError("no row has a measured component\nhint: measured positions stand in mx, my and mz")
    parts = weighed(parts)
    joined = without_false_readings(parts[0] if len(parts) == 1 else _joined(parts))
    told = (
        *counted_twice(joined),
        *in_the_way_of_repeats(joined),
        *_without_name(joined),
        # How a part was made its own table says by any name.
        *unread_columns(
            dict.fromkeys(name for part in parts if not part.has_lengths_only for name in part.table.columns)
        ),
        *other_units(joined),
        *odd_times(joined),
        *odd_lines(joined),
        *odd_temperatures(joined),
        *odd_devices(joined),
        *odd_directions(joined),
        *targets_that_moved(joined),
    )
    return replace(joined, notes=(*joined.notes, *told)) if told else joined


def _of_one(table: MeasuredTable) -> list[Sightings]:
    if isinstance(table, Lengths):
        return [sightings_of_lengths(table)]
    return [_of_circle(table)] if isinstance(table, CircularTest) else _of_sessions(table)


def _of_sessions(observations: Observations) -> list[Sightings]:
    """Give points as one, or apart where some sessions state no uncertainty at all: their own scatter may tell it.

    In the order of the sessions, which is that of time.
    """
    is_measured = np.isfinite(observations.measured_mm)
    stated = stated_rows(observations.covariance_mm2, is_measured) & is_measured.any(axis=1)
    names = np.array(observations.texts("session"))
    states = {name: bool(stated[names == name].any()) for name in dict.fromkeys(names.tolist())}
    if len(set(states.values())) < 2:
        return [_of_points(observations)]
    parts = []
    for is_stated, own in itertools.groupby(states, key=lambda name: states[name]):
        rows = np.flatnonzero(np.isin(names, list(own)))
        part = _of_points(observations.select(np.isin(np.arange(len(names)), rows)))
        if not is_stated and scatter_of(part) is None:
            return [_of_points(observations)]
        parts.append(replace(part, source_row=rows[part.source_row]))
    return parts


def within_the_machine(sightings: Sightings, machine: Machine) -> Sightings:
    """Give them with notes of places and this machine: beyond its ranges, gaps in between, targets far from offsets.

    Raises
    ------
    GeometryError
        where targets do not go with what is said to carry them, or were measured in a frame that is mirrored.
    """
    refuse_other_carriers(sightings, machine)
    refuse_mirrored(sightings, machine)
    told = [
        *misplaced_targets(sightings, machine),
        *places_in_metres(sightings, machine),
        *wide_gaps(sightings, machine),
        *places_beyond(sightings, machine),
    ]
    return replace(sightings, notes=(*sightings.notes, *told)) if told else sightings


def places_beyond(sightings: Sightings, machine: Machine) -> Iterator[str]:
    """Say along which axes something was commanded outside of their ranges."""
    for axis, along_mm in zip(AXES, sightings.commanded_mm.T, strict=True):
        low, high = machine.axes[axis].range_mm
        beyond_mm = np.maximum(low - along_mm, along_mm - high)
        n_beyond = int((beyond_mm > _AT_AN_END_MM).sum())
        if n_beyond:
            yield (
                f"places outside the range of {axis}, {low:g} to {high:g} mm, in {n_beyond} of {len(along_mm)} rows: "
                f"it was commanded from {along_mm.min():g} to {along_mm.max():g} mm; state its range as it is, or "
                "count places from the machine's zero"
            )


def _without_name(sightings: Sightings) -> Iterator[str]:
    odd = [name for name in columns_of_numbers(sightings.table) if not is_column(name)]
    if odd:
        yield (
            f"no effect can follow {', '.join(map(repr, odd))}: formulas name columns by letters a to z, digits and "
            "underscores, and not as a function or pi; rename what one may follow"
        )


def _of_points(observations: Observations) -> Sightings:
    is_measured = np.isfinite(observations.measured_mm)
    used = is_measured.any(axis=1)
    left_out = {"nothing measured": int((~used).sum())} if not used.all() else {}
    disbelieved = used & unbelievable_rows(observations.covariance_mm2, is_measured)
    if disbelieved.any() and not disbelieved[used].all():
        left_out[NOT_POSITIVE] = int(disbelieved.sum())
        used &= ~disbelieved
    kept = observations.select(used)
    names = kept.texts("session")
    sessions = tuple(dict.fromkeys(names))
    number_of = {name: number for number, name in enumerate(sessions)}
    session = np.array([number_of[name] for name in names], dtype=np.int64)
    order = np.argsort(session, kind="stable")
    kept = Observations(kept.frame[order], kept.sources, kept.set_aside)
    session = session[order]
    is_measured = is_measured[used][order]
    whitening, is_stated, notes = _whitening(kept, is_measured)
    directions = kept.directions
    frames = tuple(
        "free" if has_all else "parallel"
        for has_all in np.bincount(session, is_measured.all(axis=1), minlength=len(sessions)) > 0.0
    )
    commanded = kept.commanded_mm
    sightings = Sightings(
        table=kept.frame,
        commanded_mm=commanded,
        offset_mm=kept.target_offset_mm,
        measured_mm=np.where(is_measured, np.nan_to_num(kept.measured_mm), 0.0),
        is_measured=is_measured,
        whitening=whitening,
        is_stated=is_stated,
        carrier=np.array([CARRIERS.index(name) for name in kept.texts("carrier")], dtype=np.uint8),
        session=session,
        sessions=sessions,
        frames=frames,
        pass_number=passes_of(session, kept.texts("line"), kept.numbers("repeat")[:, 0], commanded, directions),
        directions=directions,
        source_row=np.flatnonzero(used)[order].astype(np.int64),
        left_out=left_out,
        notes=(*notes, *place_of_unbelievable(observations, disbelieved)) if NOT_POSITIVE in left_out else notes,
    )
    is_near = _near_the_others(sightings)
    if is_near.all():
        return sightings
    return sightings.select(is_near, "measured far from any place that the machine reaches")


def _near_the_others(sightings: Sightings) -> np.ndarray:
    """Tell which rows (n,) are measured where the machine can have been: a lost decimal point turns a whole frame."""
    is_near = np.ones(len(sightings), dtype=bool)
    moves = sightings.carrier != CARRIERS.index("base")
    for number in range(len(sightings.sessions)):
        rows = sightings.rows_of_session(number, moves)
        if len(rows) < 3:
            continue
        travel, offsets = (_farthest_mm(own[rows]) for own in (sightings.commanded_mm, sightings.offset_mm))
        seen, measured = sightings.is_measured[rows], sightings.measured_mm[rows]
        columns = zip(measured.T, seen.T, strict=True)
        middle = [np.median(own[is_seen]) if is_seen.any() else 0.0 for own, is_seen in columns]
        distance = np.linalg.norm(np.where(seen, measured - middle, 0.0), axis=1)
        near = distance <= _BEYOND_REACH * (travel + offsets) + _BEYOND_REACH_MM
        # Where most are far no point is lost: they are in another unit, and a fit says that they follow nothing.
        is_near[rows] = near | (near.mean() < _FEWEST_NEAR)
    return is_near


def _farthest_mm(points_mm: Numbers) -> float:
    return float(np.linalg.norm(points_mm - np.median(points_mm, axis=0), axis=1).max())


def _of_circle(test: CircularTest) -> Sightings:
    """Rows of a circular test: the tool seen from the work, one radius each.

    Every line of a session has one set-up of the bar; a pass is what was run once, in one sense at one feed.
    """
    frame = test.frame
    n_rows = frame.height
    session_names = frame["session"].cast(pl.String).to_list() if "session" in frame.columns else ["0"] * n_rows
    lines = frame["line"].cast(pl.String).to_list() if "line" in frame.columns else [""] * n_rows
    runs = [f"circle {line or ''}/{session or ''}" for line, session in zip(lines, session_names, strict=True)]
    names = tuple(dict.fromkeys(runs))
    number_of = {name: number for number, name in enumerate(names)}
    session = np.array([number_of[run] for run in runs], dtype=np.int64)
    order = np.argsort(session, kind="stable")
    frame, session = frame[order], session[order]
    commanded = np.column_stack([frame[name].cast(pl.Float64).to_numpy() for name in ("x", "y", "z")])
    repeat = frame["repeat"].cast(pl.Float64).to_numpy() if "repeat" in frame.columns else np.zeros(n_rows)
    sense = frame["dir"].cast(pl.Float64).to_numpy() if "dir" in frame.columns else np.zeros(n_rows)
    directions = Observations(frame.with_columns(pl.Series("session", session.astype(str)))).directions
    feed = frame["feed"].cast(pl.Float64).to_numpy() if "feed" in frame.columns else np.zeros(n_rows)
    _, pass_number = np.unique(
        np.column_stack([session, *(np.nan_to_num(column) for column in (repeat, feed, sense))]),
        axis=0,
        return_inverse=True,
    )
    commanded = np.ascontiguousarray(commanded, dtype=np.float64)
    for number in range(int(pass_number.max(initial=-1)) + 1):
        rows = pass_number.ravel() == number
        commanded[rows] = on_their_circle(commanded[rows])
    std_mm, is_stated, notes = stated_std_mm(frame, "sr", "radii")
    return Sightings.of_one_number(
        table=frame,
        commanded_mm=commanded,
        measured_mm=frame["r"].cast(pl.Float64).to_numpy(),
        std_mm=std_mm if is_stated else np.ones(n_rows),
        is_stated=is_stated,
        session=session,
        sessions=names,
        frames=("circle",) * len(names),
        pass_number=pass_number.astype(np.int64).ravel(),
        directions=directions,
        source_row=order.astype(np.int64),
        left_out={},
        notes=notes,
    )


def _joined(parts: Sequence[Sightings]) -> Sightings:
    if len({part.is_stated for part in parts}) > 1:
        raise GeometryError(
            "some measurements state their uncertainty; others do not, and have too few places measured twice, and "
            "too few rows along straight passes, to tell it, so that they cannot be weighed together\n"
            "hint: give sx, sy, sz (mm) in every file, or in none; or measure those passes again"
        )
    session_offsets = np.cumsum([0, *(len(part.sessions) for part in parts[:-1])])
    pass_offsets = np.cumsum([0, *(part.n_passes for part in parts[:-1])])
    left_out: dict[str, int] = {}
    for part in parts:
        for why, count in part.left_out.items():
            left_out[why] = left_out.get(why, 0) + count
    return Sightings(
        table=pl.concat([part.table for part in parts], how="diagonal_relaxed"),
        commanded_mm=np.concatenate([part.commanded_mm for part in parts]),
        offset_mm=np.concatenate([part.offset_mm for part in parts]),
        measured_mm=np.concatenate([part.measured_mm for part in parts]),
        is_measured=np.concatenate([part.is_measured for part in parts]),
        whitening=np.concatenate([part.whitening for part in parts]),
        is_stated=parts[0].is_stated,
        carrier=np.concatenate([part.carrier for part in parts]),
        session=np.concatenate([p.session + start for p, start in zip(parts, session_offsets, strict=True)]),
        sessions=tuple(name for part in parts for name in part.sessions),
        frames=tuple(kind for part in parts for kind in part.frames),
        pass_number=np.concatenate([p.pass_number + start for p, start in zip(parts, pass_offsets, strict=True)]),
        directions=np.concatenate([part.directions for part in parts]),
        source_row=np.concatenate([part.source_row for part in parts]),
        left_out=left_out,
        notes=tuple(sentence for part in parts for sentence in part.notes),
    )


def _whitening(
    observations: Observations, is_measured: npt.NDArray[np.bool_]
) -> tuple[Numbers, bool, tuple[str, ...]]:
    """Give W (n, 3, 3) with W C Wᵀ = 1 on the measured components; rows without a covariance get the mean one."""
    unit = np.asarray(np.eye(3) * is_measured[:, None, :].astype(np.float64))
    covariance_mm2 = observations.covariance_mm2
    needed = is_measured[:, :, None] & is_measured[:, None, :]
    stated = stated_rows(covariance_mm2, is_measured)
    if covariance_mm2 is None or not stated.any():
        note = unused_uncertainties(observations, is_measured)
        return unit, False, () if note is None else (note,)
    notes: tuple[str, ...] = ()
    filled = np.where(needed & np.isfinite(covariance_mm2), covariance_mm2, 0.0)
    if not stated.all():
        filled[~stated] = np.where(needed[~stated], mean_covariance(filled[stated], needed[stated]), 0.0)
        notes = (lacking_rows(int((~stated).sum())),)
    # A component that was not measured gets variance 1 of its own, and its row of W is then taken out.
    padded = filled + np.eye(3) * (~is_measured)[:, None, :]
    value, vector = np.linalg.eigh(padded)
    too_small = value < LEAST_STD_MM**2
    if too_small.any():
        row = int(np.flatnonzero(too_small.any(axis=1))[0])
        raise GeometryError(
            f"the covariance of measured row {row + 1} is not positive: its smallest eigenvalue is "
            f"{value[row].min():.3g} mm²\nhint: state the standard uncertainty of every measured component, in "
            "millimetres and above 0"
        )
    # W = V diag(1/√λ) Vᵀ: symmetric, and with a component taken out it never mixes it with the others.
    whitening = np.einsum("nik,nk,njk->nij", vector, 1.0 / np.sqrt(value), vector)
    return np.ascontiguousarray(np.where(needed, whitening, 0.0)), True, notes
