"""Of what does a comparison say that sizes follow it: nothing but noise, and noise that grows with something.

    python validation/spread_trends.py > validation/spread_trends.md

Runs of points that are scattered over the volume, with a name each or one for all, and runs along X, Y, Z by turns:
6, 12, 24 and 40 runs of 40, 20, 10 and 12 rows. A temperature is drawn for each run, rises from run to run, has three
levels, or rises slowly all the time. Noise of 2 µm from row to row, normal or of Student's t of three degrees of
freedom, and besides it offsets of runs and a drift (3 µm, a memory of 0.15 of the whole). Then the noise grows
threefold with the temperature, or with x.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from geoerr.diagnose import compare
from geoerr.machine import Machine
from geoerr.model import Model
from geoerr.observations import Observations, observations_from_columns

MODEL = Model(Machine.from_chain("wYbZXt", (400.0, 300.0, 250.0), name="a machine without errors"))
LENGTHS_MM = np.array([400.0, 300.0, 250.0])
NOISE_MM, DRIFT_MM, MEMORY = 2e-3, 3e-3, 0.15
PLANS = ((6, 40), (12, 20), (24, 10), (40, 12))
POINTS = ("scattered, runs named", "scattered, one name", "along lines")
TEMPERATURES: tuple[Callable[[np.random.Generator, int, int], np.ndarray], ...] = (
    lambda rng, n_runs, n_rows: np.repeat(rng.permutation(warming(n_runs)), n_rows),
    lambda rng, n_runs, n_rows: np.repeat(warming(n_runs), n_rows),
    lambda rng, n_runs, n_rows: np.repeat(20.0 + 10.0 * (np.arange(n_runs) * 3 // n_runs), n_rows),
    lambda rng, n_runs, n_rows: warming(n_runs * n_rows) + rng.normal(0.0, 0.05, n_runs * n_rows),
)


@dataclass(frozen=True)
class Case:
    """What is in the noise, and what it grows with."""

    offset_mm: float = 0.0
    drifts: bool = False
    heavy: bool = False
    grows_with: str = ""

    def words(self) -> str:
        """Say what is in the noise besides."""
        parts = [f"offsets of {1e3 * self.offset_mm:g} µm"] if self.offset_mm else []
        parts += ["drift"] if self.drifts else []
        parts += ["heavy tails"] if self.heavy else []
        return ", ".join(parts) or "noise from row to row alone"


NULL = (
    *(Case(), Case(3e-3), Case(8e-3), Case(3e-3, drifts=True), Case(8e-3, drifts=True)),
    *(Case(heavy=True), Case(3e-3, heavy=True), Case(8e-3, heavy=True)),
)
GROWN = tuple(Case(offset, grows_with=name) for name in ("temp", "x") for offset in (0.0, 3e-3, 8e-3))


def warming(n: int) -> np.ndarray:
    return 25.0 + 20.0 * (1.0 - np.exp(-4.0 * np.arange(n) / n))


def drift(rng: np.random.Generator, n: int) -> np.ndarray:
    """Noise that is forgotten by and by, (n, 3), of standard deviation 1."""
    kept = np.exp(-1.0 / (MEMORY * n))
    found = rng.normal(size=(n, 3))
    for row in range(1, n):
        found[row] = kept * found[row - 1] + np.sqrt(1.0 - kept**2) * found[row]
    return found


def observed(
    rng: np.random.Generator, points: str, plan: tuple[int, int], temp: np.ndarray, case: Case
) -> Observations:
    n_runs, n_rows = plan
    n, run = n_runs * n_rows, np.repeat(np.arange(n_runs), n_rows)
    q_mm = rng.uniform(0.0, LENGTHS_MM, (n, 3))
    if points == "along lines":
        ends_mm = rng.uniform(0.0, LENGTHS_MM, (n_runs, 3))[run]
        moves = (run % 3)[:, None] == np.arange(3)
        along_mm = np.sort(q_mm.reshape(n_runs, n_rows, 3), axis=1).reshape(n, 3)
        q_mm = np.where(moves, along_mm, ends_mm)
    noise_mm = NOISE_MM * (rng.standard_t(3, (n, 3)) / np.sqrt(3.0) if case.heavy else rng.normal(size=(n, 3)))
    if case.grows_with:
        values = temp if case.grows_with == "temp" else q_mm[:, 0]
        noise_mm *= 1.0 + 2.0 * ((values - values.min()) / np.ptp(values))[:, None]
    noise_mm += case.offset_mm * rng.normal(size=(n_runs, 3))[run]
    if case.drifts:
        noise_mm += DRIFT_MM * drift(rng, n)
    seen_mm = MODEL.tool_from_work(q_mm) + noise_mm
    columns: dict[str, object] = dict(
        zip(("x", "y", "z", "mx", "my", "mz"), np.hstack([q_mm, seen_mm]).T, strict=True)
    )
    columns |= {"carrier": ["relative"] * n, "temp_bed": temp, "t": 5.0 * np.arange(n)}
    columns |= {name: np.full(n, NOISE_MM) for name in ("sx", "sy", "sz")}
    if points != "scattered, one name":
        columns["line"] = [f"L{number}" for number in run]
    return observations_from_columns(columns)


def told(points: str, case: Case, seeds: int) -> Iterator[set[str]]:
    """Give what the sizes of each set are told to follow."""
    for seed in range(seeds):
        for number, plan in enumerate(PLANS):
            for other, temperature in enumerate(TEMPERATURES):
                rng = np.random.default_rng([seed, number, other])
                table = observed(rng, points, plan, temperature(rng, *plan), case)
                yield {one.variable for one in compare(MODEL, table, threads=1).spread_trends if one.stands_out}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=3)
    seeds = parser.parse_args().seeds
    print(
        "# What sizes are said to follow\n\nMade by `python validation/spread_trends.py`, which says what it does.\n"
    )
    print("Nothing but noise: sets in which a size is said to follow anything, of all that is looked at.\n")
    print(f"| in the noise | {' | '.join(POINTS)} |\n| --- | --- | --- | --- |")
    alarms = np.zeros(2, dtype=int)
    for case in NULL:
        found = [list(told(points, case, seeds)) for points in POINTS]
        alarms += [sum(bool(one) for some in found for one in some), sum(map(len, found))]
        cells = " | ".join(f"{sum(map(bool, one))}/{len(one)}" for one in found)
        print(f"| {case.words()} | {cells} |", flush=True)
    print(f"\nIn all {alarms[0]}/{alarms[1]} = {100.0 * alarms[0] / alarms[1]:.1f} %.\n")
    print(
        "Noise that grows threefold with a variable: sets in which it is told (of the temperature, that or time).\n"
    )
    print(f"| grows with | besides | {' | '.join(POINTS)} |\n| --- | --- | --- | --- | --- |")
    for case in GROWN:
        right = {"temp_bed", "t"} if case.grows_with == "temp" else {"x"}
        found = [list(told(points, case, seeds)) for points in POINTS]
        cells = " | ".join(f"{sum(bool(one & right) for one in some)}/{len(some)}" for some in found)
        print(f"| {case.grows_with} | {case.words()} | {cells} |", flush=True)


if __name__ == "__main__":
    main()
