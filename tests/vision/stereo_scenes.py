"""A camera pair and sessions photographed with it, by the brute-force renderer."""

from __future__ import annotations

import numpy as np
import tomli_w
from rendering import Lens, as_picture, marker_plate, render, turned

from geoerr.vision.images import write_png
from geoerr.vision.patterns import marker_bits
from geoerr.vision.rig import Rig, RightFromLeft, write_rig

SIZE = (640, 480)
# Depth 700 mm: a plate of 56 mm is about 80 px wide.
LEFT = Lens(1000.0, 1003.0, 318.0, 243.0, -0.08, 0.09, 4e-4, -3e-4)
RIGHT = Lens(1005.0, 1004.0, 322.0, 238.0, -0.07, 0.08, -2e-4, 5e-4)
ROTATION = turned(0.3, 16.0, -0.2)
SHIFT = np.array([-200.0, 1.5, 30.0])
TARGETS = (
    {"id": 7, "dictionary": "DICT_4X4_50", "size_mm": 56.0, "carrier": "tool", "offset_mm": [0.0, 0.0, 0.0]},
    {"id": 9, "dictionary": "DICT_4X4_50", "size_mm": 45.0, "carrier": "work", "offset_mm": [70.0, 0.0, 10.0]},
)


def rig(covariance=None):
    return Rig(
        LEFT.matrix,
        LEFT.distortion,
        RIGHT.matrix,
        RIGHT.distortion,
        RightFromLeft(ROTATION, SHIFT),
        SIZE,
        covariance,
    )


def rig_covariance():
    """Standard uncertainties as a good calibration gives them, uncorrelated."""
    camera = [0.05, 0.05, 0.05, 0.05, 2e-4, 5e-4, 2e-5, 2e-5, 1e-9]
    return np.diag(np.array([*camera, *camera, 3e-5, 3e-5, 3e-5, 0.01, 0.01, 0.01])) ** 2


def right_of(points):
    return points @ ROTATION.T + SHIFT


def plates_at(step, targets=TARGETS):
    """Both plates of frame `step` (moved by 12 mm a step) in the left camera's frame, and their centres."""
    plates, centres = [], []
    for index, target in enumerate(targets):
        centre = np.array([-30.0 + 95.0 * index + 12.0 * step, -20.0 + 8.0 * index - 3.0 * step, 700.0 - 6.0 * step])
        rotation = turned(8.0 + 5 * index, -12.0, 4.0 - 10 * index)
        plates.append(
            marker_plate(marker_bits(target["dictionary"], target["id"]), target["size_mm"], rotation, centre)
        )
        centres.append(centre)
    return plates, np.array(centres)


def photograph(plates, rng, noise=1.5, samples=3):
    """Both pictures."""
    light = {"blur_px": 0.8, "samples": samples, "background": 110.0, "margin_mm": 8.0}
    left = render(plates, LEFT, SIZE, **light)
    right = render([plate.seen_from(ROTATION, SHIFT) for plate in plates], RIGHT, SIZE, **light)
    return as_picture(left, rng, noise), as_picture(right, rng, noise)


def make_session(folder, n_frames=5, seed=1, targets=TARGETS):
    """Write session.toml, frames.csv, pictures and rig.json; give the true centres (n_frames, n_targets, 3)."""
    rng = np.random.default_rng(seed)
    (folder / "left").mkdir(parents=True)
    (folder / "right").mkdir()
    lines, truth = ["left,right,line,x,y,z,load,t"], []
    for step in range(n_frames):
        plates, centres = plates_at(step, targets)
        for side, picture in zip(("left", "right"), photograph(plates, rng), strict=True):
            write_png(folder / side / f"{step}.png", picture)
        lines.append(
            f"left/{step}.png,right/{step}.png,X,{12.0 * step},0,0,{'' if step == 1 else 0.5 * step},{4 * step}"
        )
        truth.append(centres)
    (folder / "frames.csv").write_text("\n".join(lines) + "\n")
    (folder / "session.toml").write_text(tomli_w.dumps({"targets": list(targets)}))
    write_rig(folder / "rig.json", rig(rig_covariance()))
    return np.array(truth)
