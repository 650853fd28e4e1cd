"""A marker in a full picture to its four corners: expected or found, and fitted, beside OpenCV on the same pictures.

Pictures of 2448 × 2048 px are drawn by the virtual cameras, whose exact corners are known; the marker is 130 px wide.
Every other frame is searched and tells where the marker is in the rest, which are measured.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import cv2
import numpy as np
import numpy.typing as npt
import polars as pl
from race import Reached, race, seconds_of_products, table

from geoerr.simulate.pictures import frames, true_pixels
from geoerr.simulate.plan import plan_from_document
from geoerr.simulate.scene import Scene
from geoerr.vision.camera import Camera
from geoerr.vision.expected import expected_places
from geoerr.vision.frame import FrameResult, SeenTarget
from geoerr.vision.marker_fit import MarkerFit
from geoerr.vision.markers import find_markers, reads_as, refine_marker
from geoerr.vision.patterns import opencv_dictionary
from geoerr.vision.rig import Rig, RightFromLeft

Array = npt.NDArray[np.float64]
Picture = npt.NDArray[np.uint8]

KEY = ("DICT_4X4_50", 3)
AIM_TIMES = 10.0
OURS = "geoerr, fitted where it is expected"
FOUND = "geoerr, found and fitted"
WHOLE_SUBPIX = "cv2 ArUco, CORNER_REFINE_SUBPIX"
PATCH_SUBPIX = "cv2 ArUco, CORNER_REFINE_SUBPIX, given a patch of 400 px"
PATCH_PX = 400
IN_THE_WAY = (
    "Nothing is searched: what remains, beside reading the id, is the fit of some 6,000 pixels near edges and 20,000 "
    "between them; the limit is their products in three steps alone, as fast as NumPy multiplies. A quarter "
    "evaluates the model and its 23 derivatives, a sixth multiplies them with each other, a quarter chooses pixels."
)
# What is multiplied at least: at pixels near edges 23 derivatives and what is left, with each other, in each of three
# steps, for no fewer lead from a pixel off to a ten-thousandth; between edges the light's six and the grey, once.
NEAR_EDGES, BETWEEN, LEAST_STEPS = 6_000, 20_000, 3
LEAST_FLOP = 2.0 * (LEAST_STEPS * NEAR_EDGES * 24**2 + BETWEEN * 7**2)
PLAN = {
    "seed": 4,
    "machine": {"name": "bench", "chain": "wZbXYt"},
    "axes": {axis: {"range": [0.0, 100.0]} for axis in "xyz"},
    "rig": {"middle_mm": [50.0, -600.0, 300.0], "look_at_mm": [80.0, 0.0, 0.0], "baseline_mm": 200.0},
    "noise": {"grey": 2.0},
    "targets": [{"id": KEY[1], "size_mm": 38.0, "carrier": "tool", "offset_mm": [0.0, 0.0, 60.0], "roll_deg": 7.0}],
    "passes": [{"axis": "x", "count": 16}],
}


def by_opencv(picture: Picture, method: int) -> Array:
    """Detect on the whole picture."""
    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = method
    found, _, _ = cv2.aruco.ArucoDetector(opencv_dictionary(KEY[0]), parameters).detectMarkers(picture)
    return np.asarray(found[0], dtype=np.float64).reshape(4, 2)


def measure(seconds: float) -> tuple[str, list[Reached]]:
    """Give the text of the results and rows for the summary."""
    cv2.setNumThreads(1)
    plan = plan_from_document(PLAN, "plan.toml")
    scene = Scene(plan)
    pair = scene.rig
    lenses = [(lens.matrix, np.asarray(lens.distortion)) for lens in (pair.left, pair.right)]
    rig = Rig(*lenses[0], *lenses[1], RightFromLeft(*pair.right_from_left), (2448, 2048))
    seen = [(left, right) for _, left, right in frames(plan)]
    learnt = {row: FrameResult((_searched(rig, row, seen[row]),), (), True, 2) for row in range(0, len(seen), 2)}
    still = np.zeros(len(seen))
    positions = pl.DataFrame({"x": np.linspace(0.0, 100.0, len(seen)), "y": still, "z": still})
    expected = expected_places(rig, positions, learnt)
    rows = range(1, len(seen), 2)
    pictures = {row: seen[row][0] for row in rows}
    truth = {row: true_pixels(scene, row)[KEY]["left"] for row in rows}

    def where_expected(row: int) -> Array:
        places = expected.corners_px(row, 0)
        assert places is not None
        if not reads_as(pictures[row], KEY, places[0]):
            raise SystemExit(f"marker {KEY} cannot be read where it is expected in picture {row}")
        return refine_marker(pictures[row], rig.left, KEY, places[0]).corners_px

    works: dict[str, Callable[[int], Array]] = {
        OURS: where_expected,
        FOUND: lambda row: _found(rig.left, pictures[row]).corners_px,
        WHOLE_SUBPIX: lambda row: by_opencv(pictures[row], cv2.aruco.CORNER_REFINE_SUBPIX),
        "cv2 ArUco, no refinement": lambda row: by_opencv(pictures[row], cv2.aruco.CORNER_REFINE_NONE),
    }

    def in_patch(row: int) -> Array:
        x, y = (int(place) - PATCH_PX // 2 for place in truth[row].mean(axis=0))
        patch = np.ascontiguousarray(pictures[row][y : y + PATCH_PX, x : x + PATCH_PX])
        return by_opencv(patch, cv2.aruco.CORNER_REFINE_SUBPIX) + np.array([x, y])

    works[PATCH_SUBPIX] = in_patch
    errors = {
        name: float(np.sqrt(np.mean([np.sum((work(row) - truth[row]) ** 2, axis=1) for row in rows])))
        for name, work in works.items()
    }
    found = race({name: partial(work, rows[0]) for name, work in works.items()}, seconds)
    body = [
        [name, f"{1e3 * value:.1f}", f"{value / found[OURS]:.2f}", f"{errors[name]:.4f}"]
        for name, value in sorted(found.items(), key=lambda item: item[1])
    ]
    heads = ["path", "CPU ms a picture", "time, geoerr = 1", "corner error, rms px"]
    times, least_s = found[WHOLE_SUBPIX] / found[OURS], seconds_of_products(LEAST_FLOP)
    row = Reached(
        path="markers: picture of 2448 × 2048 px to corners",
        reached=f"{1e3 * found[OURS]:.1f} ms a picture",
        aim=f"{1e3 * found[WHOLE_SUBPIX] / AIM_TIMES:.1f}",
        share_of_aim=times / AIM_TIMES,
        accuracy=f"{errors[OURS]:.4f} px rms; OpenCV {errors[WHOLE_SUBPIX]:.3f}",
        peer=f"{WHOLE_SUBPIX}: {1e3 * found[WHOLE_SUBPIX]:.0f} ms",
        times_peer=times,
        share_of_limit=least_s / found[OURS],
        in_the_way=IN_THE_WAY,
    )
    size = np.linalg.norm(np.diff(truth[rows[0]], axis=0), axis=1).mean()
    note = (
        f"One marker, {size:.0f} px wide, no lens distortion, noise of 2 grey levels, {len(pictures)} pictures. "
        "Where it is expected is worked out in both pictures, and counted for one; its id is read there.\n\n"
    )
    older = (
        f"\nOpenCV {cv2.__version__} here. An older one, 4.14, took 1.4 ms on such a patch on another machine, where "
        "5.0 took 4.7, at a corner error of 0.13 px, 36 times that of a fit of the whole marker.\n"
    )
    return note + table(heads, body) + older, [row]


def _found(camera: Camera, picture: Picture) -> MarkerFit:
    return refine_marker(picture, camera, KEY, find_markers(picture, [KEY]).corners_px[KEY])


def _searched(rig: Rig, row: int, seen: tuple[Picture, Picture]) -> SeenTarget:
    return SeenTarget(row, 0, _found(rig.left, seen[0]), _found(rig.right, seen[1]))
