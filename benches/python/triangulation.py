"""Two-view triangulation, from pixels in NumPy arrays to points in one, beside its peers."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
from fused_loops import triangulate_loop
from race import Costs, Reached, best_peer, race, rate, table

from geoerr.geometry import triangulate, triangulate_points

Array = npt.NDArray[np.float64]
Pixels = npt.NDArray[Any]
Path = Callable[[Array, Array, Pixels, Pixels], Array]

MAIN_SIZE = 100_000
POINTS = "geoerr, points"
POINTS_SINGLE = "geoerr, points, float32"
COVARIANCE = "geoerr, with covariance, no reweighting"
IN_THE_WAY = {
    POINTS: (
        "Arithmetic: about 60 fused operations and a division, and the laying out of pixels and points by "
        "coordinate (`cargo bench -p geoerr-bench --bench triangulate`, points alone). The rest is the reading and "
        "writing of 56 bytes a point, and the statuses."
    ),
    COVARIANCE: (
        "Two thirds of the time is arithmetic: about 150 fused operations, and divisions that wait for each "
        "other. A sixth is the writing of nine numbers a covariance. Each reweighting adds three divisions and "
        "about 75 operations."
    ),
}
AIM_M_PER_S, AIM_WITH_COVARIANCE_M_PER_S = 250.0, 50.0


def rig(baseline_mm: float, *, is_parallel: bool = False) -> tuple[Array, Array]:
    """Two lenses of 8 mm, pixels of 3.45 µm; the right one is parallel or looks at 600 mm before the left one."""
    k = np.array([[8.0 / 0.00345, 0.0, 1223.5], [0.0, 8.0 / 0.00345, 1023.5], [0.0, 0.0, 1.0]])
    angle = 0.0 if is_parallel else np.arctan2(baseline_mm, 600.0)
    c, s = np.cos(angle), np.sin(angle)
    turn = np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
    pose = np.column_stack([turn, turn @ np.array([-baseline_mm, 0.0, 0.0])])
    return k @ np.eye(3, 4), k @ pose


RIGS = {
    "500 mm": rig(500.0),
    "200 mm": rig(200.0),
    "100 mm": rig(100.0),
    "20 mm": rig(20.0),
    "20 mm, parallel": rig(20.0, is_parallel=True),
    "2 mm, parallel": rig(2.0, is_parallel=True),
}


def pixels(projections: tuple[Array, Array], n_points: int, noise_px: float) -> tuple[Array, Array]:
    """Pixels of points in a volume of 240 × 200 × 160 mm."""
    rng = np.random.default_rng(n_points)
    points = rng.uniform([-120.0, -100.0, 520.0], [120.0, 100.0, 680.0], (n_points, 3))
    seen = []
    for m in projections:
        h = points @ m[:, :3].T + m[:, 3]
        seen.append(h[:, :2] / h[:, 2:] + noise_px * rng.normal(size=(n_points, 2)))
    return seen[0], seen[1]


def rows(left: Array, right: Array, uv_left: Array, uv_right: Array) -> tuple[Array, Array]:
    """Matrices (n, 4, 3) and right sides (n, 4) of a point's least squares, of the pixels' precision."""
    both = ((left, uv_left), (right, uv_right))
    whole = np.stack([uv[:, i, None] * m[2] - m[i] for m, uv in both for i in (0, 1)], axis=1)
    return whole[:, :, :3], -whole[:, :, 3]


def by_numpy_normal_equations(left: Array, right: Array, uv_left: Array, uv_right: Array) -> Array:
    """Solve batched normal equations."""
    a, b = rows(left, right, uv_left, uv_right)
    t = a.transpose(0, 2, 1)
    return np.asarray(np.linalg.solve(t @ a, t @ b[:, :, None])[:, :, 0])


def by_numpy_qr(left: Array, right: Array, uv_left: Array, uv_right: Array) -> Array:
    """Solve by batched QR."""
    a, b = rows(left, right, uv_left, uv_right)
    q, r = np.linalg.qr(a)
    return np.asarray(np.linalg.solve(r, q.transpose(0, 2, 1) @ b[:, :, None])[:, :, 0])


def by_numpy_with_covariance(left: Array, right: Array, uv_left: Array, uv_right: Array) -> Array:
    """Solve batched normal equations, and invert those of the pixels at the point for its covariance at 1 px."""
    p = by_numpy_normal_equations(left, right, uv_left, uv_right)
    jacobian = []
    for m in (left, right):
        h = p @ m[:, :3].T + m[:, 3]
        jacobian += [(m[i, :3] - (h[:, i] / h[:, 2])[:, None] * m[2, :3]) / h[:, 2, None] for i in (0, 1)]
    j = np.stack(jacobian, axis=1)
    np.linalg.inv(j.transpose(0, 2, 1) @ j)
    return p


def by_opencv(left: Array, right: Array, uv_left: Array, uv_right: Array) -> Array:
    """Call OpenCV, and divide."""
    h = cv2.triangulatePoints(left, right, uv_left.T, uv_right.T)
    return np.asarray((h[:3] / h[3]).T)


def alone(left: Array, right: Array, uv_left: Pixels, uv_right: Pixels) -> Array:
    """Call geoerr for points alone."""
    return triangulate_points(left, right, uv_left, uv_right).points_mm


def with_covariance(left: Array, right: Array, uv_left: Array, uv_right: Array, *, reweightings: int) -> Array:
    """Call geoerr for points, covariances and reprojection errors."""
    return triangulate(left, right, uv_left, uv_right, reweightings=reweightings).points_mm


PATHS: dict[str, Path] = {
    POINTS: alone,
    COVARIANCE: partial(with_covariance, reweightings=0),
    "geoerr, with covariance, 1 reweighting": partial(with_covariance, reweightings=1),
    "geoerr, with covariance, 2 reweightings": partial(with_covariance, reweightings=2),
    "NumPy, batched normal equations": by_numpy_normal_equations,
    "NumPy, batched normal equations, with covariance": by_numpy_with_covariance,
    "NumPy, batched QR": by_numpy_qr,
    "cv2.triangulatePoints": by_opencv,
}
if triangulate_loop is not None:
    PATHS["Numba, one loop, normal equations"] = triangulate_loop


def in_long_double(left: Array, right: Array, uv_left: Array, uv_right: Array) -> npt.NDArray[np.longdouble]:
    """Solve in numbers of 64 bits' mantissa, refined once."""
    long = np.longdouble
    a, b = rows(left.astype(long), right.astype(long), uv_left.astype(long), uv_right.astype(long))
    t = a.transpose(0, 2, 1)
    n = t @ a
    cofactors = np.cross(n[:, [1, 2, 0]], n[:, [2, 0, 1]])
    inverse = cofactors / np.sum(n[:, 0] * cofactors[:, 0], axis=1)[:, None, None]
    p = inverse @ (t @ b[:, :, None])
    p += inverse @ (t @ (b[:, :, None] - a @ p))
    return np.asarray(p[:, :, 0])


