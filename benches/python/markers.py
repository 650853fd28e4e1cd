"""A marker in a full picture to its four corners: expected or found, and fitted, beside OpenCV on the same pictures.

Pictures of 2448 × 2048 px are drawn by the virtual cameras, whose exact corners are known; the marker is 130 px wide.
Every other frame is searched and tells where the marker is in the rest, which are measured. Behind the plate is a
machine, sheets, rails and cables of any grey, as behind every real one, or nothing at all: whoever searches the
whole picture has to look at every edge in it.
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
IN_A_MACHINE, BEFORE_NOTHING = "in a machine", "before nothing"
N_SHEETS, N_STROKES = 60, 80
GREY_NOISE = 2.0
PLATE_OVER_MARKER = 1.25
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
    "noise": {"grey": GREY_NOISE},
    "targets": [{"id": KEY[1], "size_mm": 38.0, "carrier": "tool", "offset_mm": [0.0, 0.0, 60.0], "roll_deg": 7.0}],
    "passes": [{"axis": "x", "count": 16}],
}


def by_opencv(picture: Picture, method: int) -> Array:
    """Detect on the whole picture."""
    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = method
    found, ids, _ = cv2.aruco.ArucoDetector(opencv_dictionary(KEY[0]), parameters).detectMarkers(picture)
    return np.asarray(found[int(np.flatnonzero(ids.ravel() == KEY[1])[0])], dtype=np.float64).reshape(4, 2)


def machine_behind(shape: tuple[int, int], rng: np.random.Generator) -> npt.NDArray[np.float32]:
    """Draw sheets, and rails and cables across them, (height, width) in grey levels, without noise."""
    height, width = shape
    grey = np.full(shape, 90.0, dtype=np.float32)
    for _ in range(N_SHEETS):
        corners = rng.uniform((0.0, 0.0), (width, height)) + rng.uniform(-200.0, 200.0, (4, 2))
        cv2.fillPoly(grey, [corners.astype(np.int32)], float(rng.uniform(30.0, 180.0)), cv2.LINE_AA)
    for _ in range(N_STROKES):
        begin, end = rng.uniform((0.0, 0.0), (width, height), (2, 2)).astype(int).tolist()
        cv2.line(grey, begin, end, float(rng.uniform(20.0, 210.0)), int(rng.integers(1, 7)), cv2.LINE_AA)
    # As sharp as the lens is.
    return np.asarray(cv2.GaussianBlur(grey, (0, 0), 0.8), dtype=np.float32)


def before_machine(picture: Picture, corners_px: Array, seed: int) -> Picture:
    """Put a machine behind the plate in a picture of nothing else; of the same camera the same one."""
    behind = machine_behind(picture.shape, np.random.default_rng(4))
    noise = np.random.default_rng([4, seed]).standard_normal(picture.shape, dtype=np.float32)
    middle = corners_px.mean(axis=0)
    plate = np.zeros(picture.shape, dtype=np.uint8)
    cv2.fillConvexPoly(plate, np.rint(middle + PLATE_OVER_MARKER * (corners_px - middle)).astype(np.int32), 1)
    drawn = np.clip(np.rint(behind + GREY_NOISE * noise), 0, 255).astype(np.uint8)
    return np.where(plate == 1, picture, drawn)


def measure(seconds: float) -> tuple[str, list[Reached]]:
    """Give the text of the results and rows for the summary."""
    cv2.setNumThreads(1)
    parts, reached = [], []
    for place in (IN_A_MACHINE, BEFORE_NOTHING):
        text, row = _measured(place, seconds)
        parts.append(text)
        reached.append(row)
    note = (
        "One marker, no lens distortion, noise of 2 grey levels. Where it is expected is worked out in both pictures "
        f"and counted for one; its id is read there. Behind its plate is a machine ({N_SHEETS} sheets, {N_STROKES} "
        "rails and cables, drawn by chance), or nothing.\n"
    )
    older = (
        f"\nOpenCV {cv2.__version__} here. An older one, 4.14, took 1.4 ms on such a patch on another machine, where "
        "5.0 took 4.7, at a corner error of 0.13 px, 36 times that of a fit of the whole marker.\n"
    )
    return note + "".join(parts) + older, reached


def _measured(place: str, seconds: float) -> tuple[str, Reached]:
    """Give the table of pictures of one kind, and its row for the summary."""
    plan = plan_from_document(PLAN, "plan.toml")
    scene = Scene(plan)
    pair = scene.rig
    lenses = [(lens.matrix, np.asarray(lens.distortion)) for lens in (pair.left, pair.right)]
    rig = Rig(*lenses[0], *lenses[1], RightFromLeft(*pair.right_from_left), (2448, 2048))
    corners = [true_pixels(scene, row)[KEY] for row in range(len(scene))]
    seen = [(left, right) for _, left, right in frames(plan)]
    if place == IN_A_MACHINE:
        seen = [
            (before_machine(left, at["left"], 2 * row), before_machine(right, at["right"], 2 * row + 1))
            for row, ((left, right), at) in enumerate(zip(seen, corners, strict=True))
        ]
    learnt = {row: FrameResult((_searched(rig, row, seen[row]),), (), True, 2) for row in range(0, len(seen), 2)}
    still = np.zeros(len(seen))
    positions = pl.DataFrame({"x": np.linspace(0.0, 100.0, len(seen)), "y": still, "z": still})
    expected = expected_places(rig, positions, learnt)
    rows = range(1, len(seen), 2)
    pictures = {row: seen[row][0] for row in rows}
    truth = {row: corners[row]["left"] for row in rows}

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
        x, y = (int(middle) - PATCH_PX // 2 for middle in truth[row].mean(axis=0))
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
        path=f"markers, {place}: picture of 2448 × 2048 px to corners",
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
    note = f"\n{place.capitalize()}, {size:.0f} px wide, {len(pictures)} pictures:\n\n"
    return note + table(heads, body), row


def _found(camera: Camera, picture: Picture) -> MarkerFit:
    return refine_marker(picture, camera, KEY, find_markers(picture, [KEY]).corners_px[KEY])


def _searched(rig: Rig, row: int, seen: tuple[Picture, Picture]) -> SeenTarget:
    return SeenTarget(row, 0, _found(rig.left, seen[0]), _found(rig.right, seen[1]))
