"""A marker in a full picture to its four corners: found and fitted, beside OpenCV on the same pictures.

Pictures of 2448 × 2048 px are drawn by the virtual cameras, whose exact corners are known; the marker is 130 px wide.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import cv2
import numpy as np
import numpy.typing as npt
from race import Reached, race, table

from geoerr.simulate.pictures import frames, true_pixels
from geoerr.simulate.plan import plan_from_document
from geoerr.simulate.scene import Scene
from geoerr.vision.camera import Camera
from geoerr.vision.markers import find_markers, refine_marker
from geoerr.vision.patterns import opencv_dictionary

Array = npt.NDArray[np.float64]
Picture = npt.NDArray[np.uint8]

KEY = ("DICT_4X4_50", 3)
AIM_TIMES = 10.0
OURS = "geoerr, found and fitted"
FITTED = "geoerr, fitted where it was found"
WHOLE_SUBPIX = "cv2 ArUco, CORNER_REFINE_SUBPIX"
IN_THE_WAY = (
    "The search is OpenCV's own, on the picture at half its size; the fit of all pixels near edges is what remains. "
    "Where the last frame and the commanded motion say where a marker is, is not used yet."
)
PLAN = {
    "seed": 4,
    "machine": {"name": "bench", "chain": "wZbXYt"},
    "axes": {axis: {"range": [0.0, 100.0]} for axis in "xyz"},
    "rig": {"middle_mm": [50.0, -600.0, 300.0], "look_at_mm": [80.0, 0.0, 0.0], "baseline_mm": 200.0},
    "noise": {"grey": 2.0},
    "targets": [{"id": KEY[1], "size_mm": 38.0, "carrier": "tool", "offset_mm": [0.0, 0.0, 60.0], "roll_deg": 7.0}],
    "passes": [{"axis": "x", "count": 8}],
}


def by_opencv(picture: Picture, method: int) -> Array:
    """Detect on the whole picture."""
    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = method
    found, _, _ = cv2.aruco.ArucoDetector(opencv_dictionary(KEY[0]), parameters).detectMarkers(picture)
    return np.asarray(found[0], dtype=np.float64).reshape(4, 2)


def fitted(picture: Picture, camera: Camera, start: Array | None = None) -> Array:
    """Find and fit, or fit from a start."""
    corners = find_markers(picture, [KEY]).corners_px[KEY] if start is None else start
    return refine_marker(picture, camera, KEY, corners).corners_px


def measure(seconds: float) -> tuple[str, list[Reached]]:
    """Give the text of the results and rows for the summary."""
    cv2.setNumThreads(1)
    plan = plan_from_document(PLAN, "plan.toml")
    scene = Scene(plan)
    lens = scene.rig.cameras["left"]
    camera = Camera(lens.matrix, np.asarray(lens.distortion))
    pictures = [left for _, left, _ in frames(plan)]
    truth = [true_pixels(scene, row)[KEY]["left"] for row in range(len(pictures))]
    starts = [find_markers(picture, [KEY]).corners_px[KEY] for picture in pictures]

    works: dict[str, Callable[[int], Array]] = {
        OURS: lambda row: fitted(pictures[row], camera),
        FITTED: lambda row: fitted(pictures[row], camera, starts[row]),
        WHOLE_SUBPIX: lambda row: by_opencv(pictures[row], cv2.aruco.CORNER_REFINE_SUBPIX),
        "cv2 ArUco, no refinement": lambda row: by_opencv(pictures[row], cv2.aruco.CORNER_REFINE_NONE),
    }
    errors = {
        name: float(np.sqrt(np.mean([np.sum((work(row) - truth[row]) ** 2, axis=1) for row in range(len(pictures))])))
        for name, work in works.items()
    }
    found = race({name: partial(work, 0) for name, work in works.items()}, seconds)
    body = [
        [name, f"{1e3 * value:.1f}", f"{value / found[OURS]:.2f}", f"{errors[name]:.4f}"]
        for name, value in sorted(found.items(), key=lambda item: item[1])
    ]
    heads = ["path", "CPU ms a picture", "time, geoerr = 1", "corner error, rms px"]
    times = found[WHOLE_SUBPIX] / found[OURS]
    row = Reached(
        path="markers: picture of 2448 × 2048 px to corners",
        reached=f"{1e3 * found[OURS]:.1f} ms a picture",
        aim=f"{1e3 * found[WHOLE_SUBPIX] / AIM_TIMES:.1f}",
        share_of_aim=times / AIM_TIMES,
        accuracy=f"{errors[OURS]:.4f} px rms; OpenCV {errors[WHOLE_SUBPIX]:.3f}",
        peer=f"{WHOLE_SUBPIX}: {1e3 * found[WHOLE_SUBPIX]:.0f} ms",
        times_peer=times,
        in_the_way=IN_THE_WAY,
    )
    size = np.linalg.norm(np.diff(truth[0], axis=0), axis=1).mean()
    note = (
        f"One marker, {size:.0f} px wide, no lens distortion, noise of 2 grey levels, {len(pictures)} pictures.\n\n"
    )
    return note + table(heads, body), [row]
