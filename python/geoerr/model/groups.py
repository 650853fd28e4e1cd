"""Groups of the 21 errors by name, and the names of what a user may ask to be left out."""

from __future__ import annotations

from geoerr.error_functions import LINEAR_AND_ANGULAR, SQUARENESS, is_angular

ROLL = ("EAX", "EBY", "ECZ")
POSITIONING = ("EXX", "EYY", "EZZ")
GROUPS: dict[str, tuple[str, ...]] = {
    "positioning": POSITIONING,
    "straightness": tuple(n for n in LINEAR_AND_ANGULAR if not is_angular(n) and n not in POSITIONING),
    "angular": tuple(n for n in LINEAR_AND_ANGULAR if is_angular(n)),
    "pitch-yaw": tuple(n for n in LINEAR_AND_ANGULAR if is_angular(n) and n not in ROLL),
    "roll": ROLL,
    "squareness": SQUARENESS,
    # What a firmware that probes the bed takes out: heights along X and along Y.
    "bed-mesh": ("EZX", "EZY"),
}
