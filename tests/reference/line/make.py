"""Make `points.csv` and `lines.csv`: lines by total least squares in 50 digits, to judge double precision by.

Run it in this folder; it needs mpmath and NumPy (seeded, so the files come out the same).
"""

from __future__ import annotations

import csv
from pathlib import Path

import mpmath as mp
import numpy as np

mp.mp.dps = 50
HERE = Path(__file__).parent
LINES_OF_A_KIND = 12


def clouds() -> list[tuple[str, np.ndarray]]:
    """Give point clouds of several kinds, each a seeded double-precision array (n, 3)."""
    random = np.random.default_rng(20240608)
    made = []
    for kind, count, noise_mm, offset_mm in (
        ("measured", 41, 0.01, 0.0),
        ("far", 41, 0.01, 2e4),
        ("straight", 11, 1e-9, 800.0),
        ("pair", 2, 0.0, 300.0),
        ("fat", 9, 80.0, 500.0),
    ):
        for _ in range(LINES_OF_A_KIND):
            direction = random.standard_normal(3)
            direction /= np.linalg.norm(direction)
            along = np.sort(random.uniform(0.0, 400.0, count))
            start = random.uniform(-1.0, 1.0, 3) * offset_mm
            made.append((kind, start + along[:, None] * direction + noise_mm * random.standard_normal((count, 3))))
    return made


def fit(points: np.ndarray) -> dict[str, list[mp.mpf]]:
    """Centroid, direction from the first to the last point, rms, and the three eigenvalues, in 50 digits."""
    exact = [mp.matrix(row) for row in points.tolist()]
    centroid = sum(exact, mp.zeros(3, 1)) / len(exact)
    scatter = mp.zeros(3, 3)
    for p in exact:
        scatter += (p - centroid) * (p - centroid).T
    values, vectors = mp.eigsy(scatter)
    direction = vectors[:, 2]
    if ((exact[-1] - exact[0]).T * direction)[0] < 0:
        direction = -direction
    across = [(p - centroid) - direction * ((p - centroid).T * direction)[0] for p in exact]
    rms = mp.sqrt(sum(mp.norm(r) ** 2 for r in across) / len(exact))
    return {"centroid": list(centroid), "direction": list(direction), "rms": [rms], "values": list(values)[::-1]}


def high_low(value: mp.mpf) -> tuple[float, float]:
    high = float(value)
    return high, float(value - mp.mpf(high))


def main() -> None:
    with (HERE / "points.csv").open("w", newline="") as points, (HERE / "lines.csv").open("w", newline="") as lines:
        point_writer = csv.writer(points, lineterminator="\n")
        line_writer = csv.writer(lines, lineterminator="\n")
        point_writer.writerow(["line", "x", "y", "z"])
        columns = [f"{what}_{axis}_{part}" for what in "cv" for axis in "xyz" for part in ("high", "low")]
        line_writer.writerow(["kind", *columns, "rms", "gap"])
        for index, (kind, cloud) in enumerate(clouds()):
            for row in cloud.tolist():
                point_writer.writerow([index, *map(repr, row)])
            found = fit(cloud)
            numbers = [part for x in (*found["centroid"], *found["direction"]) for part in high_low(x)]
            largest, second, _ = found["values"]
            numbers += [found["rms"][0], (largest - second) / largest]
            line_writer.writerow([kind, *(repr(float(x)) for x in numbers)])


if __name__ == "__main__":
    main()
