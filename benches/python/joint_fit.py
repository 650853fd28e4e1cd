"""The joint fit of points all over a volume by 21 spline functions: seconds, and what ten times the points cost.

    python benches/python/joint_fit.py [--points 1000 10000 100000] [--peer-up-to 10000] [--threads 0]

A point is one measured place: three numbers, a 3 × 3 covariance. Positions are drawn from 41 in each axis, targets
from three on the tool, and are seen in one frame of unknown pose; the functions are cubic splines (`--breakpoints`),
with bases given, or with the bases chosen by the data. The median of three runs counts, wall and processor seconds:
the latter where others use the machine too. A run is `fit_terms`: from the table to coefficients, covariance and what
is not determined; held-out figures are made when they are asked for, and are timed apart.

The peer is `scipy.optimize.least_squares` on the same whitened residuals with the same columns as its Jacobian, the
gauge put in as a basis of the coefficients that keep it. It gives no rank, no covariance and no outliers, and is
spared the reading of the table. Accuracy: the largest difference of a coefficient, in standard errors (Gauss-Newton
stops at corrections of 1e-4, by columns that are first order).
"""

from __future__ import annotations

import argparse
import statistics
import time
from collections.abc import Callable
from functools import partial
from typing import TypeVar

import numpy as np
import numpy.typing as npt
from scipy.linalg import null_space
from scipy.optimize import least_squares

from geoerr import _core
from geoerr.error_functions import LINEAR_AND_ANGULAR
from geoerr.fit import FitOptions, Fitted, fit_terms
from geoerr.fit.classic import gauge_rows
from geoerr.fit.held_out import folds_of
from geoerr.machine import AXES, Axis, Machine
from geoerr.observations import CARRIERS, Observations, observations_from_columns
from geoerr.terms import BasisSpec

Array = npt.NDArray[np.float64]
Result = TypeVar("Result")

LENGTH_MM = 400.0
N_POSITIONS = 41
STD_MM = 3e-3
OFFSETS_MM = np.array([[0.0, 0.0, 0.0], [150.0, 0.0, 80.0], [0.0, 150.0, -60.0]])


def measured(
    machine: Machine, n_points: int, rng: np.random.Generator, n_sessions: int = 1, n_targets: int = 3
) -> Observations:
    """Measure points of a machine whose errors are waves that no spline holds exactly: 30 µm, 60 µrad.

    Sessions have as many points each, in a pose of their own.
    """
    q = rng.integers(0, N_POSITIONS, (n_points, 3)) * LENGTH_MM / (N_POSITIONS - 1)
    offset = OFFSETS_MM[rng.integers(0, n_targets, n_points)]
    channels = np.zeros((n_points, 30))
    for number, name in enumerate(LINEAR_AND_ANGULAR):
        u = q[:, AXES.index(name[2].lower())] / LENGTH_MM
        size = 0.03 if name[1] in "XYZ" else 60e-6
        channels[:, number] = size * (np.sin(2.0 + number + 3.0 * u) - np.sin(2.0 + number))
    channels[:, 18:21] = [300e-6, -200e-6, 100e-6]
    carrier = np.full(n_points, CARRIERS.index("relative"), dtype=np.uint8)
    place = _core.chain_positions(machine.chain, "position", carrier, q, offset, machine.tool_offset_mm, channels, 0)
    session = np.arange(n_points) * n_sessions // n_points
    turn, _ = np.linalg.qr(rng.normal(size=(n_sessions, 3, 3)))
    turn[:, :, 0] *= np.linalg.det(turn)[:, None]
    seen = np.einsum("nij,nj->ni", turn[session], place)
    seen += [100.0, -50.0, 700.0] + STD_MM * rng.normal(size=place.shape)
    columns: dict[str, Array | list[str]] = {"carrier": ["relative"] * n_points}
    if n_sessions > 1:
        columns["session"] = [str(number) for number in session]
    for axis, name in enumerate("xyz"):
        columns |= {name: q[:, axis], f"t{name}": offset[:, axis], f"m{name}": seen[:, axis]}
        columns[f"s{name}"] = np.full(n_points, STD_MM)
    return observations_from_columns(columns)


