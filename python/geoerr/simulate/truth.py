"""What was put into a simulation: the 21 errors in the gauge, hidden effects, and the camera pair."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from geoerr.error_functions import (
    LI_SQUARENESS,
    LINEAR_AND_ANGULAR,
    ErrorFunction,
    ErrorFunctions,
    Squareness,
    write_errors,
)
from geoerr.machine import AXES
from geoerr.simulate.effects import HiddenEffect
from geoerr.simulate.moments import measured_positions
from geoerr.simulate.scene import Scene
from geoerr.simulate.visibility import NotSeen, look_around

_NOTE = (
    "positioning and angles are 0 at the first point of the measured range; straightness has no least-squares slope "
    "over a uniform grid of the range, tables being polygons, and is 0 at the first point; slopes are in squareness; "
    "given at the commanded positions of the passes that move the axis"
)
_NOTE_NOT_MOVED = "no pass moves axis {axis}: its gauge is that of its whole range"


@dataclass(frozen=True)
class Truth:
    """The truth of a simulation; see truth.json.

    Attributes
    ----------
    errors
        The 21 in the gauge (see `gauge`), method `truth`; `extra` holds `hidden` and `rig`.
    hidden
        What acts besides.
    rig
        The camera pair in the form of rig.json, and `base_from_left`.
    n_frames, n_board_views
        Stereo pairs of the machine and of the calibration board.
    not_seen
        Plates that a camera does not see whole.
    """

    errors: ErrorFunctions
    hidden: tuple[HiddenEffect, ...]
    rig: dict[str, Any]
    n_frames: int
    n_board_views: int
    not_seen: tuple[NotSeen, ...]

    def write(self, path: str | Path) -> None:
        """Write truth.json, whole or not at all."""
        write_errors(path, self.errors)


def truth_of(scene: Scene) -> Truth:
    """Work out the truth of a scene.

    Raises
    ------
    InputFileError
        if plates hide each other.
    """
    gauged = scene.gauged.errors
    notes = [_NOTE]
    functions: dict[str, ErrorFunction] = {}
    for index, axis in enumerate(AXES):
        position_mm = scene.positions_mm[axis]
        if len(measured_positions(scene.moments, index)) < 2:
            notes.append(_NOTE_NOT_MOVED.format(axis=axis))
        for name in LINEAR_AND_ANGULAR:
            if name.endswith(axis.upper()):
                functions[name] = ErrorFunction(position_mm, gauged.functions[name](position_mm))
    squareness = {
        iso_name: Squareness(sign * gauged.included_angle_rad[li_name])
        for iso_name, (li_name, sign) in LI_SQUARENESS.items()
    }
    rig = _rig_document(scene)
    hidden = scene.plan.hidden
    errors = ErrorFunctions(
        machine=scene.plan.machine,
        functions=functions,
        squareness=squareness,
        method="truth",
        notes=tuple(notes),
        extra={
            "hidden": [
                {"effect": item.effect, "axis": item.axis, "covariate": item.covariate, "parameters": item.parameters}
                for item in hidden
            ],
            "rig": rig,
        },
    )
    n_board_views = scene.plan.board.views if scene.plan.board is not None else 0
    return Truth(errors, hidden, rig, len(scene), n_board_views, tuple(look_around(scene)))


def _rig_document(scene: Scene) -> dict[str, Any]:
    rig = scene.rig
    turn, shift_mm = rig.right_from_left
    document: dict[str, Any] = {}
    for name, camera in rig.cameras.items():
        document[f"K_{name}"] = camera.matrix.tolist()
        document[f"dist_{name}"] = list(camera.distortion)
    return {
        **document,
        "right_from_left": {"R": turn.tolist(), "t_mm": shift_mm.tolist()},
        "image_size": list(rig.left.size_px),
        "base_from_left": {"R": rig.left.camera_from_base.T.tolist(), "t_mm": rig.left.centre_mm.tolist()},
    }
