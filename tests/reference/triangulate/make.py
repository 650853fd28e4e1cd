"""Make `rigs.csv` and `points.csv`: triangulated points in 50 digits, to judge double precision by.

Run it in this folder; it needs mpmath and NumPy (seeded, so the files come out the same).
Every number that the tests read as input is a double written in full, so both sides solve the same problem.
"""

from __future__ import annotations

import csv
from pathlib import Path

import mpmath as mp
import numpy as np

mp.mp.dps = 50
FOCAL_PX = 8.0 / 0.00345
CENTRE_PX = (1223.5, 1023.5)
RANGE_MM = 700.0
POINTS_OF_A_CASE = 40
HERE = Path(__file__).parent


def intrinsics() -> np.ndarray:
    return np.array([[FOCAL_PX, 0.0, CENTRE_PX[0]], [0.0, FOCAL_PX, CENTRE_PX[1]], [0.0, 0.0, 1.0]])


def turn(axis: int, angle: float) -> np.ndarray:
    c, s = np.cos(angle), np.sin(angle)
    matrix = np.eye(3)
    i, j = [k for k in range(3) if k != axis]
    matrix[i, i] = matrix[j, j] = c
    matrix[i, j], matrix[j, i] = -s, s
    return matrix


def pair(baseline_mm: float, *, converging: bool) -> tuple[np.ndarray, np.ndarray]:
    """Give a left camera at the origin and a right one beside it, which looks at (0, 0, RANGE_MM) or parallel."""
    k = intrinsics()
    rotation = turn(1, -np.arctan2(baseline_mm, RANGE_MM)) if converging else np.eye(3)
    left = k @ np.hstack([np.eye(3), np.zeros((3, 1))])
    right = k @ np.hstack([rotation, (rotation @ [-baseline_mm, 0.0, 0.0])[:, None]])
    return left, right


