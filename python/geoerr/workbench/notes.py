"""Notes below the data: what became of files, and of rows that take no part in what is looked at."""

from __future__ import annotations

from geoerr.summaries import counted
from geoerr.workbench.calibration import calibration_words
from geoerr.workbench.inputs import as_known
from geoerr.workbench.session import Seen, Session

_MOST_SET_ASIDE = 5


def notes_of(session: Session) -> tuple[str, ...]:
    """Give the notes on the data and on the model that is looked at now: each model has outliers of its own."""
    model = None if session.step is None else session.step.model
    told = [f"{name} took the place of the earlier file of its name" for name in session.replaced]
    told += [f"{name} is what these models began with: nothing was begun anew" for name in session.given_again]
    told += calibration_words(session.files, session.measured, session.calibration, model)
    told += _set_aside(session)
    if session.seen is not None:
        told += _left_out(session.seen)
    return tuple(told)


def _set_aside(session: Session) -> list[str]:
    if session.measured is None:
        return []
    problems = session.measured.set_aside
    told = [f"set aside: {as_known(str(problem), session.folder)}" for problem in problems[:_MOST_SET_ASIDE]]
    if len(problems) > _MOST_SET_ASIDE:
        told.append(f"set aside: {counted(len(problems) - _MOST_SET_ASIDE, 'more row')}")
    return told


def _left_out(seen: Seen) -> list[str]:
    sightings, solved = seen.comparison.points.sightings, seen.comparison.points.solved
    told = [f"left out: {counted(count, 'row')} ({why})" for why, count in sightings.left_out.items()]
    told += sightings.notes
    outliers = int((~solved.used).sum())
    return [*told, f"left out: {counted(outliers, 'row')} (gross outliers)"] if outliers else told
