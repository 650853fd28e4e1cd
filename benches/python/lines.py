"""Total-least-squares lines, from points in NumPy arrays to centroids, directions and residuals, with their peers."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
import numpy.typing as npt
from fused_loops import fit_lines_loop
from race import Costs, Reached, best_peer, race, rate, table

from geoerr.geometry import fit_lines

Array = npt.NDArray[np.float64]
Lines = tuple[Array, Array, Array]

MAIN_SIZE, POINTS_OF_A_LINE = 10_000, 50
OURS = "geoerr"
OURS_CERTAIN = "geoerr, with covariances"
OURS_ALONG = "geoerr, with covariances and distances along"
AIM_NS = 2.0
IN_THE_WAY = (
    "Called again and again with nothing between, it takes 1.8 ns/point in the median and 1.7 at least, with "
    "covariances 2.1 and 2.0; the sum of the points alone half a nanosecond. It reads points and lays them out by "
    "coordinate, for a third of the time, which waits for memory; sums nine moments, finds chords and solves the "
    "lines."
)


def points(n_lines: int) -> Array:
    """Lines of 200 mm in all directions, 600 mm from the origin, with noise of 10 µm (n, 50, 3)."""
    rng = np.random.default_rng(n_lines)
    direction = rng.normal(size=(n_lines, 1, 3))
    direction /= np.linalg.norm(direction, axis=2, keepdims=True)
    centre = rng.uniform([-100.0, -100.0, 500.0], [100.0, 100.0, 700.0], (n_lines, 1, 3))
    along = np.linspace(-100.0, 100.0, POINTS_OF_A_LINE)[None, :, None]
    return centre + along * direction + rng.normal(0.0, 0.01, (n_lines, POINTS_OF_A_LINE, 3))


def rms(d: Array, direction: Array) -> Array:
    """Root mean square distance of centred points from lines."""
    aside = d - (d @ direction[:, :, None]) * direction[:, None]
    return np.asarray(np.sqrt(np.mean(np.sum(aside**2, axis=2), axis=1)))


def by_svd(p: Array) -> Lines:
    """Batched singular values of the centred points."""
    centroid = p.mean(axis=1)
    d = p - centroid[:, None]
    direction = np.linalg.svd(d, full_matrices=False)[2][:, 0]
    return centroid, direction, rms(d, direction)


def by_eigenvectors(p: Array) -> Lines:
    """Batched eigenvectors of the scatter matrices."""
    centroid = p.mean(axis=1)
    d = p - centroid[:, None]
    direction = np.linalg.eigh(d.transpose(0, 2, 1) @ d)[1][:, :, 2]
    return centroid, direction, rms(d, direction)


def ours(
    p: Array, starts: npt.NDArray[np.int64], *, along: bool = False, direction_covariance: bool = False
) -> Lines:
    """Call geoerr for what its peers give, and for more."""
    found = fit_lines(p.reshape(-1, 3), starts, along=along, direction_covariance=direction_covariance)
    return found.centroid_mm, found.direction, found.rms_mm


def in_long_double(p: Array) -> npt.NDArray[np.longdouble]:
    """Give directions by power steps on scatter matrices in long doubles: each leaves 10⁻⁷ of the error."""
    d = p.astype(np.longdouble)
    d -= d.mean(axis=1)[:, None]
    scatter = np.einsum("lki,lkj->lij", d, d)
    v = by_svd(p)[1].astype(np.longdouble)
    for _ in range(4):
        v = np.einsum("lij,lj->li", scatter, v)
        v /= np.sqrt(np.sum(v**2, axis=1))[:, None]
    return v


def measure(sizes: tuple[int, ...], seconds: float) -> tuple[str, Costs, list[Reached]]:
    """Give the text of the results, the costs against size, and rows for the summary."""
    costs = Costs("lines of 50 points", "point")
    at_main: dict[str, float] = {}
    errors: dict[str, float] = {}
    for n_lines in sizes:
        p = points(n_lines)
        starts = np.arange(n_lines) * POINTS_OF_A_LINE
        paths: dict[str, Callable[[], object]] = {
            OURS: partial(ours, p, starts),
            OURS_CERTAIN: partial(ours, p, starts, direction_covariance=True),
            OURS_ALONG: partial(ours, p, starts, along=True, direction_covariance=True),
            "NumPy, batched SVD": partial(by_svd, p),
            "NumPy, batched scatter and eigenvectors": partial(by_eigenvectors, p),
            "limit: points summed": p.sum,
        }
        if fit_lines_loop is not None:
            paths["Numba, one loop, power iteration"] = partial(fit_lines_loop, p)
        found = race(paths, seconds)
        costs.add(n_lines * POINTS_OF_A_LINE, found)
        if n_lines == MAIN_SIZE:
            at_main = found
            expected = in_long_double(p)
            for name, work in paths.items():
                result = work()
                if isinstance(result, tuple):
                    turned = result[1] * np.sign(np.sum(result[1] * expected, axis=1))[:, None]
                    errors[name] = float(np.sqrt(np.mean(np.sum((turned - expected) ** 2, axis=1))))
    n_points = MAIN_SIZE * POINTS_OF_A_LINE
    limit = at_main["limit: points summed"]
    body = [
        [
            name,
            f"{1e9 * value / n_points:.2f}",
            rate(n_points, value),
            f"{value / at_main[OURS]:.2f}",
            f"{limit / value:.0%}",
            f"{errors[name]:.1e}" if name in errors else "",
        ]
        for name, value in sorted(at_main.items(), key=lambda item: item[1])
    ]
    heads = ["path", "ns/point", "M points/s", "time, geoerr = 1", "of the limit", "direction, rms error, rad"]
    best = best_peer(at_main)
    svd = "NumPy, batched SVD"
    each_ns = 1e9 * at_main[OURS] / n_points
    summary = [
        Reached(
            path=f"lines, {MAIN_SIZE:,} × {POINTS_OF_A_LINE} points",
            reached=f"{each_ns:.2f} ns/point",
            aim=f"{AIM_NS:.0f}",
            share_of_aim=AIM_NS / each_ns,
            accuracy=f"direction {errors[OURS]:.0e} rad; SVD {errors[svd]:.0e}",
            peer=f"{best}: {1e9 * at_main[best] / n_points:.2f}",
            times_peer=at_main[best] / at_main[OURS],
            share_of_limit=limit / at_main[OURS],
            in_the_way=IN_THE_WAY,
        )
    ]
    return f"{MAIN_SIZE:,} lines of {POINTS_OF_A_LINE} points.\n\n{table(heads, body)}", costs, summary
