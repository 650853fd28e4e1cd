"""What is explained by whatever is pointed at: a candidate by its reference, or the own effect that was tried."""

from __future__ import annotations

import numpy as np

from geoerr.diagnose import Diagnosis
from geoerr.diagnose.circles import CircleDiagnosis
from geoerr.diagnose.findings import Finding, Unknown
from geoerr.fit.sightings import Numbers
from geoerr.report.figures.style import UM_PER_MM
from geoerr.workbench.circles import cause_um
from geoerr.workbench.session import Session

# Stands for the own effect that was tried.
TRIAL = "own formula"


def what_is_shown(session: Session, name: str | None) -> Numbers | None:
    """Give the displacement (n, 3) µm, a radius in the first component.

    None where nothing is pointed at, or it is not known row by row.
    """
    seen = session.seen
    if not name or seen is None:
        return None
    if name == TRIAL:
        return _of_trial(session)
    diagnosis = session.diagnosis
    if isinstance(diagnosis, CircleDiagnosis):
        return cause_um(diagnosis, name, seen.comparison.points.sightings)
    if not isinstance(diagnosis, Diagnosis):
        return None
    things: list[Finding | Unknown] = [*diagnosis.found, *diagnosis.candidates]
    if diagnosis.unknown is not None:
        things.append(diagnosis.unknown)
    found = next((one for one in things if str(one.reference) == name), None)
    if found is None:
        return None
    moved_um = found.explained_um
    return moved_um if len(moved_um) == len(seen.comparison.points.sightings) else None


def _of_trial(session: Session) -> Numbers | None:
    """Take what the residual loses: the trial's model has moved as a whole."""
    trial, seen = session.trial, session.seen
    if trial is None or seen is None:
        return None
    before, after = seen.comparison.points, trial.change.after
    if len(after.sightings) != len(before.sightings):
        return None
    return np.asarray((before.residual_mm - after.residual_mm) * UM_PER_MM)
