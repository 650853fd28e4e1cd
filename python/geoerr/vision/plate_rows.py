"""Plates as they come from the frames, gathered so that memory does not grow with the pictures."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from geoerr.vision.frame import FrameResult, Missed, SeenTarget
from geoerr.vision.plate import SeenPlates, locate_plates
from geoerr.vision.rig import Rig
from geoerr.vision.sensitivity import project_to_both

Array = npt.NDArray[np.float64]

# Frames whose corners are held at once before they become points.
_FRAMES_AT_A_TIME = 128
# Plates that the pooled checks look at; more would tell nothing new and cost memory.
_POOLED_PLATES = 4000


@dataclass(frozen=True)
class PlateRows:
    """Plates of one block of frames as columns; the first axis is the plate."""

    row: npt.NDArray[np.int64]
    target: npt.NDArray[np.int64]
    centre_mm: Array
    covariance_mm2: Array
    sides_mm: Array
    side_std_mm: Array
    side_px: Array
    along: Array
    pixel: Array
    centre_seen_px: Array
    reprojection_px: Array
    chi: Array
    is_photometric: npt.NDArray[np.bool_]
    misfit: Array
    unevenness: Array
    why: npt.NDArray[np.object_]


class Collector:
    """Plates as they come; corners become points block by block, so that memory does not grow with them."""

    def __init__(self, rig: Rig, threads: int, most_plates: int) -> None:
        self.rig = rig
        self.threads = threads
        self.every = 1 + most_plates // _POOLED_PLATES
        self.missed: list[Missed] = []
        self.blocks: list[PlateRows] = []
        self.pooled: list[tuple[int, Array, Array]] = []
        self.digests: dict[int, int] = {}
        self.twice: list[tuple[int, int]] = []
        self.n_found = 0
        self.n_readable = 0
        self._waiting: list[SeenTarget] = []
        self._frames_waiting = 0
        self._n_plates = 0

    def add(self, row: int, result: FrameResult) -> None:
        """Take in the frame of a row; frames come in order."""
        self.missed.extend(result.missed)
        self.n_found += result.n_found
        self.n_readable += result.readable
        if result.digest is not None:
            self.digests[row] = result.digest
        self.twice.extend((row, target) for target in sorted(result.repeated))
        self._waiting.extend(result.seen)
        self._frames_waiting += 1
        if self._frames_waiting >= _FRAMES_AT_A_TIME:
            self.locate()

    def locate(self) -> None:
        """Turn the corners that wait into points."""
        seen, self._waiting, self._frames_waiting = self._waiting, [], 0
        if not seen:
            return
        corners = SeenPlates(
            np.stack([item.left.corners_px for item in seen]),
            np.stack([item.left.covariance_px2 for item in seen]),
            np.stack([item.right.corners_px for item in seen]),
            np.stack([item.right.covariance_px2 for item in seen]),
        )
        plates = locate_plates(self.rig, corners, self.threads)
        for index in range(len(seen)):
            if (self._n_plates + index) % self.every == 0:
                # Copied: a view would keep the whole block's.
                residual, by_rig = plates.whitened_residual[index].copy(), plates.whitened_by_rig[index].copy()
                self.pooled.append((self._n_plates + index, residual, by_rig))
        self._n_plates += len(seen)
        self.blocks.append(
            PlateRows(
                row=np.array([item.row for item in seen]),
                target=np.array([item.target for item in seen]),
                centre_mm=plates.centre_mm,
                covariance_mm2=plates.covariance_mm2,
                sides_mm=plates.sides_mm,
                side_std_mm=plates.side_std_mm,
                side_px=_sides_seen(corners),
                along=plates.along,
                pixel=project_to_both(self.rig, plates.centre_mm).pixel,
                centre_seen_px=_centres_seen(self.rig, corners),
                reprojection_px=plates.reprojection_px,
                chi=np.sqrt((plates.whitened_residual**2).mean(axis=1)),
                is_photometric=np.array(
                    [item.left.method == item.right.method == "photometric" for item in seen], dtype=bool
                ),
                misfit=np.array([max(item.left.misfit, item.right.misfit) for item in seen]),
                unevenness=np.array([max(item.left.unevenness, item.right.unevenness) for item in seen]),
                why=np.array(plates.why, dtype=object),
            )
        )

    def rows(self) -> PlateRows:
        """All blocks in one."""
        names = PlateRows.__dataclass_fields__
        return PlateRows(**{name: np.concatenate([getattr(block, name) for block in self.blocks]) for name in names})


def _sides_seen(corners: SeenPlates) -> Array:
    """(n,) px from corner to corner, mean of the four sides in both pictures."""
    seen = np.stack([corners.left_px, corners.right_px], axis=1)
    lengths: Array = np.linalg.norm(seen - np.roll(seen, -1, axis=2), axis=3)
    mean: Array = lengths.mean(axis=(1, 2))
    return mean


def _centres_seen(rig: Rig, corners: SeenPlates) -> Array:
    """(n, 4) distorted pixels of the middle of the corners in either picture, without the rig's pose."""
    result = np.empty((len(corners.left_px), 4))
    sides = ((rig.left, corners.left_px), (rig.right, corners.right_px))
    for view, (camera, straight) in enumerate(sides):
        rays = (straight.mean(axis=1) - camera.principal_point_px) / camera.focal_px
        result[:, 2 * view : 2 * view + 2] = camera.pixel_from_normalised(rays)
    return result