def errors_mm(n_points: int = 5000) -> dict[str, dict[str, float]]:
    """Give the root mean square distance from the solution in long doubles, for each path and rig."""
    result: dict[str, dict[str, float]] = {}
    for name, projections in RIGS.items():
        uv = pixels(projections, n_points, 0.1)
        for path, work in PATHS.items():
            if "covariance" in path and path != COVARIANCE:
                continue
            # Singular values of all four columns minimise something else: the same point without noise.
            seen = pixels(projections, n_points, 0.0) if work is by_opencv else uv
            expected = in_long_double(*projections, *seen)
            result.setdefault(path, {})[name] = rms(work(*projections, *seen) - expected)
        single = tuple(view.astype(np.float32) for view in uv)
        expected = in_long_double(*projections, *(view.astype(np.float64) for view in single))
        result.setdefault(POINTS_SINGLE, {})[name] = rms(alone(*projections, *single) - expected)
    return result


def rms(difference: npt.NDArray[Any]) -> float:
    """Root mean square length of rows."""
    return float(np.sqrt(np.mean(np.sum(np.asarray(difference, dtype=np.float64) ** 2, axis=1))))


def measure(sizes: tuple[int, ...], seconds: float) -> tuple[str, Costs, list[Reached]]:
    """Give the text of the results, the costs against size, and rows for the summary."""
    cv2.setNumThreads(1)
    costs = Costs("triangulation", "point")
    projections = RIGS["200 mm"]
    at_main: dict[str, float] = {}
    for n_points in sizes:
        uv = pixels(projections, n_points, 0.1)
        single = tuple(view.astype(np.float32) for view in uv)
        source, target = np.ones(n_points * 7 // 2), np.empty(n_points * 7 // 2)
        paths: dict[str, Callable[[], object]] = {
            name: partial(work, *projections, *uv) for name, work in PATHS.items()
        }
        paths[POINTS_SINGLE] = partial(alone, *projections, *single)
        paths["limit: 56 bytes a point copied"] = partial(np.copyto, target, source)
        found = race(paths, seconds)
        costs.add(n_points, found)
        if n_points == MAIN_SIZE:
            at_main = found
    errors = errors_mm()
    qr = errors["NumPy, batched QR"]
    worst = {name: max(error / qr[place] for place, error in each.items()) for name, each in errors.items()}
    limit = at_main["limit: 56 bytes a point copied"]
    body = [
        [
            name,
            rate(MAIN_SIZE, value),
            f"{value / at_main[POINTS]:.2f}",
            f"{limit / value:.1%}",
            f"{worst[name]:.1f}" if name in worst else "",
        ]
        for name, value in sorted(at_main.items(), key=lambda item: item[1])
    ]
    heads = ["path", "M points/s", "time, geoerr's points = 1", "of the limit", "worst error, QR's = 1"]
    accuracy = [[name, *(f"{each[place]:.1e}" for place in RIGS)] for name, each in errors.items()]
    text = (
        f"{MAIN_SIZE:,} pairs of pixels, baseline 200 mm, 0.1 px of noise.\n\n{table(heads, body)}\n"
        "Root mean square distance from the same least squares in long doubles, mm, by rig (OpenCV's, which "
        f"minimises something else, without noise):\n\n{table(['path', *RIGS], accuracy)}"
    )
    summary = []
    for path, aim in ((POINTS, AIM_M_PER_S), (COVARIANCE, AIM_WITH_COVARIANCE_M_PER_S)):
        reached = MAIN_SIZE / at_main[path] / 1e6
        has_covariance = "covariance" in path
        alike = {name: value for name, value in at_main.items() if ("covariance" in name) == has_covariance}
        best = best_peer(alike)
        same_points = best.removesuffix(", with covariance")
        summary.append(
            Reached(
                path=f"triangulation: {path.removeprefix('geoerr, ')}",
                reached=f"{reached:.0f} M points/s",
                aim=f"{aim:.0f}",
                share_of_aim=reached / aim,
                accuracy=f"{worst[path]:.1f} × QR's error at worst; peer {worst[same_points]:.0f} ×",
                peer=f"{best}: {rate(MAIN_SIZE, at_main[best])}",
                times_peer=at_main[best] / at_main[path],
                share_of_limit=limit / at_main[path],
                in_the_way=IN_THE_WAY[path],
            )
        )
    return text, costs, summary
