"""Timing side by side, and tables: what the other files of this folder share."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial

import numpy as np

LEAST_SAMPLE_S = 10e-3
LEAST_ROUNDS, MOST_ROUNDS = 5, 101


def race(paths: Mapping[str, Callable[[], object]], seconds: float) -> dict[str, float]:
    """Give the median processor seconds of a call of each path.

    Every path runs once in a round, so that what else the machine does meets all of them alike; short calls are made
    several times a sample, and as often before it uncounted: caches and memory are what the path itself leaves, which
    takes several calls where what ran before went through more than the caches hold.
    `seconds` is how long the rounds of one path may take, five of them at least.
    """
    n_calls = {}
    for name, work in paths.items():
        work()
        begin = time.perf_counter()
        work()
        n_calls[name] = max(1, round(LEAST_SAMPLE_S / max(time.perf_counter() - begin, 1e-7)))
    samples: dict[str, list[float]] = {name: [] for name in paths}
    begin = time.perf_counter()
    for n_rounds in range(1, MOST_ROUNDS + 1):
        for name, work in paths.items():
            for _ in range(n_calls[name]):
                work()
            start = time.process_time()
            for _ in range(n_calls[name]):
                work()
            samples[name].append((time.process_time() - start) / n_calls[name])
        if n_rounds >= LEAST_ROUNDS and time.perf_counter() - begin > seconds * len(paths):
            break
    return {name: statistics.median(values) for name, values in samples.items()}


def best_peer(seconds: Mapping[str, float]) -> str:
    """Name the fastest path that is neither geoerr's nor a limit."""
    return min((name for name in seconds if not name.startswith(("geoerr", "limit"))), key=lambda name: seconds[name])


@dataclass
class Costs:
    """Processor nanoseconds an item against the number of items, for each path; of one kind of work."""

    title: str
    item: str
    nanoseconds: dict[str, dict[int, float]] = field(default_factory=dict)

    def add(self, n_items: int, seconds: Mapping[str, float]) -> None:
        """Keep one race."""
        for name, value in seconds.items():
            self.nanoseconds.setdefault(name, {})[n_items] = 1e9 * value / n_items


def seconds_of_products(flop: float) -> float:
    """Give how long NumPy takes, on one thread, for matrix products of so many operations in single precision."""
    size = 1024
    one = np.ones((size, size), dtype=np.float32)
    return flop / (2.0 * size**3) * race({"limit": partial(np.matmul, one, one)}, 1.0)["limit"]


@dataclass(frozen=True)
class Reached:
    """One row of the summary: what was aimed at, what was reached, and why not more."""

    path: str
    reached: str
    aim: str
    share_of_aim: float
    accuracy: str
    peer: str = ""
    times_peer: float | None = None
    share_of_limit: float | None = None
    in_the_way: str = ""


def rate(n_items: int, seconds: float) -> str:
    """Items a second in millions, to three digits."""
    value = n_items / seconds / 1e6
    return f"{value:.0f}" if value >= 100.0 else f"{value:.3g}"


def table(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Lay a table out in Markdown."""
    lines = [heads, ["---"] * len(heads), *rows]
    return "".join(f"| {' | '.join(cells)} |\n" for cells in lines)
