"""Pictures of a plan, one after another, in memory: frames of the machine and views of the calibration board."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from geoerr.errors import InputFileError
from geoerr.machine import AXES
from geoerr.simulate.boards import board_sheets
from geoerr.simulate.cameras import StereoPair
from geoerr.simulate.plan import Plan
from geoerr.simulate.render import Sheet, expose, illumination, paint
from geoerr.simulate.rotations import Array
from geoerr.simulate.scene import STREAM_BOARD, STREAM_CALIBRATION, STREAM_FRAMES, Scene, seed_of

Image = npt.NDArray[np.uint8]
SIDES = ("left", "right")


@dataclass(frozen=True)
class FrameRow:
    """One moment: its number, and its row of frames.csv."""

    index: int
    columns: dict[str, str | int | float]


class Studio:
    """A scene with its light: what is needed again for every picture is made once. Safe to use from many threads."""

    def __init__(self, plan: Plan) -> None:
        self.scene = Scene(plan)
        self.plan = plan
        self._brightness = illumination(plan.rig.size_px, plan.light)
        self._background = self._brightness * np.float32(plan.light.background_grey)
        self.boards: list[Sheet] = []
        if plan.board is not None:
            rng = np.random.default_rng(seed_of(plan.seed, STREAM_BOARD))
            self.boards = board_sheets(plan.board, self.scene.rig, np.array(plan.rig.up), plan.path, rng)

    def frame(self, index: int, side: str) -> Image:
        """Photograph the machine at one moment with one camera."""
        sheets = self.scene.sheets(index)
        return self._photograph(self.scene.rig_at(index), side, sheets, (STREAM_FRAMES, index))

    def board_view(self, view: int, side: str) -> Image:
        """Photograph the calibration board with one camera."""
        return self._photograph(self.scene.rig, side, [self.boards[view]], (STREAM_CALIBRATION, view))

    def row(self, index: int) -> FrameRow:
        """Give a moment's row of frames.csv."""
        moments = self.scene.moments
        columns: dict[str, str | int | float] = {side: f"frames/{side}/{index + 1:04d}.png" for side in SIDES}
        columns["line"] = moments.line[index]
        columns["repeat"] = int(moments.repeat[index])
        columns |= {axis: float(value) for axis, value in zip(AXES, moments.q_mm[index], strict=True)}
        columns |= {f"dir_{axis}": int(value) for axis, value in zip(AXES, moments.direction[index], strict=True)}
        columns["t"] = float(moments.t_s[index])
        columns |= {name: float(values[index]) for name, values in moments.covariates.items()}
        return FrameRow(index, columns)

    def _photograph(self, rig: StereoPair, side: str, sheets: list[Sheet], key: tuple[int, int]) -> Image:
        camera = rig.cameras[side]
        picture = self._background.copy()
        # Far ones first, should plates ever overlap.
        for sheet in sorted(sheets, key=lambda item: -float(np.linalg.norm(item.origin_mm - camera.centre_mm))):
            paint(picture, camera, sheet, self.plan.light, self._brightness)
        return expose(picture, self.plan.light.noise_grey, seed_of(self.plan.seed, *key, SIDES.index(side)))


def frames(plan: Plan) -> Iterator[tuple[FrameRow, Image, Image]]:
    """Give row, left and right picture of every moment, one at a time: large studies need no disk.

    Raises
    ------
    InputFileError
        for a plan without passes or targets.
    """
    studio = Studio(plan)
    check_complete(plan)
    for index in range(len(studio.scene)):
        yield studio.row(index), studio.frame(index, "left"), studio.frame(index, "right")


def board_views(plan: Plan) -> Iterator[tuple[Image, Image]]:
    """Give left and right picture of every view of the calibration board, one at a time."""
    studio = Studio(plan)
    for view in range(len(studio.boards)):
        yield studio.board_view(view, "left"), studio.board_view(view, "right")


def true_pixels(plan: Plan | Scene, row: int) -> dict[tuple[str, int], dict[str, Array]]:
    """Give the exact pixels of every target's corners at one moment.

    Parameters
    ----------
    plan
        A plan, or its scene where many rows are wanted.
    row
        Number of the moment, from 0 (`FrameRow.index`).

    Returns
    -------
    dict
        (dictionary, id) to `left` and `right`, each (4, 2): upper left, upper right, lower right, lower left corner
        as one looks at the upright marker; NaN where a corner cannot be seen.
    """
    scene = plan if isinstance(plan, Scene) else Scene(plan)
    corners_mm = scene.corners_mm(row)
    cameras = scene.rig_at(row).cameras
    return {
        (plate.target.dictionary, plate.target.id): {
            name: camera.project(corners) for name, camera in cameras.items()
        }
        for plate, corners in zip(scene.plates, corners_mm, strict=True)
    }


def true_board_pixels(plan: Plan, view: int) -> dict[str, Array]:
    """Give the exact pixels of the board's inner corners in one view: `left` and `right`, each (n, 2)."""
    studio = Studio(plan)
    if plan.board is None:
        raise InputFileError(plan.path, "the plan has no board", column="board")
    corners_mm = studio.boards[view].place_mm(plan.board.board.corners_mm)
    return {name: camera.project(corners_mm) for name, camera in studio.scene.rig.cameras.items()}


def true_centres_mm(plan: Plan | Scene, row: int) -> dict[tuple[str, int], Array]:
    """Give the exact centres (3,) of all targets at one moment, in the left camera's frame."""
    scene = plan if isinstance(plan, Scene) else Scene(plan)
    left = scene.rig_at(row).left
    return {
        (plate.target.dictionary, plate.target.id): left.in_camera_mm(corners.mean(axis=0))
        for plate, corners in zip(scene.plates, scene.corners_mm(row), strict=True)
    }


def check_complete(plan: Plan) -> None:
    """Refuse a plan in which there is nothing to photograph."""
    for name, parts, remedy in (
        ("targets", plan.targets, "add [[targets]] with id, size_mm, carrier and offset_mm"),
        ("passes", plan.passes, "add [[passes]] with axis and count"),
    ):
        if not parts:
            raise InputFileError(plan.path, "there are none", column=name, remedy=remedy)
