"""Readings that are there twice: whole sessions, and rows of one session."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator

import numpy as np
import polars as pl

from geoerr.fit.lengths import other_ends_mm
from geoerr.fit.sightings import Integers, Sightings
from geoerr.summaries import counted, place_of_row

# So many rows are not the same by chance.
_LEAST_TO_BE_THE_SAME = 6
# Without a time a coarse device repeats itself honestly: so many of a session's rows must have a twin.
_LEAST_SHARE = 0.5


def counted_twice(sightings: Sightings) -> Iterator[str]:
    """Name sessions, and count rows, that hold what others hold, digit for digit: no two measurements come out so."""
    yield from _sessions(sightings)
    yield from _rows(sightings)


def _sessions(sightings: Sightings) -> Iterator[str]:
    first: dict[bytes, str] = {}
    for name, rows in zip(sightings.sessions, sightings.rows_of_sessions, strict=True):
        if rows.stop - rows.start < _LEAST_TO_BE_THE_SAME:
            continue
        held = [own[rows] for own in (sightings.commanded_mm, sightings.offset_mm, sightings.measured_mm)]
        digest = hashlib.sha256(b"".join(np.ascontiguousarray(own).tobytes() for own in held)).digest()
        if digest in first:
            yield (
                f"sessions {first[digest]} and {name} hold the same readings, digit for digit: one measurement "
                "counts twice, and all seems surer than it is; leave one out"
            )
        first.setdefault(digest, name)


def _rows(sightings: Sightings) -> Iterator[str]:
    again = _again(sightings)
    if not again.any():
        return
    count, first = int(again.sum()), int(np.argmax(again))
    place = place_of_row(float(sightings.numbers("file_row")[first]), first)
    yield (
        f"{counted(count, 'row')}, the first in {place}, {'is' if count == 1 else 'are'} the same as another of the "
        "session, digit for digit: one reading counts twice, and all seems surer than it is; give each file once, "
        "and leave copied rows out (readings that were taken again have a time t, or a number in repeat)"
    )


def _again(sightings: Sightings) -> np.ndarray:
    """Tell which rows (n,) hold what one before them in their session holds.

    With a time that is enough. Without one rows of one `repeat` are compared, and most of a session must be so within
    passes: what was come to from the other side was read again.
    """
    reading = _readings(sightings)
    if len(np.unique(reading)) == len(reading):
        return np.zeros(len(reading), dtype=bool)
    _, first, number = np.unique(reading, return_index=True, return_inverse=True)
    again = first[number] != np.arange(len(reading))
    is_timed = np.isfinite(sightings.numbers("t"))
    n_sessions = len(sightings.sessions)
    n_rows = np.bincount(sightings.session[~is_timed], minlength=n_sessions)
    # A length is come to from nowhere.
    passes = np.where(sightings.of_kind("lengths"), 0, sightings.pass_number)
    _, of_pass, count = np.unique(np.column_stack([number, passes]), axis=0, return_inverse=True, return_counts=True)
    has_twin = count[of_pass.ravel()] > 1
    n_twins = np.bincount(sightings.session[~is_timed & has_twin], minlength=n_sessions)
    is_copied = n_twins >= np.maximum(_LEAST_SHARE * n_rows, _LEAST_TO_BE_THE_SAME)
    return np.asarray(again & (is_timed | is_copied[sightings.session]))


def _readings(sightings: Sightings) -> Integers:
    """Give each row's reading a number, (n,), by its digits: of a million rows two unlike ones share none."""
    time_s = sightings.numbers("t")
    is_timed = np.isfinite(time_s)
    when = np.where(is_timed, time_s, np.nan_to_num(sightings.numbers("repeat")))
    held = (
        # A corner is an end of several lengths, which may be alike.
        other_ends_mm(sightings),
        *(sightings.commanded_mm, sightings.offset_mm, sightings.measured_mm, sightings.is_measured),
        *(sightings.carrier, sightings.session, is_timed, when),
    )
    # −0 is 0.
    return pl.DataFrame(np.column_stack(held) + 0.0).hash_rows(seed=0).to_numpy()
