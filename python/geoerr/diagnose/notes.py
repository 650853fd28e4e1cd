"""What to know before trusting a diagnosis: of the fit, of the model, of how lines are named."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from geoerr.diagnose.answer import held_out_um
from geoerr.diagnose.comparison import Comparison, all_terms
from geoerr.diagnose.components import is_circle
from geoerr.diagnose.gaps import gaps_of, unread_rows, unread_temperatures
from geoerr.diagnose.untold import untold_rows
from geoerr.fit import Fitted
from geoerr.fit.sightings import Sightings
from geoerr.fit.variables import times_s
from geoerr.model.fit_words import FAR_BELOW_STATED, NOT_SETTLED, far_below_stated_words
from geoerr.observations import CARRIERS, PIXELS
from geoerr.summaries import counted, listed, p_words

if TYPE_CHECKING:
    from collections.abc import Sequence

    from geoerr.diagnose.diagnosis import Diagnosis

# A session that lasts longer, and a machine that moves faster from row to row, have times in another unit.
_DAY_S = 86_400.0
_LONGEST_S, _FASTEST_MM_S = 14.0 * _DAY_S, 2000.0
# Fewer rows of unknown direction than this share are not told.
_UNTOLD = 0.02
# Lines that a sentence names.
_SPOKEN = 3
# A held-out error is far off from this many of what a right model would have: by repeats, so many standard errors of
# their scatter beyond; and by stated uncertainties, which say nothing of what drifts.
_FAR_OFF, _STANDARD_ERRORS = 1.25, 3.0
_FAR_OFF_AS_STATED = 2.0
# So much more than their scatter lengths leave by chance seldom enough.
_NOT_BY_CHANCE = 1e-3
_OTHER_DATA = (
    "the model's numbers come from other data: where the cause acted there already they hold a part of it, and its "
    "image is what is seen here"
)


def notes_of(
    fitted: Fitted,
    comparison: Comparison | None,
    *,
    has_found: bool,
    blames_cameras: bool = False,
    other_way: Diagnosis | None = None,
    has_unread: bool = False,
    rough: Sequence[str] = (),
) -> tuple[str, ...]:
    """Give them, a sentence each; none where nothing stands in the way.

    Parameters
    ----------
    fitted
        What was searched.
    comparison
        The model held against the measurements; None where a fit was diagnosed.
    has_found
        Whether anything is missing.
    blames_cameras
        Whether an effect of the cameras is among it.
    other_way
        What is found with the model's numbers as they are where they were fitted, and the other way round, if both
        were tried.
    has_unread
        Whether rows took part in which a temperature is unknown, and nothing that follows it.
    rough
        Why a wave was not named where few places tell it.
    """
    said = []
    is_held = comparison is not None and comparison.is_held
    if is_without_errors(fitted, comparison):
        said.append(
            "the 21 geometric errors were never fitted, as geoerr fit does: the model is a machine without errors, "
            "and what they do is looked for among all else, effects and cameras"
        )
    if not fitted.solved.converged:
        said.append(
            "the fit has not settled, so that what it leaves is not only what the model lacks: leave out the term "
            "that runs away, or measure what would hold it"
        )
    if fitted.share_of_stated < FAR_BELOW_STATED:
        said.append(far_below_stated_words(fitted.share_of_stated))
    record = None if comparison is None else comparison.model.record
    if is_held and record is not None and not record.has_settled:
        said.append(f"the model's own data: {NOT_SETTLED}")
    if other_way is not None:
        said.append(_of_both_ways(other_way, is_held=is_held))
    elif has_found and is_held and comparison is not None and all_terms(comparison.model):
        said.append(f"{_OTHER_DATA}; --refit fits them to these data")
    if blames_cameras and fitted.shared is None and set(PIXELS) <= set(fitted.sightings.table.columns):
        said.append(
            "an effect of the cameras may be no more than what their calibration does not know, which took no part: "
            f"--rig rig.json{' --refit' if is_held else ''} lets it"
        )
    said += [
        *rough,
        *([] if has_found or is_held else _not_carried_over(fitted)),
        *([] if has_found else _more_than_lengths_scatter(fitted)),
        *_beside_lengths(fitted.sightings),
        *fitted.sightings.notes,
        *_odd_times(fitted.sightings),
        *_gaps(fitted.sightings, has_unread=has_unread),
        *_untold(fitted.sightings),
    ]
    broken = interrupted_lines(fitted)
    if broken:
        names = [*broken[:_SPOKEN], *([f"{len(broken) - _SPOKEN} more"] if len(broken) > _SPOKEN else [])]
        said.append(
            f"{counted(len(broken), 'line')} ({listed(names)}) {'was' if len(broken) == 1 else 'were'} left and come "
            "back to, and both visits count as one pass: number them in the column repeat"
        )
    return tuple(said)


def _of_both_ways(other_way: Diagnosis, *, is_held: bool) -> str:
    """Say what the other way has found, and why this one is the answer."""
    if not is_held:
        assert other_way.unknown is not None
        return (
            "as they were, the model's numbers leave what no known effect explains (over "
            f"{listed(other_way.unknown.depends_on)}): they come from other data, and hold a part of a cause that "
            "acted there already; fitted to these data, too, they leave what is named here"
        )
    if other_way.unknown is not None:
        over = listed(other_way.unknown.depends_on)
        return f"{_OTHER_DATA}; fitted to these data, too, they leave what has no name either (over {over})"
    return (
        "the model's numbers come from other data; fitted to these, too, they leave nothing: what is seen here "
        "its own errors can do, which have changed since, or hold a part of a cause that acted already"
    )


def _not_carried_over(fitted: Fitted) -> list[str]:
    """Say where nothing was found, and yet held-out rows are off by far more than repeats and the fit allow.

    What knots follow is neither in a residual nor named: rows that they never saw show that it is no smooth error.
    """
    split, expected_um, is_um = fitted.split, fitted.expected_held_out_um, held_out_um(fitted)
    if expected_um is None or is_um is None:
        return []
    allowed, by = _FAR_OFF_AS_STATED, "by the stated uncertainties"
    if split.is_from_repeats:
        allowed, by = _FAR_OFF * (1.0 + _STANDARD_ERRORS / math.sqrt(2.0 * split.dof[1])), "as repeats scatter"
    if is_um < allowed * expected_um:
        return []
    return [
        f"held-out rows are off by {is_um:.3g} µm where a right model would be by {expected_um:.3g}, {by}: "
        "the errors' curves follow what is no smooth error of an axis, or the rows have too few places to hold them; "
        "measure at more places, also between these"
    ]


def _more_than_lengths_scatter(fitted: Fitted) -> list[str]:
    """Say where nothing was found in a few lengths, and yet they are off by far more than they scatter.

    A search reckons what is left as noise until it knows what it is, and of few lengths much is left. But they share
    no drift and no offset, so that their own scatter tells noise from the rest.
    """
    p_value = fitted.split.lack_of_fit_p
    if not fitted.sightings.has_lengths_only or p_value is None or p_value > _NOT_BY_CHANCE:
        return []
    by = "they scatter when they are measured again" if fitted.split.is_from_repeats else "their uncertainties allow"
    return [
        f"the lengths are off by far more than {by} ({p_words(p_value, 1)}): something is missing, and these are too "
        "few to say what; measure more of them, at other places and in other directions, or fit what you suspect"
    ]


def _beside_lengths(sightings: Sightings) -> list[str]:
    """Say that of lengths beside much surer points a search sees less than of the lengths alone.

    A column is judged by the share of it that the frames of all sessions leave, and a squareness moves all points of
    a line by as much as a frame does.
    """
    if sightings.has_lengths_only or "lengths" not in sightings.frames:
        return []
    return [
        "beside points and circles a search may pass over what only the lengths tell, or give it the name of what "
        "looks alike: ask of the lengths alone, too (a fit has all of both)"
    ]


def is_without_errors(fitted: Fitted, comparison: Comparison | None) -> bool:
    """Tell whether points are held against a machine without errors, of which the 21 could be fitted."""
    if comparison is None or not comparison.model.is_nominal or bool(is_circle(fitted).all()):
        return False
    # Where no axis moves there is nothing to fit.
    return bool(np.ptp(fitted.sightings.commanded_mm, axis=0).any())


def _odd_times(sightings: Sightings) -> list[str]:
    """Say where the times can hardly be seconds: what grows and fades in time is then looked for where it is not."""
    if not np.isfinite(sightings.numbers("t")).all():
        return []
    said, times = [], times_s(sightings)
    for number, name in enumerate(sightings.sessions):
        rows = np.flatnonzero(sightings.session == number)
        span_s = float(np.ptp(times[rows])) if len(rows) else 0.0
        path_mm = float(np.linalg.norm(np.diff(sightings.commanded_mm[rows], axis=0), axis=1).sum())
        if span_s > _LONGEST_S:
            said.append(f"session {name!r} lasts {span_s / _DAY_S:.0f} days by its times: t is in seconds")
        elif span_s > 0.0 and path_mm / span_s > _FASTEST_MM_S:
            said.append(
                f"in session {name!r} the machine goes {path_mm / 1e3:.3g} m in {span_s:.3g} s by its times, dwells "
                "included: t is in seconds"
            )
    return said


def _gaps(sightings: Sightings, *, has_unread: bool) -> list[str]:
    """Say which temperatures were not read in every row, and what was made of that."""
    alike: dict[tuple[int, int], list[str]] = {}
    for one in gaps_of(sightings):
        alike.setdefault((one.n_empty, one.n_between), []).append(one.name)
    said = []
    for (n_empty, n_between), names in alike.items():
        is_one = len(names) == 1
        empty = f"{listed(names)} {'is' if is_one else 'are'} empty in {counted(n_empty, 'row')}"
        straight = f"between readings {'it is' if is_one else 'they are'} taken to run straight"
        unknown = (
            f"in {counted(n_empty - n_between, 'row')} nobody can say what depends on {'it' if is_one else 'them'}"
        )
        parts = [*([straight] if n_between else []), *([unknown] if n_between < n_empty else [])]
        said.append(f"{empty}: {', and '.join(parts)}")
    n_unread = int(unread_rows(sightings).sum())
    if n_unread and has_unread:
        said.append(
            f"without {counted(n_unread, 'row')} of unknown temperature nothing is missing; with them, and without "
            f"what follows {listed(unread_temperatures(sightings), 'or')}, there is what is told here"
        )
    elif n_unread:
        said.append(f"the search goes on without {counted(n_unread, 'row')} of unknown temperature")
    return said


def _untold(sightings: Sightings) -> list[str]:
    """Say that rows of unknown direction took no part, where they are more than the first of a run."""
    n_untold = int(untold_rows(sightings).sum())
    if n_untold <= _UNTOLD * len(sightings):
        return []
    return [
        f"in {counted(n_untold, 'row')} nobody knows from which side an axis came: the search goes on without them; "
        "state dir_x, dir_y and dir_z"
    ]


def interrupted_lines(fitted: Fitted) -> list[str]:
    """Give the lines of which one pass has a whole other one between its rows.

    Rows that take turns (several targets in one picture) are not meant: there no pass lies between two rows; nor are
    reference markers, which are looked at between passes.
    """
    sightings = fitted.sightings
    if sightings.n_passes < 2 or "line" not in sightings.table.columns:
        return []
    place = _place_in_order(sightings)
    order = np.lexsort((place, sightings.pass_number))
    passes, places = sightings.pass_number[order], place[order]
    starts = np.flatnonzero(np.diff(passes, prepend=-1))
    first, last = places[starts], np.maximum.reduceat(places, starts)
    is_marker = sightings.carrier[order[starts]] == CARRIERS.index("base")
    first, last = first[~is_marker], last[~is_marker]
    if not first.size:
        return []
    # The last place of the passes that begin after a row: the least of them ends first.
    by_start = np.argsort(first)
    soonest_end = np.minimum.accumulate(last[by_start][::-1])[::-1]
    same = np.flatnonzero(passes[1:] == passes[:-1])
    before, after = places[same], places[same + 1]
    nearest = np.searchsorted(first[by_start], before, side="right")
    has_one = nearest < len(first)
    is_broken = has_one & (soonest_end[np.minimum(nearest, len(first) - 1)] < after)
    is_broken &= sightings.carrier[order[same]] != CARRIERS.index("base")
    names = sightings.texts("line")
    return list(dict.fromkeys(names[order[row]] for row in same[is_broken]))


def _place_in_order(sightings: Sightings) -> np.ndarray:
    """Give every row's place in the order of measurement: by time where there is one, within its session."""
    time = times_s(sightings) if "t" in sightings.table.columns else np.zeros(len(sightings))
    order = np.lexsort((np.arange(len(sightings)), np.nan_to_num(time), sightings.session))
    place = np.empty(len(sightings), dtype=np.int64)
    place[order] = np.arange(len(sightings))
    return place