def timed(work: Callable[[], Result], repeats: int) -> tuple[Result, tuple[float, float]]:
    """Give the last result, and the medians of wall and processor seconds."""
    wall, processor = [], []
    for _ in range(repeats):
        starts = time.perf_counter(), time.process_time()
        result = work()
        wall.append(time.perf_counter() - starts[0])
        processor.append(time.process_time() - starts[1])
    return result, (statistics.median(wall), statistics.median(processor))


def by_scipy(fitted: Fitted) -> Array:
    """Solve the same problem with SciPy; gives the coefficients."""
    problem, sightings = fitted.problem, fitted.sightings
    rows = gauge_rows(fitted.terms)
    gauge = np.zeros((len(rows), problem.n_columns))
    gauge[:, : rows.shape[1]] = rows
    # What does nothing but rounding the fit holds at 0.
    held = np.flatnonzero(~fitted.solved.solution.covariance_root.any(axis=1))
    free = null_space(np.vstack([gauge, np.eye(problem.n_columns)[held]]))
    scale = np.ones(len(sightings))
    # Unknowns of like size, as the covariance has them: SciPy's steps and tolerances know no units.
    free /= np.linalg.norm(problem.design(problem.start, scale, 0, len(sightings), 0) @ free, axis=0)

    def residuals(x: Array) -> Array:
        state = problem.corrected(problem.start, free @ x)
        return np.asarray(problem.whitened(problem.residuals(state, 0)).ravel())

    def jacobian(x: Array) -> Array:
        state = problem.corrected(problem.start, free @ x)
        return np.asarray(-problem.design(state, scale, 0, len(sightings), 0) @ free)

    found = least_squares(residuals, np.zeros(free.shape[1]), jac=jacobian, xtol=1e-12, ftol=1e-12, gtol=1e-12)
    return np.asarray(problem.corrected(problem.start, free @ found.x).coefficients)


def difference(fitted: Fitted, coefficients: Array) -> float:
    """Give the largest difference from other coefficients, in standard errors, where there is one."""
    std = np.sqrt(np.diag(fitted.covariance)[: len(coefficients)])
    off = np.abs(fitted.solved.state.coefficients - coefficients)
    return float(np.max(off[std > 0.0] / std[std > 0.0]))


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--points", type=int, nargs="+", default=[1000, 10_000, 100_000])
    parser.add_argument("--peer-up-to", type=int, default=10_000)
    parser.add_argument("--breakpoints", type=int, default=6)
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--threads", type=int, default=0)
    arguments = parser.parse_args()
    machine = Machine("bench", "wZbXYt", {axis: Axis((0.0, LENGTH_MM)) for axis in AXES})
    knots = tuple(np.linspace(0.0, LENGTH_MM, arguments.breakpoints).tolist())
    bases = {name: BasisSpec("bspline", name[2].lower(), knots_mm=knots, degree=3) for name in LINEAR_AND_ANGULAR}
    given = FitOptions(bases=bases, threads=arguments.threads)
    chosen = FitOptions(threads=arguments.threads)
    print("| points | path | unknowns | wall s | CPU s | CPU per point, first = 1 | difference, std |")
    print("| --- | --- | --- | --- | --- | --- | --- |")
    first: dict[str, float] = {}

    def line(n_points: int, path: str, n_unknowns: int, seconds: tuple[float, float], off: str = "") -> None:
        wall, cpu = seconds
        per_point = cpu / n_points / first.setdefault(path, cpu / n_points)
        row = f"| {n_points} | {path} | {n_unknowns} | {wall:.3f} | {cpu:.3f} | {per_point:.2f} | {off} |"
        print(row, flush=True)

    for n_points in arguments.points:
        table = measured(machine, n_points, np.random.default_rng(n_points))
        for path, options in (("bases chosen", chosen), ("bases given", given)):
            fitted, seconds = timed(partial(fit_terms, machine, [table], options=options), arguments.repeats)
            line(n_points, path, fitted.problem.n_columns, seconds)
        _, seconds = timed(partial(fitted.leave_out, folds_of(fitted.sightings)), 1)
        line(n_points, "held out, when asked for", fitted.problem.n_columns, seconds)
        if n_points <= arguments.peer_up_to:
            coefficients, seconds = timed(partial(by_scipy, fitted), 1)
            off = f"{difference(fitted, coefficients):.0e}"
            line(n_points, "scipy, bases given", fitted.problem.n_columns, seconds, off)


if __name__ == "__main__":
    main()
