"""What tied candidates are about: which axes, variables and channels a plan should bring into play."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from geoerr.machine import AXES
from geoerr.terms import CLOCK_NAME, Term, is_motion

# Motion that changes with the feed, with the travel since a reversal, with the direction.
_SPEED = ("v", "a", "mean_v", "t_rev")
_TRAVEL = ("s", "t_rev", "d")
_DIRECTION = ("d", "s", "t_rev", "v")
# Channels that a static target would see too, those whose size a bar tells, and those fixed to the cameras' view.
_POSE = ("rig-t", "rig-r", "rig-scale")
_SCALE = ("rig-scale", "rig-depth", "rig-disparity")
_VIEW = ("rig-scale", "rig-depth", "rig-disparity", "rig-ray")


@dataclass(frozen=True)
class Question:
    """What the candidates are functions of, and where they act.

    Attributes
    ----------
    axes
        x before y before z; all of them where a candidate has none.
    variables
        Of their formulas (`d_x`, `v_x`, `t`, `temp_bed` ...).
    channels
        Where they act.
    """

    axes: tuple[str, ...]
    variables: frozenset[str]
    channels: frozenset[str]

    @property
    def follows_speed(self) -> bool:
        """Whether other feeds change something."""
        return self._has(_SPEED)

    @property
    def follows_acceleration(self) -> bool:
        """Whether ramps change something."""
        return self._has(("a",))

    @property
    def follows_travel(self) -> bool:
        """Whether points close after a reversal change something."""
        return self._has(_TRAVEL)

    @property
    def follows_direction(self) -> bool:
        """Whether the side of approach changes something."""
        return self._has(_DIRECTION)

    @property
    def follows_time(self) -> bool:
        """Whether time itself changes something."""
        return "t" in self.variables or CLOCK_NAME in self.variables

    @property
    def follows_use(self) -> bool:
        """Whether running an axis hard changes something."""
        return "duty" in self.variables or self._has(("mean_v",))

    @property
    def turns(self) -> bool:
        """Whether a candidate acts through the lever of a target."""
        return any(name.startswith(("EA", "EB", "EC", "target-")) for name in self.channels)

    @property
    def moves_view(self) -> bool:
        """Whether a static target would show something."""
        return any(name.startswith(_POSE) for name in self.channels)

    @property
    def scales_view(self) -> bool:
        """Whether a length standard would show something."""
        return any(name.startswith(_SCALE) for name in self.channels)

    @property
    def tells_bodies(self) -> bool:
        """Whether one moves the tool's body and another the work's: the difference of both shows neither."""
        return all(any(name.startswith(body) for name in self.channels) for body in ("tool-", "work-"))

    @property
    def stays_in_view(self) -> bool:
        """Whether something stays in the picture when the cameras are moved."""
        return any(name.startswith(_VIEW) for name in self.channels)

    def _has(self, kinds: tuple[str, ...]) -> bool:
        return any(is_motion(name, *kinds) for name in self.variables)


def question_of(terms: Sequence[Term]) -> Question:
    """Give what some terms are about."""
    letters = {letter for term in terms for letter in (term.axis or "".join(AXES)).removeprefix("work-")}
    return Question(
        tuple(axis for axis in AXES if axis in letters),
        frozenset(name for term in terms for name in term.variables),
        frozenset(channel for term in terms for channel in term.channels),
    )
