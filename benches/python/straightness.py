"""Straightness from angles, integrated and freed of its line, through NumPy arrays, beside its peers."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Literal

import numpy as np
import numpy.typing as npt
from fused_loops import integrate_loop
from race import Costs, Reached, best_peer, race, rate, table
from scipy.integrate import cumulative_simpson, cumulative_trapezoid
from scipy.signal import detrend

from geoerr.geometry import integrate_straightness, remove_line

Array = npt.NDArray[np.float64]

MAIN_SIZE, N_POSITIONS = 10_000, 50
OURS: dict[str, Literal["trapezoid", "simpson"]] = {
    "geoerr, trapezoid": "trapezoid",
    "geoerr, Simpson": "simpson",
}
AIM_M_PER_S = {"geoerr, trapezoid": 700.0, "geoerr, Simpson": 300.0}
IN_THE_WAY = (
    "A weighted sum of the angles gives the slope before anything is integrated; then come each interval's integral "
    "and the running sum of eight functions side by side, which is half of the time: a number is read, added and "
    "written. In the cache alone all three take as long as reading and writing the memory, of which the limit is."
)
LENGTH_MM = 400.0
WAVES_MM = np.array([800.0, 310.0, 170.0])


def positions() -> Array:
    """Positions of uneven spacing: each somewhere in the middle six tenths of its share."""
    share = np.random.default_rng(5).uniform(0.2, 0.8, N_POSITIONS)
    at = (np.arange(N_POSITIONS) + share) / N_POSITIONS * LENGTH_MM
    at[[0, -1]] = 0.0, LENGTH_MM
    return at


def angles(n_functions: int, at: Array) -> tuple[Array, Array]:
    """Angles of three waves each, rad, and their exact integrals, mm."""
    rng = np.random.default_rng(n_functions)
    size, phase = rng.normal(0.0, 10e-6, (2, n_functions, 3))
    phase *= 1e5
    k = 2.0 * np.pi / WAVES_MM
    turn = k * at[:, None, None] + phase
    values, integrals = np.sum(size * np.sin(turn), axis=2), np.sum(-size / k * np.cos(turn), axis=2)
    # Function after function, as they would be measured: transposed, each path would first be put in order.
    return np.ascontiguousarray(values.T), np.ascontiguousarray(integrals.T)


def slope_weights(at: Array) -> Array:
    """Weights of the values in the slope of the least-squares line of a piecewise-linear function over its range."""
    length = at[-1] - at[0]
    step = np.diff(at) / length
    centre = (0.5 * (at[1:] + at[:-1]) - 0.5 * (at[0] + at[-1])) / length
    weights = np.zeros_like(at)
    weights[:-1] += step * (6.0 * centre - step) / length
    weights[1:] += step * (6.0 * centre + step) / length
    return weights


def by_scipy_trapezoid(at: Array, values: Array) -> Array:
    """Integrate and detrend with SciPy, whose line counts samples and not millimetres."""
    return np.asarray(detrend(cumulative_trapezoid(values, at, axis=1, initial=0.0), axis=1))


def by_scipy_simpson(at: Array, values: Array) -> Array:
    """Integrate by parabolas and detrend with SciPy."""
    return np.asarray(detrend(cumulative_simpson(values, x=at, axis=1, initial=0.0), axis=1))


# SciPy's integrals before its line is taken off.
_INTEGRALS: dict[str, Callable[[Array, Array], object]] = {
    "SciPy cumulative_trapezoid, detrend": lambda at, values: cumulative_trapezoid(values, at, axis=1, initial=0.0),
    "SciPy cumulative_simpson, detrend": lambda at, values: cumulative_simpson(values, x=at, axis=1, initial=0.0),
}


def measure(sizes: tuple[int, ...], seconds: float) -> tuple[str, Costs, list[Reached]]:
    """Give the text of the results, the costs against size, and rows for the summary."""
    costs = Costs(f"straightness of {N_POSITIONS} positions", "sample")
    at = positions()
    weights = slope_weights(at)
    at_main: dict[str, float] = {}
    errors: dict[str, float] = {}
    by_one_line: dict[str, float] = {}
    for n_functions in sizes:
        values, integral = angles(n_functions, at)
        source, target = np.ones(values.size), np.empty(values.size)
        paths: dict[str, Callable[[], object]] = {
            name: partial(integrate_straightness, at, values, rule) for name, rule in OURS.items()
        }
        paths |= {
            "SciPy cumulative_trapezoid, detrend": partial(by_scipy_trapezoid, at, values),
            "SciPy cumulative_simpson, detrend": partial(by_scipy_simpson, at, values),
            "limit: samples copied": partial(np.copyto, target, source),
        }
        if integrate_loop is not None:
            paths["Numba, one loop, trapezoid"] = partial(integrate_loop, at, values, weights)
        found = race(paths, seconds)
        costs.add(values.size, found)
        if n_functions == MAIN_SIZE:
            at_main = found
            # Each path takes off its own line; so does its truth.
            over_range = remove_line(at, integral)
            for name, work in paths.items():
                result = work()
                if isinstance(result, np.ndarray):
                    truth = detrend(integral, axis=1) if "SciPy" in name else over_range
                    errors[name] = float(1e6 * np.sqrt(np.mean((result - truth) ** 2)))
                if "SciPy" in name:
                    # Of the same line over millimetres, whatever line was taken off before.
                    off = remove_line(at, np.asarray(_INTEGRALS[name](at, values))) - over_range
                    by_one_line[name] = float(1e6 * np.sqrt(np.mean(off**2)))
    n_samples = MAIN_SIZE * N_POSITIONS
    limit = at_main["limit: samples copied"]
    body = [
        [
            name,
            rate(n_samples, value),
            f"{value / at_main['geoerr, trapezoid']:.2f}",
            f"{limit / value:.0%}",
            f"{errors[name]:.3f}" if name in errors else "",
        ]
        for name, value in sorted(at_main.items(), key=lambda item: item[1])
    ]
    heads = ["path", "M samples/s", "time, geoerr's trapezoid = 1", "of the limit", "rms error, nm"]
    summary = []
    for path, rule in OURS.items():
        best = best_peer({name: value for name, value in at_main.items() if rule in name})
        reached = n_samples / at_main[path] / 1e6
        summary.append(
            Reached(
                path=f"straightness, {path.removeprefix('geoerr, ')}",
                reached=f"{reached:.0f} M samples/s",
                aim=f"{AIM_M_PER_S[path]:.0f}",
                share_of_aim=reached / AIM_M_PER_S[path],
                accuracy=f"{errors[path]:.2g} nm rms; {best} {errors[best]:.2g}",
                peer=f"{best}: {rate(n_samples, at_main[best])}",
                times_peer=at_main[best] / at_main[path],
                share_of_limit=limit / at_main[path],
                in_the_way=IN_THE_WAY,
            )
        )
    note = f"{MAIN_SIZE:,} functions at {N_POSITIONS} uneven positions; three waves each, of 10 µrad.\n\n"
    by_trapezoid, by_simpson = by_one_line.values()
    about_lines = (
        "\nEach path is held against the truth less its own line. SciPy's counts samples and not millimetres, and "
        "takes more of the rule's error with it; with geoerr's line SciPy's integrals are off by "
        f"{by_trapezoid:.3f} and {by_simpson:.3f} nm, as geoerr's are.\n"
    )
    return note + table(heads, body) + about_lines, costs, summary
