"""Views of a board by a known rig, as corners without pictures: for tests of what follows detection."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from geoerr.vision.board_views import BoardView, SeenCorners
from geoerr.vision.camera import project
from geoerr.vision.rig import Rig, RightFromLeft

IMAGE_SIZE = (1224, 1024)


def known_rig() -> Rig:
    return Rig(
        K_left=np.array([[1160.0, 0.0, 615.0], [0.0, 1158.0, 509.0], [0.0, 0.0, 1.0]]),
        dist_left=np.array([-0.098, 0.121, 3.1e-4, -2.2e-4, -0.021]),
        K_right=np.array([[1155.0, 0.0, 609.5], [0.0, 1156.5, 515.0], [0.0, 0.0, 1.0]]),
        dist_right=np.array([-0.101, 0.127, -1.7e-4, 2.9e-4, -0.024]),
        right_from_left=RightFromLeft(
            Rotation.from_rotvec([0.004, 0.28, 0.009]).as_matrix(), np.array([-297.0, -2.8, 42.4])
        ),
        image_size=IMAGE_SIZE,
    )


def board_mm(columns: int = 9, rows: int = 6, square_mm: float = 30.0) -> np.ndarray:
    u, v = np.meshgrid(np.arange(columns, dtype=float), np.arange(rows, dtype=float))
    return np.column_stack([u.ravel(), v.ravel(), np.zeros(u.size)]) * square_mm


def board_poses(n_views: int, rng: np.random.Generator, tilt_rad: float = 0.6) -> list[tuple[np.ndarray, np.ndarray]]:
    """Draw poses around the point that both cameras look at: turn and place of the board's middle."""
    poses = []
    for _ in range(n_views):
        axis = rng.normal(size=2)
        tilt = np.append(axis / np.linalg.norm(axis), 0.0) * tilt_rad * rng.uniform(0.5, 1.0)
        turn = Rotation.from_rotvec(tilt) * Rotation.from_rotvec([0.0, 0.14, 0.4 * rng.normal()])
        place = np.array([rng.uniform(-170, 100), rng.uniform(-160, 160), rng.uniform(780, 1150)])
        poses.append((turn.as_matrix(), place))
    return poses


def seen_by(rig: Rig, corners_mm: np.ndarray, pose: tuple[np.ndarray, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """True pixels of the corners in both cameras; the pose is that of the board's middle."""
    turn, place = pose
    left_mm = (corners_mm - corners_mm.mean(axis=0)) @ turn.T + place
    right_mm = left_mm @ rig.right_from_left.R.T + rig.right_from_left.t_mm
    return project(left_mm, rig.left), project(right_mm, rig.right)


def drawn_views(
    rig: Rig, n_views: int, sigma_px: float, rng: np.random.Generator, corners_mm: np.ndarray | None = None
) -> list[BoardView]:
    corners_mm = board_mm() if corners_mm is None else corners_mm
    views = []
    for number, pose in enumerate(board_poses(n_views, rng)):
        sides = [
            SeenCorners(corners_mm, pixels + rng.normal(0.0, sigma_px, pixels.shape), np.full(len(pixels), sigma_px))
            for pixels in seen_by(rig, corners_mm, pose)
        ]
        views.append(BoardView(f"view {number}", sides[0], sides[1]))
    return views
