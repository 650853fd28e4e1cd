"""Circular tests alone: what ails a machine, ranked by what it is worth."""

from geoerr.diagnose.circles.diagnosis import (
    Cause,
    CircleDiagnosis,
    CircleUnknown,
    RunFigures,
    SetUpFigures,
    diagnose_circles,
)
from geoerr.diagnose.circles.readings import Reading
from geoerr.diagnose.circles.shares import Shares

__all__ = [
    "Cause",
    "CircleDiagnosis",
    "CircleUnknown",
    "Reading",
    "RunFigures",
    "SetUpFigures",
    "Shares",
    "diagnose_circles",
]
