"""Names that terms are made of: channels, variables, functions of formulas."""

from __future__ import annotations

import re
from functools import lru_cache

from geoerr.machine import AXES

JOINT_CHANNELS: tuple[str, ...] = tuple(f"E{direction}{axis}" for axis in "XYZ" for direction in "XYZABC")
SQUARENESS_CHANNELS = ("S_xy", "S_xz", "S_yz")
BODY_CHANNELS: tuple[str, ...] = tuple(f"{body}-{axis}" for body in ("tool", "work", "target") for axis in AXES)
RIG_CHANNELS: tuple[str, ...] = (
    *(f"rig-t{axis}" for axis in AXES),
    *(f"rig-r{axis}" for axis in AXES),
    "rig-scale",
    "rig-depth",
    "rig-disparity",
    "rig-ray-x",
    "rig-ray-y",
    *(f"motion-{axis}" for axis in AXES),
)
CHANNELS = JOINT_CHANNELS + SQUARENESS_CHANNELS + BODY_CHANNELS + RIG_CHANNELS

# What an expression may use without the data holding a column of that name.
HISTORY_NAMES = ("d", "s", "t_rev", "v", "a", "mean_v")
# The place on the work that a row is about, in the work's own frame: (tx, ty) on `work`, else the place that the
# target stands over, (x + tx, y + ty).
PLACE_NAMES = ("bed_x", "bed_y")
# Running number of the row's session, 0 for the first.
SESSION_NAME = "session"
# Time since the first session began, all sessions laid end to end: a moment of one session is no moment of another.
CLOCK_NAME = "clock"
RAW_VARIABLES = frozenset(
    {
        *AXES,
        *(f"t{axis}" for axis in AXES),
        "t",
        *(f"{name}_{axis}" for name in HISTORY_NAMES for axis in AXES),
        *PLACE_NAMES,
        SESSION_NAME,
        CLOCK_NAME,
    }
)
FUNCTIONS = frozenset(
    {
        *("sin", "cos", "tan", "asin", "acos", "atan", "atan2", "sinh", "cosh", "tanh"),
        *("exp", "log", "sqrt", "abs", "sign", "step", "min", "max", "where", "lag", "windup"),
    }
)
CONSTANTS = frozenset({"pi"})
# In a reference's place of an effect: a curve without a cause, `empirical:x@feed`.
EMPIRICAL = "empirical"
# Variables of such a curve, at most.
MOST_OF_A_CURVE = 3

_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_]{0,99}\Z")
_EFFECT_ID = re.compile(r"[a-z][a-z0-9]*(-[a-z0-9]+)*\Z")
_TOKEN = re.compile(r"(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?|([A-Za-z_][A-Za-z0-9_]*)")


def is_motion(name: str, *kinds: str) -> bool:
    """Tell whether a variable says how an axis moves, in one of these ways of `HISTORY_NAMES`.

    `v_x` is a speed; `v_left`, a row of a picture, and a user's column `a_room` are no motion.
    """
    kind, _, axis = name.rpartition("_")
    return kind in kinds and axis in AXES


def has_span(name: str) -> bool:
    """Tell whether a variable that rows have by themselves was measured over a span that says how far it is known.

    How long the machine has run, how hard it works, how fast it goes: a number for it may be as far from what was
    measured as a temperature. A clock always is, and so is a time since a reversal that stands for a long one.
    """
    return name == "t" or is_motion(name, "v", "mean_v")


def is_rig_channel(channel: str) -> bool:
    """Tell whether a channel belongs to the measuring rig: explained, never compensated."""
    return channel in RIG_CHANNELS


def is_name(text: str) -> bool:
    """Tell whether a text can stand in an expression as a name (letters, digits, underscores)."""
    return _NAME.match(text) is not None


def is_column(text: str) -> bool:
    """Tell whether a formula can mean a column by this name: one that is no function or constant of formulas."""
    return is_name(text) and text not in FUNCTIONS | CONSTANTS


def is_effect_id(text: str) -> bool:
    """Tell whether a text is an effect's id: lower-case words joined by hyphens."""
    return _EFFECT_ID.match(text) is not None and len(text) <= 100


@lru_cache(maxsize=4096)
def names_in(expression: str) -> tuple[str, ...]:
    """Give the names that an expression mentions, functions and constants aside, each once, in order.

    `windup` mentions the direction `d` and the travel `s` that it is a recursion over.
    """
    found: dict[str, None] = {}
    for match in _TOKEN.finditer(expression):
        name = match[1]
        if name == "windup":
            found |= {"d": None, "s": None}
        elif name is not None and name not in FUNCTIONS | CONSTANTS:
            found[name] = None
    return tuple(found)


@lru_cache(maxsize=4096)
def mentions(expression: str, function: str) -> bool:
    """Tell whether an expression calls a function."""
    return any(match[1] == function for match in _TOKEN.finditer(expression))
