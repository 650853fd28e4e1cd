"""Poses of the calibration board: over the whole of both pictures, near and far, tilted every way."""

from __future__ import annotations

import numpy as np

from geoerr.errors import InputFileError
from geoerr.simulate.cameras import StereoPair
from geoerr.simulate.plan import BoardPlan
from geoerr.simulate.render import Sheet
from geoerr.simulate.rotations import Array, looking_along, rotation

_ATTEMPTS = 400
_EDGE_PX = 8.0
# Generalised golden ratio in two dimensions: successive multiples fill a square evenly (Roberts' R2 sequence).
_R2 = np.array([0.7548776662466927, 0.5698402909980532])


def board_sheets(plan: BoardPlan, rig: StereoPair, up: Array, path: str, rng: np.random.Generator) -> list[Sheet]:
    """Draw the board's poses.

    The board's middle goes evenly over the picture of the left and of the right camera by turns, at distances evenly
    spread; its tilt is drawn up to the largest one, in any direction. A pose counts if both cameras see enough
    corners.

    Raises
    ------
    InputFileError
        if no pose is found for a view: the board does not fit into the pictures at these distances.
    """
    pattern = plan.board.pattern.with_margin(plan.margin_mm)
    middle_mm = 0.5 * np.array([plan.board.pattern.width_mm, plan.board.pattern.height_mm, 0.0])
    near_mm, far_mm = plan.depth_mm
    sheets = []
    for view in range(plan.views):
        camera = (rig.left, rig.right)[view % 2]
        # Distances interleaved, so that neighbours in the picture differ in depth.
        depth_mm = near_mm + (far_mm - near_mm) * ((view * 0.6180339887498949 + 0.5) % 1.0)
        for attempt in range(_ATTEMPTS):
            spread = (0.5 + (view + 1) * _R2) % 1.0
            # A pose that does not fit is tried again elsewhere, ever nearer to the middle of the picture.
            shrink = 1.0 - attempt / _ATTEMPTS
            spread = 0.5 + (spread - 0.5 + 0.1 * rng.uniform(-1.0, 1.0, 2)) * shrink
            pixel = spread * (np.array(camera.size_px) - 1.0)
            centre_mm = _at_distance(camera.ideal(pixel[0], pixel[1]), depth_mm)
            centre_mm = camera.centre_mm + camera.camera_from_base.T @ centre_mm
            tilt = np.deg2rad(plan.max_tilt_deg) * np.sqrt(rng.uniform(0.05, 1.0))
            # Every other pair of views upright, the next on its side: focal lengths and pixels' shape separate.
            around, roll = rng.uniform(0.0, 2.0 * np.pi), rng.normal(0.0, 0.2) + 0.5 * np.pi * (view // 2 % 2)
            turn = rotation(tilt * np.array([np.cos(around), np.sin(around), 0.0])) @ rotation(
                np.array([0.0, 0.0, roll])
            )
            base_from_board = looking_along(centre_mm - rig.middle_mm, up) @ turn
            sheet = Sheet(pattern, base_from_board, centre_mm - base_from_board @ middle_mm)
            if _seen(sheet, plan.board.corners_mm, rig) >= plan.least_seen:
                sheets.append(sheet)
                break
        else:
            raise InputFileError(
                path,
                f"the board does not fit into both pictures at {near_mm:g} to {far_mm:g} mm",
                column="board",
                remedy="take a smaller board, larger distances (depth_mm), or let the cameras converge",
            )
    return sheets


def _at_distance(ideal: tuple[Array, Array, Array], distance_mm: float) -> Array:
    ray = np.array([float(ideal[0]), float(ideal[1]), 1.0])
    return np.asarray(ray * (distance_mm / np.linalg.norm(ray)))


def _seen(sheet: Sheet, corners_mm: Array, rig: StereoPair) -> float:
    """Give the smaller of both cameras' shares of corners in the picture."""
    shares = []
    for camera in rig.cameras.values():
        pixels = camera.project(sheet.place_mm(corners_mm))
        shares.append(float(camera.sees(pixels, _EDGE_PX).mean()) if sheet.faces(camera) else 0.0)
    return min(shares)