def rigs() -> dict[str, tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Give the projection matrices of each rig and the 4x4 `world_from_left`."""
    world_from_left = np.eye(4)
    world_from_left[:3, :3] = turn(0, 2.1) @ turn(1, 0.3) @ turn(2, -0.7)
    world_from_left[:3, 3] = [310.0, -540.0, 880.0]
    cameras = {
        "converging_200": (*pair(200.0, converging=True), np.eye(4)),
        "parallel_20": (*pair(20.0, converging=False), np.eye(4)),
        "narrow_2": (*pair(2.0, converging=True), np.eye(4)),
    }
    left, right = pair(200.0, converging=True)
    left_from_world = np.linalg.inv(world_from_left)
    # Any scale and sign of a projection matrix is the same camera.
    cameras["moved_200"] = (left @ left_from_world * -0.37, right @ left_from_world * 12.0, world_from_left)
    return cameras


def rows(projection: mp.matrix, uv: np.ndarray) -> tuple[mp.matrix, mp.matrix]:
    """Two rows of A p = B of one view."""
    a, b = mp.matrix(2, 3), mp.matrix(2, 1)
    for i in range(2):
        for j in range(3):
            a[i, j] = mp.mpf(uv[i]) * projection[2, j] - projection[i, j]
        b[i] = projection[i, 3] - mp.mpf(uv[i]) * projection[2, 3]
    return a, b


def normalised(projection: np.ndarray) -> mp.matrix:
    """Scale to a third row of unit length and det > 0: the last coordinate becomes the depth."""
    matrix = mp.matrix(projection.tolist())
    scale = mp.sign(mp.det(matrix[:, :3])) / mp.norm(matrix[2, :3])
    return matrix * scale


def project(projection: mp.matrix, p: mp.matrix) -> mp.matrix:
    h = projection[:, :3] * p + projection[:, 3]
    return mp.matrix([h[0] / h[2], h[1] / h[2]])


def projection_jacobian(projection: mp.matrix, p: mp.matrix) -> mp.matrix:
    h = projection[:, :3] * p + projection[:, 3]
    j = mp.matrix(2, 3)
    for i in range(2):
        for k in range(3):
            j[i, k] = (projection[i, k] - h[i] / h[2] * projection[2, k]) / h[2]
    return j


def stacked(blocks: list[mp.matrix]) -> mp.matrix:
    return mp.matrix([list(block[i, :]) for block in blocks for i in range(block.rows)])


def triangulate(projections: list[mp.matrix], uv: list[np.ndarray], covariances: list[np.ndarray]) -> dict:
    """Plain least squares, two Gauss-Newton steps on the pixels, and the converged pixel minimum."""
    whiteners = [mp.inverse(mp.cholesky(mp.matrix(c.tolist()))) for c in covariances]
    system = [rows(projection, pixel) for projection, pixel in zip(projections, uv, strict=True)]
    a = stacked([w * s[0] for w, s in zip(whiteners, system, strict=True)])
    b = stacked([w * s[1] for w, s in zip(whiteners, system, strict=True)])
    point = mp.qr_solve(a, b)[0]
    found = {"plain": point}

    def linearised(p: mp.matrix) -> tuple[mp.matrix, mp.matrix]:
        pixels = [mp.matrix(pixel.tolist()) for pixel in uv]
        residual = [w * (x - project(m, p)) for w, m, x in zip(whiteners, projections, pixels, strict=True)]
        jacobian = [w * projection_jacobian(m, p) for w, m in zip(whiteners, projections, strict=True)]
        return stacked(jacobian), stacked(residual)

    for step in range(200):
        jacobian, residual = linearised(point)
        change = mp.lu_solve(jacobian.T * jacobian, jacobian.T * residual)
        point = point + change
        if step == 1:
            found["two"] = point
        if step >= 1 and mp.norm(change) < mp.mpf(10) ** -40:
            break
    else:
        raise RuntimeError("the pixel minimum was not reached")
    found["minimum"] = point

    jacobian, _ = linearised(found["two"])
    found["covariance"] = mp.inverse(jacobian.T * jacobian)
    square = sum(
        mp.norm(mp.matrix(pixel.tolist()) - project(m, found["two"])) ** 2
        for m, pixel in zip(projections, uv, strict=True)
    )
    found["reprojection"] = mp.sqrt(square / 2)
    return found


def high_low(value: mp.mpf) -> tuple[float, float]:
    high = float(value)
    return high, float(value - mp.mpf(high))


def main() -> None:
    random = np.random.default_rng(20240607)
    with (HERE / "rigs.csv").open("w", newline="") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(["rig"] + [f"{side}{i}{j}" for side in "lr" for i in range(3) for j in range(4)])
        for name, (left, right, _) in rigs().items():
            writer.writerow([name, *map(repr, map(float, [*left.ravel(), *right.ravel()]))])
    with (HERE / "points.csv").open("w", newline="") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        columns = ["rig", "noise_px", "ul", "vl", "ur", "vr", "l00", "l01", "l11", "r00", "r01", "r11"]
        columns += [
            f"{what}_{axis}_{part}" for what in ("plain", "two") for axis in "xyz" for part in ("high", "low")
        ]
        columns += [f"minimum_{axis}" for axis in "xyz"]
        columns += ["cxx", "cxy", "cxz", "cyy", "cyz", "czz", "reprojection_px"]
        writer.writerow(columns)
        for name, (left, right, world_from_left) in rigs().items():
            projections = [normalised(left), normalised(right)]
            for noise_px in (0.0, 0.1):
                for _ in range(POINTS_OF_A_CASE):
                    in_left = np.append(random.uniform([-140, -110, 600], [140, 110, 800]), 1.0)
                    point = mp.matrix((world_from_left @ in_left)[:3].tolist())
                    sigma = noise_px or 0.1
                    covariances, pixels = [], []
                    for projection in projections:
                        factor = sigma * (np.eye(2) + random.uniform(-0.4, 0.4, (2, 2)))
                        covariance = factor @ factor.T
                        covariance[1, 0] = covariance[0, 1]
                        exact = np.array([float(x) for x in project(projection, point)])
                        covariances.append(covariance)
                        pixels.append(exact + (noise_px > 0) * (factor @ random.standard_normal(2)))
                    found = triangulate(projections, pixels, covariances)
                    numbers = [*pixels[0], *pixels[1]]
                    numbers += [c[i, j] for c in covariances for i, j in ((0, 0), (0, 1), (1, 1))]
                    numbers += [part for what in ("plain", "two") for x in found[what] for part in high_low(x)]
                    numbers += list(found["minimum"])
                    cov = found["covariance"]
                    numbers += [cov[i, j] for i, j in ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))]
                    numbers.append(found["reprojection"])
                    writer.writerow([name, noise_px, *(repr(float(x)) for x in numbers)])


if __name__ == "__main__":
    main()
