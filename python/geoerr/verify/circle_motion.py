"""Conditions along a circle: what a term may follow when the axes run round, from the sense and the feed."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from geoerr.errors import GeoerrError
from geoerr.machine import AXES
from geoerr.model import Model
from geoerr.model.conditions import Conditions, constants_of
from geoerr.terms import is_motion
from geoerr.verify.circle import CircleOfCommands

Numbers = npt.NDArray[np.float64]

# The axis that rests has come from somewhere, on a long stroke: on a circle that is a constant.
_RESTING_DIRECTION = 1.0
_RESTING_TRAVEL_MM = 100.0


def conditions_on_circle(
    model: Model, circle: CircleOfCommands, positions_mm: Numbers, sense: int, at: Conditions | None
) -> Conditions:
    """Give the conditions of points on a circle that is run without a stop.

    Direction and travel since the reversal follow from the sense; speeds also from a stated `feed` (mm/min). What is
    stated has precedence.

    Parameters
    ----------
    positions_mm : (n, 3)
        Commanded positions.
    sense
        +1 counter-clockwise seen from + of the third axis, −1 clockwise.

    Raises
    ------
    GeoerrError
        where the model follows a speed and no feed is stated.
    """
    given = {} if at is None else dict(at)
    needed = [name for name in model.conditions if name not in given]
    speeds = [name for name in needed if is_motion(name, "v")]
    if speeds and "feed" not in given:
        raise GeoerrError(
            f"the model follows {', '.join(speeds)}: a circle has speeds only with a feed\n"
            "hint: state it in mm/min, as --at feed=1000, or leave the effect out with 0, as --at v_x=0"
        )
    feed_mm_min = constants_of(model.machine, {"feed": given.get("feed", 0.0)})["feed"]
    told: dict[str, npt.ArrayLike] = {**_motion(circle, positions_mm, sense, feed_mm_min), "moving": 1.0}
    return {**{name: told[name] for name in needed if name in told}, **given}


def followed_on_circle(*models: Model) -> set[str]:
    """Name the conditions that any of the models follows on a circle; the feed, where that makes their speeds."""
    follows = {name for model in models for name in model.conditions}
    if any(is_motion(name, "v") for name in follows):
        follows.add("feed")
    return follows


def _motion(circle: CircleOfCommands, positions_mm: Numbers, sense: int, feed_mm_min: float) -> dict[str, Numbers]:
    first, second, third = circle.axes
    arm = np.zeros((len(positions_mm), 3))
    arm[:, [first, second]] = circle.in_plane(positions_mm)
    tangent = np.zeros_like(arm)
    tangent[:, first], tangent[:, second] = -sense * arm[:, second], sense * arm[:, first]
    tangent /= np.linalg.norm(tangent, axis=1)[:, None]
    # At the very reversal the direction is that of the way back.
    direction = np.where(np.abs(tangent) > 1e-9, np.sign(tangent), -np.sign(arm))
    direction[:, third] = _RESTING_DIRECTION
    travel_mm = circle.radius_mm + direction * arm
    travel_mm[:, third] = _RESTING_TRAVEL_MM
    velocity = tangent * feed_mm_min / 60.0
    columns = {"d": direction, "s": travel_mm, "v": velocity}
    return {f"{name}_{axis}": values[:, place] for name, values in columns.items() for place, axis in enumerate(AXES)}
