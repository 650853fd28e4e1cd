"""Times that do not count from the begin of their session: of a day, or of a controller that was on for long."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from geoerr.fit.sightings import Numbers, Sightings

# A session that begins after so many times its own duration shows less of what has drifted since its clock began than
# the share of which nothing is said.
_LATE = 10.0


def late_clocks(sightings: Sightings) -> Iterator[str]:
    """Say so where the times of all sessions begin long before they did; where a time runs on, the first does not."""
    times_s = sightings.numbers("t")
    sessions = [times_s[rows] for rows in sightings.rows_of_sessions if rows.start < rows.stop]
    if sessions and all(_is_late(own_s) for own_s in sessions):
        first_s = sessions[0]
        yield (
            f"the time t begins at {first_s.min():g} s in a session of {np.ptp(first_s):g} s: it is to count from "
            "the session's begin; what warms up or drifts with time would be done long before, and is not found "
            "(subtract the first t of each session)"
        )


def _is_late(times_s: Numbers) -> bool:
    return bool(np.isfinite(times_s).all()) and times_s.min() > _LATE * np.ptp(times_s) > 0.0
