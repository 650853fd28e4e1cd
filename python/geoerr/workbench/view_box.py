"""A box over the volume as it is seen: the rows whose places lie inside it on the screen, in front and behind."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from geoerr.diagnose.components import is_position
from geoerr.report.figures.volume import places_mm
from geoerr.workbench.session import Rows, Seen


def rows_in_view_box(seen: Seen, told: Mapping[str, Any]) -> Rows:
    """Tell which rows (n,) are seen in a box that was drawn over the volume: all of them, drawn or not.

    A row is where its target is commanded to, at the foot of its arrow.

    Parameters
    ----------
    told
        What the page says: `to_clip`, (4, 4), takes a place (x, y, z, 1) in mm to homogeneous coordinates of the
        screen, with x to the right and y upwards from −1 to 1 over the scene once divided by the last; `right` and
        `up` are the box's ends there.
    """
    points = seen.comparison.points
    to_clip = np.asarray(told["to_clip"], dtype=np.float64).reshape(4, 4)
    places = places_mm(seen.comparison)
    clip = places @ to_clip[:, :3].T + to_clip[:, 3]
    depth = clip[:, 3]
    # What lies behind the eye would be seen upside down.
    inside = depth > 0.0
    for column, ends in enumerate((told["right"], told["up"])):
        inside &= (clip[:, column] >= min(ends) * depth) & (clip[:, column] <= max(ends) * depth)
    return np.asarray(inside & points.solved.used & is_position(points))
