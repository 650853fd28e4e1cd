"""Times that do not do what they are for: they count from no begin of a session, or order some of its rows only."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from geoerr.fit.moved_targets import numbers_of_targets
from geoerr.fit.sightings import Numbers, Sightings
from geoerr.summaries import counted

# A session that begins after so many times its own duration shows less of what has drifted since its clock began than
# the share of which nothing is said.
_LATE = 10.0
# A session has so many rows at least, and its clock begins in this first part of the longest.
_ROWS_OF_A_SESSION, _BEGIN = 10, 0.1


def odd_times(sightings: Sightings) -> Iterator[str]:
    """Say so where times of all sessions begin long before they did, and where a session has them in some rows only.

    Of a time that runs on from session to session the first begins where it should.
    """
    times_s = sightings.numbers("t")
    rows_of = [rows for rows in sightings.rows_of_sessions if rows.start < rows.stop]
    sessions = [times_s[rows] for rows in rows_of]
    if sessions and all(_is_late(own_s) for own_s in sessions):
        first_s = sessions[0]
        yield (
            f"the time t begins at {first_s.min():g} s in a session of {np.ptp(first_s):g} s: it is to count from "
            "the session's begin; what warms up or drifts with time would be done long before, and is not found "
            "(subtract the first t of each session)"
        )
    yield from _begun_again(sightings, rows_of, times_s)
    for rows, own_s in zip(rows_of, sessions, strict=True):
        n_empty = int(np.isnan(own_s).sum())
        if 0 < n_empty < len(own_s):
            yield (
                f"the time t is empty in {n_empty} of {counted(len(own_s), 'row')} of session "
                f"{sightings.sessions[sightings.session[rows.start]]!r}: it does not order them, and what follows "
                "from their order (directions, travel, drift) is as the table has it; fill it in"
            )
            return


def _begun_again(sightings: Sightings, rows_of: list[slice], times_s: Numbers) -> Iterator[str]:
    """Say so where the clock of a session begins again further down in its file: two sessions, told as one."""
    file_row, target = sightings.numbers("file_row"), sightings.once("targets", numbers_of_targets)
    for rows in rows_of:
        # Rows that are written target by target begin again with every one.
        first = np.flatnonzero(target[rows] == target[rows.start]) + rows.start
        as_written_s = times_s[first][np.argsort(file_row[first], kind="stable")]
        duration_s = float(np.ptp(as_written_s))
        falls = np.flatnonzero(np.diff(as_written_s) < 0.0)
        begins_s = as_written_s[falls + 1] - as_written_s.min()
        # Rows in any other order fall everywhere, and from anywhere.
        if (
            0 < len(falls) <= max(len(as_written_s) // _ROWS_OF_A_SESSION, 1)
            and (begins_s < _BEGIN * duration_s).all()
        ):
            name = sightings.sessions[sightings.session[rows.start]]
            yield (
                f"the time t of session {name!r} begins again {counted(len(falls), 'time')} further down its file: "
                "its rows count as one session, and those of one time as measured together; if cameras or the work "
                "were set up anew give each a name in the column session"
            )
            return


def _is_late(times_s: Numbers) -> bool:
    return bool(np.isfinite(times_s).all()) and times_s.min() > _LATE * np.ptp(times_s) > 0.0
