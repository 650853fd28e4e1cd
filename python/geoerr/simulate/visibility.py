"""Which plates the cameras see, and whether one stands in another's way."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geoerr.errors import InputFileError
from geoerr.simulate.rotations import Array
from geoerr.simulate.scene import Scene

# Plates nearer than this in the picture count as overlapping: the point spread reaches across.
_GAP_PX = 6.0


@dataclass(frozen=True)
class NotSeen:
    """A plate that one camera does not see whole at one moment."""

    row: int
    camera: str
    target: str
    why: str


def look_around(scene: Scene, margin_px: float = 0.0) -> list[NotSeen]:
    """List what is not seen whole, and refuse plates that hide each other.

    Parameters
    ----------
    scene
        The plan's scene.
    margin_px
        How far a plate must stay from the edge of the picture to count as seen.

    Raises
    ------
    InputFileError
        if two plates overlap in a picture: no detector can be blamed for what it makes of them.
    """
    missing: list[NotSeen] = []
    for row in range(len(scene)):
        for name, (outlines_px, faces) in scene.outlines_px(row).items():
            whole = np.all(scene.rig.cameras[name].sees(outlines_px, margin_px), axis=1)
            shown: list[tuple[int, Array]] = []
            for index, plate in enumerate(scene.plates):
                if faces[index] and np.isfinite(outlines_px[index]).all():
                    shown.append((index, outlines_px[index]))
                if not faces[index]:
                    missing.append(NotSeen(row, name, plate.target.name, "its printed side is turned away"))
                elif not whole[index]:
                    missing.append(NotSeen(row, name, plate.target.name, "not whole in the picture"))
            _refuse_overlap(scene, row, name, shown)
    return missing


def _refuse_overlap(scene: Scene, row: int, camera: str, shown: list[tuple[int, Array]]) -> None:
    for place, (first, outline) in enumerate(shown):
        for second, other in shown[place + 1 :]:
            apart = (
                np.linalg.norm(outline[0] - other[0]) > np.ptp(outline, axis=0).sum() + np.ptp(other, axis=0).sum()
            )
            if not apart and distance_px(outline, other) < _GAP_PX:
                q = ", ".join(f"{value:g}" for value in scene.moments.q_mm[row])
                names = scene.plates[first].target.name, scene.plates[second].target.name
                raise InputFileError(
                    scene.plan.path,
                    f"{names[0]} and {names[1]} overlap in the {camera} picture of frame {row + 1} (x, y, z = {q})",
                    column="targets",
                    remedy="move one of them, park the other axes elsewhere, or look from another side",
                )


def distance_px(first: Array, second: Array) -> float:
    """Give how far two convex polygons (n, 2) are apart along the best separating edge; negative if they overlap."""
    best = -np.inf
    for polygon in (first, second):
        edges = np.roll(polygon, -1, axis=0) - polygon
        normals = np.stack([edges[:, 1], -edges[:, 0]], axis=1)
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        one, two = first @ normals.T, second @ normals.T
        gaps = np.maximum(two.min(axis=0) - one.max(axis=0), one.min(axis=0) - two.max(axis=0))
        best = max(best, float(gaps.max()))
    return best
