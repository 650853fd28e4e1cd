"""Least squares end to end through NumPy, beside its peers: seconds, ratio, accuracy.

    python benches/python/least_squares.py [--threads N] [--rows 30000] [--columns 300]

Peers that are not installed are left out. Every path runs in the same process on the same arrays; the best of several
runs counts. Accuracy: distance of the scaled unknowns from a solution refined with residuals in extended precision,
relative.
"""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Callable

parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
parser.add_argument("--threads", type=int, default=1)
parser.add_argument("--rows", type=int, default=30_000)
parser.add_argument("--columns", type=int, default=300)
parser.add_argument("--repeats", type=int, default=5)
parser.add_argument("--without-slow", action="store_true", help="leave scipy.optimize.least_squares out")
arguments = parser.parse_args()
for variable in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[variable] = str(arguments.threads)

import numpy as np  # noqa: E402  (the numbers of threads are read when NumPy is loaded)
import numpy.typing as npt  # noqa: E402

from geoerr._core import LeastSquares, solve_least_squares  # noqa: E402

Array = npt.NDArray[np.float64]


def random_design(rng: np.random.Generator, n_rows: int, n_columns: int) -> Array:
    """No zeros at all: the case that a dense library is made for."""
    return rng.standard_normal((n_rows, n_columns))


def spline_design(rng: np.random.Generator, n_rows: int, n_columns: int) -> Array:
    """Nine lines of three components: 21 functions of cubic splines, four of each function's columns in a row."""
    n_functions = 21
    each = n_columns // n_functions
    a = np.zeros((n_rows, n_columns))
    line = np.arange(n_rows) * 9 // n_rows
    at = np.arange(n_rows)
    for function in range(n_functions):
        moves = line % 3 == function % 3
        q = np.where(moves, (at * 9 / n_rows) % 1.0, 0.5) * (each - 3)
        first = np.minimum(q.astype(int), each - 4)
        u = q - first
        weights = [(1 - u) ** 3, 3 * u**3 - 6 * u**2 + 4, -3 * u**3 + 3 * u**2 + 3 * u + 1, u**3]
        lever = rng.uniform(-1.0, 1.0, n_rows)
        for k, weight in enumerate(weights):
            a[at, function * each + first + k] = weight / 6.0 * lever
    for column in range(n_functions * each, n_columns):
        a[:, column] = rng.standard_normal(n_rows)
    return a


def best(work: Callable[[], object], repeats: int) -> tuple[float, float]:
    """Wall and processor seconds of the fastest run: the latter count where others use the machine too."""
    wall, processor = [], []
    for _ in range(repeats):
        starts = time.perf_counter(), time.process_time()
        work()
        wall.append(time.perf_counter() - starts[0])
        processor.append(time.process_time() - starts[1])
    return min(wall), min(processor)


def ours(a: Array, b: Array, method: str) -> LeastSquares:
    """Solve through the compiled core."""
    return solve_least_squares(
        a,
        b,
        constraints=None,
        basis=None,
        rank_tolerance=None,
        wants_singular_values=False,
        method=method,
        threads=arguments.threads,
    )


def with_covariance(solution: LeastSquares) -> Array:
    """Ask for the covariance too, and give the unknowns."""
    solution.covariance()
    return solution.x[:, 0]


def refined(a: Array, b: Array) -> Array:
    """QR with two steps of refinement, residuals and products in extended precision."""
    q, r = np.linalg.qr(a)
    x = np.linalg.solve(r, q.T @ b).astype(np.longdouble)
    for _ in range(2):
        gradient = np.zeros(a.shape[1], dtype=np.longdouble)
        for rows in np.array_split(np.arange(len(a)), 60):
            block = a[rows].astype(np.longdouble)
            gradient += block.T @ (b[rows] - block @ x)
        x += np.linalg.solve(r, np.linalg.solve(r.T, gradient.astype(np.float64)))
    return x.astype(np.float64)


def peers(a: Array, b: Array) -> dict[str, tuple[Callable[[], Array], int]]:
    """Every path that is installed, with the number of its runs."""
    paths: dict[str, tuple[Callable[[], Array], int]] = {
        "geoerr, QR": (lambda: ours(a, b[:, None], "qr").x[:, 0], arguments.repeats),
        "geoerr, QR, with covariance": (
            lambda: with_covariance(ours(a, b[:, None], "qr")),
            arguments.repeats,
        ),
        "geoerr, fastest": (lambda: ours(a, b[:, None], "fastest").x[:, 0], arguments.repeats),
        "numpy lstsq": (lambda: np.asarray(np.linalg.lstsq(a, b, rcond=None)[0]), arguments.repeats),
        "numpy normal equations": (
            lambda: np.asarray(np.linalg.solve(a.T @ a, a.T @ b)),
            arguments.repeats,
        ),
    }
    try:
        from scipy.linalg import lstsq
        from scipy.optimize import least_squares
    except ImportError:
        return paths
    paths["scipy lstsq, gelsy"] = (
        lambda: lstsq(a, b, lapack_driver="gelsy", check_finite=False)[0],
        arguments.repeats,
    )
    if not arguments.without_slow:
        start = np.zeros(a.shape[1])
        paths["scipy least_squares, exact Jacobian"] = (
            lambda: least_squares(lambda x: a @ x - b, start, jac=lambda x: a).x,
            1,
        )
    return paths


def main() -> None:
    """Print one table for each design."""
    rng = np.random.default_rng(0)
    m, n = arguments.rows, arguments.columns
    square = rng.standard_normal((1000, 1000))
    dgemm = 2.0 / best(lambda: square @ square, 10)[1]
    print(f"{m} × {n}, {arguments.threads} thread(s), NumPy {np.__version__}; dgemm {dgemm:.0f} GFLOP/s of CPU")
    for name, design in (("random", random_design), ("splines on nine lines", spline_design)):
        a = design(rng, m, n)
        b = a @ rng.standard_normal(n) + 0.1 * rng.standard_normal(m)
        sizes = np.linalg.norm(a, axis=0)
        reference = refined(a, b)
        rows = []
        for path, (work, repeats) in peers(a, b).items():
            error = np.linalg.norm((work() - reference) * sizes) / np.linalg.norm(reference * sizes)
            rows.append((path, *best(work, repeats), error))
        lstsq = next(seconds for path, _, seconds, _ in rows if path == "numpy lstsq")
        condition = ours(a, b[:, None], "qr").condition
        print(f"\n{name}, condition {condition:.1e}\n")
        print("| path | wall s | CPU s | CPU, numpy lstsq / path | QR operations / CPU s, GFLOP/s | error |")
        print("| --- | --- | --- | --- | --- | --- |")
        for path, wall, seconds, error in rows:
            rate = (2.0 * m * n**2 - 2.0 / 3.0 * n**3) / seconds / 1e9
            print(f"| {path} | {wall:.4f} | {seconds:.4f} | {lstsq / seconds:.2f} | {rate:.1f} | {error:.0e} |")


if __name__ == "__main__":
    main()
