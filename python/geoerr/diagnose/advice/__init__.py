"""The next measurement: what would tell apart candidates that the data cannot, in minutes of machine time."""

from geoerr.diagnose.advice.advise import advise, adviser_of, separation_for
from geoerr.diagnose.advice.families import Company
from geoerr.diagnose.advice.measurement import Measurement
from geoerr.diagnose.advice.record import plan_table, write_plan
from geoerr.diagnose.advice.separation import Advice, Adviser, Alternative

__all__ = [
    "Advice",
    "Adviser",
    "Alternative",
    "Company",
    "Measurement",
    "advise",
    "adviser_of",
    "plan_table",
    "separation_for",
    "write_plan",
]
